//! Drawn tasks: a plan with secrets exists exactly if a planner that sees everything finds one.

use std::fmt::Write as _;

use fastrand::Rng;
use pddl::factored::AgentFiles;

use crate::joint::{central, files, play, validated};

/// Number of drawn tasks. `ALTHING_SKELETON_TASKS` draws more.
const TASKS: u64 = 150;

const DOMAIN: &str = "(define (domain relay)
  (:requirements :typing :factored-privacy :negative-preconditions :conditional-effects
    :action-costs)
  (:types place item tool - object)
  (:predicates (at ?i - item ?p - place) (clean ?i - item)
    (:private (stands ?p - place) (road ?a ?b - place) (carries ?i - item) (free)
      (has ?t - tool) (lies ?t - tool ?p - place) (washes ?t - tool) (muddy ?p - place) (soiled)))
  (:functions (total-cost) - number (:private (toll ?a ?b - place) - number))
  (:action go :parameters (?a ?b - place) :precondition (and (stands ?a) (road ?a ?b))
    :effect (and (stands ?b) (not (stands ?a)) (when (muddy ?b) (soiled))
      (increase (total-cost) (toll ?a ?b))))
  (:action rinse :parameters (?p - place) :precondition (and (stands ?p) (not (muddy ?p)) (soiled))
    :effect (and (not (soiled)) (increase (total-cost) 1)))
  (:action grab :parameters (?t - tool ?p - place) :precondition (and (stands ?p) (lies ?t ?p))
    :effect (and (has ?t) (not (lies ?t ?p)) (increase (total-cost) 1)))
  (:action load :parameters (?i - item ?p - place)
    :precondition (and (stands ?p) (at ?i ?p) (free) (not (soiled)))
    :effect (and (carries ?i) (not (free)) (not (at ?i ?p)) (increase (total-cost) 1)))
  (:action unload :parameters (?i - item ?p - place)
    :precondition (and (stands ?p) (carries ?i))
    :effect (and (at ?i ?p) (free) (not (carries ?i)) (increase (total-cost) 1)))
  (:action wash :parameters (?i - item ?p - place ?t - tool)
    :precondition (and (stands ?p) (at ?i ?p) (has ?t) (or (washes ?t) (soiled)))
    :effect (and (clean ?i) (increase (total-cost) 1))))";

/// Draws a task: carriers on private roads with private tolls, each with tools of which some wash. In
/// mud a carrier is soiled, and loads nothing until it has rinsed itself. Public facts and goals stand
/// in the files of one carrier or of several.
fn draw(seed: u64) -> Vec<AgentFiles> {
    let mut rng = Rng::with_seed(seed);
    let (places, items, agents) = (rng.usize(2..5), rng.usize(1..3), rng.usize(2..4));
    let list = |kind: &str, count: usize| {
        (0..count).map(|number| format!("{kind}{number} ")).collect::<String>()
    };
    let (mut public, mut goals) = (Vec::new(), Vec::new());
    for item in 0..items {
        public.push(format!("(at item{item} place{}) ", rng.usize(0..places)));
        goals.push(format!("(at item{item} place{}) ", rng.usize(0..places)));
        if rng.bool() {
            goals.push(format!("(clean item{item}) "));
        }
    }
    // One agent at least states each of them.
    let [public, goals] =
        [public, goals].map(|all| all.into_iter().map(|it| (rng.usize(0..agents), it)).collect());
    let mut task = Vec::new();
    for agent in 0..agents {
        let mut stated = |all: &Vec<(usize, String)>| {
            let own = all.iter().filter(|(by, _)| *by == agent || rng.bool());
            own.map(|(_, it)| it.as_str()).collect::<String>()
        };
        let (public, goal) = (stated(&public), stated(&goals));
        let tools = rng.usize(1..3);
        let mut own = format!("(stands place{}) (free) ", rng.usize(0..places));
        for from in 0..places {
            for to in 0..places {
                if from != to && rng.f32() < 0.45 {
                    let toll = rng.usize(1..6);
                    let _ = write!(own, "(road place{from} place{to}) ");
                    let _ = write!(own, "(= (toll place{from} place{to}) {toll}) ");
                }
            }
        }
        for place in 0..places {
            if rng.f32() < 0.2 {
                let _ = write!(own, "(muddy place{place}) ");
            }
        }
        for tool in 0..tools {
            let _ = write!(own, "(lies tool{tool} place{}) ", rng.usize(0..places));
            if rng.f32() < 0.5 {
                let _ = write!(own, "(washes tool{tool}) ");
            }
        }
        let problem = format!(
            "(define (problem p) (:domain relay)
              (:objects {} - place {} - item (:private {} - tool))
              (:init (= (total-cost) 0) {public} {own}) (:goal (and {goal}))
              (:metric minimize (total-cost)))",
            list("place", places),
            list("item", items),
            list("tool", tools)
        );
        task.push(files(&format!("carrier{agent}"), DOMAIN, &problem));
    }
    task
}

#[test]
fn secrets_change_neither_what_is_possible_nor_what_is_proved() {
    let (mut solved, mut impossible) = (0, 0);
    let tasks = std::env::var("ALTHING_SKELETON_TASKS").ok().and_then(|it| it.parse().ok());
    for seed in 0..tasks.unwrap_or(TASKS) {
        let task = draw(seed);
        match (play(&task).steps, central(&task).is_some()) {
            (Some(steps), true) => {
                solved += 1;
                assert!(validated(&task, &steps).is_ok(), "{seed}: {steps:?}");
            }
            (None, false) => impossible += 1,
            (steps, _) => panic!("seed {seed}: {steps:?}"),
        }
    }
    assert!(solved >= 30 && impossible >= 30, "{solved} solved, {impossible} impossible");
}
