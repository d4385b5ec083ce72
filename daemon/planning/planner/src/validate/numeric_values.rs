//! Numeric evaluation: values of expressions, comparisons, and the value of a fluent after several
//! changes in one step.

use pddl::{Assignment, FluentTerm, Name, Operator, Term};

use super::compiled::{Argument, CompiledComparison, CompiledExpression, Fluent};
use super::query::WorldView;
use super::symbols::Object;
use super::tuple_table::TupleTable;

/// Values of the fluents of one function, by their arguments.
#[derive(Clone, Debug)]
pub(super) struct FunctionValues {
    fluents: TupleTable,
    /// For each row of `fluents`: the value.
    numbers: Vec<f64>,
}

// === impl FunctionValues ===

impl FunctionValues {
    pub(super) fn new(arity: usize) -> FunctionValues {
        FunctionValues { fluents: TupleTable::new(arity), numbers: Vec::new() }
    }

    pub(super) fn get(&self, object: impl Fn(usize) -> Object) -> Option<f64> {
        self.fluents.find(object).map(|row| self.numbers[row as usize])
    }

    pub(super) fn set(&mut self, objects: &[Object], value: f64) {
        self.fluents.insert(objects);
        if let Some(row) = self.fluents.find(|column| objects[column]) {
            self.numbers.resize(self.fluents.row_count(), value);
            self.numbers[row as usize] = value;
        }
    }

    /// Iterates over the fluents of the function that have a value, in no particular order. Each
    /// entry is the arguments and the value.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&[Object], f64)> {
        let rows = self.fluents.rows().iter();
        rows.map(|row| (self.fluents.tuple(*row), self.numbers[*row as usize]))
    }
}

impl PartialEq for FunctionValues {
    fn eq(&self, other: &FunctionValues) -> bool {
        let same =
            |(objects, value): (&[Object], f64)| other.get(|column| objects[column]) == Some(value);
        self.fluents.len() == other.fluents.len() && self.iter().all(same)
    }
}

// === impl WorldView ===

impl WorldView<'_> {
    pub(super) fn compares(self, compare: &CompiledComparison, frame: &[Object]) -> bool {
        let left = self.value(&compare.left, frame);
        let (Some(left), Some(right)) = (left, self.value(&compare.right, frame)) else {
            return false;
        };
        compare.comparison.holds(left, right)
    }

    /// Returns the value of an expression. If the value is undefined, returns as the error the
    /// fluent that causes it.
    pub(super) fn evaluate(
        self,
        expression: &CompiledExpression,
        frame: &[Object],
    ) -> Result<f64, FluentTerm> {
        self.value(expression, frame).ok_or_else(|| self.undefined(expression, frame))
    }

    /// Returns the value of a fluent; `None` if it is undefined.
    pub(super) fn fluent(self, fluent: &Fluent, frame: &[Object]) -> Option<f64> {
        let values = &self.world.values[fluent.function?.index()];
        values.get(|column| fluent.arguments[column].value(frame))
    }

    /// Returns the fluent with bound variables replaced by objects.
    pub(super) fn ground_fluent(self, fluent: &Fluent, frame: &[Object]) -> FluentTerm {
        let objects = &self.world.model.objects;
        let term = |(argument, term): (&Argument, &Term)| {
            let name = objects.name(argument.value(frame));
            name.map_or_else(|| term.clone(), |name| Term::Object(name.clone()))
        };
        let arguments =
            fluent.arguments.iter().zip(&fluent.source_term.arguments).map(term).collect();
        FluentTerm { arguments, ..fluent.source_term.clone() }
    }

    fn value(self, expression: &CompiledExpression, frame: &[Object]) -> Option<f64> {
        let value = match expression {
            CompiledExpression::Number(number) => *number,
            CompiledExpression::Fluent(fluent) => self.fluent(fluent, frame)?,
            CompiledExpression::Negate(inner) => -self.value(inner, frame)?,
            CompiledExpression::Apply(operator, operands) => {
                let mut values = operands.iter().map(|operand| self.value(operand, frame));
                let first = values.next()??;
                values.try_fold(first, |left, right| Some(operator.apply(left, right?)))?
            }
            // A sequential plan takes one unit of time per step.
            CompiledExpression::TotalTime => self.world.steps as f64,
            CompiledExpression::Unknown(_) => return None,
        };
        value.is_finite().then_some(value)
    }

    /// Returns the fluent because of which an expression is undefined.
    fn undefined(self, expression: &CompiledExpression, frame: &[Object]) -> FluentTerm {
        match expression {
            CompiledExpression::Fluent(fluent) => self.ground_fluent(fluent, frame),
            CompiledExpression::Negate(inner) => self.undefined(inner, frame),
            CompiledExpression::Apply(_, operands) => {
                let missing = operands.iter().find(|operand| self.value(operand, frame).is_none());
                match missing {
                    Some(operand) => self.undefined(operand, frame),
                    None => no_number(expression),
                }
            }
            other => no_number(other),
        }
    }
}

/// Returns a fluent to report if all operands are defined but the result is not. This happens after
/// a division by zero, and for values that only durative actions have. Returns a fluent named
/// `number` if the expression contains no fluent.
fn no_number(expression: &CompiledExpression) -> FluentTerm {
    match expression {
        CompiledExpression::Fluent(fluent) => fluent.source_term.clone(),
        CompiledExpression::Unknown(told) => (**told).clone(),
        CompiledExpression::Negate(inner) => no_number(inner),
        CompiledExpression::Apply(_, operands) if !operands.is_empty() => no_number(&operands[0]),
        _ => FluentTerm {
            function: Name::new("number"),
            arguments: Vec::new(),
            span: pddl::Span::default(),
        },
    }
}

/// Returns the value of one fluent after all updates of a step. Returns `None` if the updates
/// contradict each other, or if they require the old value and the fluent has none.
///
/// Increases and decreases add up, and scalings multiply; these two kinds cannot be mixed. An
/// assignment can only be combined with assignments of the same value.
pub(super) fn combine(
    old: Option<f64>,
    mut updates: impl Iterator<Item = (Assignment, f64)> + Clone,
) -> Option<f64> {
    let (first, first_value) = updates.clone().next()?;
    let is_additive = |one| matches!(one, Assignment::Increase | Assignment::Decrease);
    if first == Assignment::Assign {
        let agrees = |(assignment, value): (Assignment, f64)| {
            assignment == Assignment::Assign && value == first_value
        };
        return updates.all(agrees).then_some(first_value);
    }
    let additive = is_additive(first);
    let (old, is_single) = (old?, updates.clone().nth(1).is_none());
    // Several changes are added first, so that those that cancel each other change nothing.
    let start = if additive && !is_single { 0.0 } else { old };
    let changed = updates.try_fold(start, |value, (assignment, operand)| match assignment {
        Assignment::Assign => None,
        one if is_additive(one) == additive => Some(one.apply(value, operand)),
        _ => None,
    })?;
    Some(if additive && !is_single { Operator::Add.apply(old, changed) } else { changed })
}
