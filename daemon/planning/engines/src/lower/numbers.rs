//! Arithmetic in the form that Metric-FF supports: linear, two operands for each operator, and at
//! most one change of each fluent in an action.

use std::collections::BTreeSet;

use pddl::{
    Assign, Assignment, Condition, Domain, Effect, Expression, FunctionDeclaration, InitElement,
    Name, Number, Operator, Privacy, Problem, Span, TOTAL_COST,
};
use planner::{InputText, Unsupported};

use super::refuse::unsupported;
use super::task_parts;

/// Rewrites the arithmetic of a task for Metric-FF. Returns an error for arithmetic that is not
/// linear.
pub(super) fn lower(domain: &mut Domain, problem: &mut Problem) -> Result<(), Unsupported> {
    refuse_nonlinear(domain, problem)?;
    start_total_cost(domain, problem);
    for action in &mut domain.actions {
        action.precondition = condition(std::mem::take(&mut action.precondition));
        action.effect = merged(effect(std::mem::take(&mut action.effect)));
    }
    problem.goal = condition(std::mem::take(&mut problem.goal));
    if let Some(metric) = &mut problem.metric {
        metric.expression = binary(metric.expression.clone());
    }
    Ok(())
}

fn refuse_nonlinear(domain: &Domain, problem: &Problem) -> Result<(), Unsupported> {
    let assigns = task_parts::assigns(domain);
    let changed: BTreeSet<&Name> = assigns.iter().map(|it| &it.fluent.function).collect();
    let feature = "arithmetic that is not linear";
    for assign in &assigns {
        if matches!(assign.assignment, Assignment::ScaleUp | Assignment::ScaleDown) {
            return Err(unsupported("scaling effects", assign.span, InputText::Domain));
        }
        if degree(&assign.value, &changed) > 1 {
            return Err(unsupported(feature, assign.span, InputText::Domain));
        }
    }
    let mut first = None;
    task_parts::all_conditions(domain, problem, &mut |part, text| {
        if let Condition::Compare(compare) = part
            && degree(&compare.left, &changed).max(degree(&compare.right, &changed)) > 1
            && first.is_none()
        {
            first = Some(unsupported(feature, compare.span, text));
        }
    });
    if let Some(metric) = &problem.metric
        && degree(&metric.expression, &changed) > 1
        && first.is_none()
    {
        first = Some(unsupported("a metric that is not linear", metric.span, InputText::Problem));
    }
    first.map_or(Ok(()), Err)
}

/// Returns the degree of an expression in the functions `changed`, which actions change: 0 if the
/// value never changes, 1 if the expression is linear, 2 otherwise.
fn degree(expression: &Expression, changed: &BTreeSet<&Name>) -> u8 {
    let of = |one: &Expression| degree(one, changed);
    match expression {
        Expression::Fluent(fluent) => u8::from(changed.contains(&fluent.function)),
        Expression::Negate(inner) => of(inner),
        Expression::Apply(Operator::Add | Operator::Subtract, operands) => {
            operands.iter().map(of).max().unwrap_or(0)
        }
        Expression::Apply(Operator::Multiply, operands) => {
            operands.iter().map(of).sum::<u8>().min(2)
        }
        Expression::Apply(Operator::Divide, operands) => match &operands[..] {
            [first, by @ ..] if by.iter().all(|one| of(one) == 0) => of(first),
            _ => 2,
        },
        _ => 0,
    }
}

/// Declares `total-cost` and sets it to 0, if the task uses this function without a declaration or
/// without an initial value.
fn start_total_cost(domain: &mut Domain, problem: &mut Problem) {
    let is_used = task_parts::assigns(domain).iter().any(|it| it.fluent.function == TOTAL_COST);
    let metric =
        problem.metric.as_ref().map(|metric| metric.expression.fluents().collect::<Vec<_>>());
    let is_counted =
        metric.is_some_and(|fluents| fluents.iter().any(|it| it.function == TOTAL_COST));
    if !is_used && !is_counted {
        return;
    }
    if domain.functions.iter().all(|it| it.name != TOTAL_COST) {
        let (name, parameters) = (Name::new(TOTAL_COST), Vec::new());
        domain.functions.push(FunctionDeclaration { name, parameters, privacy: Privacy::Public });
    }
    let key = (Name::new(TOTAL_COST), Vec::new());
    if !task_parts::values(problem).contains_key(&key) {
        let (function, arguments) = key;
        let arguments = arguments.into_iter().map(pddl::Term::Object).collect();
        let fluent = pddl::FluentTerm { function, arguments, span: Span::default() };
        problem.init.push(InitElement::Assign(fluent, Number(0.0)));
    }
}

