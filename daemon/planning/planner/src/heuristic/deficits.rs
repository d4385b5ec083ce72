//! Deficits of a relaxed plan: numeric conditions that its own steps use up, such as fuel, supplies
//! or the order of two counters. The delete relaxation ignores what a step takes away, so that its
//! plans refuel once, whatever the length of the journey.
//!
//! The margins of a relaxed plan add up what all its steps give and take, in any order. Where the
//! sum is below the bound, the cheapest operator that raises the margin is added as often as the
//! deficit requires. This may use up something else, so it is repeated for a few rounds.

use super::additive::AdditiveHeuristic;
use super::relaxation::{MarginChange, Margins, NumericCondition, Relaxation};
use crate::rows::Rows;
use crate::state::State;
use crate::task::{OperatorId, Task};

/// Tolerance for the comparison of a sum with a bound.
const EPSILON: f64 = 1e-6;

/// Maximum number of repetitions of one operator that cover a deficit.
const TIMES_MAX: f64 = 1_000.0;

/// The numeric conditions of a task, with their sums in one relaxed plan.
#[derive(Debug)]
pub(super) struct Deficits {
    margins: Margins,
    /// Per comparison: the relaxed operators that approach its bound.
    approaching: Rows,
    /// Per condition: its margin in the evaluated state.
    present: Vec<f64>,
    /// Per condition: its margin after all steps of the plan.
    sums: Vec<f64>,
    /// Per condition: the most that a step of the plan which requires the condition takes from it.
    /// The last of these steps may take the sum below the bound.
    last: Vec<f64>,
}

/// Relaxed operator that covers a deficit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cover {
    /// The proposition of the numeric condition.
    pub(super) proposition: u32,
    pub(super) relaxed: u32,
    pub(super) operator: OperatorId,
    pub(super) times: u32,
}

// === impl Deficits ===

impl Deficits {
    /// Returns `None` for a task whose operators change no number that matters.
    pub(super) fn new(task: &Task, relaxation: &Relaxation) -> Option<Deficits> {
        relaxation.has_numbers().then(|| Deficits {
            margins: Margins::new(task, relaxation),
            approaching: relaxation.approaching(),
            present: Vec::new(),
            sums: Vec::new(),
            last: Vec::new(),
        })
    }

    /// Returns the relaxed operators that approach the bound of a comparison; none for another
    /// proposition.
    pub(super) fn approaching(&self, proposition: u32) -> &[u32] {
        self.approaching.row(proposition)
    }

    /// Begins with the relaxed plans of a state.
    pub(super) fn start(&mut self, task: &Task, state: &State) {
        self.margins.measure(&state[task.fact_count.div_ceil(64)..], &mut self.present);
    }

    /// Finds a cover for each deficit of a plan. `plan` contains its operators with their
    /// repetitions. `is_needed` tells whether the plan requires or reaches a proposition.
    pub(super) fn find(
        &mut self,
        relaxation: &Relaxation,
        additive: &AdditiveHeuristic,
        plan: impl Iterator<Item = (OperatorId, u32)>,
        is_needed: impl Fn(u32) -> bool,
        found: &mut Vec<Cover>,
    ) {
        found.clear();
        self.add_up(plan);
        for (index, condition) in self.margins.conditions().iter().enumerate() {
            let sum = self.sums[index] + self.last[index];
            let holds = if condition.is_strict { sum > EPSILON } else { sum >= -EPSILON };
            if holds || sum.is_nan() || !is_needed(condition.proposition) {
                continue;
            }
            let covers = self.covers(relaxation, index, condition, -sum);
            let cost = |cover: &Cover| cost(relaxation, additive, cover, &is_needed);
            let cheapest = covers.filter_map(|cover| Some((cost(&cover)?, cover)));
            found.extend(cheapest.min_by_key(|(cost, _)| *cost).map(|(_, cover)| cover));
        }
    }

    fn add_up(&mut self, plan: impl Iterator<Item = (OperatorId, u32)>) {
        self.sums.clone_from(&self.present);
        self.last.clear();
        self.last.resize(self.sums.len(), 0.0);
        for (operator, times) in plan {
            for change in self.margins.changes(operator) {
                let index = change.condition as usize;
                self.sums[index] += change.by * f64::from(times);
                if change.is_required && !self.margins.conditions()[index].is_goal {
                    self.last[index] = self.last[index].max(-change.by);
                }
            }
        }
    }

    /// Returns each operator that raises the margin of a condition, as often as `deficit` requires.
    fn covers(
        &self,
        relaxation: &Relaxation,
        index: usize,
        condition: &NumericCondition,
        deficit: f64,
    ) -> impl Iterator<Item = Cover> {
        let NumericCondition { proposition, is_strict, .. } = *condition;
        let operators = self.approaching.row(proposition).iter();
        operators.filter_map(move |&relaxed| {
            let operator = relaxation.origin(relaxed)?;
            let changes = self.margins.changes(operator).iter();
            let raises =
                |change: &&MarginChange| change.condition as usize == index && change.by > 0.0;
            let by = { changes }.find(raises)?.by;
            let times = match is_strict {
                true => (deficit / by + EPSILON).floor() + 1.0,
                false => (deficit / by - EPSILON).ceil().max(1.0),
            };
            Some(Cover { proposition, relaxed, operator, times: times.min(TIMES_MAX) as u32 })
        })
    }

    /// Returns the number of bytes of the tables.
    pub(super) fn bytes(&self) -> usize {
        self.margins.bytes() + self.approaching.bytes() + self.present.len() * 24
    }
}

/// Returns what a cover adds to the cost of a plan; `None` if it has an unreached precondition.
/// Preconditions that the plan needs anyway cost nothing.
fn cost(
    relaxation: &Relaxation,
    additive: &AdditiveHeuristic,
    cover: &Cover,
    is_needed: impl Fn(u32) -> bool,
) -> Option<u64> {
    let steps = relaxation.base_cost(cover.relaxed).saturating_mul(u64::from(cover.times));
    let preconditions = relaxation.preconditions(cover.relaxed).iter();
    let mut others = preconditions.filter(|one| !is_needed(**one));
    others.try_fold(steps, |sum, one| {
        Some(sum.saturating_add(u64::from(additive.reached_cost(*one)?)))
    })
}
