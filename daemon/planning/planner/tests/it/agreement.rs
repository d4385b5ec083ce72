//! Compares the planner with brute force on random small tasks.
//!
//! The planner must find a plan if and only if the task is solvable. A cost that the planner claims
//! to be the least must be the least. Every order of steps that deordering allows must lead to the
//! goal.
//!
//! `ALTHING_TASKS=10000` sets the number of tasks, and `ALTHING_TASKS_SEED=7` the random seed. With
//! `ALTHING_TASKS_FOLDER=FOLDER` each task is written to that folder with its least cost, so that
//! other planners can be compared (`benches/random_tasks.py`).

use std::sync::atomic::{AtomicUsize, Ordering};

use planner::order::deorder;
use planner::validate::World;
use planner::{
    CONFIGURATIONS, Cancel, Effort, Options, PlanningProgress, StopReason, plan, plan_with_progress,
};
use proptest::prelude::*;

use crate::brute_force::least_cost_within;
use crate::ordering::assert_all_orders_work;
use crate::support::{domain, parse, problem};

/// Objects of the tasks; each task uses the first few of them.
const OBJECTS: [&str; 4] = ["a", "b", "e", "f"];

/// Maximum number of states for brute force. A task with more states is replaced by another one.
const STATES_MAX: usize = 2_000;

/// Generates a term: a variable in scope, or an object as a placeholder, which gets its name later.
fn term(variables: usize) -> impl Strategy<Value = String> {
    prop_oneof![
        variables as u32 => (0..variables.max(1)).prop_map(|index| format!("?v{index}")),
        2 => (0..OBJECTS.len()).prop_map(|index| format!("object{index}")),
    ]
}

/// Replaces the placeholders of objects in a text by the names of `count` objects.
pub(crate) fn with_objects(text: &str, count: usize) -> String {
    let names = (0..OBJECTS.len()).map(|index| OBJECTS[index % count]);
    names
        .enumerate()
        .fold(text.to_owned(), |text, (index, name)| text.replace(&format!("object{index}"), name))
}

/// Generates a number of objects from one to four. With one object, each variable has only one
/// value, so that lifted parts become ground.
fn object_count() -> impl Strategy<Value = usize> {
    prop_oneof![3 => Just(1_usize), 4 => Just(2), 2 => Just(3), 1 => Just(4)]
}

/// Returns declarations of this number of constants; every second one is of type `t`.
fn constants(count: usize) -> String {
    let typed = OBJECTS[..count].iter().enumerate().map(|(index, name)| match index % 2 {
        0 => format!("{name} - t "),
        _ => format!("{name} - object "),
    });
    typed.collect()
}

pub(crate) fn atom(variables: usize) -> BoxedStrategy<String> {
    prop_oneof![
        Just("(z)".to_owned()),
        term(variables).prop_map(|x| format!("(p {x})")),
        term(variables).prop_map(|x| format!("(q {x})")),
        (term(variables), term(variables)).prop_map(|(x, y)| format!("(r {x} {y})")),
    ]
    .boxed()
}

/// Generates a condition over the variables `?v0 … ?v(n-1)`. Atoms `(d …)` are derived, and `(s …)`
/// is static.
fn condition(variables: usize, depth: usize) -> BoxedStrategy<String> {
    let leaf = prop_oneof![
        6 => atom(variables),
        1 => term(variables).prop_map(|x| format!("(d {x})")),
        1 => (term(variables), term(variables)).prop_map(|(x, y)| format!("(s {x} {y})")),
        1 => (term(variables), term(variables)).prop_map(|(x, y)| format!("(= {x} {y})")),
    ];
    if depth == 0 {
        return leaf.boxed();
    }
    let inner = || condition(variables, depth - 1);
    let inside = || condition(variables + 1, depth - 1);
    prop_oneof![
        4 => leaf,
        2 => inner().prop_map(|part| format!("(not {part})")),
        2 => prop::collection::vec(inner(), 0..3).prop_map(|all| format!("(and {})", all.concat())),
        2 => prop::collection::vec(inner(), 1..3).prop_map(|all| format!("(or {})", all.concat())),
        1 => (inner(), inner()).prop_map(|(left, right)| format!("(imply {left} {right})")),
        1 => inside().prop_map(move |part| format!("(exists (?v{variables} - t) {part})")),
        1 => inside().prop_map(move |part| format!("(forall (?v{variables}) {part})")),
    ]
    .boxed()
}

