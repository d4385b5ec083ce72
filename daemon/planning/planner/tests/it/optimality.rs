//! Proofs of optimality: a proof must cover all steps that the texts allow, not only those that are
//! relevant to the goal.

use planner::{
    Cancel, Effort, Options, PlanningOutcome, StopReason, Unprovable, configuration, plan,
};

use crate::support::{domain, parse, problem};

/// Plans with a given effort and the configuration of this name.
#[track_caller]
fn outcome(texts: (&str, &str), effort: Effort, search: &str) -> PlanningOutcome {
    let (domain, problem) = parse(&domain(texts.0), &problem(texts.1));
    let configuration = configuration(search).expect("there is one");
    let options = Options { effort, configuration, ..Options::default() };
    plan(&domain, &problem, &options, &Cancel::new()).expect("it plans")
}

/// Checks that there is a plan, and that with no effort it is proved optimal, for the reason `why`.
#[track_caller]
fn unproven(domain: &str, problem: &str, why: Unprovable) {
    for (effort, search) in [
        (Effort::First, "althing"),
        (Effort::Optimal, "althing"),
        (Effort::Optimal, "astar-lmcut"),
        (Effort::First, "astar-max"),
    ] {
        let outcome = outcome((domain, problem), effort, search);
        assert!(outcome.plan.is_some(), "{effort:?} {search}: {outcome:?}");
        assert!(!outcome.statistics.proven_optimal, "{effort:?} {search}: {outcome:?}");
        assert_eq!(outcome.unprovable, Some(why), "{effort:?} {search}");
        if effort == Effort::Optimal {
            assert_eq!(outcome.unproven, Some(StopReason::Exhausted), "{search}");
            assert_eq!(outcome.exit_code(), 4, "{search}");
        }
    }
}

/// Checks that the optimal plan has this cost, and that its optimality is proved.
#[track_caller]
fn proven(domain: &str, problem: &str, cost: f64) {
    let outcome = outcome((domain, problem), Effort::Optimal, "althing");
    assert!(outcome.statistics.proven_optimal, "{outcome:?}");
    assert_eq!(outcome.plan.and_then(|plan| plan.cost).map(|cost| cost.0), Some(cost));
    assert_eq!(outcome.unprovable, None);
}

/// A domain with coins on the way that are irrelevant to the goal.
const COINS: &str = "(:predicates (home) (taken ?c)) (:functions (score) (worth ?c))
    (:action take :parameters (?c) :precondition (not (taken ?c))
      :effect (and (taken ?c) (increase (score) (worth ?c))))
    (:action go :effect (home))";

#[test]
fn irrelevant_steps_that_improve_the_metric_prevent_a_proof() {
    let start = "(:objects c1 c2) (:init (= (score) 0) (= (worth c1) 10) (= (worth c2) 10))";
    for metric in
        ["maximize (score)", "minimize (- 10 (score))", "minimize (- (total-time) (score))"]
    {
        let text = format!("{start} (:goal (home)) (:metric {metric})");
        unproven(COINS, &text, Unprovable::NegativeCosts);
    }
    let spending = COINS.replace("increase", "decrease");
    let text = format!("{start} (:goal (home)) (:metric minimize (score))");
    unproven(&spending, &text, Unprovable::NegativeCosts);
}

#[test]
fn one_irrelevant_instance_with_a_negative_cost_prevents_a_proof() {
    let text = |worth: &str| {
        format!(
            "(:objects c1 c2) (:init (= (score) 0) (= (worth c1) 3) (= (worth c2) {worth}))
             (:goal (home)) (:metric minimize (score))"
        )
    };
    unproven(COINS, &text("-1"), Unprovable::NegativeCosts);
    proven(COINS, &text("0"), 0.0);
}

#[test]
fn an_inapplicable_step_with_a_negative_cost_allows_a_proof() {
    let never = "(:predicates (home) (never)) (:functions (score))
        (:action take :precondition (never) :effect (decrease (score) 5))
        (:action go :effect (and (home) (increase (score) 2)))";
    proven(never, "(:init (= (score) 0)) (:goal (home)) (:metric minimize (score))", 2.0);
}

#[test]
fn a_goal_that_holds_at_once_may_be_left_for_a_better_metric() {
    let text = |metric: &str| {
        format!(
            "(:objects c) (:init (home) (= (score) 0) (= (worth c) 1)) (:goal (home))
            (:metric {metric})"
        )
    };
    unproven(COINS, &text("maximize (score)"), Unprovable::NegativeCosts);
    unproven(COINS, &text("minimize (- (total-time))"), Unprovable::NegativeCosts);
    proven(COINS, &text("minimize (score)"), 0.0);
}

const PAY: &str = "(:predicates (h) (k)) (:functions (total-cost) (load))
    (:action a :precondition (not (h)) :effect (and (h) (increase (total-cost) COST)))
    (:action b :precondition (not (k)) :effect (and (k) (increase (load) 1)))
    (:action c :precondition (not (k)) :effect (and (k) (decrease (total-cost) 0)))";

#[test]
fn the_reported_reason_is_the_actual_one() {
    let text =
        "(:init (= (total-cost) 0) (= (load) 1)) (:goal (h)) (:metric minimize (total-cost))";
    let with = |cost: &str| PAY.replace("COST", cost);
    proven(&with("5"), text, 5.0);
    proven(&with("0.000001"), text, 0.000_001);
    unproven(&with("-5"), text, Unprovable::NegativeCosts);
    unproven(&with("(load)"), text, Unprovable::Varies);
    unproven(&with("0.00000015"), text, Unprovable::TooFine);
    for large in ["900000000000000", "10000000000000000000", "1000000000000000000000000000000"] {
        unproven(&with(large), text, Unprovable::TooLarge);
    }
    let product = "(:init (= (total-cost) 0) (= (load) 1)) (:goal (h))
        (:metric minimize (* (total-cost) (total-cost)))";
    unproven(&with("5"), product, Unprovable::NoSum);
}
