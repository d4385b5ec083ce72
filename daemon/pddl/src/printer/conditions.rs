//! Conditions, expressions and effects.

use std::fmt;

use super::layout::Layout;
use super::words::{atom, fluent, parameters, term, write};
use crate::tree::{
    Assign, Assignment, Compare, Comparison, Condition, Direction, Effect, Expression, Metric,
    Operator, Typed,
};

pub(super) fn condition(condition: &Condition) -> Layout<'_> {
    match condition {
        Condition::Atom(inner) => atom(inner),
        Condition::Equal(left, right, _) => Layout::headed("=", [term(left), term(right)]),
        Condition::Compare(inner) => compare(inner),
        Condition::Not(inner) => Layout::headed("not", [self::condition(inner)]),
        Condition::And(parts) => Layout::headed("and", parts.iter().map(self::condition)),
        Condition::Or(parts) => Layout::headed("or", parts.iter().map(self::condition)),
        Condition::Imply(premise, conclusion) => {
            Layout::headed("imply", [self::condition(premise), self::condition(conclusion)])
        }
        Condition::Exists(variables, inner) => {
            quantified("exists", variables, self::condition(inner))
        }
        Condition::Forall(variables, inner) => {
            quantified("forall", variables, self::condition(inner))
        }
    }
}

/// `(QUANTIFIER (VARIABLES) X)`
pub(super) fn quantified<'t>(
    quantifier: &'static str,
    variables: &'t [Typed],
    body: Layout<'t>,
) -> Layout<'t> {
    Layout::list(2, vec![Layout::word(quantifier), parameters(variables), body])
}

fn compare(compare: &Compare) -> Layout<'_> {
    let sides = [expression(&compare.left), expression(&compare.right)];
    Layout::headed(comparison(compare.comparison), sides)
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

pub(super) fn expression(expression: &Expression) -> Layout<'_> {
    match expression {
        Expression::Number(number) => Layout::written(number),
        Expression::Fluent(inner) => fluent(inner),
        Expression::Negate(inner) => Layout::headed("-", [self::expression(inner)]),
        Expression::Apply(operator, operands) => {
            Layout::headed(self::operator(*operator), operands.iter().map(self::expression))
        }
        Expression::Duration(_) => Layout::word("?duration"),
        Expression::ContinuousTime(_) => Layout::word("#t"),
        Expression::TotalTime(_) => Layout::word("(total-time)"),
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

pub(super) fn effect(effect: &Effect) -> Layout<'_> {
    match effect {
        Effect::And(parts) => Layout::headed("and", parts.iter().map(self::effect)),
        Effect::Add(inner) => atom(inner),
        Effect::Delete(inner) => Layout::headed("not", [atom(inner)]),
        Effect::Assign(inner) => assign(inner),
        Effect::Forall(variables, inner) => quantified("forall", variables, self::effect(inner)),
        Effect::When(condition, inner) => {
            Layout::headed("when", [self::condition(condition), self::effect(inner)])
        }
    }
}

pub(super) fn assign(assign: &Assign) -> Layout<'_> {
    Layout::headed(
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

fn direction(direction: Direction) -> &'static str {
    match direction {
        Direction::Minimize => "minimize",
        Direction::Maximize => "maximize",
    }
}

pub(super) fn metric(metric: &Metric) -> Layout<'_> {
    Layout::headed(
        ":metric",
        [Layout::word(direction(metric.direction)), expression(&metric.expression)],
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

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(direction(*self))
    }
}
