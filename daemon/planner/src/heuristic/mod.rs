//! Heuristics: how far a state is from the goal.
//!
//! All of them work on the delete relaxation, which never calls a state hopeless that is not; so a
//! dead end found here is a proof.

mod ff;
mod landmark_cut;
mod max;
mod queue;
mod relaxation;

pub(crate) use ff::FastForward;
pub(crate) use landmark_cut::LandmarkCut;
pub(crate) use max::Max;
pub(crate) use relaxation::{Relaxation, Weights};

use crate::state::State;
use crate::task::{OperatorId, Task};

/// Estimates the cost from a state to the nearest goal state.
pub(crate) trait Evaluator {
    /// `None` means a dead end: no plan passes through `state`.
    fn evaluate(&mut self, state: &State) -> Option<u64>;

    /// How often the last evaluation explored the relaxation: the unit its work is counted in.
    fn explorations(&self) -> u64 {
        1
    }

    /// Operators that look helpful in the state last evaluated.
    fn preferred(&self) -> &[OperatorId] {
        &[]
    }
}

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
    pub(crate) build: for<'t> fn(&'t Task) -> Box<dyn Evaluator + 't>,
}

/// One entry per heuristic; what is listed here is what there is.
pub const HEURISTICS: &[Heuristic] = &[
    Heuristic {
        name: "blind",
        summary: "zero, everywhere",
        admissible: true,
        consistent: true,
        build: |_| Box::new(Blind),
    },
    Heuristic {
        name: "max",
        summary: "the dearest goal, reached alone and without deletes",
        admissible: true,
        consistent: true,
        build: |task| Box::new(Max::new(task)),
    },
    Heuristic {
        name: "lmcut",
        summary: "the sum of landmarks that cuts in the relaxation find; each is paid for once",
        admissible: true,
        consistent: false,
        build: |task| Box::new(LandmarkCut::new(task)),
    },
    Heuristic {
        name: "ff",
        summary: "the number of operators in a plan without deletes; its first ones are preferred",
        admissible: false,
        consistent: false,
        build: |task| Box::new(FastForward::new(task)),
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
