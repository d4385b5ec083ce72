//! Actions with more ground instances than fit into memory.

use std::fmt::Write as _;

use planner::{Budget, Cancel, GroundingReuse, Options, Replanner, plan};

use crate::support::parse;

/// A domain with an action for chains of eight different beads, each linked to the one before it.
const CHAIN: &str =
    "(define (domain chain) (:requirements :typing :negative-preconditions :equality)
  (:types bead)
  (:predicates (next ?x ?y - bead) (red ?x - bead) (strung ?x ?y - bead))
  (:action string :parameters (?a ?b ?c ?d ?e ?f ?g ?h - bead)
   :precondition (and (next ?a ?b) (next ?b ?c) (next ?c ?d) (next ?d ?e) (next ?e ?f) (next ?f ?g)
     (next ?g ?h) (red ?h) (not (= ?a ?h)) (not (= ?b ?h)) (not (= ?c ?h)) (not (strung ?a ?h)))
   :effect (and (strung ?a ?h) (red ?a) (not (red ?h)))))";

/// With this number of beads, the action has about fifty million ground instances.
const BEADS: usize = 10;

#[test]
fn an_action_too_wide_to_ground_is_planned_piecewise() {
    let beads: Vec<usize> = (0..BEADS).collect();
    let mut next = String::new();
    for (one, two) in beads.iter().flat_map(|one| beads.iter().map(move |two| (one, two))) {
        if one != two {
            write!(next, "(next b{one} b{two})").expect("a text grows");
        }
    }
    let names: String = beads.iter().map(|one| format!("b{one} ")).collect();
    let problem = format!(
        "(define (problem p) (:domain chain) (:objects {names} - bead)
         (:init (red b0) {next}) (:goal (and (strung b3 b0) (strung b5 b3))))"
    );
    let (domain, problem) = parse(CHAIN, &problem);
    let budget = Budget { memory_max_bytes: 32 << 20, ..Budget::default() };
    let options = Options { budget, ..Options::default() };
    let outcome = plan(&domain, &problem, &options, &Cancel::new()).expect("supported");
    let again = Replanner::default().plan(&domain, &problem, &[], &options, &Cancel::new());
    let again = again.expect("supported");
    assert_eq!(
        (again.outcome.plan, again.grounding_reuse),
        (outcome.plan.clone(), GroundingReuse::Full)
    );
    let plan = outcome.plan.unwrap_or_else(|| panic!("no plan: {:?}", outcome.stop_reason));
    // The validator has accepted the plan in terms of the text; both ends are those of the goal.
    let ends = |step: &pddl::PlanStep| {
        (step.action.to_string(), step.arguments[0].to_string(), step.arguments[7].to_string())
    };
    let expected = [("b3", "b0"), ("b5", "b3")].map(|(a, h)| ("string".into(), a.into(), h.into()));
    assert_eq!(plan.steps.iter().map(ends).collect::<Vec<_>>(), expected);
    assert!(plan.steps.iter().all(|step| step.arguments.len() == 8));
}
