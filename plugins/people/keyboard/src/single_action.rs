//! Builds a plan of one step from a ground action that a person typed, and checks the plan against
//! the Domain Maintainer's state. A mistake is therefore reported before any agent is requested to
//! act.
//!
//! The Plan Executor executes this plan like any other: it checks the precondition, gives the
//! actuator a token that is executed at most once, and notifies the Domain Maintainer of the
//! changes.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::AgentId;
use acl::content::{Execute, Offer, Offers, Snapshot, acting_agents};
use pddl::{Condition, InitElement, Plan, PlanStep, Problem, Severity};

/// Returns a plan with the given action as its only step, and the time limit of the method that
/// carries out the action.
///
/// # Errors
///
/// Returns an error, as text for a person, if the action is not valid or not offered.
pub(crate) fn one_step_plan(
    snapshot: Snapshot,
    action: &str,
) -> Result<(Execute, Duration), String> {
    let step = pddl::parse_step(action).into_result().map_err(|found| first(&found, action))?;
    let domain = pddl::parse_domain(&snapshot.domain);
    let domain = domain.into_result().map_err(|found| first(&found, &snapshot.domain))?;
    let problem = pddl::parse_problem(&snapshot.problem);
    let problem = problem.into_result().map_err(|found| first(&found, &snapshot.problem))?;
    let first = step.arguments.first().and_then(|agent| AgentId::new(agent.as_str()).ok());
    if let Some(refusal) = first.and_then(|agent| stopped(&agent, &problem)) {
        return Err(refusal);
    }
    let offer = offer_of(&step, &snapshot.offers)?;
    let arguments = step.arguments.iter().map(|argument| argument.as_str());
    let acting = acting_agents(&snapshot.offers, step.action.as_str(), arguments);
    let different: BTreeSet<&AgentId> = acting.iter().collect();
    if acting.len() != offer.agents.max(1) || different.len() != acting.len() {
        let (action, agents) = (&step.action, offer.agents.max(1));
        return Err(format!("`{action}` takes {agents} different agents, its first arguments"));
    }
    if let Some(refusal) = acting.iter().find_map(|agent| stopped(agent, &problem)) {
        return Err(refusal);
    }
    let methods = acting
        .iter()
        .filter_map(|agent| snapshot.offers.get(agent)?.get(step.action.as_str())?.method.as_ref());
    let timeout = methods.map(|method| method.timeout.0).max().unwrap_or_default();
    // Each agent of a joint action waits for the others, as long as their methods take.
    let timeout = if acting.len() > 1 { timeout * 2 } else { timeout };
    let inside = PlanStep { action: offer.schema.as_str().into(), ..step };
    let plan = Plan { steps: vec![inside], cost: None };
    let found = pddl::check_plan(&domain, &problem, &plan);
    if let Some(mistake) = found.iter().find(|found| found.severity == Severity::Error) {
        return Err(mistake.located(action));
    }
    // The goal is empty, because the person requests an action, not a state.
    let problem = Problem { goal: Condition::And(Vec::new()), ..problem };
    let offers = snapshot.offers.into_iter().filter(|(agent, _)| acting.contains(agent)).collect();
    let execute = Execute {
        domain: snapshot.domain,
        problem: problem.to_string(),
        plan: plan.to_string(),
        epoch: snapshot.epoch,
        term: 0,
        round: 1,
        done: Vec::new(),
        offers,
        knowledge: snapshot.knowledge,
    };
    Ok((execute, timeout))
}

/// Returns why an agent acts not now, as text for a person, if a stop concerns it: it offers no
/// actions meanwhile.
fn stopped(agent: &AgentId, problem: &Problem) -> Option<String> {
    let is_stop = |element: &InitElement| match element {
        InitElement::Atom(atom) => {
            atom.predicate == "stopped"
                && atom.arguments.first().is_some_and(|of| of.to_string() == agent.as_str())
        }
        _ => false,
    };
    problem.init.iter().any(is_stop).then(|| {
        format!("`{agent}` is stopped; `althing stop --list` tells by whom, `--release` ends it")
    })
}

