//! What a plugin crate offers to a daemon, and what it is given to build an agent from.

use std::any::{Any, TypeId};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::Arc;

use acl::AgentId;
use acl::content::Mode;
use pddl::{Domain, Problem};
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::base_agent::Launch;
use crate::settings::Settings;

/// One line in the daemon's table of plugins.
#[derive(Clone, Copy, Debug)]
pub struct PluginEntry {
    /// The name under which an ecosystem file asks for it.
    pub name: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// The drivers it has; the first is the default. None, if it touches no device.
    pub drivers: &'static [&'static str],
    /// Whether several daemons may host it, of which one acts and the others stand by. Of a device
    /// there is one.
    pub stands_by: bool,
    /// Builds an agent. Opens nothing: that is for the agent's activation.
    pub build: fn(Blueprint) -> Result<Box<dyn Launch>, BuildError>,
}

/// What an agent is built from: its entry in the ecosystem file, and its host.
#[derive(Clone, Debug)]
pub struct Blueprint {
    /// Its name.
    pub id: AgentId,
    /// Which driver; one of its plugin's.
    pub driver: String,
    /// The entry's `config`, as JSON.
    pub config: Arc<Value>,
    /// The daemon.
    pub host: Arc<Host>,
}

/// What a daemon gives to all its agents.
#[derive(Debug)]
pub struct Host {
    /// The shared ontology.
    pub ontology: Arc<Domain>,
    /// Objects and facts that no agent brings.
    pub map: Arc<Problem>,
    /// Which flow the ecosystem uses.
    pub mode: Mode,
    /// Times and bounds.
    pub settings: Settings,
    /// The Journals of the ecosystem, in the order of its file.
    pub journals: Vec<AgentId>,
    /// What drivers reach the world through, by type.
    pub resources: Resources,
}

/// Among the resources of a host: where the daemon keeps what its agents must not forget.
#[derive(Clone, Debug)]
pub struct StateFolder(pub PathBuf);

/// Among the resources of a host: the names of all agents that the ecosystem's file names, also of those
/// of other daemons. What appears by itself takes none of them.
#[derive(Clone, Debug, Default)]
pub struct Named(pub BTreeSet<String>);

/// Among the resources of a host: an agent is built only to see whether it can be, perhaps on
/// another machine than its own. What is outside the entry is neither read nor missed.
#[derive(Clone, Copy, Debug)]
pub struct Rehearsal;

/// Things that drivers share, one per type.
#[derive(Clone, Default)]
pub struct Resources(HashMap<TypeId, Arc<dyn Any + Send + Sync>>);

/// Why an agent could not be built. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The entry's `config` has another shape.
    #[error("read the config of `{agent}`: {source}")]
    Config {
        /// The agent.
        agent: AgentId,
        /// What is wrong.
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
        /// The drivers there are.
        known: Vec<String>,
    },
    /// Something else about this entry.
    #[error("build `{agent}`: {problem}")]
    Other {
        /// The agent.
        agent: AgentId,
        /// What is wrong, and what would be right.
        problem: String,
    },
}

impl Blueprint {
    /// Reads the entry's `config`.
    ///
    /// # Errors
    ///
    /// If it has another shape.
    pub fn config_as<T: DeserializeOwned>(&self) -> Result<T, BuildError> {
        let config = if self.config.is_null() {
            Value::Object(Default::default())
        } else {
            Value::clone(&self.config)
        };
        serde_json::from_value(config)
            .map_err(|source| BuildError::Config { agent: self.id.clone(), source })
    }

    /// An error about this entry.
    pub fn problem(&self, problem: impl Into<String>) -> BuildError {
        BuildError::Other { agent: self.id.clone(), problem: problem.into() }
    }
}

impl Host {
    /// One with nothing but words and a map: no resources, no Journals, and the defaults.
    pub fn new(ontology: Domain, map: Problem) -> Host {
        Host {
            ontology: Arc::new(ontology),
            map: Arc::new(map),
            mode: Mode::default(),
            settings: Settings::default(),
            journals: Vec::new(),
            resources: Resources::default(),
        }
    }

    /// The names of the map: rooms, and whatever else it has.
    pub fn places(&self) -> impl Iterator<Item = &str> + Clone {
        self.map.objects.iter().map(|declared| declared.object.name.as_str())
    }

    /// Sees that there is such a place.
    ///
    /// # Errors
    ///
    /// If there is none; for a person, with the name that may have been meant.
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
    /// Puts a thing in; one of the same type is replaced.
    pub fn insert<T: Send + Sync + 'static>(&mut self, thing: T) {
        self.0.insert(TypeId::of::<T>(), Arc::new(thing));
    }

    /// Puts a thing in that others hold too.
    pub fn share<T: Send + Sync + 'static>(&mut self, thing: Arc<T>) {
        self.0.insert(TypeId::of::<T>(), thing);
    }

    /// The thing of this type.
    pub fn get<T: Send + Sync + 'static>(&self) -> Option<Arc<T>> {
        self.0.get(&TypeId::of::<T>()).cloned()?.downcast().ok()
    }
}

impl std::fmt::Debug for Resources {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Resources({})", self.0.len())
    }
}
