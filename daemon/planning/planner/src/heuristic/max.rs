//! h_max: the cost of the most expensive goal proposition in the delete relaxation (Bonet and
//! Geffner, 2001). The cost of a conjunction is that of its most expensive part. The heuristic is
//! admissible and consistent.

use super::Evaluator;
use super::relaxation::{Exploration, Relaxation, Weights};
use crate::state::State;
use crate::task::Task;

/// The h_max heuristic of a task. Plans are compared by cost, and plans of equal cost by the number
/// of steps.
#[derive(Debug)]
pub(crate) struct MaxHeuristic {
    relaxation: Relaxation,
    exploration: Exploration,
}

// === impl MaxHeuristic ===

impl MaxHeuristic {
    pub(crate) fn new(task: &Task) -> MaxHeuristic {
        MaxHeuristic {
            relaxation: Relaxation::new(task, Weights::CostThenSteps),
            exploration: Exploration::default(),
        }
    }
}

impl Evaluator for MaxHeuristic {
    fn evaluate(&mut self, state: &State) -> Option<u64> {
        let MaxHeuristic { relaxation, exploration } = self;
        if !relaxation.explore(state, exploration) {
            return None;
        }
        let goal = relaxation.goal().iter().map(|goal| exploration.costs[*goal as usize]);
        Some(goal.max().unwrap_or(0))
    }
}
