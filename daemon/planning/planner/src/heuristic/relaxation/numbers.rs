//! Number of repetitions of an operator that make a comparison true. The method is subgoaling
//! (Scala, Haslum, Thiébaux and Ramirez, “Subgoaling Techniques for Satisficing and Optimal Numeric
//! Planning”, 2020).
//!
//! A comparison is represented by a distance from a bound. An operator that changes the distance by
//! a constant amount is repeated as often as the distance requires. If it changes the distance in
//! the wrong direction, it does not achieve the comparison. If the amount depends on the state, its
//! value in the current state is used.

use pddl::{Assignment, Comparison, Operator as Arithmetic};
use rustc_hash::FxHashMap;

use crate::task::{GroundComparison, GroundExpression, NumericChange};

/// Tolerance for treating a quotient as a whole number. It affects the estimate only, never
/// reachability.
const EPSILON: f64 = 1e-9;

/// Number of repetitions that is assumed for a numeric step if its change does not approach the
/// bound in this state, because other steps must come first.
const DETOUR: u32 = 10;

/// Maximum number of repetitions; greater numbers are reduced to it, because they hardly change the
/// ranking of states.
const REPETITIONS_MAX: u32 = 100_000;

/// Required value of the distance for a comparison to be true (or to be false).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::heuristic) enum RequiredDistance {
    AtLeastZero,
    AboveZero,
    Zero,
    NotZero,
}

/// A numeric step: an operator that makes one comparison true or makes it false.
#[derive(Clone, Debug)]
struct NumericStep {
    /// Index of the comparison.
    comparison: u32,
    wanted: RequiredDistance,
    /// Required direction of the change: −1 if the distance must decrease, otherwise 1.
    sign: f64,
    change: DistanceChange,
    /// Index of the supplies that repetitions use up, or [`NO_SUPPLIES`].
    supplies: u32,
}

/// Number of repetitions of an operator in a state, with what they need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::heuristic) struct Repetitions {
    pub(in crate::heuristic) times: u32,
    /// Whether the operator does not approach the bound in this state, so that the number is a guess.
    pub(in crate::heuristic) is_detour: bool,
    /// Cost of getting what the repetitions use up, beyond what there is.
    pub(in crate::heuristic) supply_cost: u64,
}

/// Entry in place of supplies, for an operator that uses up nothing that it requires.
const NO_SUPPLIES: u32 = u32::MAX;

/// A number that an operator requires and uses up, such as the water that it pours.
#[derive(Clone, Debug)]
pub(super) struct Supply {
    comparison: u32,
    /// The distance of the comparison, times this sign, is what there is.
    sign: f64,
    /// Amount that each application uses up.
    by: f64,
    /// Cost of one unit, from the operator that adds it at the lowest cost, without the costs of its
    /// preconditions.
    unit_cost: f64,
}

/// Amount by which an operator changes the distance of a comparison.
#[derive(Clone, Debug)]
enum DistanceChange {
    /// The amount is this number in every state. It is never zero.
    Constant(f64),
    /// The amount is a weighted sum of changes that depend on the state. `parts` contains pairs of
    /// weight and change number. `is_once` is set if one of the changes is an assignment, so that a
    /// repetition has no further effect.
    Depends { parts: Box<[(f64, u32)]>, is_once: bool },
    /// The amount cannot be computed, because the comparison is not linear.
    Unknown,
}

/// All numeric steps of a relaxation, each with a number.
#[derive(Clone, Debug, Default)]
pub(in crate::heuristic) struct NumericSteps {
    comparisons: Vec<GroundComparison>,
    /// Per comparison: the coefficient of each fluent; `None` if the comparison is not linear.
    weights: Vec<Option<FxHashMap<u32, f64>>>,
    /// Changes of fluents by amounts that depend on the state. Several steps may share one change.
    changes: Vec<NumericChange>,
    steps: Vec<NumericStep>,
    /// Supplies of operators, those of each operator together.
    supplies: Vec<Box<[Supply]>>,
}

