//! Heuristics: how far a state is from the goal.
//!
//! All of them work on the delete relaxation, which never calls a state hopeless that is not; so a
//! dead end found here is a proof.

mod additive;
mod ff;
mod landmark_cut;
mod landmarks;
mod max;
mod novelty;
mod queue;
mod relaxation;

pub(crate) use ff::FastForward;
pub(crate) use landmark_cut::LandmarkCut;
pub(crate) use landmarks::LandmarkCount;
pub(crate) use max::Max;
pub(crate) use novelty::{NOT_NOVEL, Novelty};
pub(crate) use relaxation::{STEPS_PER_COST, Weights};

use crate::state::{State, StateId, Way};
use crate::task::{OperatorId, Task};

/// Estimates the cost from a state to the nearest goal state.
pub(crate) trait Evaluator {
    /// `None` means a dead end: no plan passes through `state`.
    fn evaluate(&mut self, state: &State) -> Option<u64>;

    /// The same of a state that a step leads to from another; `id` names it for steps that lead on.
    /// What was found out about the other one need not be found again.
    fn evaluate_after(&mut self, state: &State, _id: StateId, _way: Option<Way>) -> Option<u64> {
        self.evaluate(state)
    }

    /// Sets how often the next evaluation may explore the relaxation, if it does so more than once,
    /// and which estimate is enough: none need be higher. With less it says less.
    fn limit(&mut self, _explorations_max: u64, _enough: u64) {}

    /// How often the last evaluation explored the relaxation: the unit its work is counted in.
    fn explorations(&self) -> u64 {
        1
    }

    /// Operators that look helpful in the state last evaluated.
    fn preferred(&self) -> &[OperatorId] {
        &[]
    }

    /// About how many bytes it takes.
    fn bytes(&self) -> usize {
        0
    }
}

/// Makes a heuristic for a task.
pub(crate) type Build = for<'t> fn(&'t Task) -> Box<dyn Evaluator + 't>;

/// An entry of [`HEURISTICS`].
#[derive(Clone, Copy)]
pub struct Heuristic {
    /// What it is called.
    pub name: &'static str,
    /// One line about it.
    pub summary: &'static str,
    /// Whether it never overestimates.
    pub admissible: bool,
    /// Whether it never drops by more than a step costs.
    pub consistent: bool,
    /// What A* builds; only admissible ones have it.
    pub(crate) build: Option<Build>,
}

/// One entry per heuristic; what is listed here is what there is.
pub const HEURISTICS: &[Heuristic] = &[
    Heuristic {
        name: "blind",
        summary: "zero, everywhere",
        admissible: true,
        consistent: true,
        build: Some(|_| Box::new(Blind)),
    },
    Heuristic {
        name: "max",
        summary: "the most expensive goal, reached alone and without deletes",
        admissible: true,
        consistent: true,
        build: Some(|task| Box::new(Max::new(task))),
    },
    Heuristic {
        name: "lmcut",
        summary: "the sum of landmarks that cuts in the relaxation find; each is paid for once",
        admissible: true,
        consistent: false,
        build: Some(|task| Box::new(LandmarkCut::new(task))),
    },
    Heuristic {
        name: "ff",
        summary: "the number of operators in a plan without deletes; its first ones are preferred",
        admissible: false,
        consistent: false,
        build: None,
    },
    Heuristic {
        name: "landmarks",
        summary: "the number of facts that every plan achieves and this way has not, or lost again",
        admissible: false,
        consistent: false,
        build: None,
    },
    Heuristic {
        name: "novelty",
        summary: "the size of the smallest set of facts never seen together before",
        admissible: false,
        consistent: false,
        build: None,
    },
];

/// The entry of this name.
pub(crate) fn heuristic(name: &str) -> Option<&'static Heuristic> {
    HEURISTICS.iter().find(|heuristic| heuristic.name == name)
}

struct Blind;

impl Evaluator for Blind {
    fn evaluate(&mut self, _: &State) -> Option<u64> {
        Some(0)
    }
}

impl std::fmt::Debug for Heuristic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Heuristic { name, summary, admissible, consistent, build: _ } = self;
        f.debug_struct("Heuristic")
            .field("name", name)
            .field("summary", summary)
            .field("admissible", admissible)
            .field("consistent", consistent)
            .finish()
    }
}
