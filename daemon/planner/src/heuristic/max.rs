//! h_max: the cost of the dearest goal in the delete relaxation, where a conjunction costs what its
//! dearest part costs (Bonet and Geffner, 2001). Admissible and consistent.

use super::Evaluator;
use super::relaxation::{Exploration, Relaxation, Weights};
use crate::state::State;
use crate::task::Task;

/// h_max, counting costs first and steps second.
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
