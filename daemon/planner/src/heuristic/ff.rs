//! The FF heuristic: the size of a plan for the delete relaxation (Hoffmann and Nebel, 2001), with
//! best supporters by h_add (Keyder and Geffner, 2008).

use super::Evaluator;
use super::relaxation::{Combine, Exploration, NO_SUPPORTER, Relaxation, Weights};
use crate::state::{State, all_hold};
use crate::task::{OperatorId, Task};

/// The FF heuristic on unit costs.
#[derive(Debug)]
pub(crate) struct FastForward<'t> {
    task: &'t Task,
    relaxation: Relaxation,
    exploration: Exploration,
    preferred: Vec<OperatorId>,
    /// Propositions already looked at, by the number of the evaluation that did.
    marks: Vec<u32>,
    operator_marks: Vec<u32>,
    evaluation: u32,
    waiting: Vec<u32>,
}

// === impl FastForward ===

impl<'t> FastForward<'t> {
    pub(crate) fn new(task: &'t Task) -> FastForward<'t> {
        FastForward {
            task,
            relaxation: Relaxation::new(task, Weights::Unit),
            exploration: Exploration::default(),
            preferred: Vec::new(),
            marks: Vec::new(),
            operator_marks: vec![0; task.operator_count()],
            evaluation: 0,
            waiting: Vec::new(),
        }
    }

    fn mark(&mut self, proposition: u32) {
        let mark = &mut self.marks[proposition as usize];
        if *mark != self.evaluation {
            *mark = self.evaluation;
            self.waiting.push(proposition);
        }
    }

    /// Walks back from the goal; returns the size of the relaxed plan and notes the operators in it
    /// that can be applied at once.
    fn extract(&mut self, state: &State) -> u64 {
        let mut size = 0;
        self.evaluation += 1;
        self.marks.resize(self.exploration.costs.len(), 0);
        for index in 0..self.relaxation.goal().len() {
            self.mark(self.relaxation.goal()[index]);
        }
        while let Some(proposition) = self.waiting.pop() {
            let supporter = self.exploration.supporters[proposition as usize];
            if supporter == NO_SUPPORTER {
                continue;
            }
            for index in 0..self.relaxation.preconditions(supporter).len() {
                self.mark(self.relaxation.preconditions(supporter)[index]);
            }
            let Some(operator) = self.relaxation.origin(supporter) else { continue };
            let mark = &mut self.operator_marks[operator.index()];
            if *mark == self.evaluation {
                continue;
            }
            *mark = self.evaluation;
            size += self.relaxation.base_cost(supporter);
            if all_hold(state, self.task.operator(operator).preconditions) {
                self.preferred.push(operator);
            }
        }
        size
    }
}

impl Evaluator for FastForward<'_> {
    fn evaluate(&mut self, state: &State) -> Option<u64> {
        self.preferred.clear();
        let FastForward { relaxation, exploration, .. } = self;
        if !relaxation.explore(state, Combine::Add, true, exploration) {
            return None;
        }
        let size = self.extract(state);
        self.preferred.sort_unstable();
        Some(size)
    }

    fn preferred(&self) -> &[OperatorId] {
        &self.preferred
    }
}
