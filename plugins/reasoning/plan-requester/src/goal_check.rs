//! Checks the names and the conjuncts of a goal against the composite domain.

use std::collections::BTreeSet;
use std::sync::Arc;

use pddl::{ActionModel, Condition, Diagnostic, Domain, Name, Problem};

use crate::explanations::listed;
use crate::goal::Goal;
use crate::planning_snapshot::PlanningSnapshot;

/// Returns, as text for a person, the parts of a goal that are not valid any more, because the
/// agent that declared the names in them has left. Returns `None` if there are no such parts.
pub(crate) fn lost_to(goal: &Goal, known: &PlanningSnapshot) -> Option<String> {
    let errors = errors_in(&known.domain, &known.problem, &goal.condition);
    (!errors.is_empty()).then(|| format!("{}: its agent is not here", messages(&errors)))
}

/// Returns, as text for a person, the errors of checking a goal against the composite domain, or a
/// contradiction within the goal. Returns `None` if there is neither.
pub(crate) fn wrong_in(goal: &Goal, known: &PlanningSnapshot) -> Option<String> {
    mistakes(&goal.condition, &goal.text, known)
}

/// Returns, as text for a person, the errors of checking the condition that `text` contains, or a
/// contradiction within it. Returns `None` if there is neither.
pub(crate) fn mistakes(
    condition: &Condition,
    text: &str,
    known: &PlanningSnapshot,
) -> Option<String> {
    let errors = errors_in(&known.domain, &known.problem, condition);
    if errors.is_empty() {
        let both = known.contradiction(condition)?;
        return Some(format!("it can never hold: it requires `{both}` and `(not {both})`"));
    }
    let lines: Vec<_> = errors.iter().map(|error| error.located(text)).collect();
    Some(lines.join("\n"))
}

/// Returns, as text for a person, which absent agents declare the unknown names in a goal. `absent`
/// has the action models of the absent agents of the ecosystem file. Returns `None` if no name is
/// unknown, or if some mistake remains when all absent agents are present.
pub(crate) fn absent_declarers<'m>(
    goal: &Goal,
    known: &PlanningSnapshot,
    absent: impl Iterator<Item = &'m ActionModel>,
) -> Option<String> {
    declarers(&known.domain, &known.problem, &goal.condition, absent)
}

fn declarers<'m>(
    domain: &Domain,
    problem: &Problem,
    goal: &Condition,
    absent: impl Iterator<Item = &'m ActionModel>,
) -> Option<String> {
    let errors = errors_in(domain, problem, goal);
    if errors.is_empty() {
        return None;
    }
    let unknown = unknown_names(domain, problem, goal);
    let (mut domain, mut problem) = (domain.clone(), problem.clone());
    let objects = Arc::make_mut(&mut problem.objects);
    let mut agents = Vec::new();
    for model in absent {
        if names_of(model).any(|name| unknown.contains(name)) {
            agents.push(format!("`{}`", model.agent));
        }
        domain.types.extend(model.types.iter().cloned());
        domain.predicates.extend(model.predicates.iter().cloned());
        domain.functions.extend(model.functions.iter().cloned());
        objects.extend(model.objects.iter().cloned());
    }
    if agents.is_empty() || !errors_in(&domain, &problem, goal).is_empty() {
        return None;
    }
    let here = if agents.len() == 1 { "is not here" } else { "are not here" };
    let (names, agents) = (messages(&errors), listed(agents, ", "));
    Some(format!("{names}; declared by {agents} of the ecosystem file, which {here}"))
}

/// Returns the words of a goal that are names neither in the domain nor in the problem.
fn unknown_names(domain: &Domain, problem: &Problem, goal: &Condition) -> BTreeSet<Name> {
    let is_end = |char: char| char.is_whitespace() || matches!(char, '(' | ')');
    let mut words: BTreeSet<_> = goal.to_string().split(is_end).map(Name::new).collect();
    let declared = { domain.types.iter().chain(&domain.constants) }
        .map(|typed| &typed.name)
        .chain(domain.predicates.iter().map(|predicate| &predicate.name))
        .chain(domain.functions.iter().map(|function| &function.name))
        .chain(problem.objects.iter().map(|declared| &declared.object.name));
    declared.for_each(|name| {
        words.remove(name);
    });
    words
}

/// Returns the names that an action model declares.
fn names_of(model: &ActionModel) -> impl Iterator<Item = &Name> {
    { model.types.iter() }
        .map(|typed| &typed.name)
        .chain(model.predicates.iter().map(|predicate| &predicate.name))
        .chain(model.functions.iter().map(|function| &function.name))
        .chain(model.objects.iter().map(|declared| &declared.object.name))
}

fn errors_in(domain: &Domain, problem: &Problem, goal: &Condition) -> Vec<Diagnostic> {
    let diagnostics = pddl::check::check_condition(domain, problem, goal);
    diagnostics.into_iter().filter(Diagnostic::is_error).collect()
}

fn messages(errors: &[Diagnostic]) -> String {
    let messages: Vec<_> = errors.iter().map(|error| error.message.as_str()).collect();
    messages.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOMAIN: &str = "(define (domain office) (:requirements :typing) (:types room device)
        (:predicates (clean ?r - room) (near ?d - device)))";
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
        declarers(&domain, &map, &goal, models.iter())
    }

    #[test]
    fn an_absent_agent_is_named_if_it_declares_what_is_unknown() {
        let lamp = "unknown predicate `lit`; declared by `lamp` of the ecosystem file, which is not \
                    here";
        assert_eq!(explained("(lit hall)", &[LAMP, VACUUM]).as_deref(), Some(lamp));
        let both = explained("(and (lit hall) (near vacuum))", &[LAMP, VACUUM]);
        assert!(both.is_some_and(|text| text.contains("by `lamp`, `vacuum` of")), "two are needed");
        assert_eq!(explained("(lit hall)", &[VACUUM]), None, "it declares something else");
        assert_eq!(explained("(lit attic)", &[LAMP]), None, "a mistake remains");
        assert_eq!(explained("(clean hall)", &[LAMP]), None, "all names are known");
    }

    #[test]
    fn the_number_of_named_agents_is_bounded() {
        let models: Vec<String> =
            (0..50).map(|number| LAMP.replace("lamp", &format!("lamp-{number}"))).collect();
        let models: Vec<&str> = models.iter().map(String::as_str).collect();
        let text = explained("(lit hall)", &models).expect("explained");
        assert!(text.contains("and 47 more of the ecosystem file, which are"), "{text}");
    }
}
