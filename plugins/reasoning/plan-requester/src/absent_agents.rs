//! Names in a goal that only an absent agent of the ecosystem file declares.

use std::sync::Arc;

use pddl::{ActionModel, Condition, Diagnostic, Domain, Problem};

/// Maximum number of absent agents that are listed by name; the others are only counted.
const NAMED_MAX: usize = 5;

/// Returns, as text for a person, that absent agents declare the unknown names in `goal`. Returns `None`
/// if no name is unknown, or if some mistake remains when all agents in `absent` are present.
pub(crate) fn absent_declarers(
    (domain, problem): (&Domain, &Problem),
    goal: &Condition,
    absent: &[&ActionModel],
) -> Option<String> {
    let errors = errors_in(domain, problem, goal);
    let is_explained = || errors_with(domain, problem, goal, absent).is_empty();
    if errors.is_empty() || absent.is_empty() || !is_explained() {
        return None;
    }
    let fewer = |model: &&&ActionModel| {
        errors_with(domain, problem, goal, std::slice::from_ref(*model)).len() < errors.len()
    };
    let mut agents: Vec<_> =
        { absent.iter() }.filter(fewer).map(|model| format!("`{}`", model.agent)).collect();
    let is_one = agents.len() == 1;
    let more = agents.len().saturating_sub(NAMED_MAX);
    agents.truncate(NAMED_MAX);
    if more > 0 {
        agents.push(format!("{more} more"));
    }
    let last = agents.pop()?;
    let agents = if agents.is_empty() { last } else { format!("{} or {last}", agents.join(", ")) };
    let here = if is_one { "is not here" } else { "are not here" };
    let missing: Vec<_> = errors.iter().map(|error| error.message.as_str()).collect();
    Some(format!("{}; the ecosystem file has {agents} for it, which {here}", missing.join(", ")))
}

/// Returns the errors that checking `goal` finds if the agents with these models were present, too.
fn errors_with(
    domain: &Domain,
    problem: &Problem,
    goal: &Condition,
    models: &[&ActionModel],
) -> Vec<Diagnostic> {
    let (mut domain, mut problem) = (domain.clone(), problem.clone());
    let objects = Arc::make_mut(&mut problem.objects);
    for model in models {
        domain.types.extend(model.types.iter().cloned());
        domain.predicates.extend(model.predicates.iter().cloned());
        domain.functions.extend(model.functions.iter().cloned());
        objects.extend(model.objects.iter().cloned());
    }
    errors_in(&domain, &problem, goal)
}

fn errors_in(domain: &Domain, problem: &Problem, goal: &Condition) -> Vec<Diagnostic> {
    let diagnostics = pddl::check::check_condition(domain, problem, goal);
    diagnostics.into_iter().filter(Diagnostic::is_error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOMAIN: &str = "(define (domain office) (:requirements :typing) (:types room device)
        (:predicates (clean ?r - room)))";
    const MAP: &str = "(define (problem map) (:domain office) (:objects hall - room) (:init)
        (:goal (and)))";
    const LAMP: &str = "(define (agent lamp) (:domain office) (:objects lamp - device)
        (:predicates (lit ?r - room)))";
    const VACUUM: &str = "(define (agent vacuum) (:domain office) (:objects vacuum - device))";

    fn explained(goal: &str, absent: &[&str]) -> Option<String> {
        let domain = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
        let map = pddl::parse_problem(MAP).into_result().expect("a map");
        let goal = pddl::parse_condition(goal).into_result().expect("a condition");
        let read = |text: &&str| pddl::parse_action_model(text).into_result().expect("a model");
        let models: Vec<_> = absent.iter().map(read).collect();
        absent_declarers((&domain, &map), &goal, &models.iter().collect::<Vec<_>>())
    }

    #[test]
    fn an_absent_agent_is_named_if_it_declares_what_is_unknown() {
        let text = explained("(lit hall)", &[LAMP, VACUUM]).expect("explained");
        assert!(text.ends_with("has `lamp` for it, which is not here"), "{text}");
        assert!(text.contains("lit"), "{text}");
        assert_eq!(explained("(lit hall)", &[VACUUM]), None, "it declares something else");
        assert_eq!(explained("(lit attic)", &[LAMP]), None, "a mistake remains");
        assert_eq!(explained("(clean hall)", &[LAMP]), None, "all names are known");
    }
}
