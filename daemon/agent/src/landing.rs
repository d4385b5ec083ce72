//! Launching of agents while the daemon runs: agents of interfaces, and agents that plugins bring.

use std::sync::Arc;

use acl::{AgentId, EcosystemId};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::base_agent::Berth;
use crate::plugin::Host;
use crate::switchboard::Switchboard;

/// Source of launch contexts on one daemon.
#[derive(Clone)]
pub struct Landing {
    /// Router of the daemon.
    pub switchboard: Arc<Switchboard>,
    /// Data and resources from which agents are built here.
    pub host: Arc<Host>,
    /// Set when the daemon drains.
    pub stopping: CancellationToken,
    /// Tasks that the drain waits for.
    pub tasks: TaskTracker,
    /// Whether agents are launched with the ecosystems that they come through. `false` on the network
    /// of a plugin process, and in the fault laboratory to check that loops are noticed.
    pub tells_way: bool,
}

impl Landing {
    /// Returns the launch context for a new incarnation of an agent that comes from other
    /// ecosystems, `via` these.
    pub fn berth(
        &self,
        id: &AgentId,
        via: Vec<EcosystemId>,
        stopping: &CancellationToken,
    ) -> Berth {
        Berth {
            id: id.clone(),
            incarnation: self.switchboard.machine().next_life(),
            switchboard: Arc::clone(&self.switchboard),
            ontology: Arc::from(self.host.ontology.name.as_str()),
            stopping: stopping.clone(),
            stands_by: false,
            via: if self.tells_way { via.into() } else { [].into() },
        }
    }
}
