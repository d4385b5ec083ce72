//! Discovered agents: an agent that finds devices starts an agent for each of them on its own
//! daemon, and stops it when the device is gone.
//!
//! - A moment after a discovery, everything found is compared with the agents that run. Missing
//!   agents start, agents of devices that are gone or changed stop, and all other agents are left
//!   alone.
//! - An agent that the ecosystem file does not name takes part only if the policy of the file or a
//!   person admits it ([`Admissions`]). Every found agent is listed. The list states why an agent
//!   does not take part, and which lines in the ecosystem file would change that.
//! - An agent that could not start is started again after a pause.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use acl::content::Discovered;
use tokio::sync::watch;

use crate::admission::{AdmissionPolicy, AdmissionStatus, Admissions};
use crate::base_agent::Agent;
use crate::context::{ChildHandle, Context, WorkHandle};
use crate::host::Host;
use crate::launch::LaunchableAgent;
use crate::plugin::BuildError;

/// Reason why a device gets no agent: the room in which the device stands is not known.
pub const ROOM_UNKNOWN: &str = "its room is not known";

/// Delay between a discovery and the start and stop of agents, so that further changes are handled
/// together: a broker reports hundreds of devices at once.
const MORE: Duration = Duration::from_millis(50);

/// Pause before an agent that could not start is started again.
const REST: Duration = Duration::from_secs(10);

/// A device that was found, and the agent for it.
#[derive(Clone, Debug)]
pub struct FoundDevice<P> {
    /// Name of the agent for the device.
    pub agent: AgentId,
    /// Whether the ecosystem file names the agent; such an agent needs no admission.
    pub is_named: bool,
    /// Room in which the device stands; `None` if the room is not known.
    pub room: Option<String>,
    /// Data from which the agent is built, or the reason why the device can have no agent, such as
    /// [`ROOM_UNKNOWN`].
    pub part: Result<P, String>,
    /// Description of the functions of the device that cannot be used; `None` if all can.
    pub problem: Option<String>,
    /// Lines of the ecosystem file that would let the agent take part.
    pub toml: String,
}

/// The discovered agents that run, and the reasons why others could not start.
#[derive(Debug)]
pub struct DiscoveredAgents<P> {
    admissions: Arc<Admissions>,
    /// Maximum number of discovered agents that may run. Further devices get no agent.
    at_most: usize,
    here: BTreeMap<AgentId, (P, ChildHandle)>,
    /// Agents that could not start, each with the reason, until they are started again.
    failed: BTreeMap<AgentId, String>,
    /// Whether a comparison of found and running agents is scheduled.
    is_due: bool,
    hearing: Option<WorkHandle>,
}

/// Agent that starts an agent for each device that it discovers.
pub trait DiscoversAgents: Agent {
    /// Data from which an agent is built. If the data of a device change, its agent is replaced.
    type Part: Clone + PartialEq + Send + 'static;

    /// Returns the state of the discovered agents.
    fn discovered_agents(&mut self) -> &mut DiscoveredAgents<Self::Part>;

    /// Returns all devices that are found at present.
    fn found_devices(&self) -> Vec<FoundDevice<Self::Part>>;

    /// Returns the reason why no device can be found at present; `None` if discovery works.
    fn discovery_problem(&self) -> Option<String> {
        None
    }

    /// Builds the agent `agent` from `part`. Opens no device.
    ///
    /// # Errors
    ///
    /// Returns an error if the agent cannot be built.
    fn build(
        &self,
        agent: &AgentId,
        part: &Self::Part,
    ) -> Result<Box<dyn LaunchableAgent>, BuildError>;
}

impl<P> DiscoveredAgents<P> {
    /// Creates the state, without any agent; at most `at_most` agents will run. If the host's
    /// resources contain no [`Admissions`], all discovered agents are admitted.
    pub fn new(host: &Host, at_most: usize) -> DiscoveredAgents<P> {
        let admissions = host.resources.get::<Admissions>();
        DiscoveredAgents {
            admissions: admissions
                .unwrap_or_else(|| Arc::new(Admissions::new(AdmissionPolicy::default()))),
            at_most,
            here: BTreeMap::new(),
            failed: BTreeMap::new(),
            is_due: false,
            hearing: None,
        }
    }
}

/// Starts to follow the decisions of people about admissions: after each change, the found devices
/// are compared with the agents that run. Call this function when the agent is activated.
pub fn follow_admissions<A: DiscoversAgents>(agent: &mut A, ctx: &mut Context<A>) {
    let changes = agent.discovered_agents().admissions.changes();
    hear(agent, changes, ctx);
}

