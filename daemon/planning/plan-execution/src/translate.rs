//! Translation of a plan step into methods of its actuators. (The paper: “transforms these higher
//! level actions into lower level methods that the specific actuators have access to”.)

use std::collections::BTreeMap;
use std::time::Duration;

use acl::AgentId;
use acl::content::{Offer, Offers, acting_agents};
use pddl::{Domain, PlanStep};

/// Part of one agent in a step. A step has one part, or several in a joint action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StepPart {
    /// Index of the step in the plan.
    pub step: usize,
    /// Position of the agent among those that act in the step.
    pub position: usize,
}

/// The request that is sent to an actuator for one step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionRequest {
    /// The agent that carries the step out.
    pub agent: AgentId,
    /// The ground action to carry out, under the agent's own name for it.
    pub action: String,
    /// Name of the actuator's method to run.
    pub method: String,
    /// Arguments of the method, by name.
    pub arguments: BTreeMap<String, String>,
    /// Longest time that the method may take. After it, the action is reported as timed
    /// out.
    pub timeout: Duration,
    /// How long the actuator waits for the other agents of a joint action; `None` if it acts alone.
    pub ready_for: Option<Duration>,
}

/// Returns the agents that act in a step: the first argument of the step, and in a joint action the
/// next ones. The list is empty if the first argument is missing or is not a valid agent name.
pub(crate) fn actors(step: &PlanStep, offers: &Offers) -> Vec<AgentId> {
    let arguments = step.arguments.iter().map(|argument| argument.as_str());
    acting_agents(offers, step.action.as_str(), arguments)
}

/// Translates a step of a plan into the requests for its actuators, in the order of its agents.
///
/// # Errors
///
/// Returns an error if an agent does not offer the action, or if the method of the action does not
/// fit the step. The error text completes “step `…`: ”.
pub(crate) fn translate(
    step: &PlanStep,
    domain: &Domain,
    offers: &Offers,
) -> Result<Vec<ActionRequest>, String> {
    let agents = actors(step, offers);
    if agents.is_empty() {
        return Err("no agent acts in it".to_owned());
    }
    let requests = agents.into_iter().map(|agent| translate_part(step, agent, domain, offers));
    let mut requests: Vec<ActionRequest> = requests.collect::<Result<_, _>>()?;
    if requests.len() > 1 {
        // An agent may have to ask people before it is ready. The time limit of its method includes that.
        let ready_for = requests.iter().map(|request| request.timeout).max();
        requests.iter_mut().for_each(|request| request.ready_for = ready_for);
    }
    Ok(requests)
}

/// Translates the part of one agent in a step.
fn translate_part(
    step: &PlanStep,
    agent: AgentId,
    domain: &Domain,
    offers: &Offers,
) -> Result<ActionRequest, String> {
    let (outside, offer) = offers
        .get(&agent)
        .and_then(|actions| actions.iter().find(|(_, offer)| step.action == *offer.schema.as_str()))
        .ok_or_else(|| format!("`{agent}` does not offer `{}`", step.action))?;
    let Offer { method: Some(method), .. } = offer else {
        return Err(format!("`{agent}` names no method for `{outside}`"));
    };
    let schema = domain
        .actions
        .iter()
        .find(|schema| schema.name == step.action)
        .ok_or_else(|| format!("the domain has no action `{}`", step.action))?;
    let bound: BTreeMap<&str, &str> = schema
        .all_parameters()
        .map(|parameter| parameter.name.as_str())
        .zip(step.arguments.iter().map(|argument| argument.as_str()))
        .collect();
    let mut outside_step = step.clone();
    outside_step.action = outside.as_str().into();
    Ok(ActionRequest {
        agent,
        action: outside_step.to_string(),
        method: method.method.clone(),
        arguments: method.bind(&bound)?,
        timeout: method.timeout.0,
        ready_for: None,
    })
}

#[cfg(test)]
mod tests {
    use acl::Millis;
    use acl::content::Method;

    use super::*;

    const DOMAIN: &str = "(define (domain d) (:types robot place)
        (:action move--r :agent ?r - robot :parameters (?from ?to - place) :effect ()))";

    fn order(template: &str) -> Result<ActionRequest, String> {
        let method = Method {
            method: "navigate_to".into(),
            arguments: [("pose".to_owned(), template.to_owned())].into(),
            timeout: Millis(Duration::from_secs(60)),
        };
        let offer = Offer {
            schema: "move--r".into(),
            guard: String::new(),
            method: Some(method),
            agents: 1,
        };
        let robot = AgentId::new("r2").expect("a name");
        let offers = [(robot, [("move".to_owned(), offer)].into())].into();
        let domain = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
        let step = pddl::parse_step("(move--r r2 hall office1)").into_result().expect("a step");
        translate(&step, &domain, &offers).map(|mut requests| requests.remove(0))
    }

    #[test]
    fn the_request_uses_the_agents_own_name_for_the_action() {
        let order = order("?TO").expect("offered");
        assert_eq!(order.action, "(move r2 hall office1)");
        assert_eq!(order.arguments["pose"], "office1");
    }

    #[test]
    fn the_error_names_an_unknown_variable() {
        let problem = order("?where").expect_err("no such variable");
        assert!(problem.contains("`?where`"), "{problem}");
    }
}