fn literal(variables: usize) -> impl Strategy<Value = String> {
    (prop::bool::weighted(0.6), atom(variables))
        .prop_map(|(adds, atom)| if adds { atom } else { format!("(not {atom})") })
}

/// Generates a conjunction. Several conditions together make few tasks trivial or unsolvable.
pub(crate) fn conjunction(
    variables: usize,
    parts: std::ops::Range<usize>,
) -> impl Strategy<Value = String> {
    let part = prop_oneof![
        8 => atom(variables),
        4 => atom(variables).prop_map(|atom| format!("(not {atom})")),
        1 => condition(variables, 2),
    ];
    prop::collection::vec(part, parts).prop_map(|all| format!("(and {})", all.concat()))
}

fn effect(variables: usize) -> BoxedStrategy<String> {
    prop_oneof![
        4 => literal(variables),
        1 => (condition(variables, 1), literal(variables))
            .prop_map(|(when, then)| format!("(when {when} {then})")),
        1 => (condition(variables + 1, 1), literal(variables + 1))
            .prop_map(move |(when, then)| format!("(forall (?v{variables}) (when {when} {then}))")),
    ]
    .boxed()
}

pub(crate) fn action() -> impl Strategy<Value = String> {
    (1..3usize, 0..4u32).prop_flat_map(|(variables, cost)| {
        let effects = prop::collection::vec(effect(variables), 2..5);
        (conjunction(variables, 0..3), effects).prop_map(move |(precondition, effects)| {
            let parameters: String = (0..variables).map(|index| format!(" ?v{index}")).collect();
            format!(
                ":parameters ({parameters}) :precondition {precondition}
                 :effect (and {} (increase (total-cost) {cost}))",
                effects.concat()
            )
        })
    })
}

/// Generates a condition that defines `(d ?v0)`.
pub(crate) fn axiom() -> impl Strategy<Value = String> {
    prop_oneof![
        Just("(p ?v0)".to_owned()),
        Just("(exists (?v1) (and (r ?v0 ?v1) (not (q ?v1))))".to_owned()),
        Just("(or (q ?v0) (exists (?v1) (and (r ?v0 ?v1) (d ?v1))))".to_owned()),
    ]
}

fn task() -> impl Strategy<Value = (String, String)> {
    let actions = prop::collection::vec(action(), 3..6);
    let init = prop::collection::vec(atom(0), 0..6);
    (actions, init, axiom(), conjunction(0, 2..5), any::<bool>(), object_count()).prop_map(
        |(actions, init, axiom, goal, metric, count)| {
            let constants = constants(count);
            let mut parts = format!(
                "(:types t) (:constants {constants})
                 (:predicates (z) (p ?x) (q ?x) (r ?x ?y) (d ?x) (s ?x ?y))
                 (:functions (total-cost)) (:derived (d ?v0) {axiom})"
            );
            for (index, action) in actions.iter().enumerate() {
                parts += &format!("(:action act{index} {action})");
            }
            let metric = if metric { "(:metric minimize (total-cost))" } else { "" };
            let rest =
                format!("(:init (s object0 object1) {}) (:goal {goal}) {metric}", init.concat());
            (with_objects(&domain(&parts), count), with_objects(&problem(&rest), count))
        },
    )
}

/// Returns the number in an environment variable, or the default if the variable is not set.
fn given(variable: &str, default: u32) -> u32 {
    match std::env::var(variable) {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("{variable}: `{text}` is no number")),
        Err(_) => default,
    }
}

fn drawn(cases: u32, seed: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        max_global_rejects: cases.max(500) * 20,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(seed.into()),
        ..ProptestConfig::default()
    }
}

/// Writes a task to a folder, together with the result of brute force: its least cost, or `none`.
fn keep(folder: &str, domain: &str, problem: &str, truth: Option<f64>) {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let truth = truth.map_or("none".to_owned(), |cost| cost.to_string());
    for (kind, text) in [("domain.pddl", domain), ("problem.pddl", problem), ("cost", &truth)] {
        let path = std::path::Path::new(folder).join(format!("{number:05}-{kind}"));
        std::fs::write(&path, text).unwrap_or_else(|err| panic!("{}: {err}", path.display()));
    }
}