// === impl NumericSteps ===

impl NumericSteps {
    pub(super) fn new(comparisons: &[GroundComparison]) -> NumericSteps {
        let weights = { comparisons.iter() }
            .map(|comparison| {
                let mut weights = FxHashMap::default();
                let is_linear = collect(&comparison.left, 1.0, &mut weights)
                    && collect(&comparison.right, -1.0, &mut weights);
                is_linear.then_some(weights)
            })
            .collect();
        NumericSteps { comparisons: comparisons.to_vec(), weights, ..NumericSteps::default() }
    }

    /// Returns what the distance must be for the comparison to be true (or to be false, if `truth` is
    /// false), after multiplication by the returned sign: −1 if it must shrink, otherwise 1. Returns
    /// `None` if the comparison is not linear, or is an inequation (≠).
    pub(super) fn bound(&self, comparison: usize, truth: bool) -> Option<(f64, RequiredDistance)> {
        self.weights[comparison].as_ref()?;
        let (wanted, sign) = wanted(self.comparisons[comparison].comparison, truth);
        (wanted != RequiredDistance::NotZero).then_some((sign, wanted))
    }

    /// Returns the coefficient of each fluent in the distance of a comparison; `None` if the
    /// comparison is not linear.
    pub(super) fn weights(&self, comparison: usize) -> Option<&FxHashMap<u32, f64>> {
        self.weights[comparison].as_ref()
    }

    pub(in crate::heuristic) fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Numbers the changes of one relaxed operator, unless all of them are constant. Returns the
    /// number of the first change.
    pub(super) fn register(&mut self, changes: &[NumericChange]) -> u32 {
        let first = self.changes.len() as u32;
        if changes.iter().any(|change| constant_change(change).is_none()) {
            self.changes.extend_from_slice(changes);
        }
        first
    }

    /// Adds the step of `changes` that makes a comparison true, or false if `truth` is false.
    /// Returns the number of the step; `None` if the changes can never have this result. `first` is
    /// the result of registering `changes`.
    pub(super) fn step(
        &mut self,
        comparison: usize,
        truth: bool,
        changes: &[NumericChange],
        first: u32,
    ) -> Option<u32> {
        let (wanted, sign) = wanted(self.comparisons[comparison].comparison, truth);
        let change = self.change(comparison, changes, first);
        if let DistanceChange::Constant(by) = change {
            let is_either_way =
                matches!(wanted, RequiredDistance::Zero | RequiredDistance::NotZero);
            if by == 0.0 || (!is_either_way && by * sign < 0.0) {
                return None;
            }
        }
        let comparison = comparison as u32;
        self.steps.push(NumericStep { comparison, wanted, sign, change, supplies: NO_SUPPLIES });
        Some(self.steps.len() as u32 - 1)
    }

    /// Returns what an operator uses up of a comparison that it requires to be true (or to be false):
    /// the constant amount by which it takes the distance back. Returns `None` if there is none.
    pub(super) fn use_up(
        &self,
        comparison: usize,
        truth: bool,
        changes: &[NumericChange],
    ) -> Option<Supply> {
        let (sign, wanted) = self.bound(comparison, truth)?;
        // An equality is required for a moment only, and left in both directions.
        if wanted == RequiredDistance::Zero {
            return None;
        }
        let DistanceChange::Constant(by) = self.change(comparison, changes, 0) else { return None };
        let by = -by * sign;
        let comparison = comparison as u32;
        (by > 0.0).then_some(Supply { comparison, sign, by, unit_cost: 0.0 })
    }

