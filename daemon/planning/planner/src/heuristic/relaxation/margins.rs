//! Margins: how far each numeric condition of a task is beyond its bound, and by how much each
//! operator raises or lowers this.

use super::Relaxation;
use super::numbers::NumericSteps;
use crate::rows::Rows;
use crate::task::{FactId, Literal, OperatorId, Task};

/// The numeric conditions of a task that are linear inequalities. Each has a margin: the distance
/// from its bound, which is negative if the condition does not hold.
#[derive(Debug, Default)]
pub(in crate::heuristic) struct Margins {
    conditions: Vec<NumericCondition>,
    comparisons: NumericSteps,
    /// Per operator: the range of its entries in `changes`.
    starts: Vec<u32>,
    changes: Vec<MarginChange>,
}

/// A comparison, or the negation of one, that a goal or an operator requires.
#[derive(Debug)]
pub(in crate::heuristic) struct NumericCondition {
    /// The proposition of the condition in the relaxation.
    pub(in crate::heuristic) proposition: u32,
    literal: Literal,
    comparison: usize,
    sign: f64,
    /// Whether a margin of zero is too small.
    pub(in crate::heuristic) is_strict: bool,
    pub(in crate::heuristic) is_goal: bool,
}

/// Change of a margin by one application of an operator.
#[derive(Clone, Copy, Debug)]
pub(in crate::heuristic) struct MarginChange {
    /// Index of the condition.
    pub(in crate::heuristic) condition: u32,
    pub(in crate::heuristic) by: f64,
    /// Whether the operator itself requires the condition.
    pub(in crate::heuristic) is_required: bool,
}

// === impl Margins ===

impl Margins {
    /// Finds the numeric conditions of a task. Changes are those that operators make by constant
    /// amounts and without conditions; the others are not known here.
    pub(in crate::heuristic) fn new(task: &Task, relaxation: &Relaxation) -> Margins {
        let comparisons = NumericSteps::new(&task.comparisons);
        let mut margins = Margins { comparisons, ..Margins::default() };
        margins.conditions = relaxation
            .required()
            .into_iter()
            .filter_map(|proposition| margins.condition(task, relaxation, proposition))
            .collect();
        let mut reading = Vec::new();
        for (condition, index) in margins.conditions.iter().zip(0u32..) {
            let comparison = &task.comparisons[condition.comparison];
            let mut note = |fluent: u32| reading.push((fluent, index));
            comparison.left.fluents(&mut note);
            comparison.right.fluents(&mut note);
        }
        margins.add_changes(task, &Rows::collect(task.values.len(), reading.iter().copied()));
        margins
    }

    fn condition(
        &self,
        task: &Task,
        relaxation: &Relaxation,
        proposition: u32,
    ) -> Option<NumericCondition> {
        let literal = relaxation.literal(proposition)?;
        let comparison = literal.fact().index().checked_sub(task.basic_count)?;
        if comparison >= task.comparisons.len() {
            return None;
        }
        let (sign, is_strict) = self.comparisons.bound(comparison, literal.is_positive())?;
        let is_goal = relaxation.goal().binary_search(&proposition).is_ok();
        Some(NumericCondition { proposition, literal, comparison, sign, is_strict, is_goal })
    }

    /// Stores the changes of all operators. `reading` contains the conditions that read each
    /// fluent.
    fn add_changes(&mut self, task: &Task, reading: &Rows) {
        let mut changed = Vec::new();
        self.starts.push(0);
        for operator in task.operators.iter() {
            changed.clear();
            let fluents = operator.effect.numeric.iter().map(|change| change.fluent);
            changed.extend(fluents.flat_map(|fluent| reading.row(fluent)));
            changed.sort_unstable();
            changed.dedup();
            for &condition in &changed {
                let NumericCondition { literal, comparison, sign, .. } =
                    &self.conditions[condition as usize];
                let by = self.comparisons.constant(*comparison, operator.effect.numeric);
                if let Some(by) = by.filter(|by| *by != 0.0) {
                    let is_required = operator.preconditions.contains(literal);
                    self.changes.push(MarginChange { condition, by: by * sign, is_required });
                }
            }
            self.starts.push(self.changes.len() as u32);
        }
    }

    pub(in crate::heuristic) fn conditions(&self) -> &[NumericCondition] {
        &self.conditions
    }

    /// Returns the changes of margins by one application of an operator.
    pub(in crate::heuristic) fn changes(&self, operator: OperatorId) -> &[MarginChange] {
        let index = operator.index();
        &self.changes[self.starts[index] as usize..self.starts[index + 1] as usize]
    }

    /// Computes the margin of each condition for the values of the fluents in a state. The margin
    /// is not a number if a value is undefined.
    pub(in crate::heuristic) fn measure(&self, values: &[u64], found: &mut Vec<f64>) {
        found.clear();
        let margin =
            |one: &NumericCondition| self.comparisons.distance(one.comparison, values) * one.sign;
        found.extend(self.conditions.iter().map(margin));
    }

    /// Returns the number of bytes of the tables.
    pub(in crate::heuristic) fn bytes(&self) -> usize {
        self.changes.len() * size_of::<MarginChange>() + self.starts.len() * 4
    }
}

impl Relaxation {
    /// Returns the propositions that the goal or an operator requires, sorted.
    fn required(&self) -> Vec<u32> {
        let all = 0..self.proposition_count as u32;
        let is_required =
            |one: &u32| !self.asking.row(*one).is_empty() || self.goal.binary_search(one).is_ok();
        all.filter(is_required).collect()
    }

    /// Returns the literal of a proposition; `None` for that of a failing axiom.
    fn literal(&self, proposition: u32) -> Option<Literal> {
        match (proposition as usize).checked_sub(self.fact_count) {
            None => Some(Literal::new(FactId(proposition), true)),
            Some(index) => self.negated.get(index).map(|fact| Literal::new(*fact, false)),
        }
    }
}
