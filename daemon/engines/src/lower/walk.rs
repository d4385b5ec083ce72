//! Looking at every part of a tree, for whoever wants to know and not to change.

use pddl::{Assign, Condition, Domain, Effect, Expression, FluentTerm, InitElement, Problem};
use planner::Text;

/// The condition and everything in it, outermost first.
pub(super) fn conditions<'t>(condition: &'t Condition, look: &mut dyn FnMut(&'t Condition)) {
    look(condition);
    match condition {
        Condition::Atom(_) | Condition::Equal(..) | Condition::Compare(_) => (),
        Condition::And(parts) | Condition::Or(parts) => {
            parts.iter().for_each(|part| conditions(part, look));
        }
        Condition::Imply(left, right) => {
            conditions(left, look);
            conditions(right, look);
        }
        Condition::Not(inner) | Condition::Exists(_, inner) | Condition::Forall(_, inner) => {
            conditions(inner, look);
        }
    }
}

/// The effect and everything in it, outermost first.
pub(super) fn effects<'t>(effect: &'t Effect, look: &mut dyn FnMut(&'t Effect)) {
    look(effect);
    match effect {
        Effect::Add(_) | Effect::Delete(_) | Effect::Assign(_) => (),
        Effect::And(parts) => parts.iter().for_each(|part| effects(part, look)),
        Effect::When(_, inner) | Effect::Forall(_, inner) => effects(inner, look),
    }
}

/// The expression and everything in it, outermost first.
pub(super) fn expressions<'t>(expression: &'t Expression, look: &mut dyn FnMut(&'t Expression)) {
    look(expression);
    match expression {
        Expression::Negate(inner) => expressions(inner, look),
        Expression::Apply(_, operands) => operands.iter().for_each(|one| expressions(one, look)),
        _ => (),
    }
}

/// The fluents of an expression.
pub(super) fn fluents(expression: &Expression) -> Vec<&FluentTerm> {
    let mut found = Vec::new();
    expressions(expression, &mut |part| {
        if let Expression::Fluent(fluent) = part {
            found.push(fluent);
        }
    });
    found
}

/// Every numeric change that actions make.
pub(super) fn assigns(domain: &Domain) -> Vec<&Assign> {
    let mut found = Vec::new();
    for action in &domain.actions {
        effects(&action.effect, &mut |part| {
            if let Effect::Assign(assign) = part {
                found.push(&**assign);
            }
        });
    }
    found
}

/// Every condition of the task, the goal among them, and which text it is of.
pub(super) fn all_conditions<'t>(
    domain: &'t Domain,
    problem: &'t Problem,
    look: &mut dyn FnMut(&'t Condition, Text),
) {
    for action in &domain.actions {
        conditions(&action.precondition, &mut |part| look(part, Text::Domain));
        effects(&action.effect, &mut |effect| {
            if let Effect::When(condition, _) = effect {
                conditions(condition, &mut |part| look(part, Text::Domain));
            }
        });
    }
    for axiom in &domain.derived {
        conditions(&axiom.condition, &mut |part| look(part, Text::Domain));
    }
    conditions(&problem.goal, &mut |part| look(part, Text::Problem));
}

/// The values that `:init` gives; the last one counts, as for the validator.
pub(super) fn values(
    problem: &Problem,
) -> std::collections::BTreeMap<(pddl::Name, Vec<pddl::Name>), f64> {
    let assigned = problem.init.iter().filter_map(|element| match element {
        InitElement::Assign(fluent, number) => Some((fluent, number.0)),
        _ => None,
    });
    assigned.map(|(fluent, value)| (ground(fluent), value)).collect()
}

/// A fluent without variables, as something to look up.
pub(super) fn ground(fluent: &FluentTerm) -> (pddl::Name, Vec<pddl::Name>) {
    let objects = fluent.arguments.iter().map(|term| term.name().clone());
    (fluent.function.clone(), objects.collect())
}