    /// Notes that the operator of some steps uses up supplies. `cheapest` contains the lowest cost of
    /// changing the distance of a comparison by one, per comparison and direction.
    pub(super) fn note_supplies(
        &mut self,
        mut supplies: Vec<Supply>,
        steps: impl Iterator<Item = u32>,
        cheapest: &FxHashMap<(u32, bool), f64>,
    ) {
        supplies.retain_mut(|one| {
            let cost = cheapest.get(&(one.comparison, one.sign > 0.0));
            one.unit_cost = cost.copied().unwrap_or_default();
            one.unit_cost > 0.0
        });
        if supplies.is_empty() {
            return;
        }
        let index = self.supplies.len() as u32;
        self.supplies.push(supplies.into());
        steps.for_each(|step| self.steps[step as usize].supplies = index);
    }

    /// Returns the comparison of a step, the direction in which it changes the distance, and the cost
    /// of one unit at a cost of the step; `None` if its amount depends on the state.
    pub(super) fn unit_cost(&self, step: u32, cost: u64) -> Option<((u32, bool), f64)> {
        let step = &self.steps[step as usize];
        let DistanceChange::Constant(by) = step.change else { return None };
        Some(((step.comparison, step.sign > 0.0), cost as f64 / by.abs()))
    }

    fn change(&self, comparison: usize, changes: &[NumericChange], first: u32) -> DistanceChange {
        let Some(weights) = &self.weights[comparison] else { return DistanceChange::Unknown };
        let (mut constant, mut parts, mut is_once) = (Some(0.0), Vec::new(), false);
        for (index, change) in (first..).zip(changes) {
            let Some(&weight) = weights.get(&change.fluent) else { continue };
            constant = match (constant, constant_change(change)) {
                (Some(sum), Some(by)) => {
                    Some(Arithmetic::Add.apply(sum, Arithmetic::Multiply.apply(weight, by)))
                }
                _ => None,
            };
            parts.push((weight, index));
            is_once |= change.assignment == Assignment::Assign;
        }
        let depends = || DistanceChange::Depends { parts: parts.into(), is_once };
        constant.map_or_else(depends, DistanceChange::Constant)
    }

    /// Computes the number of repetitions of each step's operator, and what they need, for the values
    /// of the fluents in a state.
    pub(in crate::heuristic) fn repetitions(&self, values: &[u64], found: &mut Vec<Repetitions>) {
        let value = |fluent: u32| f64::from_bits(values[fluent as usize]);
        let distances: Vec<f64> = { self.comparisons.iter() }
            .map(|one| one.left.evaluate(&value) - one.right.evaluate(&value))
            .collect();
        let changes: Vec<f64> =
            self.changes.iter().map(|change| current_change(change, &value)).collect();
        found.clear();
        found.extend({ self.steps.iter() }.map(|step| {
            let distance = distances[step.comparison as usize] * step.sign;
            let found = step.repetitions(distance, &changes);
            let (times, is_detour) = (found.unwrap_or(DETOUR), found.is_none());
            let supply_cost = self.supply_cost(step, times, &distances);
            Repetitions { times, is_detour, supply_cost }
        }));
    }

    /// Returns the cost of getting what `times` applications of a step's operator use up, beyond what
    /// there is.
    fn supply_cost(&self, step: &NumericStep, times: u32, distances: &[f64]) -> u64 {
        let Some(supplies) = self.supplies.get(step.supplies as usize) else { return 0 };
        let cost: f64 = { supplies.iter() }
            .map(|one| {
                let there = (distances[one.comparison as usize] * one.sign).max(0.0);
                (one.by * f64::from(times - 1) - there).max(0.0) * one.unit_cost
            })
            .sum();
        cost as u64
    }
}

// === impl NumericStep ===

impl NumericStep {
    /// Returns the number of repetitions that cover `distance`; `None` if other steps must come first.
    /// `changes` contains the current amount of each state-dependent change.
    fn repetitions(&self, distance: f64, changes: &[f64]) -> Option<u32> {
        match &self.change {
            DistanceChange::Unknown => Some(1),
            DistanceChange::Constant(by) => times(self.wanted, distance, by * self.sign),
            DistanceChange::Depends { parts, is_once } => {
                let by = parts.iter().map(|(weight, index)| weight * changes[*index as usize]);
                match times(self.wanted, distance, by.sum::<f64>() * self.sign) {
                    Some(more) if *is_once && more > 1 => None,
                    other => other,
                }
            }
        }
    }
}

