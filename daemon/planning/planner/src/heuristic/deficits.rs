//! Deficits of a relaxed plan: numeric conditions that its own steps use up, such as fuel, supplies
//! or the order of two counters. The delete relaxation ignores what a step takes away, so that its
//! plans refuel once, whatever the length of the journey.
//!
//! The margins of a relaxed plan add up what all its steps give and take, in any order. Where the
//! sum is below the bound, the cheapest operator that approaches the bound is added as often as the
//! deficit requires. This may use up something else, so it is repeated for a few rounds.

use super::additive::AdditiveHeuristic;
use super::relaxation::{Margins, NumericCondition, Relaxation, repeatable_change};
use crate::rows::Rows;
use crate::state::State;
use crate::task::{GroundOperator, OperatorId, Task};

/// Maximum number of repetitions of one operator for one deficit in one round. Beyond it, states
/// hardly differ.
const TIMES_MAX: u32 = 1_000;

/// The numeric conditions of a task, with the sums of one relaxed plan.
#[derive(Debug)]
pub(super) struct Deficits {
    margins: Margins,
    /// Per comparison: the relaxed operators that may reach its bound from some state.
    approaching: Rows,
    /// Per fluent: its value in the evaluated state.
    values: Vec<f64>,
    /// Per fluent: its change by all steps of the plan. Not a number if the amount of one of them is
    /// not known; conditions on this fluent have no deficit.
    sums: Vec<f64>,
    /// Per condition: the greatest amount that one step of the plan takes from a condition that it
    /// requires itself. The bound need not hold after the last of these steps.
    last_use: Vec<f64>,
    /// Balances of the goal that the plan does not reach, and for which there is no cover.
    unmet: Vec<u32>,
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
    /// Returns `None` if no operator can reach the bound of a comparison.
    pub(super) fn new(task: &Task, relaxation: &Relaxation) -> Option<Deficits> {
        relaxation.has_numbers().then(|| Deficits {
            margins: Margins::new(task, relaxation),
            approaching: relaxation.approaching(),
            values: Vec::new(),
            sums: Vec::new(),
            last_use: Vec::new(),
            unmet: Vec::new(),
        })
    }

    /// Returns the relaxed operators that may reach the bound of a comparison from some state; none
    /// for another proposition.
    pub(super) fn approaching(&self, proposition: u32) -> &[u32] {
        self.approaching.row(proposition)
    }

