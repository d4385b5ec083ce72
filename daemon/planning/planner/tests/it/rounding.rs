//! Numbers with more digits than are kept: what rests on rounded sums is no proof.

use expect_test::{Expect, expect};
use planner::{Cancel, Effort, Options, StopReason};

use crate::support::{self, check};

#[track_caller]
fn case(domain: &str, problem: &str, expected: Expect) {
    check(&support::domain(domain), &support::problem(problem), expected);
}

#[test]
fn zero_changes_no_number() {
    case(
        "(:functions (n)) (:predicates (p)) (:action z :effect (and (p) (increase (n) 0)))",
        "(:init (= (n) 0.333333333333333)) (:goal (and (p) (>= (n) 0.333333333333333)))",
        expect![[r#"
            (z)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn changes_that_cancel_each_other_change_no_number() {
    let both = "(:functions (n)) (:predicates (p))
         (:action z :effect (and (p) (increase (n) 1000000000000) (decrease (n) 1000000000000)))";
    case(
        both,
        "(:init (= (n) 0.1234567)) (:goal (and (p) (< (n) 0.1234)))",
        expect![[r#"
        proven unsolvable before search
    "#]],
    );
    case(
        both,
        "(:init (= (n) 0.1234567)) (:goal (and (p) (= (n) 0.1234567)))",
        expect![[r#"
        (z)
        cost 1, optimal
    "#]],
    );
}

#[test]
fn a_goal_that_only_rounding_prevents_is_not_proven_unsolvable() {
    case(
        "(:predicates (z)) (:functions (n))
         (:action i :precondition (not (z)) :effect (and (z) (increase (n) 0.001)))",
        "(:init (= (n) 1000000000000)) (:goal (> (n) 1000000000000))",
        expect![[r#"
            ended without a plan; this is no proof, because sums were rounded to fifteen digits
        "#]],
    );
    case(
        "(:functions (n)) (:action i :precondition (< (n) 1) :effect (increase (n) (/ 1 3)))",
        "(:init (= (n) 0)) (:goal (= (n) 1))",
        expect![[r#"
            (i)
            (i)
            (i)
            cost 3, unproven
        "#]],
    );
    // Nothing is rounded here.
    case(
        "(:functions (n)) (:action i :precondition (< (n) 1) :effect (increase (n) 0.3))",
        "(:init (= (n) 0)) (:goal (= (n) 1))",
        expect![[r#"
            proven unsolvable
        "#]],
    );
}

#[test]
fn costs_that_are_rounded_prove_no_plan_cheapest() {
    let domain = support::domain(
        "(:predicates (p)) (:functions (total-cost) (d ?x))
         (:action a :parameters (?x) :effect (and (p) (increase (total-cost) 1000000000000)
           (increase (total-cost) (d ?x))))",
    );
    let problem = support::problem(
        "(:objects a b) (:init (= (total-cost) 0) (= (d a) 0.0001) (= (d b) 0.0002)) (:goal (p))
         (:metric minimize (total-cost))",
    );
    let (domain, problem) = support::parse(&domain, &problem);
    let options = Options { effort: Effort::Optimal, ..Options::default() };
    let found = planner::plan(&domain, &problem, &options, &Cancel::new()).expect("it is planned");
    assert!(found.plan.is_some() && found.unproven == Some(StopReason::Exhausted), "{found:?}");
}
