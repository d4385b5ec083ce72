//! Printing of conditions, expressions and effects.

use std::fmt;

use super::layout::PrintLayout;
use super::terms::{atom, fluent, parameters, term, write};
use crate::tree::{
    Assign, Assignment, Compare, Comparison, Condition, Effect, Expression, Metric,
    MetricDirection, Operator, Typed,
};

pub(super) fn condition(condition: &Condition) -> PrintLayout<'_> {
    match condition {
        Condition::Atom(inner) => atom(inner),
        Condition::Equal(left, right, _) => PrintLayout::headed("=", [term(left), term(right)]),
        Condition::Compare(inner) => compare(inner),
        Condition::Not(inner) => PrintLayout::headed("not", [self::condition(inner)]),
        Condition::And(parts) => PrintLayout::headed("and", parts.iter().map(self::condition)),
        Condition::Or(parts) => PrintLayout::headed("or", parts.iter().map(self::condition)),
        Condition::Imply(premise, conclusion) => {
            PrintLayout::headed("imply", [self::condition(premise), self::condition(conclusion)])
        }
        Condition::Exists(variables, inner) => {
            quantified("exists", variables, self::condition(inner))
        }
        Condition::Forall(variables, inner) => {
            quantified("forall", variables, self::condition(inner))
        }
    }
}

/// Lays out a quantifier: `(QUANTIFIER (VARIABLES) X)`.
pub(super) fn quantified<'t>(
    quantifier: &'static str,
    variables: &'t [Typed],
    body: PrintLayout<'t>,
) -> PrintLayout<'t> {
    PrintLayout::list(2, vec![PrintLayout::word(quantifier), parameters(variables), body])
}

fn compare(compare: &Compare) -> PrintLayout<'_> {
    let sides = [expression(&compare.left), expression(&compare.right)];
    PrintLayout::headed(comparison(compare.comparison), sides)
}

pub(super) fn comparison(comparison: Comparison) -> &'static str {
    match comparison {
        Comparison::Less => "<",
        Comparison::LessOrEqual => "<=",
        Comparison::Equal => "=",
        Comparison::GreaterOrEqual => ">=",
        Comparison::Greater => ">",
    }
}

pub(super) fn expression(expression: &Expression) -> PrintLayout<'_> {
    match expression {
        Expression::Number(number) => PrintLayout::written(number),
        Expression::Fluent(inner) => fluent(inner),
        Expression::Negate(inner) => PrintLayout::headed("-", [self::expression(inner)]),
        Expression::Apply(operator, operands) => {
            PrintLayout::headed(self::operator(*operator), operands.iter().map(self::expression))
        }
        Expression::Duration(_) => PrintLayout::word("?duration"),
        Expression::ContinuousTime(_) => PrintLayout::word("#t"),
        Expression::TotalTime(_) => PrintLayout::word("(total-time)"),
    }
}

fn operator(operator: Operator) -> &'static str {
    match operator {
        Operator::Add => "+",
        Operator::Subtract => "-",
        Operator::Multiply => "*",
        Operator::Divide => "/",
    }
}

pub(super) fn effect(effect: &Effect) -> PrintLayout<'_> {
    match effect {
        Effect::And(parts) => PrintLayout::headed("and", parts.iter().map(self::effect)),
        Effect::Add(inner) => atom(inner),
        Effect::Delete(inner) => PrintLayout::headed("not", [atom(inner)]),
        Effect::Assign(inner) => assign(inner),
        Effect::Forall(variables, inner) => quantified("forall", variables, self::effect(inner)),
        Effect::When(condition, inner) => {
            PrintLayout::headed("when", [self::condition(condition), self::effect(inner)])
        }
    }
}

pub(super) fn assign(assign: &Assign) -> PrintLayout<'_> {
    PrintLayout::headed(
        assignment(assign.assignment),
        [fluent(&assign.fluent), expression(&assign.value)],
    )
}

fn assignment(assignment: Assignment) -> &'static str {
    match assignment {
        Assignment::Assign => "assign",
        Assignment::Increase => "increase",
        Assignment::Decrease => "decrease",
        Assignment::ScaleUp => "scale-up",
        Assignment::ScaleDown => "scale-down",
    }
}

fn direction(direction: MetricDirection) -> &'static str {
    match direction {
        MetricDirection::Minimize => "minimize",
        MetricDirection::Maximize => "maximize",
    }
}

pub(super) fn metric(metric: &Metric) -> PrintLayout<'_> {
    PrintLayout::headed(
        ":metric",
        [PrintLayout::word(direction(metric.direction)), expression(&metric.expression)],
    )
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&condition(self), f)
    }
}

impl fmt::Display for Compare {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&compare(self), f)
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(comparison(*self))
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&expression(self), f)
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&effect(self), f)
    }
}

impl fmt::Display for Assign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&assign(self), f)
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&metric(self), f)
    }
}

impl fmt::Display for Operator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(operator(*self))
    }
}

impl fmt::Display for Assignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(assignment(*self))
    }
}

impl fmt::Display for MetricDirection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(direction(*self))
    }
}
