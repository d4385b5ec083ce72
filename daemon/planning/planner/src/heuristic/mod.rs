//! Heuristics: estimates of the distance from a state to the goal.
//!
//! All heuristics here use the delete relaxation. If the relaxation has no plan, the task has none
//! either, so a detected dead end is proved.

mod additive;
mod cost_queue;
mod deficits;
mod ff;
mod landmark_cut;
mod landmarks;
mod max;
mod novelty;
mod relaxation;

pub(crate) use ff::FastForward;
pub(crate) use landmark_cut::LandmarkCut;
pub(crate) use landmarks::LandmarkCount;
pub(crate) use max::MaxHeuristic;
pub(crate) use novelty::{NOT_NOVEL, Novelty};
pub(crate) use relaxation::{STEPS_PER_COST, Weights};

use crate::state::{State, StateId, Transition};
use crate::task::{OperatorId, Task};

/// An evaluator: estimates the cost from a state to the nearest goal state.
pub(crate) trait Evaluator {
    /// Returns an estimate of the cost from `state` to the goal; `None` if no plan passes through
    /// `state`.
    fn evaluate(&mut self, state: &State) -> Option<u64>;

    /// Estimates the cost as [`Evaluator::evaluate`] does, for a state after the given transition.
    /// `id` identifies the state in later calls. Results for the parent state may be reused.
    fn evaluate_after(
        &mut self,
        state: &State,
        _id: StateId,
        _way: Option<Transition>,
    ) -> Option<u64> {
        self.evaluate(state)
    }

    /// Limits the next evaluation to `explorations_max` explorations of the relaxation. The
    /// evaluation may also stop when the estimate is at least `enough`. Fewer explorations give a
    /// lower estimate.
    fn limit(&mut self, _explorations_max: u64, _enough: u64) {}

    /// Returns the number of explorations of the relaxation in the last evaluation, which is the
    /// measure of its work.
    fn explorations(&self) -> u64 {
        1
    }

    /// Returns the preferred operators of the last evaluated state.
    fn preferred(&self) -> &[OperatorId] {
        &[]
    }

    /// Returns the approximate number of bytes of the evaluator.
    fn bytes(&self) -> usize {
        0
    }
}

/// A heuristic for A*: it never overestimates the cost to the goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Admissible {
    Blind,
    Max,
    LandmarkCut,
}

impl Admissible {
    /// Returns the name of this heuristic in [`HEURISTICS`].
    #[cfg(test)]
    pub(crate) fn name(self) -> &'static str {
        match self {
            Admissible::Blind => "blind",
            Admissible::Max => "max",
            Admissible::LandmarkCut => "lmcut",
        }
    }

    /// Builds the evaluator of this heuristic for a task.
    pub(crate) fn evaluator(self, task: &Task) -> Box<dyn Evaluator + '_> {
        match self {
            Admissible::Blind => Box::new(BlindHeuristic),
            Admissible::Max => Box::new(MaxHeuristic::new(task)),
            Admissible::LandmarkCut => Box::new(LandmarkCut::new(task)),
        }
    }
}

/// Description of a heuristic; an entry of [`HEURISTICS`].
#[derive(Clone, Copy, Debug)]
pub struct Heuristic {
    /// Name of the heuristic in search configurations.
    pub name: &'static str,
    /// Description of the heuristic in one line.
    pub summary: &'static str,
    /// Whether the heuristic is admissible: it never overestimates the cost to the goal.
    pub admissible: bool,
    /// Whether the heuristic is consistent: its estimate never decreases along a step by more than
    /// the step's cost.
    pub consistent: bool,
}

/// All heuristics of this crate.
pub const HEURISTICS: &[Heuristic] = &[
    Heuristic { name: "blind", summary: "zero, everywhere", admissible: true, consistent: true },
    Heuristic {
        name: "max",
        summary: "the most expensive goal, reached alone and without deletes",
        admissible: true,
        consistent: true,
    },
    Heuristic {
        name: "lmcut",
        summary: "the sum of landmarks that cuts in the relaxation find; each is paid for once",
        admissible: true,
        consistent: false,
    },
    Heuristic {
        name: "ff",
        summary: "the number of operators in a plan without deletes; its first ones are preferred",
        admissible: false,
        consistent: false,
    },
    Heuristic {
        name: "landmarks",
        summary: "the number of landmarks (facts of every plan) not achieved yet, or lost again",
        admissible: false,
        consistent: false,
    },
    Heuristic {
        name: "novelty",
        summary: "the size of the smallest set of facts never seen together before",
        admissible: false,
        consistent: false,
    },
];

struct BlindHeuristic;

impl Evaluator for BlindHeuristic {
    fn evaluate(&mut self, _: &State) -> Option<u64> {
        Some(0)
    }
}
