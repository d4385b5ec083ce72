//! Tests of the adapter of Metric-FF, on recorded outputs.
//!
//! No package registry has Metric-FF, so a stand-in replays its output. The format is that of
//! published logs of version 2.1, with the names of the task below.

use engines::{Ending, EngineError, EngineOptions, ExternalEngine, Installation};

use crate::support::{fake, repository, run};

/// Domain of a task that has an `ä` and upper case in its names, and two kinds of costs.
const DOMAIN: &str = "(define (domain x) (:predicates (at ?x) (painted ?x))
    (:functions (total-cost) (length ?x ?y))
    (:action Move :parameters (?x ?y) :precondition (at ?x)
      :effect (and (at ?y) (not (at ?x)) (increase (total-cost) 1)
                   (increase (total-cost) (length ?x ?y))))
    (:action paint :parameters (?x) :precondition (at ?x) :effect (painted ?x)))";
const METRIC: &str = "(:metric minimize (total-cost))";

fn problem(metric: bool) -> String {
    problem_for("(or (painted Halle) (and (at Büro) (painted Büro)))", metric)
}

fn problem_for(goal: &str, metric: bool) -> String {
    let metric = if metric { METRIC } else { "" };
    format!(
        "(define (problem y) (:domain x) (:objects Büro Halle)
           (:init (at Büro) (= (length Büro Halle) 2.5)) (:goal {goal}) {metric})"
    )
}

/// Returns a stand-in for Metric-FF that prints one output with costs and another without costs,
/// and exits with `code`.
fn ff(with_costs: &str, without_costs: &str, code: &str) -> Installation {
    fake(ExternalEngine::MetricFf, "replay.sh", &[with_costs, without_costs, code])
}

#[track_caller]
fn solved(installation: &Installation, metric: bool) -> (String, f64) {
    let outcome = run(installation, DOMAIN, &problem(metric), &EngineOptions::default());
    let outcome = outcome.expect("an outcome");
    assert_eq!(outcome.ending, Ending::GoalReached);
    let plan = outcome.plan.expect("a plan");
    let cost = plan.cost.map_or(f64::NAN, |cost| cost.0);
    (plan.steps.iter().map(|step| format!("{step}")).collect::<Vec<_>>().join(" "), cost)
}

#[test]
fn a_plan_has_the_names_of_the_task_and_a_recomputed_cost() {
    let steps = "(Move Büro Halle) (paint Halle)";
    let (plan, cost) = solved(&ff("none", "plan.txt", "0"), false);
    assert_eq!((plan.as_str(), cost), (steps, 2.0), "two steps; `REACH-GOAL` is none");
    // The recorded output has the cost 99, in single precision.
    let (plan, cost) = solved(&ff("plan-with-cost.txt", "none", "0"), true);
    assert_eq!((plan.as_str(), cost), (steps, 3.5));
}

#[test]
fn a_rejected_metric_is_left_out() {
    let (_, cost) = solved(&ff("metric-refused.txt", "plan.txt", "1"), true);
    assert_eq!(cost, 3.5, "ours all the same");
}

#[test]
fn the_output_determines_the_ending() {
    for (said, code, expected) in [
        ("goal-false.txt", "1", Ending::Unsolvable { before_search: true }),
        ("proven.txt", "0", Ending::Unsolvable { before_search: false }),
        ("empty.txt", "0", Ending::Exhausted),
        ("no-memory.txt", "1", Ending::OutOfMemory),
    ] {
        let outcome =
            run(&ff("none", said, code), DOMAIN, &problem(false), &EngineOptions::default());
        let outcome = outcome.unwrap_or_else(|err| panic!("{said}: {err}"));
        assert_eq!((outcome.plan, outcome.ending), (None, expected), "{said}");
    }
}

#[test]
fn a_building_with_batteries_is_supported() {
    let text = |file| {
        repository(&format!("daemon/planning/planner/benches/scenarios/1-temperatures/{file}.pddl"))
    };
    let said = ff("goal-false.txt", "goal-false.txt", "1");
    let outcome = run(&said, &text("domain"), &text("problem"), &EngineOptions::default());
    assert!(matches!(outcome.expect("an outcome").ending, Ending::Unsolvable { .. }));
}

#[test]
fn an_empty_plan_is_accepted_if_the_validator_accepts_it() {
    let satisfied = problem_for("(at Büro)", false);
    let outcome =
        run(&ff("none", "goal-true.txt", "1"), DOMAIN, &satisfied, &EngineOptions::default());
    let outcome = outcome.expect("an outcome");
    assert_eq!(outcome.plan.expect("a plan").steps.len(), 0);
    let outcome =
        run(&ff("none", "goal-true.txt", "1"), DOMAIN, &problem(false), &EngineOptions::default());
    assert!(matches!(outcome, Err(EngineError::WrongPlan { .. })), "{outcome:?}");
}

#[test]
fn exceeded_limits_and_crashes_are_reported() {
    let told = |said| {
        let outcome =
            run(&ff("none", said, "1"), DOMAIN, &problem(false), &EngineOptions::default());
        outcome.expect_err(said)
    };
    let err = told("too-many.txt");
    assert!(matches!(err, EngineError::Beyond { .. }), "{err:?}");
    assert!(err.to_string().contains("increase MAX_PREDICATES"), "{err}");
    let err = told("syntax.txt");
    assert!(matches!(err, EngineError::BrokeDown { .. }), "{err:?}");
    assert!(err.to_string().contains("exit code 1: D: syntax error in line 3"), "{err}");
}

#[test]
fn a_missing_program_is_reported() {
    let installation = Installation::of(ExternalEngine::MetricFf, ["/nowhere/ff"]);
    let err = run(&installation, DOMAIN, &problem(false), &EngineOptions::default());
    let err = err.expect_err("nothing is there");
    assert!(matches!(err, EngineError::Run { .. }), "{err:?}");
}
