//! Stop reasons: the planner distinguishes “unsolvable” (proved), “gave up” (limit reached) and
//! “cancelled”.

use planner::{Budget, Cancel, Options, StopReason, plan};

use crate::support::{domain, parse, problem};

/// Two actions that undo each other's goal: the relaxed task has a plan, the task itself has none.
const SWITCH: &str = "(:predicates (a) (b)) (:action left :effect (and (a) (not (b))))
    (:action right :effect (and (b) (not (a))))";

/// A counter of eight bits: a short task with a long plan.
const COUNTER: &str = "(:predicates (on ?x) (before ?x ?y))
    (:action flip :parameters (?x) :precondition (and (not (on ?x)) (forall (?y)
        (imply (before ?y ?x) (on ?y))))
      :effect (and (on ?x) (forall (?y) (when (before ?y ?x) (not (on ?y))))))";

fn counter() -> String {
    let names: Vec<String> = (0..8).map(|index| format!("b{index}")).collect();
    let mut init = String::new();
    for (low, name) in names.iter().enumerate() {
        names[low + 1..].iter().for_each(|high| init += &format!("(before {name} {high})"));
    }
    let objects = names.join(" ");
    problem(&format!("(:objects {objects}) (:init {init}) (:goal (forall (?x) (on ?x)))"))
}

#[track_caller]
fn check(domain_parts: &str, problem: &str, budget: Budget, cancel: &Cancel, expected: StopReason) {
    let (domain, problem) = parse(&domain(domain_parts), problem);
    let options = Options { budget, ..Options::default() };
    let outcome = plan(&domain, &problem, &options, cancel).expect("supported");
    assert_eq!(outcome.stop_reason, expected);
    assert_eq!(outcome.plan.is_some(), expected == StopReason::GoalReached);
}

#[test]
fn unreachable_in_the_relaxation_is_a_proof_before_search() {
    let goal = problem("(:init) (:goal (c))");
    let parts = "(:predicates (a) (c)) (:action left :effect (a))";
    let expected = StopReason::Unsolvable { before_search: true };
    check(parts, &goal, Budget::default(), &Cancel::new(), expected);
    assert_eq!(expected.exit_code(), 10);
}

#[test]
fn an_exhausted_state_space_is_a_proof() {
    let goal = problem("(:init (free-1) (free-2)) (:goal (and (a) (b) (c)))");
    let expected = StopReason::Unsolvable { before_search: false };
    check(&two_of_three(), &goal, Budget::default(), &Cancel::new(), expected);
    assert_eq!(expected.exit_code(), 11);
}

/// Returns a task with three facts, of which any two can be achieved one after the other.
fn two_of_three() -> String {
    let mut parts = "(:predicates (a) (b) (c) (free-1) (free-2))".to_owned();
    for thing in ["a", "b", "c"] {
        for slot in ["free-1", "free-2"] {
            parts += &format!(
                "(:action {thing}-{slot} :precondition ({slot})
                   :effect (and ({thing}) (not ({slot}))))"
            );
        }
    }
    parts
}

#[test]
fn a_pair_that_is_never_true_is_a_proof_before_search() {
    let goal = problem("(:init) (:goal (and (a) (b)))");
    let expected = StopReason::Unsolvable { before_search: true };
    check(SWITCH, &goal, Budget::default(), &Cancel::new(), expected);
}

#[test]
fn a_long_plan_is_found_without_limits() {
    check(COUNTER, &counter(), Budget::default(), &Cancel::new(), StopReason::GoalReached);
}

#[test]
fn a_cap_on_expansions_is_no_proof() {
    let budget = Budget { expansions_max: 20, ..Budget::default() };
    let expected = StopReason::ExpansionLimit { limit: 20 };
    check(COUNTER, &counter(), budget, &Cancel::new(), expected);
    assert_eq!(expected.exit_code(), 12);
}

#[test]
fn a_cap_on_grounding_is_no_proof() {
    let budget = Budget { join_steps_max: 10, ..Budget::default() };
    let expected = StopReason::JoinStepLimit { limit: 10 };
    check(COUNTER, &counter(), budget, &Cancel::new(), expected);
}

#[test]
fn a_cap_on_memory_is_no_proof() {
    let budget = Budget { memory_max_bytes: 3_000, ..Budget::default() };
    let expected = StopReason::MemoryLimit { limit: 3_000 };
    check(COUNTER, &counter(), budget, &Cancel::new(), expected);
    assert_eq!(expected.exit_code(), 22);
}

#[test]
fn the_caller_can_cancel_planning() {
    let cancel = Cancel::new();
    cancel.clone().set();
    check(COUNTER, &counter(), Budget::default(), &cancel, StopReason::Cancelled);
    assert_eq!(StopReason::Cancelled.exit_code(), 23);
}

#[test]
fn the_same_input_gives_the_same_result() {
    let (domain, problem) = parse(&domain(COUNTER), &counter());
    let ask = || plan(&domain, &problem, &Options::default(), &Cancel::new()).expect("supported");
    let (first, second) = (ask(), ask());
    assert_eq!(first.plan, second.plan);
    assert_eq!(first.statistics, second.statistics);
}
