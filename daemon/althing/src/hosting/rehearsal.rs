//! Builds agents of an ecosystem without letting them live: what each would say of itself, and what is
//! wrong with its entry.
//!
//! Nothing is opened and nothing written; files that only an agent's own machine has are not read.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::building::{Building, Layout};
use acl::AgentId;
use agent::{Host, Launch, Rehearsal, Resources};
use pddl::ActionModel;

use super::{HostError, supervisor};
use crate::config::{AgentEntry, Ecosystem};

/// Where agents of an ecosystem are built that do not live.
pub(crate) struct Stage {
    host: Arc<Host>,
}

impl Stage {
    /// One for the agents of this ecosystem.
    pub(crate) fn of(ecosystem: &Ecosystem) -> Stage {
        let mut resources = Resources::default();
        resources.insert(Rehearsal);
        // Drivers take it in hand, and nobody acts: what is in it does not matter.
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
        Stage { host: Arc::new(host) }
    }

    /// Builds an agent as `up` would.
    ///
    /// # Errors
    ///
    /// What is wrong with its entry.
    pub(crate) fn build(&self, entry: &AgentEntry) -> Result<Box<dyn Launch>, HostError> {
        supervisor::rehearse(entry, &self.host)
    }
}

/// The action models of an ecosystem's agents, as far as they can be built: what each would say
/// of itself when it comes.
pub(crate) fn models(ecosystem: &Ecosystem) -> BTreeMap<AgentId, ActionModel> {
    let stage = Stage::of(ecosystem);
    let model = |entry: &AgentEntry| {
        let text = stage.build(entry).ok()?.model()?;
        let model = pddl::parse_action_model(&text).into_result().ok()?;
        Some((entry.name.clone(), model))
    };
    ecosystem.agents.iter().filter(|entry| entry.is_built_in()).filter_map(model).collect()
}
