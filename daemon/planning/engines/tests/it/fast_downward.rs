//! Tests with the installed Fast Downward, and with a stand-in that returns wrong results.

use engines::{Ending, EngineError, EngineOptions, ExternalEngine, Installation, PlanningAim};

use crate::support::{fake, fast_downward, parse, repository, run};

const GO: &str = "(define (domain x) (:predicates (q)) (:functions (total-cost))
    (:action go :effect (and (q) (increase (total-cost) 2) (increase (total-cost) 0.5)))
    (:action wait :effect (and (q) (increase (total-cost) 9))))";
const GOAL: &str = "(define (problem y) (:domain x) (:init) (:goal (q))
    (:metric minimize (total-cost)))";

#[test]
fn fast_downward_solves_the_same_task_as_the_embedded_planner() {
    let Some(installation) = fast_downward() else { return };
    let domain = "(define (domain office) (:requirements :typing)
        (:types room robot) (:predicates (at ?r - robot ?x - room) (door ?x ?y - room)
          (known ?x - room)) (:functions (total-cost) (distance ?x ?y - room))
        (:action move :agent ?r - robot :parameters (?from ?to - room)
          :precondition (and (at ?r ?from) (door ?from ?to))
          :effect (and (not (at ?r ?from)) (at ?r ?to)
                       (increase (total-cost) (distance ?from ?to))))
        (:action measure :agent ?r - robot :parameters (?x - room) :precondition (at ?r ?x)
          :effect (and (known ?x) (increase (total-cost) 1))))";
    let problem = "(define (problem rooms) (:domain office)
        (:objects r1 - robot corridor büro@1 büro.1 B/2 and - room)
        (:init (at r1 corridor) (door corridor büro@1) (door büro@1 corridor)
          (door corridor büro.1) (door büro.1 corridor) (door corridor B/2) (door B/2 and)
          (= (distance corridor büro@1) 2.5) (= (distance büro@1 corridor) 2.5)
          (= (distance corridor büro.1) 1) (= (distance büro.1 corridor) 1)
          (= (distance corridor B/2) 4) (= (distance B/2 and) 0.5))
        (:goal (forall (?x - room) (known ?x))) (:metric minimize (total-cost)))";
    let outcome =
        run(&installation, domain, problem, &EngineOptions::default()).expect("an outcome");
    assert_eq!(outcome.ending, Ending::GoalReached);
    let text = outcome.plan.expect("a plan").to_string();
    for step in ["(move r1 corridor büro@1)", "(measure r1 and)", "(measure r1 B/2)"] {
        assert!(text.contains(step), "{text}");
    }
    let options = EngineOptions { aim: PlanningAim::CheapestPlan, ..EngineOptions::default() };
    let outcome = run(&installation, domain, problem, &options).expect("an outcome");
    assert!(outcome.proven_optimal);
    assert_eq!(outcome.plan.and_then(|plan| plan.cost), Some(pddl::Number(16.5)));
}

#[test]
fn fast_downward_plans_actions_of_several_agents() {
    let Some(installation) = fast_downward() else { return };
    let domain = "(define (domain office) (:requirements :typing :equality :negative-preconditions)
        (:types room robot) (:predicates (at ?r - robot ?x - room) (table-at ?x - room))
        (:action move :agent ?r - robot :parameters (?from ?to - room)
          :precondition (at ?r ?from) :effect (and (not (at ?r ?from)) (at ?r ?to)))
        (:action carry :agent (?a ?b - robot) :parameters (?from ?to - room)
          :precondition (and (not (= ?a ?b)) (at ?a ?from) (at ?b ?from) (table-at ?from))
          :effect (and (table-at ?to) (not (table-at ?from)) (at ?a ?to) (not (at ?a ?from))
            (at ?b ?to) (not (at ?b ?from)))))";
    let problem = "(define (problem rooms) (:domain office)
        (:objects r1 r2 - robot hall lab - room)
        (:init (at r1 hall) (at r2 lab) (table-at hall)) (:goal (table-at lab)))";
    let outcome =
        run(&installation, domain, problem, &EngineOptions::default()).expect("an outcome");
    let text = outcome.plan.expect("a plan").to_string();
    let carried = |one, other| text.contains(&format!("(carry {one} {other} hall lab)"));
    assert!(text.contains("(move r2 lab hall)"), "{text}");
    assert!(carried("r1", "r2") || carried("r2", "r1"), "{text}");
}

