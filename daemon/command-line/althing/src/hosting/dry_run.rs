//! Builds the agents of an ecosystem without launching them, to get their action models and to find
//! the mistakes in their entries.
//!
//! Building an agent this way opens no device or connection, writes no file, and reads no file that
//! exists only on the agent's own machine.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::building::{Building, Layout};
use acl::AgentId;
use agent::{BuildCheck, EcosystemFolder, Host, LaunchableAgent, ModelPrivacy, Resources};
use pddl::ActionModel;

use super::{HostError, supervisor};
use crate::config::{AgentEntry, Ecosystem};

/// The context in which the agents of an ecosystem are built without being launched.
pub(crate) struct DryRun {
    host: Arc<Host>,
}

impl DryRun {
    /// Creates the context for building the agents of `ecosystem`.
    pub(crate) fn of(ecosystem: &Ecosystem) -> DryRun {
        let mut resources = Resources::default();
        resources.insert(BuildCheck);
        resources.insert(ecosystem.safeguards.clone());
        ecosystem.stop_buttons().into_iter().for_each(|buttons| resources.insert(buttons));
        resources.insert(EcosystemFolder(ecosystem.folder.clone()));
        // Drivers need a handle of a building. No agent acts, so the building is empty.
        let building = Building::new(Layout::new(), 1.0);
        building.into_iter().for_each(|building| resources.insert(building.handle()));
        let host = Host {
            ontology: Arc::clone(&ecosystem.domain),
            map: Arc::clone(&ecosystem.problem),
            mode: ecosystem.mode,
            settings: ecosystem.settings.clone(),
            journals: ecosystem.journals().cloned().collect(),
            resources,
        };
        DryRun { host: Arc::new(host) }
    }

    /// Builds the agent of an entry, as `althing up` would.
    ///
    /// # Errors
    ///
    /// Returns an error if the entry has a mistake.
    pub(crate) fn build(&self, entry: &AgentEntry) -> Result<Box<dyn LaunchableAgent>, HostError> {
        supervisor::build_unlaunched(entry, &self.host)
    }
}

/// Returns the action models of those agents of an ecosystem that have a built-in plugin and can be
/// built. An action model is what the agent would announce when it joins.
pub(crate) fn models(ecosystem: &Ecosystem) -> BTreeMap<AgentId, ActionModel> {
    models_of(ecosystem, &DryRun::of(ecosystem))
}

/// Returns the models of the same agents with their `:private` declarations, also if these are kept
/// from other agents.
pub(crate) fn whole_models(ecosystem: &Ecosystem) -> BTreeMap<AgentId, ActionModel> {
    let mut whole = ecosystem.clone();
    whole.settings.privacy = ModelPrivacy::Ecosystem;
    models_of(ecosystem, &DryRun::of(&whole))
}

fn models_of(ecosystem: &Ecosystem, stage: &DryRun) -> BTreeMap<AgentId, ActionModel> {
    let model = |entry: &AgentEntry| {
        let text = stage.build(entry).ok()?.model()?;
        let model = pddl::parse_action_model(&text).into_result().ok()?;
        Some((entry.name.clone(), model))
    };
    ecosystem.agents.iter().filter(|entry| entry.is_built_in()).filter_map(model).collect()
}