/// Returns the offer of the action by the first agent of a step. Returns an error, as text for a
/// person, if the agent does not offer the action.
fn offer_of(step: &PlanStep, offers: &Offers) -> Result<Offer, String> {
    let named = step.arguments.first().map_or("", |name| name.as_str());
    let hint = |word: &str, known: Vec<&str>| {
        let near = pddl::nearest(word, known.iter().copied());
        let near = near.map(|near| format!("did you mean `{near}`? ")).unwrap_or_default();
        if known.is_empty() {
            "no agent here offers actions".to_owned()
        } else {
            format!("{near}there is: {}", known.join(", "))
        }
    };
    let Some((agent, actions)) = offers.get_key_value(named) else {
        let known = offers.keys().map(AgentId::as_str).collect();
        return Err(format!(
            "the first argument of an action is the agent that acts, and no agent `{named}` \
             offers actions here; {}",
            hint(named, known)
        ));
    };
    let action = step.action.as_str();
    actions.get(action).cloned().ok_or_else(|| {
        let known = actions.keys().map(String::as_str).collect();
        format!("`{agent}` does not offer `{action}`; {}", hint(action, known))
    })
}

fn first(found: &[pddl::Diagnostic], text: &str) -> String {
    found.first().map_or_else(|| "unreadable".to_owned(), |found| found.located(text))
}

#[cfg(test)]
mod tests {
    use acl::Millis;
    use acl::content::Method;

    use super::*;

    fn snapshot() -> Snapshot {
        let method = Method {
            method: "navigate_to".into(),
            arguments: Default::default(),
            timeout: Millis(Duration::from_secs(7)),
        };
        let offer = Offer {
            schema: "move--r".into(),
            guard: String::new(),
            method: Some(method),
            agents: 1,
        };
        let robot = AgentId::new("r2").expect("a name");
        let domain = "(define (domain d) (:types robot place)
            (:action move--r :agent ?r - robot :parameters (?from ?to - place) :effect ()))";
        let problem = "(define (problem p) (:domain d)
            (:objects r2 - robot hall office1 - place) (:init) (:goal (and)))";
        Snapshot {
            epoch: 3,
            revision: 4,
            domain: domain.into(),
            digest: String::new(),
            problem: problem.into(),
            offers: [(robot, [("move".to_owned(), offer)].into())].into(),
            guards: [].into(),
            former: Vec::new(),
            knowledge: [].into(),
            conflicts: [].into(),
        }
    }

    #[track_caller]
    fn check_mistake(action: &str, expected: &str) {
        let problem = one_step_plan(snapshot(), action).expect_err("a mistake");
        assert!(problem.contains(expected), "{problem}");
    }

    #[test]
    fn an_action_becomes_a_plan_of_one_step() {
        let (execute, timeout) =
            one_step_plan(snapshot(), "(move r2 hall office1)").expect("offered");
        assert_eq!(execute.plan.trim(), "(move--r r2 hall office1)");
        assert_eq!((execute.epoch, timeout), (3, Duration::from_secs(7)));
        assert!(pddl::parse_problem(&execute.problem).is_ok(), "{}", execute.problem);
    }

    #[test]
    fn a_stopped_agent_is_told_from_an_unknown_one() {
        let domain = "(define (domain d) (:types robot place)
            (:predicates (stopped ?a - object)))";
        let stopped = Snapshot {
            domain: domain.into(),
            problem: snapshot().problem.replace("(:init)", "(:init (stopped r2))"),
            offers: [].into(),
            ..snapshot()
        };
        let problem = one_step_plan(stopped, "(move r2 hall office1)").expect_err("stopped");
        assert!(problem.contains("`r2` is stopped; `althing stop --list`"), "{problem}");
    }

    #[test]
    fn a_mistake_is_reported_before_any_agent_acts() {
        check_mistake("(move r2 hall office1", "1:");
        check_mistake("(move r3 hall office1)", "did you mean `r2`?");
        check_mistake("(mov r2 hall office1)", "did you mean `move`?");
        check_mistake("(move r2 hall offce1)", "`office1`");
        check_mistake("(move r2 hall)", "1:");
    }
}
