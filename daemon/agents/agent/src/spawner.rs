//! Launching of agents while the daemon runs: agents of interfaces between ecosystems, and agents
//! of plugin processes.

use std::sync::Arc;

use acl::{AgentId, EcosystemId};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::host::Host;
use crate::launch::LaunchContext;
use crate::router::MessageRouter;

/// Source of the contexts with which agents are launched on one daemon.
#[derive(Clone)]
pub struct Spawner {
    /// Router of the daemon that hosts the agents.
    pub router: Arc<MessageRouter>,
    /// Data and resources from which the agents are built.
    pub host: Arc<Host>,
    /// Token that is cancelled when the daemon begins to shut down.
    pub stopping: CancellationToken,
    /// Tasks that a daemon waits for while it shuts down.
    pub tasks: TaskTracker,
    /// Whether a launched agent records the ecosystems through which it came. `false` on the
    /// network of a plugin process, and in the fault laboratory, which checks that loops are
    /// noticed.
    pub records_via: bool,
}

impl Spawner {
    /// Returns the launch context for a new incarnation of the agent `id`, which came through the
    /// ecosystems `via`.
    pub fn launch_context(
        &self,
        id: &AgentId,
        via: Vec<EcosystemId>,
        stopping: &CancellationToken,
    ) -> LaunchContext {
        LaunchContext {
            id: id.clone(),
            incarnation: self.router.host_services().next_incarnation(),
            router: Arc::clone(&self.router),
            ontology: Arc::from(self.host.ontology.name.as_str()),
            stopping: stopping.clone(),
            has_replicas: false,
            via: if self.records_via { via.into() } else { [].into() },
        }
    }
}