proptest! {
    #![proptest_config(drawn(given("ALTHING_TASKS", 500), given("ALTHING_TASKS_SEED", 2_026)))]

    #[test]
    fn planner_and_brute_force_agree(texts in task()) {
        let (domain, problem) = parse(&texts.0, &texts.1);
        let outcome = plan(&domain, &problem, &Options::default(), &Cancel::new())
            .map_err(|err| TestCaseError::fail(err.to_string()))?;
        let Ok(truth) = least_cost_within(&domain, &problem, STATES_MAX) else {
            return Err(TestCaseError::reject("too large to try everything"));
        };
        if let Ok(folder) = std::env::var("ALTHING_TASKS_FOLDER") {
            keep(&folder, &texts.0, &texts.1, truth);
        }
        match (&outcome.plan, truth) {
            (Some(plan), Some(least)) => {
                prop_assert!(outcome.statistics.proven_optimal);
                let cost = plan.cost.map_or(f64::NAN, |cost| cost.0);
                prop_assert!((cost - least).abs() < 1e-6, "found {cost}, least {least}");
                let world = World::initial(&domain, &problem).expect("it is planned for");
                let order = deorder(&world, &plan.steps);
                assert_all_orders_work(&domain, &problem, plan, &order, 50);
            }
            (None, None) => {
                let is_proof = matches!(outcome.stop_reason, StopReason::Unsolvable { .. });
                prop_assert!(is_proof, "{}", outcome.stop_reason);
            }
            (plan, truth) => prop_assert!(false, "planner {plan:?}, truth {truth:?}"),
        }
    }
}

proptest! {
    #![proptest_config(drawn(60, 2_027))]

    #[test]
    fn all_configurations_agree((domain, problem) in task()) {
        let (domain, problem) = parse(&domain, &problem);
        let Ok(truth) = least_cost_within(&domain, &problem, STATES_MAX / 4) else {
            return Err(TestCaseError::reject("too large to try everything"));
        };
        for options in ways() {
            let name = (options.configuration.name, options.effort, options.threads);
            let mut told = Vec::new();
            let mut tell = |news: PlanningProgress<'_>| {
                if let PlanningProgress::Plan(plan) = news {
                    told.push(plan.cost.map_or(f64::NAN, |cost| cost.0));
                }
            };
            let outcome = plan_with_progress(&domain, &problem, &options, &Cancel::new(), &mut tell)
                .map_err(|err| TestCaseError::fail(err.to_string()))?;
            prop_assert_eq!(outcome.plan.is_some(), truth.is_some(), "{:?}", name);
            prop_assert!(told.is_sorted_by(|one, next| next < one), "{name:?} told {told:?}");
            let (Some(plan), Some(least)) = (outcome.plan, truth) else {
                let is_proof = matches!(outcome.stop_reason, StopReason::Unsolvable { .. });
                prop_assert!(is_proof, "{name:?}: {}", outcome.stop_reason);
                continue;
            };
            // These searches end only if no cheaper plan is left.
            let is_best = options.configuration.optimal || options.effort != Effort::First;
            let cost = plan.cost.map_or(f64::NAN, |cost| cost.0);
            prop_assert!(cost >= least - 1e-6, "{name:?} found {cost}, least {least}");
            prop_assert!(!is_best || cost <= least + 1e-6, "{name:?} found {cost}, least {least}");
        }
    }
}

/// Returns the options of all runs: every configuration alone, on two threads, and with further
/// effort after the first plan.
fn ways() -> Vec<Options> {
    let mut ways = Vec::new();
    for configuration in CONFIGURATIONS {
        let plain = Options { configuration, optimal_expansions_max: 0, ..Options::default() };
        ways.push(plain);
        ways.push(Options { threads: 2, ..plain });
        ways.push(Options { effort: Effort::Anytime, ..plain });
        ways.push(Options { effort: Effort::Optimal, ..plain });
    }
    ways
}
