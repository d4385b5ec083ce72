//! Where agents that come while the daemon runs can live: those of the interfaces, those that plugins
//! bring.

use std::sync::Arc;

use acl::{AgentId, EcosystemId};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::base_agent::Berth;
use crate::plugin::Host;
use crate::switchboard::Switchboard;

/// A place for them on a daemon.
#[derive(Clone)]
pub struct Landing {
    /// The daemon's end of the substrate.
    pub switchboard: Arc<Switchboard>,
    /// What agents are built with here.
    pub host: Arc<Host>,
    /// Set when the daemon drains.
    pub stopping: CancellationToken,
    /// What the drain waits for.
    pub tasks: TaskTracker,
    /// Whether agents are told through which ecosystems they have come. The fault laboratory leaves it
    /// out, to see that what goes round in circles is noticed.
    pub tells_way: bool,
}

impl Landing {
    /// A place for a new life of an agent that comes from other ecosystems, `via` these.
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
