//! Explanations of unsolvable problems in plain PDDL (without agents). Every statement in them must
//! be true.

use expect_test::{Expect, expect};
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

/// Compares the explanation of a problem that has no plan with `expected`.
#[track_caller]
fn check(domain_parts: &str, problem_parts: &str, expected: Expect) {
    let told = why(domain_parts, problem_parts).replace("; ", ";\n") + "\n";
    expected.assert_eq(&told);
}

#[test]
fn a_negated_derived_fact_is_shown_as_the_author_wrote_it() {
    check(
        "(:predicates (p) (q) (d)) (:derived (d) (or (p) (q))) (:action x :effect (q))",
        "(:init (p)) (:goal (and (not (d))))",
        expect![[r#"
            `(not (d))` cannot be reached: it needs `(not (p))`;
            no action makes `(p)` false
        "#]],
    );
}

const FOR_TYPE: &str =
    "(:types t s) (:predicates (p ?x)) (:action a :parameters (?x - t) :effect (p ?x))";

#[test]
fn an_action_for_objects_of_another_type_is_named_with_the_type() {
    let objects = "(:objects t1 - t s1 - s)";
    let some = format!("{objects} (:goal (exists (?x - s) (p ?x)))");
    check(
        FOR_TYPE,
        &some,
        expect![[r#"
        `(exists (?x - s) (p ?x))` cannot be reached: `a` makes `(p ?x)` true, but not of objects of type `s`
    "#]],
    );
    check(
        FOR_TYPE,
        &format!("{objects} (:goal (p s1))"),
        expect![[r#"
        `(p s1)` cannot be reached: no action makes it true of these objects
    "#]],
    );
    // The action is for objects of both types, but its condition holds only of those of one.
    let both = FOR_TYPE.replace("(?x - t)", "(?x) :precondition (r ?x)");
    let both = both.replace("(:predicates", "(:predicates (r ?x)");
    check(
        &both,
        &format!("(:init (r t1)) {some}"),
        expect![[r#"
        `(exists (?x - s) (p ?x))` cannot be reached: `a` makes it true, but needs `(exists (?x - s) (r ?x))`;
        no action makes `(exists (?x - s) (r ?x))` true, and `:init` does not contain it
    "#]],
    );
}

#[test]
fn the_condition_of_a_universal_effect_is_named() {
    let effect = |variable: &str, condition: &str| {
        format!(
            "(:predicates (p ?x) (q ?x)) (:action a :parameters (?x)
               :effect (forall ({variable}) (when {condition} (p {variable}))))"
        )
    };
    let goal = "(:objects o) (:init (q o)) (:goal (p o))";
    check(
        &effect("?y", "(and (q ?y) (not (= ?x ?y)))"),
        goal,
        expect![[r#"
        `(p o)` cannot be reached: `a` makes it true, but the condition of its effect never holds: `(exists (?x) (not (= ?x o)))`
    "#]],
    );
    // Variables of one name are not told apart.
    check(
        &effect("?x", "(not (= ?x ?x))"),
        goal,
        expect![[r#"
        `(p o)` cannot be reached: `a` makes it true, but in no state that can be reached
    "#]],
    );
}

#[test]
fn the_branches_of_a_goal_are_explained() {
    let domain = "(:constants o) (:predicates (p) (q) (r) (s ?x) (u))
        (:action a :precondition (r) :effect (and (p) (s o))) (:action b :effect (u))";
    check(
        domain,
        "(:init) (:goal (or (p) (q)))",
        expect![[r#"
        `(or (p) (q))` cannot be reached: for `(p)`, `a` makes it true, but needs `(r)`;
        no action makes `(r)` true, and `:init` does not contain it;
        for `(q)`, no action makes it true, and `:init` does not contain it
    "#]],
    );
    check(
        domain,
        "(:init) (:goal (imply (not (q)) (p)))",
        expect![[r#"
        `(imply (not (q)) (p))` cannot be reached: for `(q)`, no action makes it true, and `:init` does not contain it;
        for `(p)`, `a` makes it true, but needs `(r)`;
        no action makes `(r)` true, and `:init` does not contain it
    "#]],
    );
    check(
        domain,
        "(:init) (:goal (exists (?x) (and (s ?x) (u))))",
        expect![[r#"
        `(exists (?x) (and (s ?x) (u)))` cannot be reached: it needs `(exists (?x) (s ?x))`;
        `a` makes `(exists (?x) (s ?x))` true, but needs `(r)`;
        no action makes `(r)` true, and `:init` does not contain it
    "#]],
    );
    check(
        domain,
        "(:init) (:goal (exists (?x) (or (s ?x) (q))))",
        expect![[r#"
        `(exists (?x) (or (s ?x) (q)))` cannot be reached: for `(exists (?x) (s ?x))`, `a` makes it true, but needs `(r)`;
        no action makes `(r)` true, and `:init` does not contain it;
        for `(exists (?x) (q))`, no action makes it true, and `:init` does not contain it
    "#]],
    );
    let many = "(:init) (:goal (or (and (u) (q)) (and (u) (p)) (q) (r) (p)))";
    check(
        domain,
        many,
        expect![[r#"
        `(or (and (u) (q)) (and (u) (p)) (q) (r) (p))` cannot be reached: for `(and (u) (q))`, it needs `(q)`;
        no action makes `(q)` true, and `:init` does not contain it;
        for `(and (u) (p))`, it needs `(p)`;
        `a` makes `(p)` true, but needs `(r)`;
        no action makes `(r)` true, and `:init` does not contain it;
        for `(q)`, no action makes it true, and `:init` does not contain it;
        2 more branches never hold, either
    "#]],
    );
    let nested = "(:predicates (p) (q) (r))
        (:action a :precondition (or (q) (and (r) (or (q) (r)))) :effect (p))";
    check(
        nested,
        "(:init) (:goal (p))",
        expect![[r#"
        `(p)` cannot be reached: `a` makes it true, but needs `(or (q) (and (r) (or (q) (r))))`;
        for `(q)`, no action makes it true, and `:init` does not contain it;
        for `(and (r) (or (q) (r)))`, it needs `(r)` and `(or (q) (r))`;
        no action makes `(r)` true, and `:init` does not contain it
    "#]],
    );
    check(
        nested,
        "(:init) (:goal (or (p) (q)))",
        expect![[r#"
        `(or (p) (q))` cannot be reached: for `(p)`, `a` makes it true, but needs `(or (q) (and (r) (or (q) (r))))`;
        `(or (q) (and (r) (or (q) (r))))` never holds;
        for `(q)`, no action makes it true, and `:init` does not contain it
    "#]],
    );
}

#[test]
fn a_fact_that_no_step_makes_false_is_explained() {
    let act = "(:predicates (p) (q)) (:action a :precondition (q) :effect (not (p)))";
    check(
        act,
        "(:init (p)) (:goal (not (p)))",
        expect![[r#"
        `(not (p))` cannot be reached: `a` makes it true, but needs `(q)`;
        no action makes `(q)` true, and `:init` does not contain it
    "#]],
    );
    let derived = "(:constants o) (:predicates (p ?x) (d ?x)) (:derived (d ?x) (p ?x))
        (:action a :effect (p o))";
    check(
        derived,
        "(:init (p o)) (:goal (exists (?x) (not (d ?x))))",
        expect![[r#"
        `(exists (?x) (not (d ?x)))` cannot be reached: it never holds
    "#]],
    );
}

#[test]
fn a_number_that_is_never_reached_is_named_with_its_action() {
    let domain = "(:predicates (p)) (:functions (fuel))
        (:action mv :precondition (>= (fuel) 5) :effect (p))
        (:action re :precondition (< (fuel) 3) :effect (increase (fuel) 1))";
    check(
        domain,
        "(:init (= (fuel) 0)) (:goal (p))",
        expect![[r#"
        `(p)` cannot be reached: `mv` makes it true, but needs `(>= (fuel) 5)`, which no sequence of steps reaches
    "#]],
    );
    check(
        domain,
        "(:init (= (fuel) 0)) (:goal (and (p) (>= (fuel) 1)))",
        expect![[r#"
        `(p)` cannot be reached: `mv` makes it true, but needs `(>= (fuel) 5)`, which no sequence of steps reaches
    "#]],
    );
    check(
        domain,
        "(:init) (:goal (p))",
        expect![[r#"
        `(p)` cannot be reached: `mv` makes it true, but needs `(>= (fuel) 5)`;
        `(fuel)` has no value, and no action assigns it one
    "#]],
    );
}
