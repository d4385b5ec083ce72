//! State that all machines of a trial share.

use std::sync::{Arc, Mutex, PoisonError};

use agent::AgentSettings;
use building::BuildingHandle;
use pddl::{Domain, Problem};
use substrate::faulty::Network;

use crate::script::{Safeguard, TrialScript};

/// State that all machines of a trial share.
pub struct TrialContext {
    /// The ontology.
    pub ontology: Arc<Domain>,
    /// The map.
    pub map: Arc<Problem>,
    /// The script of the trial.
    pub script: TrialScript,
    /// Times and bounds.
    pub settings: AgentSettings,
    /// The network between the machines.
    pub network: Network,
    /// The network of the second ecosystem, if there is one.
    pub annex: Option<Network>,
    /// The building.
    pub building: BuildingHandle,
    /// The guard that is missing in this trial; `None` if all are there.
    pub without: Option<Safeguard>,
    /// Agents that panicked or failed; there must be none.
    pub broken: Mutex<Vec<String>>,
}

impl TrialContext {
    /// Records that an agent panicked or failed.
    pub(crate) fn note_broken(&self, line: String) {
        self.broken.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }
}