/// Returns the number of changes by `by` until `distance` has the value that `wanted` requires; `None`
/// if the changes do not approach it.
pub(super) fn times(wanted: RequiredDistance, distance: f64, by: f64) -> Option<u32> {
    if distance.is_nan() || by.is_nan() {
        return Some(1);
    }
    let missing = match wanted {
        RequiredDistance::NotZero => return Some(1),
        RequiredDistance::AtLeastZero | RequiredDistance::Zero => -distance / by,
        // The distance must end strictly above zero.
        RequiredDistance::AboveZero => (-distance / by).floor() + 1.0,
    };
    if by == 0.0 || missing < -EPSILON {
        return None;
    }
    Some(((missing - EPSILON).ceil().max(1.0) as u32).min(REPETITIONS_MAX))
}

fn wanted(comparison: Comparison, truth: bool) -> (RequiredDistance, f64) {
    match (comparison, truth) {
        (Comparison::GreaterOrEqual, true) => (RequiredDistance::AtLeastZero, 1.0),
        (Comparison::Greater, true) => (RequiredDistance::AboveZero, 1.0),
        (Comparison::LessOrEqual, true) => (RequiredDistance::AtLeastZero, -1.0),
        (Comparison::Less, true) => (RequiredDistance::AboveZero, -1.0),
        (Comparison::GreaterOrEqual, false) => (RequiredDistance::AboveZero, -1.0),
        (Comparison::Greater, false) => (RequiredDistance::AtLeastZero, -1.0),
        (Comparison::LessOrEqual, false) => (RequiredDistance::AboveZero, 1.0),
        (Comparison::Less, false) => (RequiredDistance::AtLeastZero, 1.0),
        (Comparison::Equal, true) => (RequiredDistance::Zero, 1.0),
        (Comparison::Equal, false) => (RequiredDistance::NotZero, 1.0),
    }
}

/// Returns the amount by which a change raises its fluent; `None` if the amount depends on the
/// state.
fn constant_change(change: &NumericChange) -> Option<f64> {
    let GroundExpression::Number(number) = change.value else { return None };
    match change.assignment {
        Assignment::Increase => Some(number),
        Assignment::Decrease => Some(-number),
        Assignment::Assign | Assignment::ScaleUp | Assignment::ScaleDown => None,
    }
}

/// Returns the amount by which a change raises its fluent in the current state.
fn current_change(change: &NumericChange, value: &dyn Fn(u32) -> f64) -> f64 {
    let (old, operand) = (value(change.fluent), change.value.evaluate(value));
    match change.assignment {
        Assignment::Increase => operand,
        Assignment::Decrease => -operand,
        Assignment::Assign => operand - old,
        Assignment::ScaleUp => old * operand - old,
        Assignment::ScaleDown => old / operand - old,
    }
}

/// Returns the amount by which each application of a change raises its fluent in the current state.
/// The amount is not a number if the second application has another effect than the first.
pub(in crate::heuristic) fn repeatable_change(
    change: &NumericChange,
    value: &dyn Fn(u32) -> f64,
) -> f64 {
    match change.assignment {
        Assignment::Increase | Assignment::Decrease => current_change(change, value),
        Assignment::Assign | Assignment::ScaleUp | Assignment::ScaleDown => f64::NAN,
    }
}