fn hear<A: DiscoversAgents>(agent: &mut A, mut changes: watch::Receiver<()>, ctx: &mut Context<A>) {
    let next = async move { changes.changed().await.is_ok().then_some(changes) };
    let work = ctx.run(next, |agent: &mut A, changes, ctx| {
        let Some(changes) = changes else { return };
        schedule_reconcile(agent, ctx);
        hear(agent, changes, ctx);
    });
    agent.discovered_agents().hearing = Some(work);
}

/// Schedules a comparison of the found devices with the agents that run; the comparison starts and
/// stops agents. Call this function whenever the found devices have changed. Calls within a short
/// time lead to one comparison.
pub fn schedule_reconcile<A: DiscoversAgents>(agent: &mut A, ctx: &mut Context<A>) {
    if std::mem::replace(&mut agent.discovered_agents().is_due, true) {
        return;
    }
    ctx.after(MORE, |agent: &mut A, ctx| {
        agent.discovered_agents().is_due = false;
        settle(agent, ctx);
    });
}

fn settle<A: DiscoversAgents>(agent: &mut A, ctx: &mut Context<A>) {
    let (by, found) = (ctx.id().to_string(), agent.found_devices());
    let trouble = agent.discovery_problem();
    let DiscoveryDecision { wanted, mut discovered, applicants } =
        DiscoveryDecision::of(agent.discovered_agents(), &by, found);
    if let Some(problem) = trouble {
        let (agent, by) = (ctx.id().clone(), by.clone());
        let problem = Some(problem);
        discovered.push(Discovered { agent, by, joined: true, problem, toml: String::new() });
    }
    let bringing = agent.discovered_agents();
    bringing.here.retain(|agent, (part, _)| wanted.get(agent) == Some(part));
    bringing.admissions.present(&by, applicants);
    ctx.report_discovered(discovered);
    for (name, part) in wanted {
        let DiscoveredAgents { here, failed, .. } = agent.discovered_agents();
        if !here.contains_key(&name) && !failed.contains_key(&name) {
            bring(agent, name, part, ctx);
        }
    }
}

fn bring<A: DiscoversAgents>(agent: &mut A, name: AgentId, part: A::Part, ctx: &mut Context<A>) {
    let built = match agent.build(&name, &part) {
        Ok(built) => built,
        Err(error) => return fail(agent, name, format!("failed to {error}"), ctx),
    };
    let whose = name.clone();
    let brought = ctx.spawn_child(name.clone(), built, move |agent: &mut A, error, ctx| {
        let Some(error) = error else { return };
        agent.discovered_agents().here.remove(&whose);
        fail(agent, whose, format!("failed to {error}"), ctx);
    });
    tracing::info!(agent = %name, by = %ctx.id(), "appears");
    agent.discovered_agents().here.insert(name, (part, brought));
}

fn fail<A: DiscoversAgents>(agent: &mut A, name: AgentId, problem: String, ctx: &mut Context<A>) {
    tracing::warn!(agent = %name, "{problem}");
    agent.discovered_agents().failed.insert(name.clone(), problem);
    ctx.after(REST, move |agent: &mut A, ctx| {
        agent.discovered_agents().failed.remove(&name);
        schedule_reconcile(agent, ctx);
    });
    schedule_reconcile(agent, ctx);
}

/// Decision about which of the found devices get an agent.
#[derive(Debug)]
struct DiscoveryDecision<P> {
    /// Agents that are to run, each with the data from which it is built.
    wanted: BTreeMap<AgentId, P>,
    /// All agents found, including those that do not take part, for display to people.
    discovered: Vec<Discovered>,
    /// Agents that a person could admit, with a description of each.
    applicants: BTreeMap<String, String>,
}

impl<P> DiscoveryDecision<P> {
    fn of(
        bringing: &DiscoveredAgents<P>,
        by: &str,
        found: Vec<FoundDevice<P>>,
    ) -> DiscoveryDecision<P> {
        let (wanted, discovered, applicants) = (BTreeMap::new(), Vec::new(), BTreeMap::new());
        let mut census = DiscoveryDecision { wanted, discovered, applicants };
        let mut names = BTreeSet::new();
        for finding in found {
            let is_new = names.insert(finding.agent.clone());
            census.count(bringing, by, finding, is_new);
        }
        census
    }

