//! Builds the agents of an ecosystem without launching them, to get their action models and the
//! mistakes in their entries.
//!
//! Nothing is opened or written; files that exist only on an agent's own machine are not read.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::building::{Building, Layout};
use acl::AgentId;
use agent::{BuildCheck, Host, LaunchableAgent, Resources};
use pddl::ActionModel;

use super::{HostError, supervisor};
use crate::config::{AgentEntry, Ecosystem};

/// The context in which agents of an ecosystem are built without being launched.
pub(crate) struct DryRun {
    host: Arc<Host>,
}

impl DryRun {
    /// Creates the context for the agents of this ecosystem.
    pub(crate) fn of(ecosystem: &Ecosystem) -> DryRun {
        let mut resources = Resources::default();
        resources.insert(BuildCheck);
        // Drivers take a handle of it, but no agent acts: its contents do not matter.
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

    /// Builds an agent as `althing up` would.
    ///
    /// # Errors
    ///
    /// Returns an error if its entry is wrong.
    pub(crate) fn build(&self, entry: &AgentEntry) -> Result<Box<dyn LaunchableAgent>, HostError> {
        supervisor::build_unlaunched(entry, &self.host)
    }
}

/// Returns the action models of an ecosystem's agents that are built in and can be built: what each
/// would announce when it joins.
pub(crate) fn models(ecosystem: &Ecosystem) -> BTreeMap<AgentId, ActionModel> {
    let stage = DryRun::of(ecosystem);
    let model = |entry: &AgentEntry| {
        let text = stage.build(entry).ok()?.model()?;
        let model = pddl::parse_action_model(&text).into_result().ok()?;
        Some((entry.name.clone(), model))
    };
    ecosystem.agents.iter().filter(|entry| entry.is_built_in()).filter_map(model).collect()
}
