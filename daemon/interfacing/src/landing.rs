//! Where agents that no ecosystem file names can live: those of the interfaces.

use std::sync::Arc;

use acl::{AgentId, EcosystemId};
use agent::{Berth, Host, Switchboard};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

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
    pub(crate) fn berth(
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
