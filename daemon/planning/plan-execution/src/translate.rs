//! Translation of a plan step into a method of an actuator. (The paper: “transforms these higher
//! level actions into lower level methods that the specific actuators have access to”.)

use std::collections::BTreeMap;
use std::time::Duration;

use acl::AgentId;
use acl::content::{Offer, Offers};
use pddl::{Domain, PlanStep};

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
}

/// Returns the agent that acts in a step: the first argument of the step. Returns `None` if that
/// argument is missing or is not a valid agent name.
pub(crate) fn acting_agent(step: &PlanStep) -> Option<AgentId> {
    AgentId::new(step.arguments.first()?.as_str()).ok()
}

/// Translates a step of a plan into the request for its actuator.
///
/// # Errors
///
/// Returns an error if the agent does not offer the action, or if the method of the action does not
/// fit the step. The error text completes “step `…`: ”.
pub(crate) fn translate(
    step: &PlanStep,
    domain: &Domain,
    offers: &Offers,
) -> Result<ActionRequest, String> {
    let agent = acting_agent(step).ok_or("no agent acts in it")?;
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
        let offer = Offer { schema: "move--r".into(), guard: String::new(), method: Some(method) };
        let robot = AgentId::new("r2").expect("a name");
        let offers = [(robot, [("move".to_owned(), offer)].into())].into();
        let domain = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
        let step = pddl::parse_step("(move--r r2 hall office1)").into_result().expect("a step");
        translate(&step, &domain, &offers)
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