/// Adds the coefficient of each fluent in an expression, multiplied by `factor`, to `weights`.
/// Returns `false` if the expression is not linear.
fn collect(expression: &GroundExpression, factor: f64, weights: &mut FxHashMap<u32, f64>) -> bool {
    match expression {
        GroundExpression::Number(_) => true,
        GroundExpression::Fluent(fluent) => {
            *weights.entry(*fluent).or_default() += factor;
            true
        }
        GroundExpression::Negate(inner) => collect(inner, -factor, weights),
        GroundExpression::Apply(Arithmetic::Add, parts) => {
            parts.iter().all(|part| collect(part, factor, weights))
        }
        GroundExpression::Apply(Arithmetic::Subtract, parts) => {
            let mut parts = parts.iter();
            let first = parts.next().is_none_or(|first| collect(first, factor, weights));
            first && parts.all(|part| collect(part, -factor, weights))
        }
        GroundExpression::Apply(Arithmetic::Multiply, parts) => {
            let numbers = parts.iter().filter_map(constant);
            let factor = numbers.fold(factor, |product, number| product * number);
            let mut others = parts.iter().filter(|part| constant(part).is_none());
            match (others.next(), others.next()) {
                (None, _) => true,
                (Some(only), None) => collect(only, factor, weights),
                _ => false,
            }
        }
        GroundExpression::Apply(Arithmetic::Divide, parts) => {
            let Some((first, rest)) = parts.split_first() else { return true };
            let divisor: Option<f64> = rest.iter().map(constant).product();
            divisor.is_some_and(|divisor| collect(first, factor / divisor, weights))
        }
    }
}

/// Returns the value of an expression without fluents; `None` if the expression contains fluents.
fn constant(expression: &GroundExpression) -> Option<f64> {
    let mut has_fluent = false;
    expression.fluents(&mut |_| has_fluent = true);
    (!has_fluent).then(|| expression.evaluate(&|_| f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(comparison: Comparison, truth: bool, distance: f64, by: f64, expected: u32) {
        let (wanted, sign) = wanted(comparison, truth);
        assert_eq!(times(wanted, distance * sign, by * sign).unwrap_or(DETOUR), expected);
    }

    #[test]
    fn steps_are_counted_up_to_the_bound() {
        check(Comparison::GreaterOrEqual, true, -7.0, 2.0, 4);
        check(Comparison::GreaterOrEqual, true, -8.0, 2.0, 4);
        check(Comparison::Greater, true, -8.0, 2.0, 5);
        check(Comparison::Greater, true, 0.0, 2.0, 1);
        check(Comparison::LessOrEqual, true, 7.0, -2.0, 4);
        check(Comparison::Less, true, 8.0, -2.0, 5);
        check(Comparison::GreaterOrEqual, false, 3.0, -1.0, 4);
        check(Comparison::Equal, true, -0.3, 0.1, 3);
    }

    #[test]
    fn a_change_in_the_wrong_direction_counts_as_a_detour() {
        check(Comparison::Equal, true, -3.0, -1.0, DETOUR);
        check(Comparison::GreaterOrEqual, true, -3.0, 0.0, DETOUR);
        check(Comparison::Equal, false, 0.0, -1.0, 1);
    }

    #[test]
    fn an_undefined_number_counts_as_one_step_away() {
        check(Comparison::GreaterOrEqual, true, f64::NAN, 1.0, 1);
    }

    #[test]
    fn weights_of_a_linear_expression_add_up() {
        let fluent = |index| GroundExpression::Fluent(index);
        let number = |value| GroundExpression::Number(value);
        let twice = GroundExpression::Apply(Arithmetic::Multiply, vec![number(2.0), fluent(1)]);
        let sum = GroundExpression::Apply(Arithmetic::Add, vec![fluent(0), twice.clone()]);
        let less = GroundExpression::Apply(Arithmetic::Subtract, vec![sum, fluent(1)]);
        let half = GroundExpression::Apply(Arithmetic::Divide, vec![less, number(2.0)]);
        let mut weights = FxHashMap::default();
        assert!(collect(&half, 1.0, &mut weights));
        assert_eq!((weights[&0], weights[&1]), (0.5, 0.5));
        let square = GroundExpression::Apply(Arithmetic::Multiply, vec![fluent(0), fluent(0)]);
        assert!(!collect(&square, 1.0, &mut weights));
    }
}
