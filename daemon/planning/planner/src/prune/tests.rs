//! Tests that pruned tasks have the same plans as the original tasks.

use std::collections::VecDeque;

use proptest::prelude::*;

use super::*;
use crate::progression::Progression;
use crate::state::{StateId, StateSpace, all_hold};
use crate::test_tasks::{task, texts, with_goal};

fn pruned(task: &Task) -> Pruned {
    prune(task, u64::MAX, usize::MAX, &Cancel::new())
}

/// Returns a shortest plan of a task, by breadth-first search over all states.
fn shortest(task: &Task) -> Option<Vec<OperatorId>> {
    let mut progression = Progression::new(task);
    let mut space = StateSpace::new(&progression.initial());
    let mut open = VecDeque::from([StateId(0)]);
    let mut next = Vec::new();
    while let Some(id) = open.pop_front() {
        if all_hold(space.state(id), &task.goal) {
            return Some(space.path(id));
        }
        for operator in (0..task.operator_count() as u32).map(OperatorId) {
            let state = space.state(id).to_vec();
            if all_hold(&state, task.operator(operator).preconditions)
                && progression.apply(task.operator(operator), &state, &mut next)
            {
                let (child, is_new) = space.insert(&next, id, operator);
                open.extend(is_new.then_some(child));
            }
        }
    }
    None
}

/// A domain with a robot that paints the floor next to it and never moves onto painted floor.
const FLOOR: &str =
    "(define (domain floor) (:predicates (at ?x) (clear ?x) (painted ?x) (up ?x ?y))
  (:action walk-up :parameters (?x ?y) :precondition (and (at ?x) (up ?x ?y) (clear ?y))
    :effect (and (not (at ?x)) (clear ?x) (at ?y) (not (clear ?y))))
  (:action walk-down :parameters (?x ?y) :precondition (and (at ?x) (up ?y ?x) (clear ?y))
    :effect (and (not (at ?x)) (clear ?x) (at ?y) (not (clear ?y))))
  (:action paint-up :parameters (?x ?y) :precondition (and (at ?x) (up ?x ?y) (clear ?y))
    :effect (and (painted ?y) (not (clear ?y))))
  (:action paint-down :parameters (?x ?y) :precondition (and (at ?x) (up ?y ?x) (clear ?y))
    :effect (and (painted ?y) (not (clear ?y)))))";

#[test]
fn operators_that_block_the_goal_are_pruned() {
    let problem = "(define (problem p) (:domain floor) (:objects a b c d)
      (:init (up a b) (up b c) (up c d) (at a) (clear b) (clear c) (clear d))
      (:goal (and (painted b) (painted c) (painted d))))";
    let task = task(FLOOR, problem);
    let Pruned::Smaller(smaller) = pruned(&task) else { panic!("something is superfluous") };
    let steps = |task: &Task| -> Vec<String> {
        let all = (0..task.operator_count() as u32).map(OperatorId);
        all.map(|id| task.step(id).to_string()).filter(|step| step.contains("paint")).collect()
    };
    assert_eq!(steps(&task).len(), 6);
    // The robot moves backwards while it paints: each cell is painted from below.
    assert_eq!(steps(&smaller.task), ["(paint-up a b)", "(paint-up b c)", "(paint-up c d)"]);
    let last = smaller.task.operators.iter().find(|one| smaller_step(&smaller.task, *one, "a b"));
    let asked = last.expect("it is painted").preconditions.len();
    assert_eq!(asked, 2 + 2, "it asks for the two that are painted before");
}

fn smaller_step(task: &Task, operator: crate::task::GroundOperator<'_>, arguments: &str) -> bool {
    let name = task.schema_names[operator.schema as usize].as_str();
    let own: Vec<_> =
        operator.arguments.iter().map(|one| task.object_names[one.index()].as_str()).collect();
    name == "paint-up" && own.join(" ") == arguments
}

#[test]
fn a_goal_that_blocks_itself_is_proved_unreachable() {
    let domain = "(define (domain d) (:predicates (a) (b) (c))
      (:action one :precondition (c) :effect (and (not (c)) (a)))
      (:action other :precondition (c) :effect (and (not (c)) (b))))";
    let problem = "(define (problem p) (:domain d) (:init (c)) (:goal (and (a) (b))))";
    assert!(matches!(pruned(&task(domain, problem)), Pruned::Nothing));
}

#[test]
fn pruning_stops_at_its_limits() {
    let problem = "(define (problem p) (:domain floor) (:objects a b)
      (:init (up a b) (at a) (clear b)) (:goal (painted b)))";
    let task = task(FLOOR, problem);
    for (work_max, bytes_max) in [(0, 1 << 20), (8, 1 << 20), (100, 1 << 20), (1 << 20, 100)] {
        let pruned = prune(&task, work_max, bytes_max, &Cancel::new());
        assert!(matches!(pruned, Pruned::Everything), "{work_max} {bytes_max}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, ..ProptestConfig::default() })]

    #[test]
    fn pruning_keeps_a_shortest_plan(
        (actions, initial) in texts(),
        goal in prop_oneof![
            Just("(z)"), Just("(not (z))"), Just("(and (p b) (q a))"), Just("(and (z) (r a a))"),
            Just("(and (p a) (not (q b)))"), Just("(and (r a b) (r b a) (not (p a)))"),
            Just("(and (q a) (q b) (p a) (p b))"), Just("(or (z) (and (p a) (r b b)))"),
        ],
    ) {
        let Some(task) = with_goal(&actions, &initial, goal) else { return Ok(()) };
        let plan = shortest(&task);
        match pruned(&task) {
            Pruned::Everything => (),
            Pruned::Nothing => prop_assert_eq!(plan, None),
            Pruned::Smaller(smaller) => {
                let other = shortest(&smaller.task).map(|plan| smaller.original(&plan));
                let lengths = [&plan, &other].map(|plan| plan.as_ref().map(Vec::len));
                prop_assert_eq!(lengths[0], lengths[1], "{:?} {:?}", plan, other);
                if let Some(plan) = plan {
                    prop_assert!(smaller.translate(&plan).is_some(), "all its steps are left");
                }
            }
        }
    }
}
