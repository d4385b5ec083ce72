//! Tests with small, well-known tasks: their mutex groups must be as expected, and no random walk
//! may violate a group.

use proptest::prelude::*;

use super::*;
use crate::progression::Progression;
use crate::state::{all_hold, is_true};
use crate::task::OperatorId;
use crate::test_tasks::{reached, task, texts};

fn find(task: &Task) -> MutexGroups {
    MutexGroups::find(task, u64::MAX, &Cancel::new())
}

/// Checks the sizes of all mutex groups of a task, the largest first, and the number of variables.
#[track_caller]
fn check(domain: &str, problem: &str, sizes: &[usize], variables: usize) {
    let task = task(domain, problem);
    let groups = find(&task);
    assert_eq!(groups.groups().iter().map(Vec::len).collect::<Vec<_>>(), sizes);
    assert_eq!(groups.variables().len(), variables);
    let mut all: Vec<FactId> = groups.variables().concat();
    all.sort_unstable();
    let basic = (0..task.basic_count).map(FactId::from_index);
    assert_eq!(all, basic.collect::<Vec<_>>(), "a partition");
}

const GRIPPER: &str = "(define (domain gripper) (:predicates (room ?r) (ball ?b) (hand ?g)
    (robot ?r) (at ?b ?r) (free ?g) (carry ?b ?g))
  (:action move :parameters (?a ?b) :precondition (and (room ?a) (room ?b) (robot ?a))
    :effect (and (robot ?b) (not (robot ?a))))
  (:action pick :parameters (?b ?r ?g)
    :precondition (and (ball ?b) (room ?r) (hand ?g) (at ?b ?r) (robot ?r) (free ?g))
    :effect (and (carry ?b ?g) (not (at ?b ?r)) (not (free ?g))))
  (:action drop :parameters (?b ?r ?g)
    :precondition (and (ball ?b) (room ?r) (hand ?g) (carry ?b ?g) (robot ?r))
    :effect (and (at ?b ?r) (free ?g) (not (carry ?b ?g)))))";

#[test]
fn each_ball_has_one_place_and_each_hand_holds_at_most_one_ball() {
    let problem = "(define (problem p) (:domain gripper) (:objects a b x y z l r)
      (:init (room a) (room b) (ball x) (ball y) (ball z) (hand l) (hand r) (robot a)
        (at x a) (at y a) (at z a) (free l) (free r))
      (:goal (and (at x b) (at y b) (at z b))))";
    // Each ball is in one of two rooms or two hands. Each hand holds one of three balls or is free.
    // The robot is in one of two rooms.
    check(GRIPPER, problem, &[4, 4, 4, 4, 4, 2], 6);
}

#[test]
fn conditional_moves_keep_a_thing_in_one_place() {
    let domain = "(define (domain d) (:predicates (at ?x ?p) (next ?p ?q))
      (:action turn :effect (forall (?x ?p ?q) (when (and (at ?x ?p) (next ?p ?q))
        (and (not (at ?x ?p)) (at ?x ?q))))))";
    let problem = "(define (problem p) (:domain d) (:objects x y a b c)
      (:init (next a b) (next b c) (next c a) (at x a) (at y b)) (:goal (and (at x c) (at y a))))";
    check(domain, problem, &[3, 3], 2);
}

#[test]
fn a_failing_instance_does_not_affect_the_others() {
    let domain =
        "(define (domain d) (:constants mud) (:predicates (at ?x ?p) (thing ?x) (place ?p))
      (:action go :parameters (?x ?p ?q)
        :precondition (and (thing ?x) (place ?p) (place ?q) (at ?x ?p))
        :effect (and (not (at ?x ?p)) (at ?x ?q)))
      (:action spread :parameters (?p) :precondition (place ?p) :effect (at mud ?p)))";
    let problem = "(define (problem p) (:domain d) (:objects x y a b c)
      (:init (thing x) (thing y) (place a) (place b) (place c) (at x a) (at y b))
      (:goal (and (at x c) (at y a) (at mud a) (at mud b) (at mud c))))";
    check(domain, problem, &[3, 3], 5);
}

#[test]
fn facts_added_together_form_no_group() {
    let domain = "(define (domain d) (:predicates (a) (b) (c))
      (:action one :precondition (c) :effect (and (not (c)) (a) (b))))";
    let problem = "(define (problem p) (:domain d) (:init (c)) (:goal (and (a) (b))))";
    let task = task(domain, problem);
    let both = |group: &Vec<FactId>| group.len() > 2;
    assert!(!find(&task).groups().iter().any(both));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn no_walk_violates_a_group(
        (actions, initial) in texts(),
        steps in proptest::collection::vec(any::<proptest::sample::Index>(), 40),
    ) {
        let Some(task) = reached(&actions, &initial) else { return Ok(()) };
        let groups = find(&task);
        let mut progression = Progression::new(&task);
        let mut state = progression.initial();
        let mut next = Vec::new();
        for step in steps {
            for group in groups.groups() {
                let count = group.iter().filter(|fact| is_true(&state, **fact)).count();
                prop_assert!(count <= 1, "{group:?} has {count}");
            }
            let applicable: Vec<OperatorId> = (0..task.operator_count() as u32)
                .map(OperatorId)
                .filter(|id| all_hold(&state, task.operator(*id).preconditions))
                .collect();
            if applicable.is_empty() {
                break;
            }
            if progression.apply(task.operator(*step.get(&applicable)), &state, &mut next) {
                std::mem::swap(&mut state, &mut next);
            }
        }
    }
}
