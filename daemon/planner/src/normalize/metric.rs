//! What a plan costs: the metric as a weighted sum of fluents that only ever grow step by step.
//!
//! A metric is additive if every change of its fluents is an unconditional increase or decrease.
//! Anything else is refused by name. Where the amount depends on the state, planning counts what it
//! is in the initial state, and proves no cost; what a plan costs is told by the validator.

use pddl::{
    Assignment, Direction, Expression, FluentTerm, Metric, Operator as Arithmetic, Problem,
};

use super::formula::Scope;
use super::lifted::{Costs, Formula, FunctionUse, LiftedNumeric, LiftedTerm, Schema};
use super::symbols::Symbols;
use crate::outcome::{PlanError, Unsupported};
use crate::task::ObjectId;

/// The weights of the metric, if there is one.
pub(super) fn costs(symbols: &mut Symbols, problem: &Problem) -> Result<Costs, PlanError> {
    let Some(metric) = &problem.metric else { return Ok(Costs::default()) };
    let sign = if metric.direction == Direction::Maximize { -1.0 } else { 1.0 };
    let mut linear = Linear { metric, weights: Vec::new(), per_step: 0.0 };
    linear.add(&metric.expression, sign)?;
    let (mut weights, per_step) = (Vec::new(), linear.per_step);
    for (fluent, weight) in linear.weights {
        let mut scope = Scope::new(symbols, []);
        let Some(fluent) = scope.fluent(fluent) else { continue };
        let objects = fluent.arguments.iter().filter_map(|term| match term {
            LiftedTerm::Object(object) => Some(*object),
            LiftedTerm::Variable(_) => None,
        });
        let objects: Vec<ObjectId> = objects.collect();
        weights.push((fluent.function, objects, weight));
    }
    Ok(Costs { weights: Some(weights), per_step, varies: false })
}

/// Refuses a metric whose fluents are set, scaled, or changed under conditions; notes whether their
/// changes depend on the state.
pub(super) fn check_additive(
    costs: &mut Costs,
    schemas: &[Schema],
    functions: &[FunctionUse],
) -> Result<(), Unsupported> {
    let weights = costs.weights.as_deref().unwrap_or_default();
    let mut varies = false;
    let in_metric = |change: &LiftedNumeric| {
        weights.iter().any(|(function, ..)| *function == change.fluent.function)
    };
    for change in schemas.iter().flat_map(|schema| &schema.numeric).filter(|one| in_metric(one)) {
        let name = &functions[change.fluent.function].name;
        let refuse = |what: &str| {
            Unsupported::in_domain(
                format!("{what} of `{name}`, which the metric counts"),
                change.span,
            )
        };
        if !matches!(change.assignment, Assignment::Increase | Assignment::Decrease) {
            return Err(refuse("an assignment or scaling"));
        }
        if !matches!(&change.condition, Formula::And(parts) if parts.is_empty()) {
            return Err(refuse("a conditional change"));
        }
        change.value.functions(&mut |function| varies |= functions[function].changed);
    }
    costs.varies = varies;
    Ok(())
}

/// A sum of weighted fluents; constants do not tell plans apart and are dropped.
struct Linear<'m> {
    metric: &'m Metric,
    weights: Vec<(&'m FluentTerm, f64)>,
    /// The weight of `total-time`.
    per_step: f64,
}

// === impl Linear ===

impl<'m> Linear<'m> {
    fn add(&mut self, expression: &'m Expression, weight: f64) -> Result<(), PlanError> {
        match expression {
            Expression::Number(_) => Ok(()),
            Expression::Fluent(fluent) => {
                self.weights.push((fluent, weight));
                Ok(())
            }
            Expression::Negate(inner) => self.add(inner, -weight),
            Expression::Apply(operator, operands) => self.apply(*operator, operands, weight),
            Expression::TotalTime(_) => {
                self.per_step += weight;
                Ok(())
            }
            Expression::Duration(span) | Expression::ContinuousTime(span) => {
                Err(self.refuse("time in a metric", *span))
            }
        }
    }

    fn apply(
        &mut self,
        operator: Arithmetic,
        operands: &'m [Expression],
        weight: f64,
    ) -> Result<(), PlanError> {
        match operator {
            Arithmetic::Add => operands.iter().try_for_each(|one| self.add(one, weight)),
            Arithmetic::Subtract => {
                let mut sign = weight;
                for operand in operands {
                    self.add(operand, sign)?;
                    sign = -weight;
                }
                Ok(())
            }
            Arithmetic::Multiply | Arithmetic::Divide => self.scale(operator, operands, weight),
        }
    }

    /// `(* NUMBER E)`, `(* E NUMBER)`, `(/ E NUMBER)`
    fn scale(
        &mut self,
        operator: Arithmetic,
        operands: &'m [Expression],
        weight: f64,
    ) -> Result<(), PlanError> {
        match operands {
            [Expression::Number(factor), inner] if operator == Arithmetic::Multiply => {
                self.add(inner, weight * factor.0)
            }
            [inner, Expression::Number(factor)] if operator == Arithmetic::Multiply => {
                self.add(inner, weight * factor.0)
            }
            [inner, Expression::Number(divisor)] if divisor.0 != 0.0 => {
                self.add(inner, weight / divisor.0)
            }
            _ => Err(self.refuse("a metric that is not linear", self.metric.span)),
        }
    }

    fn refuse(&self, feature: &str, span: pddl::Span) -> PlanError {
        Unsupported::in_problem(feature, span).into()
    }
}
