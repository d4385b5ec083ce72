//! Margins: how far each numeric condition of a task is beyond its bound, and how the changes of
//! numbers move it.

use super::Relaxation;
use super::numbers::{RequiredDistance, times};
use crate::task::{FactId, Literal, Task};

/// Tolerance for the comparison of a margin with zero.
const EPSILON: f64 = 1e-6;

/// Entry in place of a condition.
const NO_CONDITION: u32 = u32::MAX;

/// The numeric conditions of a task that are linear inequalities, and its goals that are linear
/// equalities. Each has a margin: the distance from its bound, which is negative if an inequality does
/// not hold, and not zero if an equality does not.
#[derive(Debug)]
pub(in crate::heuristic) struct Margins {
    conditions: Vec<NumericCondition>,
    /// Per literal of a comparison, from that of the first one on: the index of its condition, or
    /// [`NO_CONDITION`].
    of_literal: Vec<u32>,
    first_literal: usize,
}

/// A comparison, or the negation of one, that a goal or an operator requires.
#[derive(Debug)]
pub(in crate::heuristic) struct NumericCondition {
    /// The proposition of the condition in the relaxation.
    pub(in crate::heuristic) proposition: u32,
    /// What the margin must be.
    wanted: RequiredDistance,
    pub(in crate::heuristic) is_goal: bool,
    /// The margin is the sum of the fluents, each times its weight, and of the constant.
    weights: Box<[(u32, f64)]>,
    constant: f64,
}

// === impl Margins ===

impl Margins {
    /// Finds the numeric conditions of a task.
    pub(in crate::heuristic) fn new(task: &Task, relaxation: &Relaxation) -> Margins {
        let first_literal = Literal::new(FactId::from_index(task.basic_count), true).index();
        let of_literal = vec![NO_CONDITION; task.comparisons.len() * 2];
        let mut margins = Margins { conditions: Vec::new(), of_literal, first_literal };
        for index in 0..margins.of_literal.len() {
            let literal = Literal::from_index(first_literal + index);
            if let Some(condition) = condition(task, relaxation, literal) {
                margins.of_literal[index] = margins.conditions.len() as u32;
                margins.conditions.push(condition);
            }
        }
        margins
    }

    pub(in crate::heuristic) fn conditions(&self) -> &[NumericCondition] {
        &self.conditions
    }

    /// Returns the indices of the numeric conditions among literals.
    pub(in crate::heuristic) fn among<'m>(
        &'m self,
        literals: &'m [Literal],
    ) -> impl Iterator<Item = usize> + 'm {
        let index = |one: &Literal| one.index().checked_sub(self.first_literal);
        let found = literals.iter().filter_map(move |one| self.of_literal.get(index(one)?));
        found.filter(|one| **one != NO_CONDITION).map(|one| *one as usize)
    }

    /// Returns the number of bytes of the tables.
    pub(in crate::heuristic) fn bytes(&self) -> usize {
        let weights: usize = self.conditions.iter().map(|one| one.weights.len() * 16).sum();
        self.conditions.len() * size_of::<NumericCondition>() + weights + self.of_literal.len() * 4
    }
}

/// Returns the condition of a literal; `None` if nothing requires it, or if it is not a linear
/// inequality.
fn condition(task: &Task, relaxation: &Relaxation, literal: Literal) -> Option<NumericCondition> {
    let proposition = relaxation.proposition(literal)?;
    let is_goal = relaxation.goal.binary_search(&proposition).is_ok();
    if !is_goal && relaxation.asking.row(proposition).is_empty() {
        return None;
    }
    let index = literal.fact().index() - task.basic_count;
    let (sign, wanted) = relaxation.numbers.bound(index, literal.is_positive())?;
    // An equality that an operator requires holds for a moment only.
    if wanted == RequiredDistance::Zero && !is_goal {
        return None;
    }
    let weights = relaxation.numbers.weights(index)?;
    let mut weights: Box<[_]> =
        weights.iter().map(|(fluent, weight)| (*fluent, weight * sign)).collect();
    weights.sort_unstable_by_key(|(fluent, _)| *fluent);
    let comparison = &task.comparisons[index];
    let zero = |_| 0.0;
    let constant = (comparison.left.evaluate(&zero) - comparison.right.evaluate(&zero)) * sign;
    Some(NumericCondition { proposition, wanted, is_goal, weights, constant })
}

// === impl NumericCondition ===

impl NumericCondition {
    /// Returns the margin for the values of the fluents. The margin is not a number if one of them
    /// is undefined.
    pub(in crate::heuristic) fn margin(&self, value: impl Fn(u32) -> f64) -> f64 {
        let sum: f64 = self.weights.iter().map(|(fluent, weight)| weight * value(*fluent)).sum();
        self.constant + sum
    }

    /// Returns the number of changes by `by`, which approach the bound, from `margin` to it.
    pub(in crate::heuristic) fn times(&self, margin: f64, by: f64) -> u32 {
        times(self.wanted, margin, by).unwrap_or(1)
    }

    /// Whether the condition holds at a margin, with a tolerance, since sums of decimal fractions are not
    /// exact.
    pub(in crate::heuristic) fn is_met(&self, margin: f64) -> bool {
        match self.wanted {
            RequiredDistance::AboveZero => margin > EPSILON,
            RequiredDistance::Zero => margin.abs() <= EPSILON,
            RequiredDistance::AtLeastZero => margin >= -EPSILON,
            RequiredDistance::NotZero => margin.abs() > EPSILON,
        }
    }

    /// Whether changes by `by` bring `margin` to the bound.
    pub(in crate::heuristic) fn is_approached(&self, margin: f64, by: f64) -> bool {
        match self.wanted {
            RequiredDistance::Zero => by * margin < 0.0,
            _ => by > 0.0,
        }
    }

    pub(in crate::heuristic) fn is_inequality(&self) -> bool {
        self.wanted != RequiredDistance::Zero
    }

    /// Whether the condition requires a sum of several numbers to have one value.
    pub(in crate::heuristic) fn is_balance(&self) -> bool {
        let weights = self.weights.iter().filter(|(_, weight)| *weight != 0.0);
        self.wanted == RequiredDistance::Zero && weights.count() > 1
    }

    /// Returns the weight of a fluent; `None` if the condition does not read it.
    pub(in crate::heuristic) fn weight(&self, fluent: u32) -> Option<f64> {
        let index = self.weights.binary_search_by_key(&fluent, |(one, _)| *one).ok()?;
        Some(self.weights[index].1)
    }
}