    fn count(
        &mut self,
        bringing: &DiscoveredAgents<P>,
        by: &str,
        finding: FoundDevice<P>,
        is_new: bool,
    ) {
        let FoundDevice { agent, is_named, room, part, problem, toml } = finding;
        let admission = match is_named {
            true => AdmissionStatus::Granted,
            false => bringing.admissions.of(by, agent.as_str()),
        };
        // Obstacles that no admission can remove.
        let part = if !is_new {
            Err("another device has this name; rename one of them".to_owned())
        } else if self.wanted.len() >= bringing.at_most {
            Err("there are too many devices".to_owned())
        } else {
            part
        };
        let (part, obstacle) = match part {
            Ok(part) => (Some(part), None),
            Err(obstacle) => (None, Some(obstacle)),
        };
        let is_let_in = part.is_some() && admission == AdmissionStatus::Granted;
        let failed = bringing.failed.get(&agent).filter(|_| is_let_in).cloned();
        let joined = is_let_in && failed.is_none();
        let reason = part.as_ref().and_then(|_| admission.reason());
        let problem = obstacle.or(reason).or(failed).or(problem);
        let (name, by) = (agent.clone(), by.to_owned());
        if part.is_some() && admission == AdmissionStatus::Asked {
            let about = format!("{by}, {}", room.unwrap_or_default());
            self.applicants.insert(agent.to_string(), about);
        }
        self.discovered.push(Discovered { agent: name, by, joined, problem, toml });
        if let Some(part) = part.filter(|_| is_let_in) {
            self.wanted.insert(agent, part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(name: &str, part: Option<u8>) -> FoundDevice<u8> {
        FoundDevice {
            agent: AgentId::new(name).expect("a name"),
            is_named: false,
            room: part.map(|_| "hall".to_owned()),
            part: part.ok_or_else(|| ROOM_UNKNOWN.to_owned()),
            problem: None,
            toml: String::new(),
        }
    }

    fn bringing(admit: AdmissionPolicy, at_most: usize) -> DiscoveredAgents<u8> {
        DiscoveredAgents {
            admissions: Arc::new(Admissions::new(admit)),
            at_most,
            here: BTreeMap::new(),
            failed: BTreeMap::new(),
            is_due: false,
            hearing: None,
        }
    }

    /// Returns the name of each agent, whether it takes part, and why not.
    fn told(census: &DiscoveryDecision<u8>) -> Vec<(&str, bool, &str)> {
        let told = |one: &'_ Discovered| one.problem.clone().unwrap_or_default().leak() as &str;
        census.discovered.iter().map(|one| (one.agent.as_str(), one.joined, told(one))).collect()
    }

    #[test]
    fn each_agent_that_does_not_take_part_has_a_reason() {
        let mut all = bringing(AdmissionPolicy::All, 2);
        all.failed.insert(AgentId::new("b").expect("a name"), "failed to open it".to_owned());
        let useless = FoundDevice { part: Err("no words".to_owned()), ..finding("e", None) };
        let half = FoundDevice {
            problem: Some("its co2 is in furlongs".to_owned()),
            ..finding("h", None)
        };
        let found = vec![
            finding("a", Some(1)),
            finding("a", Some(2)),
            finding("nowhere", None),
            useless,
            half,
            finding("b", Some(3)),
            finding("c", Some(4)),
        ];
        let census = DiscoveryDecision::of(&all, "zigbee", found);
        assert_eq!(
            told(&census),
            [
                ("a", true, ""),
                ("a", false, "another device has this name; rename one of them"),
                ("nowhere", false, "its room is not known"),
                ("e", false, "no words"),
                ("h", false, "its room is not known"),
                ("b", false, "failed to open it"),
                ("c", false, "there are too many devices"),
            ]
        );
        assert_eq!(census.wanted.into_values().collect::<Vec<_>>(), [1, 3]);
    }

    #[test]
    fn people_are_asked_only_about_agents_that_could_take_part() {
        let ask = bringing(AdmissionPolicy::Ask, 9);
        let named = FoundDevice { is_named: true, ..finding("named", Some(1)) };
        let found = vec![named, finding("a", Some(2)), finding("nowhere", None)];
        let census = DiscoveryDecision::of(&ask, "zigbee", found);
        assert_eq!(census.applicants, [("a".to_owned(), "zigbee, hall".to_owned())].into());
        assert_eq!(census.wanted.len(), 1);
        assert_eq!(
            told(&census),
            [
                ("named", true, ""),
                ("a", false, "a person is being asked: althing keyboard"),
                ("nowhere", false, "its room is not known"),
            ]
        );
    }
}
