//! Groups in small tasks that are well known, and walks that never leave them.

use proptest::prelude::*;

use super::*;
use crate::ground::ground;
use crate::limits::Budget;
use crate::normalize::normalize;
use crate::state::{Progression, all_hold, is_true};
use crate::task::OperatorId;

fn task(domain: &str, problem: &str) -> Task {
    let domain = pddl::parse_domain(domain).into_result().expect("a domain");
    let problem = pddl::parse_problem(problem).into_result().expect("a problem");
    let lifted = normalize(&domain, &problem).expect("supported");
    let grounded = ground(&lifted, Budget::default(), &Cancel::new(), &mut 0).expect("no limit");
    grounded.task.expect("a goal in reach")
}

fn find(task: &Task) -> MutexGroups {
    MutexGroups::find(task, u64::MAX, &Cancel::new())
}

/// The sizes of all groups, the largest first, and the number of variables.
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
fn balls_are_somewhere_or_in_a_hand_and_hands_hold_one() {
    let problem = "(define (problem p) (:domain gripper) (:objects a b x y z l r)
      (:init (room a) (room b) (ball x) (ball y) (ball z) (hand l) (hand r) (robot a)
        (at x a) (at y a) (at z a) (free l) (free r))
      (:goal (and (at x b) (at y b) (at z b))))";
    // Each ball: two rooms, two hands. Each hand: three balls, free. The robot: two rooms.
    check(GRIPPER, problem, &[4, 4, 4, 4, 4, 2], 6);
}

#[test]
fn conditional_moves_of_a_thing_keep_it_in_one_place() {
    let domain = "(define (domain d) (:predicates (at ?x ?p) (next ?p ?q))
      (:action turn :effect (forall (?x ?p ?q) (when (and (at ?x ?p) (next ?p ?q))
        (and (not (at ?x ?p)) (at ?x ?q))))))";
    let problem = "(define (problem p) (:domain d) (:objects x y a b c)
      (:init (next a b) (next b c) (next c a) (at x a) (at y b)) (:goal (and (at x c) (at y a))))";
    check(domain, problem, &[3, 3], 2);
}

#[test]
fn an_instance_that_fails_does_not_spoil_the_others() {
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
fn facts_added_together_are_no_group() {
    let domain = "(define (domain d) (:predicates (a) (b) (c))
      (:action one :precondition (c) :effect (and (not (c)) (a) (b))))";
    let problem = "(define (problem p) (:domain d) (:init (c)) (:goal (and (a) (b))))";
    let task = task(domain, problem);
    let both = |group: &Vec<FactId>| group.len() > 2;
    assert!(!find(&task).groups().iter().any(both));
}

/// A literal of one of a few atoms; `?v` is a parameter.
fn atom() -> impl Strategy<Value = String> {
    let term = || prop_oneof![Just("?v0"), Just("?v1"), Just("a"), Just("b")];
    prop_oneof![
        Just("(z)".to_owned()),
        term().prop_map(|one| format!("(p {one})")),
        term().prop_map(|one| format!("(q {one})")),
        (term(), term()).prop_map(|(one, two)| format!("(r {one} {two})")),
    ]
}

fn literal() -> impl Strategy<Value = String> {
    (atom(), proptest::bool::weighted(0.3))
        .prop_map(|(atom, not)| if not { format!("(not {atom})") } else { atom })
}

/// An action that mostly moves: what it deletes it has asked for.
fn action() -> impl Strategy<Value = String> {
    let conditional = (literal(), atom(), atom())
        .prop_map(|(when, gone, new)| format!("(when {when} (and (not {gone}) {new}))"));
    let parts = (
        proptest::collection::vec(atom(), 0..3),
        proptest::collection::vec(literal(), 0..2),
        proptest::collection::vec(literal(), 0..3),
        proptest::collection::vec(conditional, 0..3),
    );
    parts.prop_map(|(moved, asked, effects, conditional)| {
        let deletes: Vec<String> = moved.iter().map(|atom| format!("(not {atom})")).collect();
        format!(
            ":parameters (?v0 ?v1) :precondition (and {} {}) :effect (and {} {} {})",
            moved.join(" "),
            asked.join(" "),
            deletes.join(" "),
            effects.join(" "),
            conditional.join(" ")
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn no_walk_violates_a_group(
        actions in proptest::collection::vec(action(), 1..4),
        initial in proptest::collection::vec(prop_oneof![
            Just("(z)"), Just("(p a)"), Just("(q b)"), Just("(r a b)"), Just("(r b a)"),
        ], 0..4),
        steps in proptest::collection::vec(any::<proptest::sample::Index>(), 40),
    ) {
        let actions: Vec<String> = actions
            .iter()
            .enumerate()
            .map(|(index, action)| format!("(:action act{index} {action})"))
            .collect();
        let domain = format!(
            "(define (domain d) (:constants a b) (:predicates (z) (p ?x) (q ?x) (r ?x ?y)) {})",
            actions.join(" ")
        );
        // Every fact matters to some part of this goal, and most tasks reach one of them.
        let problem = format!(
            "(define (problem p) (:domain d) (:init {}) (:goal (or (z) (not (z)) (exists (?x ?y)
               (and (p ?x) (q ?x) (r ?x ?y))))))",
            initial.join(" ")
        );
        let domain = pddl::parse_domain(&domain).into_result().expect("a domain");
        let problem = pddl::parse_problem(&problem).into_result().expect("a problem");
        let lifted = normalize(&domain, &problem).expect("supported");
        let grounded =
            ground(&lifted, Budget::default(), &Cancel::new(), &mut 0).expect("no limit");
        let Some(task) = grounded.task else { return Ok(()) };
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
