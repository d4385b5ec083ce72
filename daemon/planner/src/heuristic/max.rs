//! h_max: the cost of the most expensive goal proposition in the delete relaxation, where a conjunction
//! costs as much as its most expensive part (Bonet and Geffner, 2001). It is admissible and consistent.

use super::Evaluator;
use super::relaxation::{Exploration, Relaxation, Weights};
use crate::state::State;
use crate::task::Task;

/// h_max, with costs that count first and steps second.
#[derive(Debug)]
pub(crate) struct Max {
    relaxation: Relaxation,
    exploration: Exploration,
}

// === impl Max ===

impl Max {
    pub(crate) fn new(task: &Task) -> Max {
        Max {
            relaxation: Relaxation::new(task, Weights::CostThenSteps),
            exploration: Exploration::default(),
        }
    }
}

impl Evaluator for Max {
    fn evaluate(&mut self, state: &State) -> Option<u64> {
        let Max { relaxation, exploration } = self;
        if !relaxation.explore(state, exploration) {
            return None;
        }
        let goal = relaxation.goal().iter().map(|goal| exploration.costs[*goal as usize]);
        Some(goal.max().unwrap_or(0))
    }
}
