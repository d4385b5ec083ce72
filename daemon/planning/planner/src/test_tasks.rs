//! Small tasks, random or written by hand, for unit tests.

use pddl::{Domain, Plan, Problem};
use proptest::prelude::*;

use crate::ground::ground;
use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::Lifted;
use crate::normalize::normalize;
use crate::options::{Effort, Options};
use crate::outcome::Statistics;
use crate::progression::Progression;
use crate::search::SearchProgress;
use crate::solve::Solver;
use crate::state::all_hold;
use crate::task::{OperatorId, Task};

/// Parses a domain and a problem from their texts.
pub(crate) fn parsed(domain: &str, problem: &str) -> (Domain, Problem) {
    let domain = pddl::parse_domain(domain).into_result().expect("a domain");
    let problem = pddl::parse_problem(problem).into_result().expect("a problem");
    (domain, problem)
}

/// Returns the lifted task of a domain text and a problem text.
pub(crate) fn lifted(domain: &str, problem: &str) -> Lifted {
    let (domain, problem) = parsed(domain, problem);
    normalize(&domain, &problem).expect("supported")
}

/// Returns the ground task of a domain text and a problem text; `None` if its goal is unreachable.
pub(crate) fn grounded(domain: &str, problem: &str) -> Option<Task> {
    let lifted = lifted(domain, problem);
    ground(&lifted, Budget::default(), &Cancel::new(), &mut 0).expect("no limit").task
}

/// Returns a cheapest plan of a lifted task, with its cost; `None` if there is no plan.
pub(crate) fn cheapest(lifted: &Lifted) -> Option<Plan> {
    let cancel = Cancel::new();
    let task = ground(lifted, Budget::default(), &cancel, &mut 0).expect("no limit").task?;
    let options = Options { effort: Effort::Optimal, ..Options::default() };
    let mut statistics = Statistics::default();
    let mut cheapest = None;
    Solver::new(&task, &options, &cancel, &mut statistics).run(&mut |told| {
        if let SearchProgress::Found(plan) = told {
            cheapest = Some(task.plan(plan));
        }
    });
    cheapest
}

pub(crate) fn task(domain: &str, problem: &str) -> Task {
    grounded(domain, problem).expect("a goal in reach")
}

/// Executes a plan, and asserts that each step applies and that the goal holds in the end.
pub(crate) fn assert_reaches_the_goal(task: &Task, plan: &[OperatorId]) {
    let mut progression = Progression::new(task);
    let (mut state, mut next) = (progression.initial(), Vec::new());
    for id in plan {
        let operator = task.operator(*id);
        assert!(all_hold(&state, operator.preconditions), "{}", task.step(*id));
        assert!(progression.apply(operator, &state, &mut next));
        std::mem::swap(&mut state, &mut next);
    }
    assert!(all_hold(&state, &task.goal));
}

/// Generates the arguments of [`reached`]: bodies of actions, and initial facts.
pub(crate) fn texts() -> impl Strategy<Value = (Vec<String>, Vec<&'static str>)> {
    let initial =
        prop_oneof![Just("(z)"), Just("(p a)"), Just("(q b)"), Just("(r a b)"), Just("(r b a)"),];
    (proptest::collection::vec(action(), 1..4), proptest::collection::vec(initial, 0..4))
}

/// Returns the ground task with these action bodies and initial facts; `None` if its goal is
/// unreachable. The goal is chosen so that every fact is relevant to a part of it, and so that it
/// is usually reachable in the delete relaxation.
pub(crate) fn reached(actions: &[String], initial: &[&str]) -> Option<Task> {
    let goal = "(or (z) (not (z)) (exists (?x ?y) (and (p ?x) (q ?x) (r ?x ?y))))";
    with_goal(actions, initial, goal)
}

/// Returns the ground task as [`reached`] does, with the goal `goal`.
pub(crate) fn with_goal(actions: &[String], initial: &[&str], goal: &str) -> Option<Task> {
    let named = actions.iter().enumerate();
    let actions: Vec<String> =
        named.map(|(index, action)| format!("(:action act{index} {action})")).collect();
    let domain = format!(
        "(define (domain d) (:constants a b) (:predicates (z) (p ?x) (q ?x) (r ?x ?y)) {})",
        actions.join(" ")
    );
    let initial = initial.join(" ");
    let problem = format!("(define (problem p) (:domain d) (:init {initial}) (:goal {goal}))");
    grounded(&domain, &problem)
}

/// Generates a goal of several parts for [`with_goal`].
pub(crate) fn conjunction() -> impl Strategy<Value = &'static str> {
    prop_oneof![
        Just("(and (z) (p a) (not (q b)))"),
        Just("(and (r a b) (r b a) (q a))"),
        Just("(and (p b) (not (z)))"),
    ]
}

/// Generates one of a few atoms. Its arguments are constants or the parameters `?v0` and `?v1`.
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

/// Generates the body of an action. Its unconditional deletes are usually preconditions, like those
/// of a moving action.
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
