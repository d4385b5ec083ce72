//! The FF heuristic: the cost of a plan for the delete relaxation (Hoffmann and Nebel, 2001). The
//! best supporters are those of h_add (Keyder and Geffner, 2008).

use super::Evaluator;
use super::additive::{AdditiveHeuristic, NO_SUPPORTER};
use super::relaxation::{Relaxation, Weights};
use crate::state::{State, all_hold};
use crate::task::{OperatorId, Task};

/// Maximum length of the stored relaxed plan; further steps are not stored. A longer plan is
/// unlikely to be executable.
const PLAN_MAX: usize = 10_000;

/// Number of occurrences of an operator in a relaxed plan.
#[derive(Clone, Copy, Debug, Default)]
struct OperatorMark {
    /// Number of the evaluation that set the mark. The mark of an earlier evaluation is treated as
    /// zero.
    evaluation: u32,
    times: u32,
}

/// The FF heuristic of a task.
#[derive(Debug)]
pub(crate) struct FastForward<'t> {
    task: &'t Task,
    relaxation: Relaxation,
    additive: AdditiveHeuristic,
    preferred: Vec<OperatorId>,
    /// Last relaxed plan, unordered. An operator that must be repeated occurs several times.
    plan: Vec<OperatorId>,
    /// Per proposition: the number of the last evaluation that visited it.
    marks: Vec<u32>,
    operator_marks: Vec<OperatorMark>,
    evaluation: u32,
    waiting: Vec<u32>,
}

// === impl FastForward ===

impl<'t> FastForward<'t> {
    pub(crate) fn new(task: &'t Task, weights: Weights) -> FastForward<'t> {
        let relaxation = Relaxation::simplified(task, weights);
        FastForward {
            task,
            additive: AdditiveHeuristic::new(&relaxation),
            preferred: Vec::new(),
            plan: Vec::new(),
            marks: vec![0; relaxation.proposition_count()],
            operator_marks: vec![OperatorMark::default(); task.operators.len()],
            evaluation: 0,
            waiting: Vec::new(),
            relaxation,
        }
    }

    /// Returns the size of the relaxation, which is a measure of the work of one evaluation.
    pub(crate) fn size(&self) -> usize {
        self.relaxation.size()
    }

    /// Returns the delete relaxation that this heuristic plans in.
    pub(crate) fn relaxation(&self) -> &Relaxation {
        &self.relaxation
    }

    /// Returns the operators of the last relaxed plan, unordered.
    pub(crate) fn relaxed_plan(&self) -> &[OperatorId] {
        &self.plan
    }

    /// Returns the propositions that the last relaxed plan makes true and that do not hold in the
    /// evaluated state.
    pub(crate) fn relaxed_propositions(&self) -> Vec<u32> {
        let marked = (0..self.marks.len()).filter(|one| self.marks[*one] == self.evaluation);
        marked.map(|one| one as u32).filter(|one| !self.is_given(*one)).collect()
    }

    /// Returns the h_add cost of the most expensive positive precondition of an operator. Sorting
    /// operators by this cost gives an ordered relaxed plan.
    pub(crate) fn depth(&self, operator: OperatorId) -> u64 {
        let preconditions = self.task.operator(operator).preconditions.iter();
        let costs = preconditions
            .filter(|literal| literal.is_positive())
            .map(|literal| u64::from(self.additive.cost(literal.fact().0)));
        costs.max().unwrap_or(0)
    }

    fn mark(&mut self, proposition: u32) {
        let mark = &mut self.marks[proposition as usize];
        if *mark != self.evaluation {
            *mark = self.evaluation;
            self.waiting.push(proposition);
        }
    }

    /// Extracts the relaxed plan backwards from the goal, and returns its cost. The plan's
    /// operators that are applicable in `state` become the preferred operators.
    fn extract(&mut self, state: &State) -> u64 {
        let mut size: u64 = 0;
        self.evaluation += 1;
        for index in 0..self.relaxation.goal().len() {
            self.mark(self.relaxation.goal()[index]);
        }
        while let Some(proposition) = self.waiting.pop() {
            if self.is_given(proposition) {
                continue;
            }
            let supporter = self.additive.supporter(proposition);
            for index in 0..self.relaxation.preconditions(supporter).len() {
                self.mark(self.relaxation.preconditions(supporter)[index]);
            }
            let Some(operator) = self.relaxation.origin(supporter) else { continue };
            let times = self.additive.repetitions(&self.relaxation, proposition);
            let mark = &mut self.operator_marks[operator.index()];
            let known = if mark.evaluation == self.evaluation { mark.times } else { 0 };
            if times <= known {
                continue;
            }
            *mark = OperatorMark { evaluation: self.evaluation, times };
            let further = u64::from(times - known);
            let cost = self.relaxation.base_cost(supporter).saturating_mul(further);
            size = size.saturating_add(cost);
            let room = PLAN_MAX.saturating_sub(self.plan.len());
            self.plan.extend(std::iter::repeat_n(operator, room.min(further as usize)));
            if known == 0 && all_hold(state, self.task.operator(operator).preconditions) {
                self.preferred.push(operator);
            }
        }
        size
    }

    /// Whether a proposition holds in the evaluated state and needs no supporter.
    fn is_given(&self, proposition: u32) -> bool {
        self.additive.supporter(proposition) == NO_SUPPORTER
    }
}

impl Evaluator for FastForward<'_> {
    fn evaluate(&mut self, state: &State) -> Option<u64> {
        self.preferred.clear();
        self.plan.clear();
        if !self.additive.explore(&self.relaxation, state) {
            return None;
        }
        let size = self.extract(state);
        self.preferred.sort_unstable();
        Some(size)
    }

    fn preferred(&self) -> &[OperatorId] {
        &self.preferred
    }

    fn bytes(&self) -> usize {
        self.relaxation.bytes() + self.additive.bytes() + self.operator_marks.len() * 8
    }
}