/// Merges several increases and decreases of one fluent into one change.
fn merged(effect: Effect) -> Effect {
    let Effect::And(parts) = effect else { return effect };
    let mut merged: Vec<Effect> = Vec::new();
    for part in parts {
        let Effect::Assign(assign) = part else {
            merged.push(part);
            continue;
        };
        let same = merged.iter_mut().find_map(|known| match known {
            Effect::Assign(known) if known.fluent == assign.fluent && is_additive(known) => {
                Some(known)
            }
            _ => None,
        });
        match same {
            Some(known) if is_additive(&assign) => add(known, *assign),
            _ => merged.push(Effect::Assign(assign)),
        }
    }
    Effect::And(merged)
}

fn is_additive(assign: &Assign) -> bool {
    matches!(assign.assignment, Assignment::Increase | Assignment::Decrease)
}

fn add(known: &mut Assign, other: Assign) {
    let is_same = known.assignment == other.assignment;
    let operator = if is_same { Operator::Add } else { Operator::Subtract };
    let left = std::mem::replace(&mut known.value, Expression::Number(Number(0.0)));
    known.value = Expression::Apply(operator, vec![left, other.value]);
}

fn condition(from: Condition) -> Condition {
    let each = |parts: Vec<Condition>| parts.into_iter().map(condition).collect();
    match from {
        Condition::Atom(_) | Condition::Equal(..) => from,
        Condition::Compare(mut compare) => {
            compare.left = binary(compare.left);
            compare.right = binary(compare.right);
            Condition::Compare(compare)
        }
        Condition::Not(inner) => Condition::Not(Box::new(condition(*inner))),
        Condition::And(parts) => Condition::And(each(parts)),
        Condition::Or(parts) => Condition::Or(each(parts)),
        Condition::Imply(left, right) => {
            Condition::Imply(Box::new(condition(*left)), Box::new(condition(*right)))
        }
        Condition::Exists(variables, inner) => {
            Condition::Exists(variables, Box::new(condition(*inner)))
        }
        Condition::Forall(variables, inner) => {
            Condition::Forall(variables, Box::new(condition(*inner)))
        }
    }
}

/// Flattens the conjunctions in an effect, so that changes of one fluent are next to each other.
fn effect(from: Effect) -> Effect {
    match from {
        Effect::Add(_) | Effect::Delete(_) => from,
        Effect::And(parts) => {
            let flat = parts.into_iter().flat_map(|part| match effect(part) {
                Effect::And(parts) => parts,
                other => vec![other],
            });
            Effect::And(flat.collect())
        }
        Effect::Assign(mut assign) => {
            assign.value = binary(assign.value);
            Effect::Assign(assign)
        }
        Effect::When(when, inner) => {
            Effect::When(Box::new(condition(*when)), Box::new(merged(effect(*inner))))
        }
        Effect::Forall(variables, inner) => {
            Effect::Forall(variables, Box::new(merged(effect(*inner))))
        }
    }
}

/// Converts operators with more than two operands: `(+ a b c)` becomes `(+ (+ a b) c)`.
fn binary(expression: Expression) -> Expression {
    match expression {
        Expression::Negate(inner) => {
            let zero = Expression::Number(Number(0.0));
            Expression::Apply(Operator::Subtract, vec![zero, binary(*inner)])
        }
        Expression::Apply(operator, operands) => {
            let nested = operands.into_iter().map(binary);
            let nested =
                nested.reduce(|left, right| Expression::Apply(operator, vec![left, right]));
            nested.unwrap_or(Expression::Number(Number(0.0)))
        }
        other => other,
    }
}
