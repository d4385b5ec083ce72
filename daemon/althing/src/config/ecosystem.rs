//! An ecosystem as its file defines it: complete and consistent.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{AdmissionPolicy, AgentSettings, Mode, Rights};
use keyboard::GoalRequest;
use pddl::{Domain, Problem};
use serde_json::Value;
use terminal::report::SourceText;

use super::InterfaceEntry;
use super::layer::SourceMap;

/// A whole ecosystem; it is the same on every machine.
#[derive(Clone, Debug)]
pub(crate) struct Ecosystem {
    /// Its name.
    pub(crate) name: EcosystemId,
    /// The shared ontology.
    pub(crate) domain: Arc<Domain>,
    /// The map: the objects and facts that no agent brings.
    pub(crate) problem: Arc<Problem>,
    /// The planning flow: centralised or decentralised.
    pub(crate) mode: Mode,
    /// All daemons: those listed, and those that agents and interfaces name.
    pub(crate) daemons: BTreeSet<DaemonId>,
    /// All agents, in the order of the file.
    pub(crate) agents: Vec<AgentEntry>,
    /// Interfaces to other ecosystems.
    pub(crate) interfaces: Vec<InterfaceEntry>,
    /// The named goals; each has been parsed and checked.
    pub(crate) goals: BTreeMap<String, GoalRequest>,
    /// The configuration for Zenoh, as it is written; null if there is none.
    pub(crate) zenoh: Value,
    /// Times and bounds.
    pub(crate) settings: AgentSettings,
    /// The settings of security; `None` if the ecosystem is not secured.
    pub(crate) security: Option<SecuritySettings>,
    /// The rights of agents and daemons; they are enforced only if the ecosystem is secured.
    pub(crate) rights: Rights,
    /// Plugins that run as processes.
    pub(crate) plugins: PluginSettings,
    /// The simulated building.
    pub(crate) building: BuildingSettings,
    /// The place of each key: `agent.0.config` and all within it.
    pub(crate) places: SourceMap,
    /// The texts from which the ecosystem was read.
    pub(crate) sources: SourceTexts,
    /// Whether ontology and map are free of errors; otherwise checks against them prove nothing.
    pub(crate) are_files_sound: bool,
}

/// The texts from which an ecosystem was read.
#[derive(Clone, Debug)]
pub(crate) struct SourceTexts {
    /// The ecosystem file.
    pub(crate) file: Arc<SourceText>,
    /// The map.
    pub(crate) map: Arc<SourceText>,
}

/// One `[[agent]]`.
#[derive(Clone, Debug)]
pub(crate) struct AgentEntry {
    /// The path of the entry in the file, such as `agent.3`; empty for an agent that no file names.
    pub(crate) path: String,
    /// Its name, unique in the ecosystem.
    pub(crate) name: AgentId,
    /// The plugin that builds it: a built-in one, or one of its package.
    pub(crate) plugin: String,
    /// The package that provides its plugin; `None` for a built-in plugin.
    pub(crate) package: Option<String>,
    /// The daemons that host it. If there are none, a machine that runs alone hosts it. If there
    /// are several, one is the leader and the others are standbys.
    pub(crate) daemons: Vec<DaemonId>,
    /// One of the plugin's drivers; `None` for the plugin's default.
    pub(crate) driver: Option<String>,
    /// The configuration for the plugin, as it is written; null if there is none.
    pub(crate) config: Arc<Value>,
}

impl AgentEntry {
    /// Whether its plugin is built into the daemon.
    pub(crate) fn is_built_in(&self) -> bool {
        self.package.is_none()
    }
}

/// The security settings of an ecosystem.
#[derive(Clone, Debug)]
pub(crate) struct SecuritySettings {
    /// The folder with keys and certificates.
    pub(crate) folder: PathBuf,
    /// How long before its expiry a certificate is announced.
    pub(crate) warn_before: Duration,
    /// Most messages per second that are accepted from one daemon.
    pub(crate) messages_per_second_max: u32,
}

/// The settings for plugins that run as processes.
#[derive(Clone, Debug)]
pub(crate) struct PluginSettings {
    /// The folder with their packages; `None` for the default folder of the machine.
    pub(crate) folder: Option<PathBuf>,
    /// The rule for the admission of agents that the file does not name.
    pub(crate) admit: AdmissionPolicy,
    /// Whether plugins run only if the machine supports all parts of their confinement.
    pub(crate) requires_confinement: bool,
}

/// The initial state of the simulated building, besides the map.
#[derive(Clone, Debug)]
pub(crate) struct BuildingSettings {
    /// The true temperature of places, in °C.
    pub(crate) temperatures: BTreeMap<String, f64>,
    /// Other true quantities of places, by place and quantity.
    pub(crate) conditions: BTreeMap<String, BTreeMap<String, f64>>,
    /// Factor on all durations; 1 is real time.
    pub(crate) time_scale: f64,
    /// The socket by which several processes share the building; `None` if it belongs to one
    /// process.
    pub(crate) socket: Option<PathBuf>,
}

/// Returns a goal without further settings.
pub(crate) fn plain_goal(goal: &str) -> GoalRequest {
    let (keep, partition) = Default::default();
    GoalRequest { goal: goal.to_owned(), keep, priority: 0, partition }
}

/// Whether a goal is PDDL, right or wrong, and not a name.
pub(crate) fn is_pddl(goal: &str) -> bool {
    goal.trim().is_empty() || goal.contains([' ', '(', ')', ','])
}

// === impl Ecosystem ===

impl Ecosystem {
    /// Returns the goal named `goal`, or `goal` itself if it is PDDL.
    ///
    /// The error lists the names of goals.
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

    /// Returns the agents that are assigned to a daemon by name.
    pub(crate) fn agents_of(&self, daemon: &DaemonId) -> impl Iterator<Item = &AgentEntry> {
        self.agents.iter().filter(move |agent| agent.daemons.contains(daemon))
    }

    /// Returns the Journals: the agents that keep records for others.
    pub(crate) fn journals(&self) -> impl Iterator<Item = &AgentId> {
        let journals = self
            .agents
            .iter()
            .filter(|agent| agent.is_built_in() && agent.plugin == journal::PLUGIN.name);
        journals.map(|agent| &agent.name)
    }

    /// Returns the agents that are assigned to no daemon: a machine that runs alone hosts them.
    pub(crate) fn unassigned_agents(&self) -> impl Iterator<Item = &AgentEntry> {
        self.agents.iter().filter(|agent| agent.daemons.is_empty())
    }
}
