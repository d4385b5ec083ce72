//! An ecosystem as its file means it: no options left open, no impossible pairs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{Admit, Mode, Rights, Settings};
use keyboard::Wish;
use pddl::{Domain, Problem};
use serde_json::Value;
use terminal::report::Source;

use super::InterfaceEntry;
use super::layer::Places;

/// A whole ecosystem, the same on every machine.
#[derive(Clone, Debug)]
pub(crate) struct Ecosystem {
    /// Its name.
    pub(crate) name: EcosystemId,
    /// The shared ontology.
    pub(crate) domain: Arc<Domain>,
    /// The map: objects and facts that no agent brings.
    pub(crate) problem: Arc<Problem>,
    /// Who plans.
    pub(crate) mode: Mode,
    /// All daemons: those listed, and those that agents name.
    pub(crate) daemons: BTreeSet<DaemonId>,
    /// All agents, in the order of the file.
    pub(crate) agents: Vec<AgentEntry>,
    /// Where this ecosystem meets others.
    pub(crate) interfaces: Vec<InterfaceEntry>,
    /// Goals with a name; each has been parsed and checked.
    pub(crate) goals: BTreeMap<String, Wish>,
    /// For Zenoh, as it is; null where nothing is said.
    pub(crate) zenoh: Value,
    /// Times and bounds.
    pub(crate) settings: Settings,
    /// How it is secured, if it is.
    pub(crate) security: Option<SecuritySettings>,
    /// Who may do what, where it is secured.
    pub(crate) rights: Rights,
    /// Plugins that run as processes.
    pub(crate) plugins: PluginSettings,
    /// The simulated building.
    pub(crate) building: BuildingSettings,
    /// Where each key was written: `agent.0.config` and what is in it.
    pub(crate) places: Places,
    /// The texts that the ecosystem was read from.
    pub(crate) texts: Texts,
    /// Whether ontology and map are free of errors, so that what is held against them means
    /// something.
    pub(crate) are_files_sound: bool,
}

/// The texts that an ecosystem was read from.
#[derive(Clone, Debug)]
pub(crate) struct Texts {
    /// The ecosystem file.
    pub(crate) file: Arc<Source>,
    /// The map.
    pub(crate) map: Arc<Source>,
}

/// One `[[agent]]`.
#[derive(Clone, Debug)]
pub(crate) struct AgentEntry {
    /// Where the entry stands in the file, such as `agent.3`; empty for an agent that no file names.
    pub(crate) path: String,
    /// Its name, unique in the ecosystem.
    pub(crate) name: AgentId,
    /// The plugin that builds it: a known one, or one of its package's.
    pub(crate) plugin: String,
    /// The package whose process brings it; none for an agent of the daemon itself.
    pub(crate) package: Option<String>,
    /// Which daemons host it; none where whoever runs alone does. Of several, one acts and the
    /// others stand by.
    pub(crate) daemons: Vec<DaemonId>,
    /// One of the plugin's drivers; none for the plugin's default.
    pub(crate) driver: Option<String>,
    /// For the plugin, as it is; null where nothing is said.
    pub(crate) config: Arc<Value>,
}

impl AgentEntry {
    /// Whether the daemon itself has its plugin.
    pub(crate) fn is_built_in(&self) -> bool {
        self.package.is_none()
    }
}

/// How an ecosystem is secured.
#[derive(Clone, Debug)]
pub(crate) struct SecuritySettings {
    /// Where keys and certificates are.
    pub(crate) folder: PathBuf,
    /// How long before its end a certificate is announced.
    pub(crate) warn_before: Duration,
    /// What one daemon may send in a second.
    pub(crate) messages_per_second_max: u32,
}

/// Where plugins that run as processes come from, and who of theirs takes part.
#[derive(Clone, Debug)]
pub(crate) struct PluginSettings {
    /// The folder with their packages; none for this machine's own.
    pub(crate) folder: Option<PathBuf>,
    /// Whether agents that the file does not name take part.
    pub(crate) admit: Admit,
    /// Whether plugins run only where nothing of their confinement is missing.
    pub(crate) requires_confinement: bool,
}

/// What the simulated building is like besides the map.
#[derive(Clone, Debug)]
pub(crate) struct BuildingSettings {
    /// The true temperature of places, in °C.
    pub(crate) temperatures: BTreeMap<String, f64>,
    /// What else is true of places, by place and quantity.
    pub(crate) conditions: BTreeMap<String, BTreeMap<String, f64>>,
    /// Factor on all durations; 1 is real time.
    pub(crate) time_scale: f64,
    /// Where several processes share the building.
    pub(crate) socket: Option<PathBuf>,
}

/// A goal of which nothing more is said.
pub(crate) fn wish_for(goal: &str) -> Wish {
    let (keep, partition) = Default::default();
    Wish { goal: goal.to_owned(), keep, priority: 0, partition }
}

/// Whether a goal is PDDL, right or wrong, and no name.
pub(crate) fn is_pddl(goal: &str) -> bool {
    goal.trim().is_empty() || goal.contains([' ', '(', ')', ','])
}

// === impl Ecosystem ===

impl Ecosystem {
    /// What is wanted by `goal`: the named goal, or `goal` itself if it is PDDL already.
    ///
    /// The error says which names there are.
    pub(crate) fn wish(&self, goal: &str) -> Result<Wish, String> {
        if let Some(wish) = self.goals.get(goal) {
            return Ok(wish.clone());
        }
        if is_pddl(goal) {
            return Ok(wish_for(goal));
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

    /// The agents that a daemon hosts by name.
    pub(crate) fn agents_of(&self, daemon: &DaemonId) -> impl Iterator<Item = &AgentEntry> {
        self.agents.iter().filter(move |agent| agent.daemons.contains(daemon))
    }

    /// The agents that keep what must outlive a process.
    pub(crate) fn journals(&self) -> impl Iterator<Item = &AgentId> {
        let journals = self
            .agents
            .iter()
            .filter(|agent| agent.is_built_in() && agent.plugin == journal::PLUGIN.name);
        journals.map(|agent| &agent.name)
    }

    /// The agents that are given to no daemon: they belong to the machine that runs alone.
    pub(crate) fn agents_of_nobody(&self) -> impl Iterator<Item = &AgentEntry> {
        self.agents.iter().filter(|agent| agent.daemons.is_empty())
    }
}