    /// Returns the goals that require a sum of several numbers to have one value.
    pub(super) fn balances(&self) -> impl Iterator<Item = u32> + '_ {
        let conditions = self.margins.conditions().iter();
        conditions.filter(|one| one.is_balance()).map(|one| one.proposition)
    }

    /// Reads the numbers of a state. Must be called before [`Deficits::find`] for its plans.
    pub(super) fn start(&mut self, task: &Task, state: &State) {
        let values = &state[task.fact_count.div_ceil(64)..];
        self.values.clear();
        self.values.extend(values.iter().map(|value| f64::from_bits(*value)));
    }

    /// Finds a cover for each deficit of a plan. `plan` contains its operators with their
    /// repetitions. `is_needed` tells whether the plan requires or reaches a proposition.
    pub(super) fn find(
        &mut self,
        (task, relaxation): (&Task, &Relaxation),
        additive: &AdditiveHeuristic,
        plan: impl Iterator<Item = (OperatorId, u32)>,
        is_needed: impl Fn(u32) -> bool,
        found: &mut Vec<Cover>,
    ) {
        found.clear();
        self.unmet.clear();
        let is_goal = |one: &NumericCondition| {
            one.is_goal && relaxation.goal().binary_search(&one.proposition).is_ok()
        };
        self.add_up(task, plan, is_goal);
        for index in 0..self.margins.conditions().len() {
            let condition = &self.margins.conditions()[index];
            // The goal may be one part of the task's goal now.
            let is_of_another_part = !condition.is_inequality() && !is_goal(condition);
            if !is_needed(condition.proposition) || is_of_another_part {
                continue;
            }
            let sum = condition
                .margin(|fluent| self.values[fluent as usize] + self.sums[fluent as usize]);
            let sum = sum + self.last_use[index];
            let unmet = condition.is_balance().then_some(condition.proposition);
            if sum.is_nan() {
                self.unmet.extend(unmet);
                continue;
            }
            if condition.is_met(sum) {
                continue;
            }
            let covers = self.covers((task, relaxation), condition, sum);
            let cost = |cover: &Cover| cost(relaxation, additive, cover, &is_needed);
            let cheapest = covers.filter_map(|cover| Some((cost(&cover)?, cover)));
            let Some((_, cover)) = cheapest.min_by_key(|(cost, _)| *cost) else {
                self.unmet.extend(unmet);
                continue;
            };
            // One supply covers several bounds of the same number.
            self.add(task.operator(cover.operator), cover.times);
            found.push(cover);
        }
    }

    /// Returns the goals that require a sum of several numbers to have one value, which the last plan
    /// does not reach and no operator covers.
    pub(super) fn unmet(&self) -> &[u32] {
        &self.unmet
    }

    fn add_up(
        &mut self,
        task: &Task,
        plan: impl Iterator<Item = (OperatorId, u32)>,
        is_goal: impl Fn(&NumericCondition) -> bool,
    ) {
        self.sums.clear();
        self.sums.resize(self.values.len(), 0.0);
        self.last_use.clear();
        self.last_use.resize(self.margins.conditions().len(), 0.0);
        for (operator, times) in plan {
            let operator = task.operator(operator);
            self.add(operator, times);
            for index in self.margins.among(operator.preconditions) {
                let condition = &self.margins.conditions()[index];
                let by = change(condition, operator, &self.values);
                if !is_goal(condition) && by < 0.0 {
                    self.last_use[index] = self.last_use[index].max(-by);
                }
            }
        }
    }

    /// Adds the changes by an operator to the sums.
    fn add(&mut self, operator: GroundOperator<'_>, times: u32) {
        for one in operator.effect.numeric {
            let by = repeatable_change(one, &|fluent| self.values[fluent as usize]);
            self.sums[one.fluent as usize] += by * f64::from(times);
        }
        for one in operator.conditional.iter().flat_map(|one| one.effect.numeric) {
            self.sums[one.fluent as usize] = f64::NAN;
        }
    }

    /// Returns each operator that approaches the bound of a condition, as often as it takes from
    /// `margin` to the bound.
    fn covers(
        &self,
        (task, relaxation): (&Task, &Relaxation),
        condition: &NumericCondition,
        margin: f64,
    ) -> impl Iterator<Item = Cover> {
        let proposition = condition.proposition;
        let operators = self.approaching.row(proposition).iter();
        operators.filter_map(move |&relaxed| {
            let operator = relaxation.origin(relaxed)?;
            let by = change(condition, task.operator(operator), &self.values);
            if by.is_nan() || !condition.is_approached(margin, by) {
                return None;
            }
            let times = condition.times(margin, by).min(TIMES_MAX);
            Some(Cover { proposition, relaxed, operator, times })
        })
    }

    /// Returns the number of bytes of the tables.
    pub(super) fn bytes(&self) -> usize {
        self.margins.bytes()
            + self.approaching.bytes()
            + self.values.len() * 16
            + self.last_use.len() * 8
    }
}

/// Returns the amount by which one application of an operator approaches the bound of a condition in
/// the evaluated state, without conditional effects. The amount is not a number if it is not known.
fn change(condition: &NumericCondition, operator: GroundOperator<'_>, values: &[f64]) -> f64 {
    let changes = operator.effect.numeric.iter();
    let changes = changes.filter_map(|one| Some((condition.weight(one.fluent)?, one)));
    let value = |fluent: u32| values[fluent as usize];
    changes.map(|(weight, one)| weight * repeatable_change(one, &value)).sum()
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
    others.try_fold(steps, |sum, one| Some(sum.saturating_add(additive.reached_cost(*one)?)))
}
