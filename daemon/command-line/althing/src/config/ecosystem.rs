//! The definition of an ecosystem, as its file gives it: complete and consistent.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::ops::Deref;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId};
use actuator::Safeguards;
use agent::{AdmissionPolicy, AgentSettings, Mode, Rights, StopButton, StopButtons};
use jiff::tz::TimeZone;
use keyboard::GoalRequest;
use pddl::{Domain, Problem};
use phrases::{Language, OwnWords};
use plan_requester::FileGoals;
use serde_json::Value;
use terminal::report::SourceText;

use super::InterfaceEntry;
use super::layer::SourceMap;

/// The definition of a whole ecosystem; it is the same on every machine.
#[derive(Clone, Debug)]
pub(crate) struct Ecosystem {
    /// The name of the ecosystem.
    pub(crate) name: EcosystemId,
    /// The folder of the ecosystem file.
    pub(crate) folder: PathBuf,
    /// The shared ontology, as a PDDL domain.
    pub(crate) domain: Arc<Domain>,
    /// The map, as a PDDL problem: the objects and facts that no agent brings.
    pub(crate) problem: Arc<Problem>,
    /// The planning mode: centralised or decentralised.
    pub(crate) mode: Mode,
    /// All daemons: those that the file lists, and those that its agents and interfaces name.
    pub(crate) daemons: BTreeSet<DaemonId>,
    /// All agents that the file names, in the order of the file.
    pub(crate) agents: Vec<AgentEntry>,
    /// The interfaces to other ecosystems.
    pub(crate) interfaces: Vec<InterfaceEntry>,
    /// The goals that the file names; each has been parsed and checked.
    pub(crate) goals: NamedGoals,
    /// The configuration for Zenoh, as the file writes it; null if there is none.
    pub(crate) zenoh: Value,
    /// Times and bounds that all agents use.
    pub(crate) settings: AgentSettings,
    /// The security settings; `None` if the ecosystem is not secured.
    pub(crate) security: Option<SecuritySettings>,
    /// The rights of agents and daemons. Rights are enforced only if the ecosystem is secured.
    pub(crate) rights: Rights,
    /// The path of the file of people; the file need not exist.
    pub(crate) people: PathBuf,
    /// Whether the ecosystem file names the file of people.
    pub(crate) is_people_file_named: bool,
    /// The actions that a person must allow, or that are limited in their rate.
    pub(crate) safeguards: Safeguards,
    /// The sensors that stop actuators while they are pressed, by agent.
    pub(crate) hardware_stops: BTreeMap<AgentId, StopButton>,
    /// The settings for plugins that run as processes.
    pub(crate) plugins: PluginSettings,
    /// The address at which each daemon serves metrics; `None` if it serves none. Other machines
    /// reach it only if the ecosystem is secured.
    pub(crate) metrics: Option<SocketAddr>,
    /// The settings of the page for browsers; `None` if the file does not ask for one.
    pub(crate) web: Option<WebSettings>,
    /// The settings of the simulated building.
    pub(crate) building: BuildingSettings,
    /// The words that the file adds to those of goals and facts, by language.
    pub(crate) words: BTreeMap<Language, OwnWords>,
    /// The place of each key in the texts: keys have paths such as `agent.0.config`.
    pub(crate) places: SourceMap,
    /// The texts from which the ecosystem was read.
    pub(crate) sources: SourceTexts,
    /// Whether the ontology and the map are free of errors. If they are not, checks against them
    /// prove nothing.
    pub(crate) are_files_sound: bool,
}

/// The goals that an ecosystem file names.
#[derive(Clone, Debug, Default)]
pub(crate) struct NamedGoals {
    /// The goals by name.
    pub(crate) named: BTreeMap<String, GoalRequest>,
    /// The goals among them that are asked for by themselves, and the time zone of their times.
    pub(crate) by_themselves: FileGoals,
}

impl Deref for NamedGoals {
    type Target = BTreeMap<String, GoalRequest>;

