//! The host of agents: data and resources that a daemon gives to all its agents.

use std::any::{Any, TypeId};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::Arc;

use acl::AgentId;
use acl::content::Mode;
use pddl::{ActionModel, Domain, Problem};

use crate::settings::AgentSettings;
use crate::stops::StopRegistry;

/// Data and resources that a daemon gives to all its agents.
#[derive(Debug)]
pub struct Host {
    /// The shared ontology of the ecosystem.
    pub ontology: Arc<Domain>,
    /// The shared map: places and facts that belong to no agent.
    pub map: Arc<Problem>,
    /// Planning mode of the ecosystem: centralised or decentralised.
    pub mode: Mode,
    /// Times and bounds that apply to the daemon's agents.
    pub settings: AgentSettings,
    /// Names of the Journals of the ecosystem, in the order of the ecosystem file.
    pub journals: Vec<AgentId>,
    /// Objects through which drivers reach the outside world, one per type.
    pub resources: Resources,
}

/// Resource of a host: path of the folder for data that the daemon's agents need after a restart.
#[derive(Clone, Debug)]
pub struct StateFolder(pub PathBuf);

/// Resource of a host: path of the folder with the ecosystem file. Relative paths in the `config` of an
/// agent begin there; such files are on every machine, as the ecosystem file is.
#[derive(Clone, Debug)]
pub struct EcosystemFolder(pub PathBuf);

/// Resource of a host: the names of all agents in the ecosystem file, including those of other
/// daemons. A discovered agent must not take any of these names.
#[derive(Clone, Debug, Default)]
pub struct ConfiguredNames(pub BTreeSet<String>);

/// Resource of a host: the action models that the agents of the ecosystem file will announce,
/// including those of other daemons. Models that the file does not determine, such as those of
/// packages, are missing.
#[derive(Clone, Debug, Default)]
pub struct ConfiguredModels(pub Vec<ActionModel>);

/// Resource of a host that marks a trial: the agent is built only to check that it can be built,
/// perhaps on another machine than its own. The build then neither reads nor requires files,
/// devices or anything else outside the agent's entry.
#[derive(Clone, Copy, Debug)]
pub struct BuildCheck;

/// Objects that drivers share; at most one of each type.
#[derive(Clone, Default)]
pub struct Resources(HashMap<TypeId, Arc<dyn Any + Send + Sync>>);

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

    /// Returns the stops of the daemon. A host without such a resource has a registry of its own,
    /// which keeps nothing.
    pub fn stops(&self) -> Arc<StopRegistry> {
        self.resources.get::<StopRegistry>().unwrap_or_default()
    }

    /// Checks that the map has the object `place`.
    ///
    /// # Errors
    ///
    /// Returns a text for a person if the map has no such object. The text suggests a similar name
    /// on the map, if there is one.
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
    /// Adds an object. An object of the same type is replaced.
    pub fn insert<T: Send + Sync + 'static>(&mut self, thing: T) {
        self.0.insert(TypeId::of::<T>(), Arc::new(thing));
    }

    /// Adds an object that has other owners too. An object of the same type is replaced.
    pub fn share<T: Send + Sync + 'static>(&mut self, thing: Arc<T>) {
        self.0.insert(TypeId::of::<T>(), thing);
    }

    /// Returns the object of this type; `None` if no such object was added.
    pub fn get<T: Send + Sync + 'static>(&self) -> Option<Arc<T>> {
        self.0.get(&TypeId::of::<T>()).cloned()?.downcast().ok()
    }
}

impl std::fmt::Debug for Resources {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Resources({})", self.0.len())
    }
}
