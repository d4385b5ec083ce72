//! Terms of a ground task: indices of objects, facts and operators, literals, and numeric
//! expressions.
//!
//! A [`FactId`] or [`OperatorId`] is valid in one task only, and never sent in a message.

use pddl::{Comparison, Operator as Arithmetic};

/// Index of an object in one task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct ObjectId(u32);

/// Index of a ground fact in one task. The order is: *basic* facts, which operators change;
/// *comparisons*, which follow from numbers; *derived* facts, which follow from axioms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct FactId(pub(crate) u32);

/// Index of an operator in one task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct OperatorId(pub(crate) u32);

/// A literal: a fact that must be true, or a fact that must be false.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Literal(u32);

/// A change of one numeric fluent.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NumericChange {
    pub(crate) fluent: u32,
    pub(crate) assignment: pddl::Assignment,
    pub(crate) value: GroundExpression,
}

/// An expression over the values of numeric fluents.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum GroundExpression {
    Number(f64),
    Fluent(u32),
    Negate(Box<GroundExpression>),
    Apply(Arithmetic, Vec<GroundExpression>),
}

/// A comparison of two numeric expressions. Its truth value is a fact of the task.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GroundComparison {
    pub(crate) comparison: Comparison,
    pub(crate) left: GroundExpression,
    pub(crate) right: GroundExpression,
}

// === impl ObjectId ===

impl ObjectId {
    pub(crate) fn from_index(index: usize) -> ObjectId {
        ObjectId(u32::try_from(index).unwrap_or(u32::MAX))
    }

    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl FactId ===

impl FactId {
    pub(crate) fn from_index(index: usize) -> FactId {
        FactId(u32::try_from(index).unwrap_or(u32::MAX))
    }

    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

impl OperatorId {
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl Literal ===

impl Literal {
    pub(crate) fn new(fact: FactId, positive: bool) -> Literal {
        Literal(fact.0 << 1 | u32::from(!positive))
    }

    pub(crate) fn fact(self) -> FactId {
        FactId(self.0 >> 1)
    }

    pub(crate) fn is_positive(self) -> bool {
        self.0 & 1 == 0
    }

    pub(crate) fn negated(self) -> Literal {
        Literal(self.0 ^ 1)
    }

    /// Returns the literal with this index: twice the index of its fact, plus one for a negative
    /// literal.
    pub(crate) fn from_index(index: usize) -> Literal {
        Literal(u32::try_from(index).unwrap_or(u32::MAX))
    }

    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl GroundExpression ===

impl GroundExpression {
    /// Returns the value of the expression for these values of the fluents; NaN if a fluent is
    /// undefined or a divisor is zero.
    pub(crate) fn evaluate(&self, values: &dyn Fn(u32) -> f64) -> f64 {
        match self {
            GroundExpression::Number(number) => *number,
            GroundExpression::Fluent(fluent) => values(*fluent),
            GroundExpression::Negate(inner) => -inner.evaluate(values),
            GroundExpression::Apply(operator, operands) => {
                let mut operands = operands.iter().map(|operand| operand.evaluate(values));
                let first = operands.next().unwrap_or(f64::NAN);
                let value = operands.fold(first, |left, right| operator.apply(left, right));
                if value.is_finite() { value } else { f64::NAN }
            }
        }
    }

    /// Whether the value of the expression may be undefined although all its fluents are defined.
    pub(crate) fn may_fail(&self) -> bool {
        match self {
            GroundExpression::Number(_) | GroundExpression::Fluent(_) => false,
            GroundExpression::Negate(inner) => inner.may_fail(),
            GroundExpression::Apply(Arithmetic::Divide, _) => true,
            GroundExpression::Apply(_, operands) => operands.iter().any(Self::may_fail),
        }
    }

    /// Calls `visit` for every fluent in the expression.
    pub(crate) fn fluents(&self, visit: &mut dyn FnMut(u32)) {
        match self {
            GroundExpression::Number(_) => (),
            GroundExpression::Fluent(fluent) => visit(*fluent),
            GroundExpression::Negate(inner) => inner.fluents(visit),
            GroundExpression::Apply(_, operands) => {
                operands.iter().for_each(|operand| operand.fluents(visit));
            }
        }
    }
}
