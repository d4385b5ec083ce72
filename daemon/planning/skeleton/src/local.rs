//! A joint planning in one process, without messages: as the requester and the members do it, one
//! after the other.

use std::collections::BTreeMap;

use pddl::PlanStep;
use pddl::factored::AgentFiles;
use planner::{Cancel, Options};

use crate::partner::Partner;
use crate::projection::Projection;
use crate::requester::{SkeletonOutcome, SkeletonTask};

/// The result of a joint planning in one process.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalPlan {
    /// The steps of all agents in an order that they agreed to, each with its agent; `None` if it is
    /// proved that there is no plan.
    pub steps: Option<Vec<(String, PlanStep)>>,
    /// Number of skeletons.
    pub rounds: u32,
}

/// Plans until all agents agree, or until it is proved that there is no plan. Calls `sent` with each
/// text that would leave an agent or come to one.
///
/// # Errors
///
/// Returns the reason, as text for a person, if the task is not supported, or a limit was reached.
pub fn plan_in_one_process(
    task: &[AgentFiles],
    options: &Options,
    cancel: &Cancel,
    sent: &mut dyn FnMut(&str),
) -> Result<LocalPlan, String> {
    let mut partners: BTreeMap<String, Partner> = BTreeMap::new();
    for files in task {
        partners.insert(files.agent.clone(), Partner::new(files.clone())?);
    }
    let mut projections: BTreeMap<String, Projection> = BTreeMap::new();
    let mut news: Vec<String> = partners.keys().cloned().collect();
    let mut rounds = 0;
    loop {
        rounds += 1;
        for agent in news.drain(..) {
            let projection = partners[&agent].projection();
            sent(&projection.domain);
            sent(&projection.problem);
            projections.insert(agent, projection);
        }
        let planned = SkeletonTask::merge(&projections)
            .and_then(|merged| merged.plan(options, cancel))
            .map_err(|error| error.why)?;
        let skeleton = match planned {
            SkeletonOutcome::Found(skeleton) => skeleton,
            SkeletonOutcome::NoPlan => return Ok(LocalPlan { steps: None, rounds }),
            SkeletonOutcome::Undecided(limit) => return Err(limit.to_string()),
        };
        let mut filled = BTreeMap::new();
        for (agent, part) in &skeleton.parts {
            part.iter().for_each(|step| sent(step.text()));
            let partner = partners.get_mut(agent).ok_or("a part of no agent")?;
            match partner.fill(part, options, cancel) {
                Ok(own) => {
                    sent(&own.cost.to_string());
                    filled.insert(agent.clone(), own.steps);
                }
                Err(refusal) if partner.sharpen(&refusal) => {
                    sent(&refusal.why);
                    news.push(agent.clone());
                }
                Err(refusal) => return Err(format!("`{agent}`: {}", refusal.why)),
            }
        }
        if news.is_empty() {
            return Ok(LocalPlan { steps: Some(skeleton.join(filled)), rounds });
        }
    }
}
