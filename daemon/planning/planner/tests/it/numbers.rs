//! Numeric fluents that are part of the state.

use expect_test::{Expect, expect};

use crate::support::{self, check};

#[track_caller]
fn case(domain: &str, problem: &str, expected: Expect) {
    check(&support::domain(domain), &support::problem(problem), expected);
}

const TANK: &str =
    "(:predicates (at ?x) (road ?x ?y)) (:functions (fuel) (capacity) (length ?x ?y))
    (:action drive :parameters (?x ?y)
      :precondition (and (at ?x) (road ?x ?y) (>= (fuel) (length ?x ?y)))
      :effect (and (not (at ?x)) (at ?y) (decrease (fuel) (length ?x ?y))))
    (:action refuel :parameters (?x) :precondition (at ?x) :effect (assign (fuel) (capacity)))";

#[test]
fn fuel_is_consumed_and_refilled() {
    case(
        TANK,
        "(:objects a b c) (:init (at a) (road a b) (road b c) (= (length a b) 3) (= (length b c) 4)
           (= (fuel) 3) (= (capacity) 5))
         (:goal (and (at c) (>= (fuel) 1)))",
        expect![[r#"
            (drive a b)
            (refuel b)
            (drive b c)
            cost 3, optimal
        "#]],
    );
}

#[test]
fn a_demand_above_the_tank_capacity_is_proved_unsolvable() {
    case(
        TANK,
        "(:objects a b) (:init (at a) (road a b) (= (length a b) 9) (= (fuel) 3) (= (capacity) 5))
         (:goal (at b))",
        expect![[r#"
            proven unsolvable
        "#]],
    );
}

#[test]
fn a_value_that_no_condition_reads_may_be_assigned() {
    case(
        "(:predicates (known ?r)) (:functions (temperature ?r))
         (:action read :parameters (?r) :effect (and (known ?r) (assign (temperature ?r) 20)))",
        "(:objects lab) (:init) (:goal (known lab))",
        expect![[r#"
            (read lab)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn increasing_an_undefined_number_never_applies() {
    case(
        "(:predicates (done)) (:functions (count))
         (:action go :effect (and (done) (increase (count) 1)))",
        "(:init) (:goal (done))",
        expect![[r#"
            warning: some instances of `go` never apply: they use a function value that :init leaves out
            proven unsolvable before search
        "#]],
    );
    case(
        "(:predicates (done)) (:functions (count))
         (:action start :effect (assign (count) 0))
         (:action go :effect (and (done) (increase (count) 1)))",
        "(:init) (:goal (done))",
        expect![[r#"
            (start)
            (go)
            cost 2, optimal
        "#]],
    );
}

#[test]
fn preconditions_of_purely_numeric_actions_are_achieved_first() {
    case(
        "(:predicates (done) (ready)) (:functions (count))
         (:action prepare :effect (ready))
         (:action start :precondition (ready) :effect (assign (count) 0))
         (:action go :effect (and (done) (increase (count) 1)))",
        "(:init) (:goal (done))",
        expect![[r#"
            (prepare)
            (start)
            (go)
            cost 3, optimal
        "#]],
    );
}

#[test]
fn division_by_zero_makes_no_condition_true() {
    case(
        "(:predicates (done)) (:functions (a) (b))
         (:action set :effect (increase (b) 1))
         (:action go :precondition (> (/ (a) (b)) 1) :effect (done))",
        "(:init (= (a) 4) (= (b) 0)) (:goal (done))",
        expect![[r#"
            (set)
            (go)
            cost 2, optimal
        "#]],
    );
}

#[test]
fn static_comparisons_are_decided_while_grounding() {
    case(
        "(:predicates (in ?x)) (:functions (size ?x))
         (:action enter :parameters (?x) :precondition (< (size ?x) 10) :effect (in ?x))",
        "(:objects small large) (:init (= (size small) 5) (= (size large) 20))
         (:goal (exists (?x) (in ?x)))",
        expect![[r#"
            (enter small)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn a_state_dependent_cost_counts_and_allows_no_proof() {
    case(
        "(:predicates (q)) (:functions (total-cost) (load))
         (:action load :precondition (< (load) 2) :effect (increase (load) 1))
         (:action go :precondition (> (load) 1) :effect (and (q) (increase (total-cost) (load))))",
        "(:init (= (load) 0)) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            (load)
            (load)
            (go)
            cost 2, unproven
        "#]],
    );
}

#[test]
fn time_is_the_number_of_steps() {
    case(
        "(:predicates (p) (q)) (:functions (total-cost))
         (:action first :effect (p))
         (:action then :precondition (p) :effect (and (q) (increase (total-cost) 3)))
         (:action at-once :effect (and (q) (increase (total-cost) 6)))",
        "(:init) (:goal (q)) (:metric minimize (+ (* 2 (total-time)) (total-cost)))",
        expect![[r#"
            (first)
            (then)
            cost 7, optimal
        "#]],
    );
}

#[test]
fn values_of_undeclared_functions_are_ignored() {
    case(
        "(:predicates (q)) (:functions (load)) (:action go :effect (and (q) (increase (load) 1)))",
        "(:init (= (load) 0) (= (fuel) 7)) (:goal (and (q) (>= (load) 1)))",
        expect![[r#"
            (go)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn an_action_that_always_divides_by_zero_never_applies() {
    for effect in [
        "(scale-down (a) 0)",
        "(scale-down (a) (b))",
        "(scale-down (a) (- 1 1))",
        "(assign (a) (/ (a) 0))",
        "(increase (a) (/ 1 (b)))",
        "(when (not (done)) (scale-down (a) 0))",
    ] {
        let parts = format!(
            "(:predicates (done)) (:functions (a) (b))
             (:action bad :parameters () :effect (and (done) {effect}))"
        );
        let problem = support::problem("(:init (= (a) 1) (= (b) 0)) (:goal (done))");
        let outcome = support::outcome(&support::domain(&parts), &problem);
        let outcome = outcome.unwrap_or_else(|err| panic!("{effect}: {err}"));
        assert!(outcome.plan.is_none(), "{effect}");
        let is_proof = matches!(outcome.stop_reason, planner::StopReason::Unsolvable { .. });
        assert!(is_proof, "{effect}: {}", outcome.stop_reason);
    }
    case(
        "(:predicates (done)) (:functions (a))
         (:action bad :parameters () :effect (and (done) (scale-down (a) 0)))",
        "(:init (= (a) 1)) (:goal (done))",
        expect![[r#"
            warning: some instances of `bad` never apply: they use a function value that :init leaves out, or divide by zero
            proven unsolvable before search
        "#]],
    );
}

#[test]
fn an_action_that_overflows_a_number_never_applies() {
    case(
        "(:predicates (p) (q)) (:functions (a))
         (:action first :effect (and (p) (scale-up (a) 1e200)))
         (:action then :precondition (p) :effect (and (q) (scale-up (a) 1e200)))",
        "(:init (= (a) 1)) (:goal (q))",
        expect![[r#"
            proven unsolvable
        "#]],
    );
}

#[test]
fn numbers_are_compared_exactly() {
    // Two numbers that differ by less than a usual tolerance are still different.
    case(
        "(:predicates (q)) (:functions (x)) (:action set :effect (assign (x) 0.0000005))
         (:action go :precondition (> (x) 0) :effect (q))",
        "(:init (= (x) 0)) (:goal (q))",
        expect![[r#"
            (set)
            (go)
            cost 2, optimal
        "#]],
    );
    case(
        "(:predicates (q)) (:functions (x)) (:action go :precondition (= (x) 1) :effect (q))",
        "(:init (= (x) 1.0000001)) (:goal (q))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
    case(
        "(:predicates (q)) (:functions (x)) (:action add :effect (increase (x) 0.0000000001))
         (:action go :precondition (>= (x) 0.0000000003) :effect (q))",
        "(:init (= (x) 0)) (:goal (q))",
        expect![[r#"
            (add)
            (add)
            (add)
            (go)
            cost 4, optimal
        "#]],
    );
}

#[test]
fn decimals_add_up_exactly() {
    case(
        "(:predicates (q)) (:functions (x)) (:action add :effect (increase (x) 0.1))
         (:action go :precondition (= (x) 0.3) :effect (q))",
        "(:init (= (x) 0)) (:goal (q))",
        expect![[r#"
            (add)
            (add)
            (add)
            (go)
            cost 4, optimal
        "#]],
    );
    case(
        "(:predicates (q)) (:functions (x)) (:action take :precondition (>= (x) 0.1)
           :effect (decrease (x) 0.1))
         (:action go :precondition (<= (x) 0) :effect (q))",
        "(:init (= (x) 0.3)) (:goal (q))",
        expect![[r#"
            (take)
            (take)
            (take)
            (go)
            cost 4, optimal
        "#]],
    );
}

#[test]
fn a_tiny_cost_is_not_zero() {
    case(
        "(:predicates (q)) (:functions (total-cost))
         (:action dear :effect (and (q) (increase (total-cost) 1.0000000001)))
         (:action cheap :effect (and (q) (increase (total-cost) 1)))",
        "(:init) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            (dear)
            cost 1.0000000001, unproven
        "#]],
    );
}

/// Conditions over `(n)`, which is undefined, and `(z)`, which is zero. None of them holds.
const UNDEFINED: [&str; 10] = [
    "(not (> (n) 0))",
    "(not (<= (n) 0))",
    "(not (= (n) 0))",
    "(not (not (> (n) 0)))",
    "(not (> (/ 1 (z)) 0))",
    "(not (< 0 (/ (z) (z))))",
    "(imply (> (n) 0) (never))",
    "(not (or (> (n) 0) (never)))",
    "(not (exists (?o) (> (m ?o) 0)))",
    "(not (forall (?o) (= (m ?o) 0)))",
];

/// Returns a domain for [`UNDEFINED`] with the additional parts `more`. If `may_be_set`, an action
/// can set `(n)`, so that the comparisons are part of the state.
fn undefined(may_be_set: bool, more: &str) -> String {
    let set = "(:action set :precondition (never) :effect (and (assign (n) 1) (assign (z) 0)))
        (:action set-one :parameters (?o) :precondition (never) :effect (assign (m ?o) 1))";
    let set = if may_be_set { set } else { "" };
    support::domain(&format!(
        "(:predicates (g) (never) (seen)) (:functions (n) (z) (m ?o)) {set} {more}"
    ))
}

#[test]
fn an_undefined_number_satisfies_no_comparison_and_no_negation() {
    let problem =
        |goal: &str| support::problem(&format!("(:objects o) (:init (= (z) 0)) (:goal {goal})"));
    for (condition, may_be_set) in UNDEFINED.iter().flat_map(|one| [(one, false), (one, true)]) {
        let action = format!("(:action a :precondition {condition} :effect (g))");
        let axiom =
            format!("(:derived (seen) {condition}) (:action a :precondition (seen) :effect (g))");
        let nothing = "(:action a :effect (seen))";
        for (more, goal) in [(&*action, "(g)"), (&*axiom, "(g)"), (nothing, condition)] {
            let (domain, problem) = (undefined(may_be_set, more), problem(goal));
            let outcome = support::outcome(&domain, &problem).expect("it plans");
            assert!(outcome.plan.is_none(), "{condition} in {more}: {outcome:?}");
            let (domain, problem) = support::parse(&domain, &problem);
            let plan = pddl::parse_plan("(a)").into_result().expect("a plan");
            let verdict = planner::validate(&domain, &problem, &plan);
            assert!(matches!(verdict, planner::Verdict::Fault(_)), "{condition} in {more}");
        }
    }
}

#[test]
fn a_negated_comparison_of_defined_numbers_holds_if_the_comparison_does_not() {
    for (condition, steps) in [
        ("(not (= (count) 0))", 1),
        ("(not (< (count) 3))", 3),
        ("(not (and (>= (count) 0) (<= (count) 1)))", 2),
        ("(not (forall (?o) (= (count) (m ?o))))", 0),
        ("(and (not (= (count) 0)) (not (= (count) 1)) (not (= (count) 2)))", 3),
    ] {
        let domain = support::domain(
            "(:functions (count) (m ?o)) (:action add :effect (increase (count) 1))",
        );
        let problem = format!("(:objects o) (:init (= (count) 0) (= (m o) 2)) (:goal {condition})");
        let outcome = support::outcome(&domain, &support::problem(&problem)).expect("it plans");
        assert_eq!(outcome.plan.map(|plan| plan.steps.len()), Some(steps), "{condition}");
    }
}
