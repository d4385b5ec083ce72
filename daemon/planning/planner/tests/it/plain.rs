//! Explanations of unsolvable problems in plain PDDL (without agents). Every statement in them must
//! be true.

use planner::Cancel;
use planner::explain::why_unsolvable;

use crate::support::{self, domain, parse, problem};

/// Returns the explanation of a problem that has no plan.
#[track_caller]
fn why(domain_parts: &str, problem_parts: &str) -> String {
    let (domain, problem) = (domain(domain_parts), problem(problem_parts));
    let outcome = support::outcome(&domain, &problem).expect("it plans");
    assert!(outcome.plan.is_none(), "{outcome:?}");
    let (domain, problem) = parse(&domain, &problem);
    why_unsolvable(&domain, &problem, 1 << 30, &Cancel::new()).expect("it is told").to_string()
}

#[test]
fn a_type_without_objects_is_named() {
    let lift = "(:types box crane) (:predicates (up ?b - box) (free ?c - crane) (seen))
        (:action lift :parameters (?c - crane ?b - box) :precondition (free ?c) :effect (up ?b))";
    let told = why(lift, "(:objects b - box) (:init) (:goal (up b))");
    assert!(told.contains("there is no object of type `crane` for its `?c`"), "{told}");
    let free = lift.replace(":precondition (free ?c)", "");
    let told = why(&free, "(:objects b - box) (:init) (:goal (up b))");
    assert!(told.contains("there is no object of type `crane` for its `?c`"), "{told}");
    assert!(!told.contains("together"), "{told}");
    let axiom = "(:types box crane) (:predicates (seen ?b - box) (near ?b - box))
        (:derived (seen ?b - box) (near ?b))
        (:action look :parameters (?c - crane ?b - box) :effect (near ?b))";
    let told = why(axiom, "(:objects b - box) (:init) (:goal (seen b))");
    assert!(told.contains("there is no object of type `crane` for its `?c`"), "{told}");
}

#[test]
fn conditions_that_never_hold_together_are_reported() {
    let told = why(
        "(:predicates (left ?x) (right ?x) (g))
         (:action go :parameters (?x) :precondition (and (left ?x) (right ?x)) :effect (g))",
        "(:objects a b) (:init (left a) (right b)) (:goal (g))",
    );
    assert!(told.contains("its conditions never hold together"), "{told}");
}

const HEATER: &str = "(:predicates (on)) (:functions (temp ?r))
    (:action heat :parameters (?r) :precondition (< (temp ?r) 18) :effect (increase (temp ?r) 1))";

#[test]
fn a_numeric_obstacle_is_not_reported_as_undone_progress() {
    let told =
        why(HEATER, "(:objects room) (:init (= (temp room) 15)) (:goal (>= (temp room) 20))");
    assert!(!told.contains("undo"), "{told}");
    let both = "(:objects room) (:init (= (temp room) 15)) (:goal (and (>= (temp room) 20) (on)))";
    let switch = HEATER.to_owned() + "(:action switch :effect (on))";
    let told = why(&switch, both);
    assert!(!told.contains("undo"), "{told}");
    let told = why(
        "(:predicates (a) (b) (c)) (:action x :precondition (c) :effect (and (a) (not (c))))
         (:action y :precondition (and (a) (c)) :effect (b))",
        "(:init (c)) (:goal (b))",
    );
    assert!(told.contains("the steps towards it undo what it needs"), "{told}");
}

#[test]
fn an_undefined_number_is_named() {
    let told = why(HEATER, "(:objects room) (:init) (:goal (>= (temp room) 17))");
    assert!(told.contains("`(temp room)` has no value, and no action assigns it one"), "{told}");
    assert!(!told.contains("undo"), "{told}");
}

#[test]
fn no_claim_is_made_about_a_goal_that_is_not_fully_examined() {
    let (domain, problem) = parse(
        &domain(
            "(:predicates (fuel) (a) (b))
             (:action one :precondition (and (fuel) (b)) :effect (and (a) (not (fuel))))",
        ),
        &problem("(:init (fuel)) (:goal (a))"),
    );
    let cancel = Cancel::new();
    cancel.set();
    let told = why_unsolvable(&domain, &problem, 1 << 30, &cancel).expect("it is told").to_string();
    assert_eq!(told, "no sequence of steps reaches all parts of the goal");
    let told = why_unsolvable(&domain, &problem, 1 << 30, &Cancel::new()).expect("it is told");
    assert!(told.to_string().contains("`(a)` cannot be reached"), "{told}");
}

#[test]
fn parts_beyond_the_examined_ones_are_not_mentioned() {
    // Each of seventy parts can be reached alone, but there is fuel for only one.
    let objects: Vec<String> = (0..70).map(|number| format!("o{number}")).collect();
    let told = why(
        "(:predicates (done ?x) (fuel))
         (:action work :parameters (?x) :precondition (fuel) :effect (and (done ?x) (not (fuel))))",
        &format!("(:objects {}) (:init (fuel)) (:goal (forall (?x) (done ?x)))", objects.join(" ")),
    );
    assert_eq!(told, "no sequence of steps reaches all parts of the goal");
}