#[test]
fn fast_downward_plans_for_a_building_without_numbers() {
    let Some(installation) = fast_downward() else { return };
    let texts = |building: &str| {
        let text =
            |file| repository(&format!("daemon/planning/planner/benches/{building}/{file}.pddl"));
        (text("domain"), text("problem"))
    };
    // A battery level is a number, which Fast Downward does not support.
    let (domain, problem) = texts("scenarios/1-temperatures");
    let err =
        run(&installation, &domain, &problem, &EngineOptions::default()).expect_err("numeric");
    let EngineError::Unsupported { unsupported, .. } = &err else { panic!("{err:?}") };
    assert_eq!(&domain[unsupported.span.range()], "(>= (charge ?b) (distance ?from ?to))");
    let (domain, problem) = texts("office");
    let outcome = run(&installation, &domain, &problem, &EngineOptions::default());
    let plan = outcome.expect("an outcome").plan;
    let cost = plan.and_then(|plan| plan.cost).map_or(f64::NAN, |cost| cost.0);
    let (domain, problem) = parse(&domain, &problem);
    let options = planner::Options::default();
    let embedded = planner::plan(&domain, &problem, &options, &planner::Cancel::new());
    let embedded = embedded.expect("an outcome");
    assert!(embedded.statistics.proven_optimal);
    let least = embedded.plan.and_then(|plan| plan.cost).map_or(f64::NAN, |cost| cost.0);
    assert!(cost >= least - 1e-9, "{cost} beats the optimum {least}");
}

#[test]
fn unsolvable_tasks_are_proved_unsolvable() {
    let Some(installation) = fast_downward() else { return };
    for domain in [
        // In the first domain no action makes `(q)` or `(r)` true. In the second, `go` and `come`
        // exclude each other.
        "(define (domain x) (:predicates (p) (q) (r)) (:action go :effect (p)))",
        "(define (domain x) (:predicates (p) (q) (r)) (:action start :effect (p))
           (:action go :precondition (and (p) (not (r))) :effect (q))
           (:action come :precondition (and (p) (not (q))) :effect (r)))",
    ] {
        let problem = "(define (problem y) (:domain x) (:init) (:goal (and (q) (r))))";
        let outcome = run(&installation, domain, problem, &EngineOptions::default());
        let ending = outcome.expect("an outcome").ending;
        assert!(matches!(ending, Ending::Unsolvable { .. }), "{ending:?}");
    }
}

#[test]
fn costs_are_recomputed_by_the_validator() {
    let stand_in = |code, plan, better| {
        fake(ExternalEngine::FastDownward, "fast-downward.sh", &[code, plan, better])
    };
    let cost = |installation: &Installation| {
        let outcome = run(installation, GO, GOAL, &EngineOptions::default()).expect("an outcome");
        assert_eq!(outcome.ending, Ending::GoalReached);
        assert!(!outcome.proven_optimal);
        outcome.plan.and_then(|plan| plan.cost).map(|cost| cost.0)
    };
    // Fast Downward uses only the last of two cost effects, and costs are multiplied by ten here.
    assert_eq!(cost(&stand_in("0", "(a-go )\n; cost = 5 (general cost)\n", "")), Some(2.5));
    // Of numbered plans, the last is the best. If it is incomplete, the previous one is used.
    assert_eq!(cost(&stand_in("2", "", "(A-WAIT)\n")), Some(9.0));
    assert_eq!(cost(&stand_in("3", "(a-wait)\n", "(a-go)")), Some(2.5));
    assert_eq!(cost(&stand_in("3", "(a-wait)\n", "(a-go")), Some(9.0));
}

#[test]
fn wrong_and_unreadable_plans_are_errors() {
    let err = |code, plan| {
        let installation =
            fake(ExternalEngine::FastDownward, "fast-downward.sh", &[code, plan, ""]);
        run(&installation, GO, GOAL, &EngineOptions::default()).expect_err("no outcome")
    };
    let wrong = err("0", "; nothing need be done\n");
    assert!(matches!(wrong, EngineError::WrongPlan { .. }), "{wrong:?}");
    assert_eq!(wrong.to_string(), "confirm the plan of Fast Downward: goal: (q) does not hold");
    for (plan, problem) in
        [("(a-fly)\n", "no action or object `a-fly`"), ("", "wrote none"), ("(a-go", "")]
    {
        let unreadable = err("0", plan);
        assert!(matches!(unreadable, EngineError::UnreadablePlan { .. }), "{unreadable:?}");
        assert!(unreadable.to_string().contains(problem), "{unreadable}");
    }
    assert!(matches!(err("30", ""), EngineError::BrokeDown { .. }));
    assert!(matches!(err("34", ""), EngineError::Beyond { .. }));
}

#[test]
fn exit_codes_determine_the_ending() {
    for (code, expected) in [
        ("10", Ending::Unsolvable { before_search: true }),
        ("11", Ending::Unsolvable { before_search: false }),
        ("12", Ending::Exhausted),
        ("13", Ending::Exhausted),
        ("20", Ending::OutOfMemory),
        ("21", Ending::OutOfTime),
        ("22", Ending::OutOfMemory),
        ("23", Ending::OutOfTime),
        ("24", Ending::OutOfMemory),
    ] {
        let installation = fake(ExternalEngine::FastDownward, "fast-downward.sh", &[code, "", ""]);
        let outcome = run(&installation, GO, GOAL, &EngineOptions::default()).expect("an outcome");
        assert_eq!((outcome.plan, outcome.ending), (None, expected), "{code}");
    }
}
