//! Greedy best-first search with deferred evaluation and preferred operators.
//!
//! A state is only evaluated when it is taken out; its successors wait under its estimate. That is
//! one evaluation per expansion instead of one per successor.

use super::open::Alternation;
use super::{Search, Step};
use crate::heuristic::Evaluator;
use crate::outcome::StopReason;
use crate::state::{Progression, StateId, StateSpace, all_hold};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, Task};

/// Searches for any plan.
pub(crate) struct Greedy<'t> {
    task: &'t Task,
    evaluator: Box<dyn Evaluator + 't>,
    progression: Progression<'t>,
    generator: &'t SuccessorGenerator,
    space: StateSpace,
    open: Alternation,
    best: u64,
    started: bool,
    dead_end_at_start: bool,
    expansions: u64,
    evaluations: u64,
    successor: Vec<u64>,
    applicable: Vec<OperatorId>,
}

// === impl Greedy ===

impl<'t> Greedy<'t> {
    pub(crate) fn new(
        task: &'t Task,
        generator: &'t SuccessorGenerator,
        evaluator: Box<dyn Evaluator + 't>,
    ) -> Greedy<'t> {
        let mut progression = Progression::new(task);
        let space = StateSpace::new(&progression.initial());
        Greedy {
            task,
            evaluator,
            progression,
            generator,
            space,
            open: Alternation::default(),
            best: u64::MAX,
            started: false,
            dead_end_at_start: false,
            expansions: 0,
            evaluations: 0,
            successor: Vec::new(),
            applicable: Vec::new(),
        }
    }

    pub(crate) fn evaluations(&self) -> u64 {
        self.evaluations
    }

    fn start(&mut self) -> Step {
        self.started = true;
        let initial = StateId(0);
        if all_hold(self.space.state(initial), &self.task.goal) {
            return Step::Solved(Vec::new());
        }
        self.dead_end_at_start = !self.expand(initial);
        Step::InProgress
    }

    /// Evaluates a state and queues its successors; `false` at a dead end.
    fn expand(&mut self, id: StateId) -> bool {
        let state = self.space.state(id);
        self.evaluations += 1;
        let Some(estimate) = self.evaluator.evaluate(state) else { return false };
        self.expansions += 1;
        if estimate < self.best {
            self.best = estimate;
            self.open.boost();
        }
        self.generator.applicable(self.task, state, &mut self.applicable);
        let preferred = self.evaluator.preferred();
        for &operator in &self.applicable {
            let is_preferred = preferred.binary_search(&operator).is_ok();
            self.open.push(estimate, (id, operator), is_preferred);
        }
        true
    }
}

impl Search for Greedy<'_> {
    fn step(&mut self) -> Step {
        if !self.started {
            return self.start();
        }
        let Some((parent, operator)) = self.open.pop() else { return Step::Exhausted };
        let from = self.space.state(parent);
        if !self.progression.apply(self.task.operator(operator), from, &mut self.successor) {
            return Step::InProgress;
        }
        let (id, is_new) = self.space.insert(&self.successor, parent, operator);
        if !is_new {
            return Step::InProgress;
        }
        if all_hold(&self.successor, &self.task.goal) {
            return Step::Solved(self.space.path(id));
        }
        self.expand(id);
        Step::InProgress
    }

    fn expansions(&self) -> u64 {
        self.expansions
    }

    fn bytes(&self) -> usize {
        self.space.bytes() + self.open.bytes()
    }

    /// Only dead ends of the relaxation are left out, so an empty list is a proof.
    fn exhausted(&self) -> StopReason {
        StopReason::Unsolvable { before_search: self.dead_end_at_start }
    }
}
