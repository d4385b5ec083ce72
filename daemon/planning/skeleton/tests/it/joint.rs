//! Plays a factored task in this process, as the requester and the members do by messages.

use std::collections::BTreeMap;

use acl::content::PartStep;
use pddl::factored::{AgentFiles, merge_factored};
use pddl::{Name, Plan, PlanStep};
use planner::{Cancel, Options, World};
use skeleton::{FilledPart, Partner, Projection, SkeletonOutcome, SkeletonTask};

/// All that a planning has put on the wire, and its result.
pub(crate) struct Played {
    /// The steps of all agents in an order that they agreed to; `None` if it is proved that there
    /// is no plan.
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
    let mut partners: BTreeMap<String, Partner> = { task.iter() }
        .map(|own| (own.agent.clone(), Partner::new(own.clone()).expect("supported")))
        .collect();
    let mut sent = Vec::new();
    let mut news: Vec<String> = partners.keys().cloned().collect();
    loop {
        for agent in news.drain(..) {
            let Projection { domain, problem } = partners[&agent].projection().clone();
            sent.extend([domain, problem]);
        }
        let projections =
            { partners.iter() }.map(|(name, it)| (name.clone(), it.projection().clone())).collect();
        let merged = SkeletonTask::merge(&projections).expect("they fit together");
        let found = merged.plan(&options, &cancel).expect("it can be planned for");
        let skeleton = match found {
            SkeletonOutcome::Found(skeleton) => skeleton,
            SkeletonOutcome::NoPlan => return Played { steps: None, sent },
            SkeletonOutcome::Undecided(limit) => panic!("undecided: {limit}"),
        };
        let mut filled: BTreeMap<String, std::vec::IntoIter<Vec<PlanStep>>> = BTreeMap::new();
        for (agent, part) in &skeleton.parts {
            sent.extend(part.iter().map(|step| match step {
                PartStep::Own(text) | PartStep::Others(text) => text.clone(),
            }));
            let partner = partners.get_mut(agent).expect("a member");
            match partner.fill(part, &options, &cancel) {
                Ok(FilledPart { steps, cost }) => {
                    sent.push(cost.to_string());
                    filled.insert(agent.clone(), steps.into_iter());
                }
                Err(refusal) => {
                    assert!(partner.sharpen(&refusal), "{refusal:?}");
                    sent.push(refusal.why);
                    news.push(agent.clone());
                }
            }
        }
        if news.is_empty() {
            let mut steps = Vec::new();
            let named = |agent: &String, own: Option<Vec<PlanStep>>| {
                let own = own.unwrap_or_default().into_iter();
                own.map(|step| (agent.clone(), step)).collect::<Vec<_>>()
            };
            for (agent, own) in &mut filled {
                steps.extend(named(agent, own.next()));
            }
            for owner in &skeleton.owners {
                steps.extend(named(owner, filled.get_mut(owner).and_then(Iterator::next)));
            }
            for (agent, rest) in &mut filled {
                rest.for_each(|own| steps.extend(named(agent, Some(own))));
            }
            return Played { steps: Some(steps), sent };
        }
    }
}

/// Returns the cost of a joint plan by a validator that sees the tasks of all agents.
///
/// # Errors
///
/// Returns the reason if the plan does not hold.
pub(crate) fn validated(task: &[AgentFiles], steps: &[(String, PlanStep)]) -> Result<f64, String> {
    let merged = merge_factored(task)?;
    let names: Vec<Name> = merged.domain.actions.iter().map(|it| it.name.clone()).collect();
    let objects: Vec<Name> =
        merged.problem.objects.iter().map(|it| it.object.name.clone()).collect();
    let own = |known: &[Name], agent: &str, name: &Name| {
        let own = Name::new(&format!("{name}--{agent}"));
        if known.contains(&own) { own } else { name.clone() }
    };
    let steps = steps.iter().map(|(agent, step)| {
        let arguments = step.arguments.iter().map(|name| own(&objects, agent, name));
        PlanStep::new(own(&names, agent, &step.action), arguments)
    });
    let plan = Plan { steps: steps.collect(), cost: None };
    let world = World::initial(&merged.domain, &merged.problem).map_err(|it| format!("{it:?}"))?;
    planner::validate::cost_from(&world, &plan.steps, &merged.problem.goal)
        .map_err(|fault| fault.to_string())
}

/// Whether a planner that sees everything finds a plan.
pub(crate) fn is_solvable(task: &[AgentFiles]) -> bool {
    let merged = merge_factored(task).expect("they fit together");
    let (options, cancel) = (Options::default(), Cancel::new());
    let outcome = planner::plan(&merged.domain, &merged.problem, &options, &cancel);
    outcome.expect("it can be planned for").plan.is_some()
}
