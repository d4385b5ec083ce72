//! Numbers while grounding: static functions are looked up, fluents become part of the state.

use pddl::{Comparison, Operator as Arithmetic};
use rustc_hash::FxHashMap;

use crate::normalize::lifted::{
    FunctionIndex, Lifted, LiftedExpression, LiftedFluent, LiftedTerm, objects,
};
use crate::task::{GroundComparison, GroundExpression, ObjectId};

/// Two numbers this close are one: sums of decimal fractions are not exact in binary.
pub(crate) const TOLERANCE: f64 = 1e-6;

type Key = (FunctionIndex, Vec<ObjectId>);

/// The values of `:init`, and the numeric fluents found so far.
#[derive(Debug, Default)]
pub(super) struct Values {
    initial: FxHashMap<Key, f64>,
    fluent_ids: FxHashMap<Key, u32>,
    fluent_functions: Vec<bool>,
    /// The initial values of the fluents; not a number where there is none.
    pub(super) fluents: Vec<f64>,
}

/// What became of an expression.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Grounded {
    /// It has no value, in no state.
    Undefined,
    /// It has the same value in every state.
    Fixed(f64),
    /// Its value depends on the state.
    Varying(GroundExpression),
}

// === impl Values ===

impl Values {
    pub(super) fn new(lifted: &Lifted) -> Values {
        let mut values = Values {
            fluent_functions: lifted.functions.iter().map(|one| one.is_numeric_fluent()).collect(),
            ..Values::default()
        };
        let total_cost = lifted.functions.iter().position(|one| one.name == "total-cost");
        if let Some(function) = total_cost.filter(|index| lifted.functions[*index].arity == 0) {
            values.initial.insert((function, Vec::new()), 0.0);
        }
        for (function, arguments, value) in &lifted.values {
            values.initial.insert((*function, arguments.clone()), *value);
        }
        values
    }

    /// The value of a fluent in the initial state.
    pub(super) fn initially(&self, function: FunctionIndex, arguments: &[ObjectId]) -> Option<f64> {
        self.initial.get(&(function, arguments.to_vec())).copied()
    }

    /// The value of an expression over static functions.
    pub(super) fn fixed(&self, expression: &LiftedExpression, binding: &[ObjectId]) -> Option<f64> {
        let value = match expression {
            LiftedExpression::Number(number) => *number,
            LiftedExpression::Fluent(fluent) => {
                let arguments: Vec<ObjectId> = objects(&fluent.arguments, binding).collect();
                self.initially(fluent.function, &arguments)?
            }
            LiftedExpression::Negate(inner) => -self.fixed(inner, binding)?,
            LiftedExpression::Apply(operator, operands) => {
                let operands: Option<Vec<GroundExpression>> = operands
                    .iter()
                    .map(|one| self.fixed(one, binding).map(GroundExpression::Number))
                    .collect();
                GroundExpression::Apply(*operator, operands?).evaluate(&|_| f64::NAN)
            }
        };
        value.is_finite().then_some(value)
    }

    /// The expression under a binding.
    pub(super) fn ground(
        &mut self,
        expression: &LiftedExpression,
        binding: &[ObjectId],
    ) -> Grounded {
        match expression {
            LiftedExpression::Number(number) => Grounded::Fixed(*number),
            LiftedExpression::Fluent(fluent) if self.fluent_functions[fluent.function] => {
                Grounded::Varying(GroundExpression::Fluent(self.fluent(fluent, binding)))
            }
            LiftedExpression::Fluent(_) => {
                self.fixed(expression, binding).map_or(Grounded::Undefined, Grounded::Fixed)
            }
            LiftedExpression::Negate(inner) => match self.ground(inner, binding) {
                Grounded::Varying(inner) => {
                    Grounded::Varying(GroundExpression::Negate(Box::new(inner)))
                }
                Grounded::Fixed(number) => Grounded::Fixed(-number),
                Grounded::Undefined => Grounded::Undefined,
            },
            LiftedExpression::Apply(operator, operands) => self.apply(*operator, operands, binding),
        }
    }

    /// The number of a numeric fluent.
    pub(super) fn fluent(&mut self, fluent: &LiftedFluent, binding: &[ObjectId]) -> u32 {
        let key = (fluent.function, objects(&fluent.arguments, binding).collect::<Vec<_>>());
        let next = self.fluents.len() as u32;
        if let Some(&id) = self.fluent_ids.get(&key) {
            return id;
        }
        self.fluents.push(self.initial.get(&key).copied().unwrap_or(f64::NAN));
        self.fluent_ids.insert(key, next);
        next
    }

    fn apply(
        &mut self,
        operator: Arithmetic,
        operands: &[LiftedExpression],
        binding: &[ObjectId],
    ) -> Grounded {
        let mut ground = Vec::with_capacity(operands.len());
        let mut varies = false;
        for operand in operands {
            match self.ground(operand, binding) {
                Grounded::Undefined => return Grounded::Undefined,
                Grounded::Fixed(number) => ground.push(GroundExpression::Number(number)),
                Grounded::Varying(inner) => {
                    varies = true;
                    ground.push(inner);
                }
            }
        }
        let whole = GroundExpression::Apply(operator, ground);
        if varies {
            return Grounded::Varying(whole);
        }
        let value = whole.evaluate(&|_| f64::NAN);
        if value.is_finite() { Grounded::Fixed(value) } else { Grounded::Undefined }
    }
}

impl LiftedExpression {
    /// Calls `visit` for every term in it.
    pub(super) fn terms(&self, visit: &mut dyn FnMut(&LiftedTerm)) {
        match self {
            LiftedExpression::Number(_) => (),
            LiftedExpression::Fluent(fluent) => fluent.arguments.iter().for_each(visit),
            LiftedExpression::Negate(inner) => inner.terms(visit),
            LiftedExpression::Apply(_, operands) => {
                operands.iter().for_each(|operand| operand.terms(visit));
            }
        }
    }
}

impl GroundComparison {
    /// Whether it holds; not where a side has no value.
    pub(crate) fn holds(&self, values: &dyn Fn(u32) -> f64) -> bool {
        compares(self.comparison, self.left.evaluate(values), self.right.evaluate(values))
    }
}

/// Compares two numbers; nothing holds of what is not a number.
pub(super) fn compares(comparison: Comparison, left: f64, right: f64) -> bool {
    match comparison {
        Comparison::Less => left < right - TOLERANCE,
        Comparison::LessOrEqual => left <= right + TOLERANCE,
        Comparison::Equal => (left - right).abs() <= TOLERANCE,
        Comparison::GreaterOrEqual => left >= right - TOLERANCE,
        Comparison::Greater => left > right + TOLERANCE,
    }
}
