//! Functions during grounding. Static functions are replaced by their values; numeric fluents
//! become part of the state.

use pddl::Operator as Arithmetic;

use super::relation::Relation;
use crate::normalize::lifted::{
    FunctionIndex, FunctionUse, Lifted, LiftedExpression, LiftedFluent, objects,
};
use crate::task::{GroundComparison, GroundExpression, ObjectId};

/// Initial values of functions, and the numeric fluents found so far.
#[derive(Debug)]
pub(super) struct GroundFluents {
    /// Per function: its argument tuples with their values.
    tables: Vec<FunctionTable>,
    fluent_functions: Vec<bool>,
    /// Initial values of the numeric fluents; NaN for an undefined fluent.
    pub(super) fluents: Vec<f64>,
}

/// The argument tuples of one function, with the value and the fluent number of each tuple.
#[derive(Debug)]
struct FunctionTable {
    tuples: Relation,
    /// Per tuple: the initial value of the function; NaN without a value.
    values: Vec<f64>,
    /// Per tuple: the number of its numeric fluent; `None` if the tuple is not a fluent.
    fluents: Vec<Option<u32>>,
}

/// Result of grounding a numeric expression.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ExpressionValue {
    /// The expression is undefined in every state.
    Undefined,
    /// The expression has this value in every state.
    Fixed(f64),
    /// The value of the expression depends on the state.
    Varying(GroundExpression),
}

// === impl ExpressionValue ===

impl ExpressionValue {
    /// Returns the value as an expression; `None` if it is undefined.
    pub(super) fn into_expression(self) -> Option<GroundExpression> {
        match self {
            ExpressionValue::Fixed(number) => Some(GroundExpression::Number(number)),
            ExpressionValue::Varying(expression) => Some(expression),
            ExpressionValue::Undefined => None,
        }
    }
}

// === impl GroundFluents ===

impl GroundFluents {
    pub(super) fn new(lifted: &Lifted) -> GroundFluents {
        let table = |arity| FunctionTable {
            tuples: Relation::new(arity),
            values: Vec::new(),
            fluents: Vec::new(),
        };
        let mut values = GroundFluents {
            tables: lifted.functions.iter().map(|one| table(one.arity)).collect(),
            fluent_functions: lifted.functions.iter().map(|one| one.is_numeric_fluent()).collect(),
            fluents: Vec::new(),
        };
        if let Some(function) = total_cost(lifted) {
            values.tables[function].set(&[], 0.0);
        }
        for (function, arguments, value) in &lifted.values {
            values.tables[*function].set(arguments, *value);
        }
        values
    }

    /// Adds the function values of an extended task. Returns `false` if they contradict the
    /// existing grounding: a tuple of old objects (the first `objects` objects) has its first
    /// value, or a function becomes or ceases to be a numeric fluent.
    pub(super) fn add_values(&mut self, lifted: &Lifted, objects: usize) -> bool {
        for (function, arguments, value) in &lifted.values {
            let table = &mut self.tables[*function];
            let is_known = table.tuples.find(arguments).is_some();
            let is_new = arguments.iter().any(|object| object.index() >= objects);
            if !is_known && !is_new && lifted.functions[*function].matters() {
                return false;
            }
            if !is_known {
                table.set(arguments, *value);
            }
        }
        let matters = lifted.functions.iter().map(|one| one.is_numeric_fluent());
        matters.eq(self.fluent_functions.iter().copied())
    }

    /// Whether all argument tuples in `values` are known.
    pub(super) fn has_tuples(&self, values: &[(FunctionIndex, Vec<ObjectId>, f64)]) -> bool {
        { values.iter() }
            .all(|(function, arguments, _)| self.tables[*function].tuples.find(arguments).is_some())
    }

    /// Whether all ground expressions stay valid if the functions have these values for the
    /// `present` objects. The same tuples of numeric fluents must be defined as before, and all
    /// other relevant functions must have the same values as before.
    pub(super) fn keeps_expressions_valid(
        &self,
        lifted: &Lifted,
        values: &[(FunctionIndex, Vec<ObjectId>, f64)],
        present: &[bool],
    ) -> bool {
        let matters = |function: usize| lifted.functions[function].matters();
        let mut told = 0;
        for (function, arguments, value) in values.iter().filter(|one| matters(one.0)) {
            let table = &self.tables[*function];
            let Some(row) = table.tuples.find(arguments) else { return false };
            let is_same = match self.fluent_functions[*function] {
                true => !table.values[row].is_nan(),
                false => table.values[row] == *value,
            };
            if !is_same {
                return false;
            }
            told += 1;
        }
        let is_here = |table: &FunctionTable, row: usize| {
            !table.values[row].is_nan()
                && table.tuples.row(row).iter().all(|object| present[object.index()])
        };
        let tables = self.tables.iter().enumerate().filter(|(function, _)| matters(*function));
        let known = tables.map(|(function, table)| {
            let count = (0..table.tuples.len()).filter(|row| is_here(table, *row)).count();
            // A total cost without a value is zero.
            let is_implied = is_total_cost(lifted, function)
                && !values.iter().any(|(other, ..)| *other == function);
            count - usize::from(is_implied)
        });
        known.sum::<usize>() == told
    }