    fn deref(&self) -> &BTreeMap<String, GoalRequest> {
        &self.named
    }
}

/// The texts from which an ecosystem was read.
#[derive(Clone, Debug)]
pub(crate) struct SourceTexts {
    /// The text of the ecosystem file.
    pub(crate) file: Arc<SourceText>,
    /// The text in which the map is written: a PDDL file, or the ecosystem file itself.
    pub(crate) map: Arc<SourceText>,
}

/// The entry of one agent: one table `[[agent]]` of the ecosystem file.
#[derive(Clone, Debug)]
pub(crate) struct AgentEntry {
    /// The path of the entry in the ecosystem file, such as `agent.3`; empty for an agent that no
    /// file names, and [`DEFAULT_AGENTS`] for one that is there by itself.
    pub(crate) path: String,
    /// The name of the agent, unique in the ecosystem.
    pub(crate) name: AgentId,
    /// The plugin that builds the agent: a built-in plugin, or a plugin of the package.
    pub(crate) plugin: String,
    /// The package that provides the agent's plugin; `None` if the plugin is built in.
    pub(crate) package: Option<String>,
    /// The daemons that host the agent. If the list is empty, a machine that runs alone hosts the
    /// agent. If it names several, one of them hosts the leader and the others host standbys.
    pub(crate) daemons: Vec<DaemonId>,
    /// The name of the plugin's driver that the agent uses; `None` for the plugin's default driver.
    pub(crate) driver: Option<String>,
    /// The configuration for the plugin, as the file writes it; null if there is none.
    pub(crate) config: Arc<Value>,
}

/// The path of the agents that a file gets because it names none that reasons.
pub(crate) const DEFAULT_AGENTS: &str = "ecosystem.reasoning";

impl AgentEntry {
    /// Whether the agent is there because the file names no agent that reasons.
    pub(crate) fn is_default(&self) -> bool {
        self.path == DEFAULT_AGENTS
    }

    /// Whether the agent's plugin is built into the daemon.
    pub(crate) fn is_built_in(&self) -> bool {
        self.package.is_none()
    }
}

/// The security settings of an ecosystem.
#[derive(Clone, Debug)]
pub(crate) struct SecuritySettings {
    /// The folder with keys and certificates.
    pub(crate) folder: PathBuf,
    /// How long before a certificate expires a warning about it is logged.
    pub(crate) warn_before: Duration,
    /// Maximum number of messages per second that an agent or daemon accepts from one other daemon;
    /// further messages are rejected.
    pub(crate) messages_per_second_max: u32,
}

/// The settings for plugins that run as processes.
#[derive(Clone, Debug)]
pub(crate) struct PluginSettings {
    /// The folder with the packages of plugins; `None` for the machine's default folder.
    pub(crate) folder: Option<PathBuf>,
    /// The rule for admitting agents that the ecosystem file does not name.
    pub(crate) admit: AdmissionPolicy,
    /// Whether plugins run only on a machine that supports all parts of their confinement.
    pub(crate) requires_confinement: bool,
}

/// The settings of the page for browsers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct WebSettings {
    /// The address at which each of the daemons serves the page. Other machines reach it only if the
    /// ecosystem is secured.
    pub(crate) listen: SocketAddr,
    /// The daemons that serve the page; if the list is empty, all do.
    pub(crate) daemons: BTreeSet<DaemonId>,
    /// The host names by which browsers reach the page, besides the address and `localhost`.
    pub(crate) names: Vec<String>,
    /// The files of the certificate; `None` for those of `althing cert page`.
    pub(crate) files: Option<PageFiles>,
}

/// The files of a page's certificate and key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PageFiles {
    /// The certificate.
    pub(crate) certificate: PathBuf,
    /// The key.
    pub(crate) key: PathBuf,
}

impl WebSettings {
    /// Whether a daemon serves the page.
    pub(crate) fn is_served_by(&self, daemon: &DaemonId) -> bool {
        self.daemons.is_empty() || self.daemons.contains(daemon)
    }
}

