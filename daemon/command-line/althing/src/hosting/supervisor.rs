//! Restarts agents that fail: an agent that panics or loses its name is launched again, each time
//! after a longer wait. Other agents notice only that the agent is absent.

use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use agent::{
    Blueprint, BuildError, Host, LaunchContext, LaunchableAgent, MessageRouter, PluginEntry,
};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::HostError;
use crate::config::AgentEntry;
use crate::plugins;

/// Wait before the first restart of an agent. The wait doubles at each further restart, up to
/// `RESTART_LAST`, because an agent that panics at every start must not keep the machine busy.
const RESTART_FIRST: Duration = Duration::from_millis(500);
const RESTART_LAST: Duration = Duration::from_secs(30);

/// An agent under supervision.
pub(super) struct SupervisedAgent {
    pub(super) id: AgentId,
    /// Token that, when it is cancelled, aborts the agent at once and ends its supervision.
    pub(super) aborted: CancellationToken,
    /// Token that, when it is cancelled, asks the agent to cancel its commitments and to end, and
    /// ends its supervision.
    pub(super) stopping: CancellationToken,
    /// The task that supervises the agent; it completes when the supervision has ended.
    pub(super) supervision: JoinHandle<()>,
}

/// Builds the agent of an entry once, so that mistakes in the entry are reported at start, and
/// supervises all incarnations of the agent.
pub(super) fn supervise(
    entry: AgentEntry,
    host: &Arc<Host>,
    router: &Arc<MessageRouter>,
    stopping: &CancellationToken,
    tasks: &TaskTracker,
) -> Result<SupervisedAgent, HostError> {
    let id = entry.name.clone();
    let unknown = || HostError::UnknownPlugin { agent: id.clone(), plugin: entry.plugin.clone() };
    let plugin = plugins::find(&entry.plugin).ok_or_else(unknown)?;
    let blueprint = blueprint(&entry, plugin, host)?;
    let first = (plugin.build)(blueprint.clone())?;
    let (unplugged, stopping) = (CancellationToken::new(), stopping.child_token());
    let supervision = AgentSupervisor {
        plugin,
        blueprint,
        router: Arc::clone(router),
        stopping: stopping.clone(),
        unplugged: unplugged.clone(),
        stands_by: entry.daemons.len() > 1,
    };
    let supervision = tasks.spawn(supervision.run(first));
    Ok(SupervisedAgent { id, aborted: unplugged, stopping, supervision })
}

/// Builds the agent of an entry without launching it. Mistakes in the entry are reported as they
/// would be at start.
pub(super) fn build_unlaunched(
    entry: &AgentEntry,
    host: &Arc<Host>,
) -> Result<Box<dyn LaunchableAgent>, HostError> {
    let (agent, plugin) = (entry.name.clone(), entry.plugin.clone());
    let plugin = plugins::find(&plugin).ok_or(HostError::UnknownPlugin { agent, plugin })?;
    Ok((plugin.build)(blueprint(entry, plugin, host)?)?)
}

fn blueprint(
    entry: &AgentEntry,
    plugin: &PluginEntry,
    host: &Arc<Host>,
) -> Result<Blueprint, BuildError> {
    let default = plugin.drivers.first().copied().unwrap_or_default();
    let driver = entry.driver.clone().unwrap_or_else(|| default.to_owned());
    if driver != default && !plugin.drivers.contains(&driver.as_str()) {
        let known = plugin.drivers.iter().map(|driver| format!("`{driver}`")).collect();
        return Err(BuildError::UnknownDriver { agent: entry.name.clone(), driver, known });
    }
    Ok(Blueprint {
        id: entry.name.clone(),
        driver,
        config: Arc::clone(&entry.config),
        host: Arc::clone(host),
    })
}

struct AgentSupervisor {
    plugin: &'static PluginEntry,
    blueprint: Blueprint,
    router: Arc<MessageRouter>,
    stopping: CancellationToken,
    unplugged: CancellationToken,
    stands_by: bool,
}

impl AgentSupervisor {
    async fn run(self, first: Box<dyn LaunchableAgent>) {
        let id = &self.blueprint.id;
        let mut wait = RESTART_FIRST;
        let mut next = Ok(first);
        loop {
            match next {
                Ok(agent) => {
                    if self.run_incarnation(agent).await {
                        return;
                    }
                }
                Err(error) => tracing::error!(%id, "failed to {error}"),
            }
            tokio::select! {
                () = tokio::time::sleep(wait) => (),
                () = self.stopping.cancelled() => return,
                () = self.unplugged.cancelled() => return,
            }
            wait = (wait * 2).min(RESTART_LAST);
            tracing::warn!(%id, "is restarted after a failure");
            self.router.activity().count_agent_restart();
            next = (self.plugin.build)(self.blueprint.clone());
        }
    }

    fn launch_context(&self) -> LaunchContext {
        let ontology = self.blueprint.host.ontology.name.as_str();
        let (id, router) = (&self.blueprint.id, &self.router);
        launch_context(id, router, ontology, &self.stopping, self.stands_by)
    }

    /// Runs one incarnation of the agent to its end. Returns `true` if no further one must be
    /// started.
    async fn run_incarnation(&self, agent: Box<dyn LaunchableAgent>) -> bool {
        let id = &self.blueprint.id;
        let mut task = agent.launch(self.launch_context());
        let ended = tokio::select! {
            ended = &mut task => ended,
            () = self.unplugged.cancelled() => {
                task.abort();
                return true;
            }
        };
        match ended {
            Ok(Ok(())) => return true,
            Ok(Err(error)) => tracing::error!(%id, "failed to {error}"),
            // The runtime ends with the daemon.
            Err(error) if error.is_cancelled() => return true,
            // The panic message itself is on stderr already, with its source location.
            Err(error) => tracing::error!(%id, %error, "the agent panicked"),
        }
        self.stopping.is_cancelled()
    }
}

/// Creates the context with which a new incarnation of an agent is launched.
pub(super) fn launch_context(
    id: &AgentId,
    router: &Arc<MessageRouter>,
    ontology: &str,
    stopping: &CancellationToken,
    stands_by: bool,
) -> LaunchContext {
    LaunchContext {
        id: id.clone(),
        incarnation: router.host_services().next_incarnation(),
        router: Arc::clone(router),
        ontology: Arc::from(ontology),
        stopping: stopping.clone(),
        has_replicas: stands_by,
        via: [].into(),
    }
}
