//! Tests that a part of a model that cannot be composed is left out and reported, without an effect
//! on other parts.

use expect_test::{Expect, expect};

use crate::office::{model, office, turtlebot};

/// Admits models of the agents `a`, `b`, …, each with one of these sections; then checks the
/// conflicts and the actions.
#[track_caller]
fn check<const N: usize>(sections: [&str; N], expected: Expect) {
    let names = ["a", "b", "c"];
    let models = names.iter().zip(sections).map(|(name, sections)| model(name, sections));
    let office = office().with(models);
    expected.assert_eq(&format!("{}actions: {}\n", office.conflicts(), office.actions()));
}

#[test]
fn the_ontology_takes_precedence() {
    check(
        ["(:types room - sensor) (:predicates (at ?b - mobile-base))
          (:objects corridor - room a - sensor)
          (:action wait :agent ?a - sensor :parameters (?b - mobile-base) :effect (at ?b))
          (:action look :agent ?a - sensor :parameters (?r - room)
            :effect (known-temperature ?r))"],
        expect![[r#"
            type `room` of `a`: the ontology declares `room - location`, which is used; `room - sensor` is left out
            predicate `at` of `a`: the ontology declares `(at ?b - mobile-base ?l - location)`, which is used; `(at ?b - mobile-base)` is left out
            object `corridor` of `a`: the map declares `corridor - location`, which is used; `corridor - room` is left out
            action `wait` of `a`: it uses the predicate `at` with 1 of its 2 arguments
            actions: look
        "#]],
    );
}

#[test]
fn a_conflict_of_two_agents_names_both() {
    check(
        [
            "(:objects a - sensor) (:predicates (lit ?r - room))
             (:action light :agent ?a - sensor :parameters (?r - room) :effect (lit ?r))",
            "(:objects b - sensor) (:predicates (lit ?r ?s - room))
             (:action glow :agent ?a - sensor :parameters (?r - room) :effect (lit ?r ?r))
             (:action look :agent ?a - sensor :parameters (?r - room)
               :effect (known-temperature ?r))",
        ],
        expect![[r#"
            predicate `lit` of `a` and `b`: `a` declares `(lit ?r - room)`, which is used; `(lit ?r ?s - room)` of `b` is left out
            action `glow` of `b`: it uses the predicate `lit`, which another agent declares differently
            actions: light look
        "#]],
    );
}

#[test]
fn the_first_declaration_keeps_precedence_after_a_model_change() {
    let mut office = office()
        .with([model("b", "(:predicates (lit ?r - room))"), model("a", "(:predicates (lit))")]);
    let admission = office.admit(&model("b", "(:predicates (lit ?r - room) (dark))"));
    assert_eq!(admission.conflicts, []);
    expect![[r#"
        predicate `lit` of `b` and `a`: `b` declares `(lit ?r - room)`, which is used; `(lit)` of `a` is left out
    "#]].assert_eq(&office.conflicts());
    // The agent with the declaration in force has left, so the other declaration comes into force.
    office.remove("b");
    assert_eq!(office.conflicts(), "");
    // The declaration of `a` stays in force when `b` returns.
    office.admit(&model("b", "(:predicates (lit ?r - room))"));
    expect![[r#"
        predicate `lit` of `a` and `b`: `a` declares `(lit)`, which is used; `(lit ?r - room)` of `b` is left out
    "#]].assert_eq(&office.conflicts());
}

#[test]
fn an_action_without_an_agent_is_left_out() {
    check(
        ["(:objects a - sensor)
          (:action think :effect (known-temperature office2))
          (:durative-action sleep :agent ?a - sensor :parameters () :duration (= ?duration 1)
            :condition (and) :effect (and))"],
        expect![[r#"
            action `sleep` of `a`: no planner here uses durative actions yet; describe it as an `:action`
            action `think` of `a`: it has no acting agent; write `:agent ?a - TYPE` before its parameters
            actions: 
        "#]],
    );
}

#[test]
fn the_acting_agent_must_be_an_object_of_the_right_type() {
    check(
        [
            "(:action think :agent ?a - sensor :effect (known-temperature office2))",
            "(:objects b - mobile-base)
             (:action think :agent ?a - sensor :effect (known-temperature office2))",
        ],
        expect![[r#"
            action `think` of `a`: `a` is no object; write `(:objects a - sensor)`
            action `think` of `b`: its agent is a `sensor`, and `b` is a `mobile-base`
            actions: 
        "#]],
    );
}

#[test]
fn types_cannot_form_a_cycle() {
    check(
        ["(:types x - y z - x)", "(:types y - x)"],
        expect![[r#"
        type `x` of `a`: `x - y` makes the type its own supertype
        type `y` of `b`: `y - x` makes the type its own supertype
        actions: 
    "#]],
    );
}

#[test]
fn an_object_of_two_types_has_the_first() {
    check(
        ["(:objects thing - room)", "(:objects thing - sensor)"],
        expect![[r#"
        object `thing` of `a` and `b`: `a` declares `thing - room`, which is used; `thing - sensor` of `b` is left out
        actions: 
    "#]],
    );
}

#[test]
fn undeclared_names_cannot_be_used() {
    check(
        ["(:objects a - sensor box - crate) (:predicates (in ?x - crate ?y - bag))
          (:action fly :agent ?a - sensor :effect (flown ?a))
          (:action pay :agent ?a - sensor :effect (increase (money) 1))
          (:action call :agent ?a - sensor :effect (at phone office2))
          (:action lose :agent ?a - sensor :effect (known-temperature ?r))"],
        expect![[r#"
            predicate `in` of `a`: it uses the type `crate`, which is not declared
            object `box` of `a`: it uses the type `crate`, which is not declared
            action `call` of `a`: it names the object `phone`, which is not here
            action `fly` of `a`: it uses the predicate `flown`, which is not declared
            action `lose` of `a`: it uses the variable `?r`, which nothing binds
            action `pay` of `a`: it uses the function `money`, which is not declared
            actions: 
        "#]],
    );
}

#[test]
fn only_the_declaring_model_may_derive_a_predicate() {
    check(
        [
            "(:derived (known-temperature ?r - room) (connected ?r ?r))",
            "(:objects b - sensor) (:predicates (far ?r - room))
             (:derived (far ?r - room) (connected ?r ?r))
             (:action drift :agent ?a - sensor :parameters (?r - room) :effect (far ?r))",
        ],
        expect![[r#"
            axiom for `known-temperature` of `a`: the model does not declare the predicate, and only a model that declares it may derive it
            action `drift` of `b`: it changes `far`, which axioms derive
            actions: 
        "#]],
    );
}

#[test]
fn a_conflict_is_reported_once() {
    let mut office = office().with([model("a", "(:predicates (lit ?r - room))")]);
    let clash = model("b", "(:predicates (lit))");
    let admission = office.admit(&clash);
    assert_eq!(admission.conflicts, office.maintainer.conflicts());
    assert_eq!(admission.conflicts.len(), 1);
    assert_eq!(office.admit(&turtlebot("turtlebot-1")).conflicts, []);
}
