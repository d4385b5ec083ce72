//! Plays a factored task in this process, and validates plans on the files of all agents.

use pddl::factored::{AgentFiles, merge_factored};
use pddl::{Plan, PlanStep};
use planner::{Cancel, Options, World};

/// All that a planning has put on the wire, and its result.
pub(crate) struct Played {
    /// The steps of all agents; `None` if it is proved that there is no plan.
    pub(crate) steps: Option<Vec<(String, PlanStep)>>,
    /// The texts that were sent, in their order.
    pub(crate) sent: Vec<String>,
}

pub(crate) fn files(agent: &str, domain: &str, problem: &str) -> AgentFiles {
    AgentFiles {
        agent: agent.to_owned(),
        domain: pddl::parse_domain(domain).into_result().expect("a domain"),
        problem: pddl::parse_problem(problem).into_result().expect("a problem"),
    }
}

/// Plays a task until all agree, or until it is proved that there is no plan.
pub(crate) fn play(task: &[AgentFiles]) -> Played {
    let (options, cancel) = (Options::default(), Cancel::new());
    let mut sent = Vec::new();
    let played = skeleton::plan_in_one_process(task, &options, &cancel, &mut |text| {
        sent.push(text.to_owned());
    });
    Played { steps: played.expect("it ends").steps, sent }
}

/// Returns the cost of a joint plan by a validator that sees the tasks of all agents.
///
/// # Errors
///
/// Returns the reason if the plan does not hold.
pub(crate) fn validated(task: &[AgentFiles], steps: &[(String, PlanStep)]) -> Result<f64, String> {
    let merged = merge_factored(task)?;
    let steps = steps.iter().map(|(agent, step)| merged.merged(agent, step));
    let plan = Plan { steps: steps.collect(), cost: None };
    let world = World::initial(&merged.domain, &merged.problem).map_err(|it| format!("{it:?}"))?;
    planner::validate::cost_from(&world, &plan.steps, &merged.problem.goal)
        .map_err(|fault| fault.to_string())
}

/// Returns the cost of the plan of a planner that sees everything; `None` if there is no plan.
pub(crate) fn central(task: &[AgentFiles]) -> Option<f64> {
    let merged = merge_factored(task).expect("they fit together");
    let (options, cancel) = (Options::default(), Cancel::new());
    let outcome = planner::plan(&merged.domain, &merged.problem, &options, &cancel);
    outcome.expect("it can be planned for").plan.and_then(|plan| plan.cost).map(|cost| cost.0)
}