    /// Returns the values of the numeric fluents in a state with these function values.
    pub(super) fn fluent_values(
        &self,
        lifted: &Lifted,
        values: &[(FunctionIndex, Vec<ObjectId>, f64)],
    ) -> Vec<f64> {
        let mut all = vec![f64::NAN; self.fluents.len()];
        let mut set = |function: usize, arguments: &[ObjectId], value: f64| {
            let table = &self.tables[function];
            let row = table.tuples.find(arguments);
            if let Some(fluent) = row.and_then(|row| table.fluents[row]) {
                all[fluent as usize] = value;
            }
        };
        if let Some(function) = total_cost(lifted) {
            set(function, &[], 0.0);
        }
        for (function, arguments, value) in values {
            set(*function, arguments, *value);
        }
        all
    }

    /// Returns the value of a function in the initial state; `None` if it has no value there.
    pub(super) fn initially(&self, fluent: &LiftedFluent, binding: &[ObjectId]) -> Option<f64> {
        let table = &self.tables[fluent.function];
        let row = table.tuples.find_terms(&fluent.arguments, binding)?;
        Some(table.values[row]).filter(|value| !value.is_nan())
    }

    /// Returns the value of an expression over static functions; `None` if it is undefined.
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

    /// Grounds a numeric expression under a binding.
    pub(super) fn ground(
        &mut self,
        expression: &LiftedExpression,
        binding: &[ObjectId],
    ) -> ExpressionValue {
        match expression {
            LiftedExpression::Number(number) => ExpressionValue::Fixed(*number),
            LiftedExpression::Fluent(fluent) if self.fluent_functions[fluent.function] => {
                ExpressionValue::Varying(GroundExpression::Fluent(self.fluent(fluent, binding)))
            }
            LiftedExpression::Fluent(_) => self
                .fixed(expression, binding)
                .map_or(ExpressionValue::Undefined, ExpressionValue::Fixed),
            LiftedExpression::Negate(inner) => match self.ground(inner, binding) {
                ExpressionValue::Varying(inner) => {
                    ExpressionValue::Varying(GroundExpression::Negate(Box::new(inner)))
                }
                ExpressionValue::Fixed(number) => ExpressionValue::Fixed(-number),
                ExpressionValue::Undefined => ExpressionValue::Undefined,
            },
            LiftedExpression::Apply(operator, operands) => self.apply(*operator, operands, binding),
        }
    }

    /// Returns the value of a ground expression in the initial state; `None` if it is undefined.
    pub(super) fn initial_value(&self, expression: &GroundExpression) -> Option<f64> {
        let value = expression.evaluate(&|fluent| self.fluents[fluent as usize]);
        value.is_finite().then_some(value)
    }

    /// Returns the number of a numeric fluent. A new fluent gets the next number.
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
    ) -> ExpressionValue {
        let mut ground = Vec::with_capacity(operands.len());
        let mut varies = false;
        for operand in operands {
            match self.ground(operand, binding) {
                ExpressionValue::Undefined => return ExpressionValue::Undefined,
                ExpressionValue::Fixed(number) => ground.push(GroundExpression::Number(number)),
                ExpressionValue::Varying(inner) => {
                    varies = true;
                    ground.push(inner);
                }
            }
        }
        let whole = GroundExpression::Apply(operator, ground);
        if varies {
            return ExpressionValue::Varying(whole);
        }
        let value = whole.evaluate(&|_| f64::NAN);
        if value.is_finite() { ExpressionValue::Fixed(value) } else { ExpressionValue::Undefined }
    }
}

/// Returns the function `total-cost`; `None` if the task has none.
fn total_cost(lifted: &Lifted) -> Option<FunctionIndex> {
    (0..lifted.functions.len()).find(|index| is_total_cost(lifted, *index))
}

fn is_total_cost(lifted: &Lifted, function: FunctionIndex) -> bool {
    let FunctionUse { name, arity, .. } = &lifted.functions[function];
    *arity == 0 && name == pddl::TOTAL_COST
}

// === impl FunctionTable ===

impl FunctionTable {
    /// Sets the value of a tuple, replacing an earlier value. Returns the row of the tuple.
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
    /// Whether the comparison holds for these values of the fluents; `false` if one of its sides is
    /// undefined.
    pub(crate) fn holds(&self, values: &dyn Fn(u32) -> f64) -> bool {
        self.comparison.holds(self.left.evaluate(values), self.right.evaluate(values))
    }
}
