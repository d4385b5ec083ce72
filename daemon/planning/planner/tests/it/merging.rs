//! Merging of plans: an order that works is found wherever there is one, and changes by others are
//! carried from one state into another.

use pddl::PlanStep;
use planner::merge::merge;
use planner::validate::{World, cost_from};

use crate::support::parse;

const DOMAIN: &str = "(define (domain d) (:requirements :typing) (:types item)
    (:predicates (have ?i - item) (free ?i - item) (done ?i - item) (used ?i - item))
    (:action take :agent ?a - item :parameters (?i - item)
        :precondition (free ?i) :effect (and (have ?i) (not (free ?i))))
    (:action use :agent ?a - item :parameters (?i - item)
        :precondition (have ?i) :effect (used ?i))
    (:action give :agent ?a - item :parameters (?i - item)
        :precondition (have ?i) :effect (and (free ?i) (not (have ?i)) (done ?a))))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:objects a b c key - item)
    (:init (free key)) (:goal (and)))";

fn steps(text: &str) -> Vec<PlanStep> {
    pddl::parse_plan(text).into_result().expect("a plan").steps
}

/// Returns the merged plan of these plans, as text.
fn merged(plans: &[&str], goal: &str, states_max: usize) -> Option<String> {
    let (domain, problem) = parse(DOMAIN, PROBLEM);
    let world = World::initial(&domain, &problem).expect("makes sense");
    let goal = pddl::parse_condition(goal).into_result().expect("a goal");
    let plans: Vec<_> = plans.iter().map(|plan| steps(plan)).collect();
    let steps = merge(&world, &plans, &goal, states_max)?;
    cost_from(&world, &steps, &goal).expect("a merged plan is valid");
    Some(steps.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "))
}

#[test]
fn plans_that_fit_are_joined_in_their_order() {
    let one = "(take a key) (use a key) (give a key)";
    let two = "(take b key) (give b key)";
    let found = merged(&[one, two], "(and (done a) (done b))", 100);
    assert_eq!(found, Some([one, two].join(" ")));
}

#[test]
fn another_order_is_found_if_the_first_one_fails() {
    // The first plan keeps the key; so the second one must come first.
    let keeps = "(take a key) (use a key)";
    let returns = "(take b key) (give b key)";
    let found = merged(&[keeps, returns], "(and (done b) (have key))", 100);
    assert_eq!(found, Some([returns, keeps].join(" ")));
    // Three plans, of which the first two interleave with the last.
    let found = merged(&[keeps, returns, "(take c key) (give c key)"], "(have key)", 100);
    assert!(found.is_some_and(|found| found.ends_with(keeps)));
}

#[test]
fn steps_without_a_threat_need_no_search() {
    let domain = DOMAIN.replacen("(and (have ?i) (not (free ?i)))", "(have ?i)", 1);
    let (domain, problem) = parse(&domain, &PROBLEM.replace("(free key)", "(free a) (free b)"));
    let world = World::initial(&domain, &problem).expect("makes sense");
    let goal = pddl::parse_condition("(and (have a) (have b))").into_result().expect("a goal");
    let plans = ["a", "b"]
        .map(|name| steps(&format!("(take {name} {name}) (use {name} {name}) ").repeat(50)));
    let found = merge(&world, &plans, &goal, 1).expect("one after the other");
    assert_eq!(found, plans.concat());
}

#[test]
fn a_search_without_a_result_ends() {
    let keeps = ["(take a key) (use a key)", "(take b key) (use b key)"];
    assert_eq!(merged(&keeps, "(and)", 1_000), None);
    assert_eq!(merged(&["(take a key) (give a key)", "(take b key)"], "(and)", 2), None);
}

#[test]
fn changes_by_others_are_carried_over_as_far_as_they_are_known() {
    let (domain, problem) = parse(DOMAIN, PROBLEM);
    let start = World::initial(&domain, &problem).expect("makes sense");
    let mut later = start.clone();
    later.apply(&steps("(take a key)")[0]).expect("the key is free");
    let changes = start.changes_to(&later);
    let texts: Vec<String> = changes.iter().map(ToString::to_string).collect();
    assert_eq!(texts, ["(have key)", "(not (free key))"]);
    // A state of an agent that does not know the predicate `have`.
    let less = DOMAIN.replace("(have ?i - item)", "").replace("(have ?i)", "(used ?i)");
    let (domain, problem) = parse(&less, PROBLEM);
    let mut other = World::initial(&domain, &problem).expect("makes sense");
    other.take_changes(&changes);
    let facts: Vec<String> = other.atoms().map(|atom| atom.to_string()).collect();
    assert_eq!(facts, [""; 0], "`free` is taken over, `have` is left out");
    let mut same = start.clone();
    same.take_changes(&changes);
    assert!(same == later);
}
