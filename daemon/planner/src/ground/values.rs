//! Numbers while grounding: static functions are looked up, fluents become part of the state.

use pddl::{Comparison, Operator as Arithmetic};

use super::relation::Relation;
use crate::normalize::lifted::{Lifted, LiftedExpression, LiftedFluent, objects};
use crate::task::{GroundComparison, GroundExpression, ObjectId};

/// Two numbers this close are one: sums of decimal fractions are not exact in binary.
pub(crate) const TOLERANCE: f64 = 1e-6;

/// The values of `:init`, and the numeric fluents found so far.
#[derive(Debug)]
pub(super) struct Values {
    /// By function.
    tables: Vec<Table>,
    fluent_functions: Vec<bool>,
    /// The initial values of the fluents; not a number where there is none.
    pub(super) fluents: Vec<f64>,
}

/// The tuples of one function, and what is known of each.
#[derive(Debug)]
struct Table {
    tuples: Relation,
    /// The initial value; not a number where there is none.
    values: Vec<f64>,
    /// The number of the fluent, if it has one.
    fluents: Vec<Option<u32>>,
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
        let table =
            |arity| Table { tuples: Relation::new(arity), values: Vec::new(), fluents: Vec::new() };
        let mut values = Values {
            tables: lifted.functions.iter().map(|one| table(one.arity)).collect(),
            fluent_functions: lifted.functions.iter().map(|one| one.is_numeric_fluent()).collect(),
            fluents: Vec::new(),
        };
        let total_cost = lifted.functions.iter().position(|one| one.name == "total-cost");
        if let Some(function) = total_cost.filter(|index| lifted.functions[*index].arity == 0) {
            values.tables[function].set(&[], 0.0);
        }
        for (function, arguments, value) in &lifted.values {
            values.tables[*function].set(arguments, *value);
        }
        values
    }

    /// The value of a fluent in the initial state.
    pub(super) fn initially(&self, fluent: &LiftedFluent, binding: &[ObjectId]) -> Option<f64> {
        let table = &self.tables[fluent.function];
        let row = table.tuples.find_terms(&fluent.arguments, binding)?;
        Some(table.values[row]).filter(|value| !value.is_nan())
    }

    /// The value of an expression over static functions.
    pub(super) fn fixed(&self, expression: &LiftedExpression, binding: &[ObjectId]) -> Option<f64> {
        let value = match expression {
            LiftedExpression::Number(number) => *number,
            LiftedExpression::Fluent(fluent) => self.initially(fluent, binding)?,
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

    /// The value of a ground expression in the initial state.
    pub(super) fn at_first(&self, expression: &GroundExpression) -> Option<f64> {
        let value = expression.evaluate(&|fluent| self.fluents[fluent as usize]);
        value.is_finite().then_some(value)
    }

    /// The number of a numeric fluent.
    pub(super) fn fluent(&mut self, fluent: &LiftedFluent, binding: &[ObjectId]) -> u32 {
        let table = &mut self.tables[fluent.function];
        let row = table.tuples.find_terms(&fluent.arguments, binding).unwrap_or_else(|| {
            let arguments: Vec<ObjectId> = objects(&fluent.arguments, binding).collect();
            table.set(&arguments, f64::NAN)
        });
        let value = table.values[row];
        *table.fluents[row].get_or_insert_with(|| {
            self.fluents.push(value);
            self.fluents.len() as u32 - 1
        })
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

// === impl Table ===

impl Table {
    /// Sets the value of a tuple; returns its row. The last value counts.
    fn set(&mut self, arguments: &[ObjectId], value: f64) -> usize {
        if let Some(row) = self.tuples.find(arguments) {
            self.values[row] = value;
            return row;
        }
        self.tuples.insert(arguments);
        self.values.push(value);
        self.fluents.push(None);
        self.values.len() - 1
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
