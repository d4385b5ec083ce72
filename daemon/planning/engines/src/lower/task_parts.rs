//! Functions that iterate over the parts of a task without changing it.

use pddl::{Assign, Condition, Domain, Effect, FluentTerm, InitElement, Problem};
use planner::InputText;

/// Returns every numeric change in the effects of a domain's actions.
pub(super) fn assigns(domain: &Domain) -> Vec<&Assign> {
    let parts = domain.actions.iter().flat_map(|action| action.effect.parts());
    let assigns = parts.filter_map(|part| match part {
        Effect::Assign(assign) => Some(&**assign),
        _ => None,
    });
    assigns.collect()
}

/// Calls `look` for every condition of the task, including the goal. The second argument of `look`
/// is the text that contains the condition (domain or problem).
pub(super) fn all_conditions<'t>(
    domain: &'t Domain,
    problem: &'t Problem,
    look: &mut dyn FnMut(&'t Condition, InputText),
) {
    for action in &domain.actions {
        action.precondition.parts().for_each(|part| look(part, InputText::Domain));
        for effect in action.effect.parts() {
            if let Effect::When(condition, _) = effect {
                condition.parts().for_each(|part| look(part, InputText::Domain));
            }
        }
    }
    for axiom in &domain.derived {
        axiom.condition.parts().for_each(|part| look(part, InputText::Domain));
    }
    problem.goal.parts().for_each(|part| look(part, InputText::Problem));
}

/// Returns the values that `:init` gives to ground fluents. The key is the function and its
/// arguments. If a fluent has several values, the last one is used, as in the validator.
pub(super) fn values(
    problem: &Problem,
) -> std::collections::BTreeMap<(pddl::Name, Vec<pddl::Name>), f64> {
    let assigned = problem.init.iter().filter_map(|element| match element {
        InitElement::Assign(fluent, number) => Some((fluent, number.0)),
        _ => None,
    });
    assigned.map(|(fluent, value)| (ground(fluent), value)).collect()
}

/// Returns a ground fluent as a key for look-ups: its function and its arguments.
pub(super) fn ground(fluent: &FluentTerm) -> (pddl::Name, Vec<pddl::Name>) {
    let objects = fluent.arguments.iter().map(|term| term.name().clone());
    (fluent.function.clone(), objects.collect())
}