/// The initial state of the simulated building, apart from what the map states.
#[derive(Clone, Debug)]
pub(crate) struct BuildingSettings {
    /// The true temperature of each place, by the name of the place, in °C.
    pub(crate) temperatures: BTreeMap<String, f64>,
    /// Other true quantities of places, by the name of the place and then by the name of the
    /// quantity.
    pub(crate) conditions: BTreeMap<String, BTreeMap<String, f64>>,
    /// The factor by which all durations in the building are multiplied; 1 is real time.
    pub(crate) time_scale: f64,
    /// The socket by which several processes share the building; `None` if the file names no
    /// socket.
    pub(crate) socket: Option<PathBuf>,
}

/// Returns the request for a goal with default settings; `goal` is its PDDL text.
pub(crate) fn plain_goal(goal: &str) -> GoalRequest {
    let (keep, partition) = Default::default();
    GoalRequest { goal: goal.to_owned(), keep, priority: 0, partition }
}

/// Whether a text is a goal in PDDL, correct or not, as opposed to the name of a goal.
pub(crate) fn is_pddl(goal: &str) -> bool {
    goal.trim().is_empty() || goal.contains([' ', '(', ')', ','])
}

// === impl Ecosystem ===

impl Ecosystem {
    /// Whether the map is made from `[rooms]` and `[doors]`. The spans in the map are then places in
    /// the ecosystem file.
    pub(crate) fn is_map_of_tables(&self) -> bool {
        Arc::ptr_eq(&self.sources.file, &self.sources.map)
    }

    /// Returns the goal of the file that is named `goal`, or `goal` itself if it is PDDL.
    ///
    /// The error lists the names of the goals in the file.
    pub(crate) fn find_goal(&self, goal: &str) -> Result<GoalRequest, String> {
        if let Some(wish) = self.goals.get(goal) {
            return Ok(wish.clone());
        }
        if is_pddl(goal) {
            return Ok(plain_goal(goal));
        }
        let names = || self.goals.keys().map(String::as_str);
        let help = match (pddl::nearest(goal, names()), self.goals.len()) {
            (Some(nearest), _) => format!("did you mean `{nearest}`?"),
            (None, 0) => "the ecosystem file names none; write it in PDDL".to_owned(),
            (None, _) => format!(
                "known are {}; others are written in PDDL",
                names().collect::<Vec<_>>().join(", ")
            ),
        };
        Err(format!("there is no goal called `{goal}`; {help}"))
    }

    /// Returns the time zone of the ecosystem: that of the file, or that of this machine.
    pub(crate) fn time_zone(&self) -> TimeZone {
        let named = self.goals.by_themselves.time_zone.as_deref();
        named.and_then(|name| TimeZone::get(name).ok()).unwrap_or_else(TimeZone::system)
    }

    /// Returns the hardware stops for one daemon, which knows nothing of them yet; `None` if there are
    /// none.
    pub(crate) fn stop_buttons(&self) -> Option<StopButtons> {
        let silence = self.settings.heartbeat_lease;
        let rules = self.hardware_stops.clone();
        (!rules.is_empty()).then(|| StopButtons::new(rules, silence))
    }

    /// Returns the agents with the daemon `daemon` in their entries.
    pub(crate) fn agents_of(&self, daemon: &DaemonId) -> impl Iterator<Item = &AgentEntry> {
        self.agents.iter().filter(move |agent| agent.daemons.contains(daemon))
    }

    /// Returns the names of the Journals: the agents that keep records for others.
    pub(crate) fn journals(&self) -> impl Iterator<Item = &AgentId> {
        let journals = self
            .agents
            .iter()
            .filter(|agent| agent.is_built_in() && agent.plugin == journal::PLUGIN.name);
        journals.map(|agent| &agent.name)
    }

    /// Returns the agents without any daemon in their entries. A machine that runs alone hosts
    /// them.
    pub(crate) fn unassigned_agents(&self) -> impl Iterator<Item = &AgentEntry> {
        self.agents.iter().filter(|agent| agent.daemons.is_empty())
    }
}
