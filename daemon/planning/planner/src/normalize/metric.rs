//! Costs: converts the metric to a weighted sum of fluents, plus a constant amount for each step.
//!
//! A metric is additive if it is linear and every effect on its fluents is an unconditional
//! increase or decrease by an amount that no step changes. With such a metric, planning searches
//! for a cheapest plan. With any other metric, planning uses the costs of steps in the initial
//! state: the plans are valid, but not proved to be cheapest. The validator computes the true cost
//! of a plan.

use pddl::{
    Assignment, Diagnostic, Expression, FluentTerm, InitElement, Metric, MetricDirection,
    Operator as Arithmetic, Problem,
};

use super::formula::FormulaScope;
use super::lifted::{Costs, Formula, FunctionUse, LiftedNumeric, LiftedSchema, LiftedTerm};
use super::symbols::SymbolTable;
use crate::outcome::{PlanError, Unsupported};
use crate::task::ObjectId;

/// Returns the costs that the metric defines. Without a metric, every step costs one.
pub(super) fn costs(
    symbols: &mut SymbolTable,
    problem: &Problem,
    schemas: &[LiftedSchema],
) -> Result<Costs, PlanError> {
    let Some(metric) = &problem.metric else { return Ok(Costs::default()) };
    refuse_what_has_no_value(symbols, problem, metric, schemas);
    let sign = if metric.direction == MetricDirection::Maximize { -1.0 } else { 1.0 };
    let mut linear = LinearMetric { weights: Vec::new(), per_step: 0.0, is_linear: true };
    linear.add(&metric.expression, sign)?;
    if !linear.is_linear {
        // The cost of a step is unknown, so all steps have the same cost.
        return Ok(Costs { weights: Some(Vec::new()), per_step: 1.0, varies: true, is_sum: false });
    }
    let (mut weights, per_step) = (Vec::new(), linear.per_step);
    for (fluent, weight) in linear.weights {
        let mut scope = FormulaScope::new(symbols, []);
        let Some(fluent) = scope.fluent(fluent) else { continue };
        let objects = fluent.arguments.iter().filter_map(|term| match term {
            LiftedTerm::Object(object) => Some(*object),
            LiftedTerm::Variable(_) => None,
        });
        let objects: Vec<ObjectId> = objects.collect();
        weights.push((fluent.function, objects, weight));
    }
    Ok(Costs { weights: Some(weights), per_step, varies: false, is_sum: true })
}

/// Sets `varies` if the cost of any step depends on the state. This is so if a fluent of the metric
/// is assigned, scaled, changed under a condition, or changed by an amount that is not constant.
pub(super) fn note_variation(
    costs: &mut Costs,
    schemas: &[LiftedSchema],
    functions: &[FunctionUse],
) {
    let weights = costs.weights.as_deref().unwrap_or_default();
    let mut varies = costs.varies;
    let in_metric = |change: &LiftedNumeric| {
        weights.iter().any(|(function, ..)| *function == change.fluent.function)
    };
    for change in schemas.iter().flat_map(|schema| &schema.numeric).filter(|one| in_metric(one)) {
        varies |= !matches!(change.assignment, Assignment::Increase | Assignment::Decrease);
        varies |= !matches!(&change.condition, Formula::And(parts) if parts.is_empty());
        change.value.functions(&mut |function| varies |= functions[function].changed);
    }
    costs.varies = varies;
}

/// Reports fluents of the metric without a value in the initial state that no action assigns.
fn refuse_what_has_no_value(
    symbols: &mut SymbolTable,
    problem: &Problem,
    metric: &Metric,
    schemas: &[LiftedSchema],
) {
    let mut fluents = Vec::new();
    collect(&metric.expression, &mut fluents);
    for fluent in fluents {
        let is_total_cost = fluent.function == pddl::TOTAL_COST && fluent.arguments.is_empty();
        let has_value = problem
            .init
            .iter()
            .any(|element| matches!(element, InitElement::Assign(other, _) if other == fluent));
        if is_total_cost || has_value || !symbols.has_function(&fluent.function) {
            continue;
        }
        let function = symbols.function(&fluent.function, fluent.arguments.len());
        let gives = |change: &LiftedNumeric| {
            change.assignment == Assignment::Assign && Some(change.fluent.function) == function
        };
        if !schemas.iter().flat_map(|schema| &schema.numeric).any(gives) {
            let message = format!("the metric reads `{fluent}`, which has no value");
            let help = format!("give it one in `:init`: `(= {fluent} NUMBER)`");
            symbols.problems.push(Diagnostic::error(fluent.span, message).with_help(help));
        }
    }
}

/// Collects all fluents in an expression.
fn collect<'e>(expression: &'e Expression, fluents: &mut Vec<&'e FluentTerm>) {
    match expression {
        Expression::Fluent(fluent) => fluents.push(fluent),
        Expression::Negate(inner) => collect(inner, fluents),
        Expression::Apply(_, operands) => operands.iter().for_each(|one| collect(one, fluents)),
        Expression::Number(_)
        | Expression::Duration(_)
        | Expression::ContinuousTime(_)
        | Expression::TotalTime(_) => (),
    }
}

/// A weighted sum of fluents. Constants are dropped, because they do not distinguish plans.
struct LinearMetric<'m> {
    weights: Vec<(&'m FluentTerm, f64)>,
    /// The weight of `total-time`, which is the cost of each step.
    per_step: f64,
    /// Whether the whole metric is a weighted sum of fluents.
    is_linear: bool,
}

// === impl LinearMetric ===

impl<'m> LinearMetric<'m> {
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
                Err(Unsupported::in_problem("time in a metric", *span).into())
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

    /// Adds `(* NUMBER E)`, `(* E NUMBER)` or `(/ E NUMBER)` to the sum. Marks the metric as not
    /// linear for other products and quotients.
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
            _ => {
                self.is_linear = false;
                Ok(())
            }
        }
    }
}
