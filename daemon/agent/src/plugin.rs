//! Entry point of a plugin crate for a daemon, and the data from which an agent is built.

use std::any::{Any, TypeId};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::Arc;

use acl::AgentId;
use acl::content::Mode;
use pddl::{Domain, Problem};
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::base_agent::LaunchableAgent;
use crate::settings::AgentSettings;

/// Entry of the daemon's table of plugins.
#[derive(Clone, Copy, Debug)]
pub struct PluginEntry {
    /// Name of the plugin in an ecosystem file.
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// Names of the drivers; the first is the default. Empty if the plugin uses no device.
    pub drivers: &'static [&'static str],
    /// Whether several daemons may host the agent: one replica is the leader, the others are
    /// standbys. `false` for a device, because there is only one.
    pub has_replicas: bool,
    /// Builds an agent. Opens nothing: that is done when the agent is activated.
    pub build: fn(Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError>,
}

/// Data from which an agent is built: its entry in the ecosystem file, and its host.
#[derive(Clone, Debug)]
pub struct Blueprint {
    /// Name of the agent.
    pub id: AgentId,
    /// Name of the driver; one of the plugin's.
    pub driver: String,
    /// The entry's `config`, as JSON.
    pub config: Arc<Value>,
    /// Data and resources of the daemon.
    pub host: Arc<Host>,
}

/// Data and resources that a daemon gives to all its agents.
#[derive(Debug)]
pub struct Host {
    /// The shared ontology.
    pub ontology: Arc<Domain>,
    /// The shared map: objects and facts that no agent brings.
    pub map: Arc<Problem>,
    /// Flow of planning in the ecosystem: centralised or decentralised.
    pub mode: Mode,
    /// Times and bounds.
    pub settings: AgentSettings,
    /// The Journals of the ecosystem, in the order of its file.
    pub journals: Vec<AgentId>,
    /// Objects through which drivers reach the outside world, by type.
    pub resources: Resources,
}

/// Resource of a host: the folder for data that the daemon's agents need after a restart.
#[derive(Clone, Debug)]
pub struct StateFolder(pub PathBuf);

/// Resource of a host: the names of all agents in the ecosystem's file, including those of other
/// daemons. A discovered agent must not take any of them.
#[derive(Clone, Debug, Default)]
pub struct ConfiguredNames(pub BTreeSet<String>);

/// Resource of a host: the agent is built only to check that it can be, perhaps on another machine
/// than its own. Then everything outside its entry, such as files and devices, is neither read nor
/// required.
#[derive(Clone, Copy, Debug)]
pub struct BuildCheck;

/// Objects that drivers share, one per type.
#[derive(Clone, Default)]
pub struct Resources(HashMap<TypeId, Arc<dyn Any + Send + Sync>>);

/// Reason why an agent could not be built. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The entry's `config` does not have the expected shape.
    #[error("read the config of `{agent}`: {source}")]
    Config {
        /// The agent.
        agent: AgentId,
        /// Error of the parser.
        #[source]
        source: serde_json::Error,
    },
    /// The plugin has no such driver.
    #[error("find driver `{driver}` for `{agent}`; there is {}", known.join(", "))]
    UnknownDriver {
        /// The agent.
        agent: AgentId,
        /// The driver asked for.
        driver: String,
        /// The drivers that the plugin has.
        known: Vec<String>,
    },
    /// Any other problem of this entry.
    #[error("build `{agent}`: {problem}")]
    Other {
        /// The agent.
        agent: AgentId,
        /// Description of the problem, and of what would be right.
        problem: String,
    },
}

impl Blueprint {
    /// Parses the entry's `config`.
    ///
    /// # Errors
    ///
    /// Returns an error if it does not have the expected shape.
    pub fn config_as<T: DeserializeOwned>(&self) -> Result<T, BuildError> {
        let config = if self.config.is_null() {
            Value::Object(Default::default())
        } else {
            Value::clone(&self.config)
        };
        serde_json::from_value(config)
            .map_err(|source| BuildError::Config { agent: self.id.clone(), source })
    }

    /// Creates an error about this entry.
    pub fn problem(&self, problem: impl Into<String>) -> BuildError {
        BuildError::Other { agent: self.id.clone(), problem: problem.into() }
    }
}

impl Host {
    /// Creates a host with an ontology, a map and default settings, without resources and Journals.
    pub fn new(ontology: Domain, map: Problem) -> Host {
        Host {
            ontology: Arc::new(ontology),
            map: Arc::new(map),
            mode: Mode::default(),
            settings: AgentSettings::default(),
            journals: Vec::new(),
            resources: Resources::default(),
        }
    }

    /// Returns the names of all objects on the map, such as rooms.
    pub fn places(&self) -> impl Iterator<Item = &str> + Clone {
        self.map.objects.iter().map(|declared| declared.object.name.as_str())
    }

    /// Checks that the map has this place.
    ///
    /// # Errors
    ///
    /// Returns a text for a person if it has not, with a similar name that may have been meant.
    pub fn has_place(&self, place: &str) -> Result<(), String> {
        if self.places().any(|known| known == place) {
            return Ok(());
        }
        let near = pddl::nearest(place, self.places());
        let hint = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
        Err(format!("there is no `{place}` on the map{hint}"))
    }
}

impl Resources {
    /// Adds an object; replaces one of the same type.
    pub fn insert<T: Send + Sync + 'static>(&mut self, thing: T) {
        self.0.insert(TypeId::of::<T>(), Arc::new(thing));
    }

    /// Adds an object that others hold too; replaces one of the same type.
    pub fn share<T: Send + Sync + 'static>(&mut self, thing: Arc<T>) {
        self.0.insert(TypeId::of::<T>(), thing);
    }

    /// Returns the object of this type; `None` if there is none.
    pub fn get<T: Send + Sync + 'static>(&self) -> Option<Arc<T>> {
        self.0.get(&TypeId::of::<T>()).cloned()?.downcast().ok()
    }
}

impl std::fmt::Debug for Resources {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Resources({})", self.0.len())
    }
}
