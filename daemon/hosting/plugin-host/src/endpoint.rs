//! The endpoint that a plugin connects to: a Zenoh listener on a socket that the plugin shares with
//! its host only. The host is the part of the daemon that runs plugins.
//!
//! The host receives the plugin's messages, but the ecosystem does not, and the plugin does not
//! receive those of the ecosystem. The plugin therefore cannot take another agent's name, send
//! requests to other agents, or read their messages. The plugin's agents are in the ecosystem only
//! as proxy agents, if the host admits them (`proxy`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use acl::{AgentId, DaemonId, EcosystemId, HostName};
use agent::{AgentSettings, AgentWatch, LaunchableAgent as _, MessageRouter, Observer, Spawner};
use pddl::ActionModel;
use serde_json::{Value, json};
use substrate::{Answer, Delivery, Inbound, Presence, ReceivedQuery, Rejected, Substrate};
use substrate_zenoh::OpenError;
use tokio::sync::{Notify, mpsc};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::package::Package;
use crate::plugin_client::{PluginClient, PluginClientHandle};
use crate::proxy::{AcceptedAgents, ProxyRunner};

/// Name of the client agent on the endpoint, which forwards actions to the plugin's agents.
const HOST: &str = "host";
/// Name of the agent on the endpoint that observes the plugin's agents.
const WATCHER: &str = "host-watch";

/// Capacity of the queue of agents that have joined the endpoint for the first time. An agent that
/// exceeds the capacity is rejected. A gateway of a large building has hundreds of agents.
const AGENTS_MAX: usize = 1_024;

/// Messages per second, such as heartbeats and events, that are accepted from a plugin:
/// [`MESSAGES_PER_SECOND`], plus [`MESSAGES_PER_AGENT`] for each of its agents. Further messages
/// are dropped.
const MESSAGES_PER_SECOND: u32 = 200;
const MESSAGES_PER_AGENT: u32 = 20;

/// Number of successive seconds with too many messages after which a plugin is stopped.
const FLOOD_SECONDS: u32 = 5;

/// Maximum number of simultaneous connections to an endpoint, for each process of the plugin: its
/// session, and sessions that have ended but are not yet detected as closed. Further connections
/// are closed at once. The maximum for the whole plugin is at least [`SESSIONS_MIN`].
const SESSIONS_PER_PROCESS: u32 = 4;
const SESSIONS_MIN: u32 = 8;
/// Maximum number of connections to an endpoint that are being opened at the same time; further
/// ones are closed at once.
const OPENING_MAX: u32 = 8;

/// Maximum time for the agents of a plugin to leave when the endpoint is closed. After this time,
/// the endpoint closes without waiting for them.
const LEAVING: Duration = Duration::from_secs(3);

/// Period over which the messages of a plugin are counted.
const SECOND: Duration = Duration::from_secs(1);

/// An open endpoint of a plugin. The endpoint stays open when the plugin's process is restarted.
pub(crate) struct Endpoint {
    pub(crate) locator: String,
    /// Path of the socket of the endpoint.
    pub(crate) socket: PathBuf,
    pub(crate) host: HostName,
    substrate: Arc<dyn Substrate>,
    pub(crate) accepted: Arc<AcceptedAgents>,
    pub(crate) meter: Arc<RateLimit>,
    stopping: CancellationToken,
    tasks: TaskTracker,
}

/// Parameters of the endpoint of a plugin.
pub(crate) struct EndpointParameters<'p> {
    pub(crate) ecosystem: &'p EcosystemId,
    pub(crate) daemon: &'p DaemonId,
    pub(crate) settings: &'p AgentSettings,
    pub(crate) socket: &'p Path,
    pub(crate) package: &'p Arc<Package>,
    /// Agents that the plugin must bring, each with its action model; `None` if the package has no
    /// model for the agent.
    pub(crate) agents: BTreeMap<AgentId, Option<Arc<ActionModel>>>,
    pub(crate) spawner: &'p Spawner,
}

impl Endpoint {
    pub(crate) async fn open(purpose: EndpointParameters<'_>) -> Result<Endpoint, OpenError> {
        let EndpointParameters { ecosystem, daemon, settings, socket, package, agents, spawner } =
            purpose;
        let machine = spawner.router.host_services();
        let router =
            MessageRouter::on(machine, ecosystem.clone(), daemon.clone(), settings.clone());
        let meter = Arc::new(RateLimit::new(Arc::clone(&router)));
        let locator = format!("unixsock-stream/{}", socket.display());
        let mut config = substrate_zenoh::Config::new(ecosystem.clone(), daemon.clone());
        config.listen = vec![locator.clone()];
        config.zenoh = wire(package.manifest.permissions.processes);
        let inbound: Arc<dyn Inbound> = Arc::<RateLimit>::clone(&meter);
        let substrate: Arc<dyn Substrate> = config.open(inbound).await?;
        router.connect(Arc::clone(&substrate));
        let (stopping, tasks) = (spawner.stopping.child_token(), TaskTracker::new());
        let own = Spawner {
            router,
            host: Arc::clone(&spawner.host),
            stopping: CancellationToken::new(),
            tasks: tasks.clone(),
            records_via: false,
        };
        let (attendant, bell) = PluginClient::new();
        let (newcomers, met) = mpsc::channel(AGENTS_MAX);
        let host = HostName { daemon: daemon.clone(), agent: plain(HOST) };
        drop(Box::new(attendant).launch(own.launch_context(&host.agent, Vec::new(), &stopping)));
        let observer = Observer::of_all(newcomers);
        drop(Box::new(observer).launch(own.launch_context(&plain(WATCHER), Vec::new(), &stopping)));
        let accepted = Arc::new(AcceptedAgents::new(BTreeMap::new()));
        let reception = AgentReception {
            package: Arc::clone(package),
            agents,
            client: bell,
            spawner: spawner.clone(),
            accepted: Arc::clone(&accepted),
            stopping: stopping.clone(),
            tasks: tasks.clone(),
            meter: Arc::clone(&meter),
        };
        tasks.spawn(reception.run(met));
        let socket = socket.to_owned();
        Ok(Endpoint { locator, socket, host, substrate, accepted, meter, stopping, tasks })
    }

    /// Stops the proxy agents of the plugin's agents, waits for their end up to [`LEAVING`], and
    /// closes the endpoint.
    pub(crate) async fn close(self) {
        self.stopping.cancel();
        self.tasks.close();
        if tokio::time::timeout(LEAVING, self.tasks.wait()).await.is_err() {
            tracing::warn!(locator = self.locator, "agents of a plugin have not left in time");
        }
        self.substrate.close().await;
    }
}

/// Returns Zenoh's settings for the endpoint of a plugin with at most `processes` processes. The
/// number of sessions is bounded because each session takes memory of the daemon.
fn wire(processes: u32) -> Value {
    let sessions = processes.saturating_mul(SESSIONS_PER_PROCESS).max(SESSIONS_MIN);
    json!({ "transport": { "unicast": {
        "max_sessions": sessions,
        "accept_pending": OPENING_MAX,
    } } })
}

fn plain(name: &str) -> AgentId {
    AgentId::new(name).expect("invariant: the names of the host's own agents are valid")
}

/// Task that accepts or rejects the agents of the plugin when they join the endpoint.
struct AgentReception {
    package: Arc<Package>,
    agents: BTreeMap<AgentId, Option<Arc<ActionModel>>>,
    client: PluginClientHandle,
    spawner: Spawner,
    accepted: Arc<AcceptedAgents>,
    stopping: CancellationToken,
    tasks: TaskTracker,
    meter: Arc<RateLimit>,
}

impl AgentReception {
    async fn run(self, mut met: mpsc::Receiver<(AgentId, AgentWatch)>) {
        loop {
            let (agent, watch) = tokio::select! {
                biased;
                () = self.stopping.cancelled() => return,
                met = met.recv() => match met {
                    Some(met) => met,
                    None => return,
                },
            };
            let own = match self.agents.get(&agent) {
                Some(own) => own.clone(),
                None if self.package.manifest.may_bring(&agent) => None,
                None => {
                    let plugin = &self.package.manifest.name;
                    let why = format!(
                        "`{plugin}` was not asked for this agent, and its manifest does not name \
                         it in `brings`"
                    );
                    tracing::warn!(%agent, "is rejected: {why}");
                    self.accepted.send_modify(|accepted| drop(accepted.insert(agent, Err(why))));
                    continue;
                }
            };
            self.meter.allow_more();
            let escort = ProxyRunner {
                agent,
                watch,
                client: self.client.clone(),
                package: Arc::clone(&self.package),
                own,
                spawner: self.spawner.clone(),
                accepted: Arc::clone(&self.accepted),
                stopping: self.stopping.clone(),
            };
            self.tasks.spawn(escort.run());
        }
    }
}

/// Limit on the rate of messages from a plugin: counts the messages and drops those above the
/// limit.
pub(crate) struct RateLimit {
    inner: Arc<MessageRouter>,
    per_second: AtomicU32,
    second: Mutex<RateWindow>,
    /// Notified when the plugin has sent too many messages for [`FLOOD_SECONDS`] seconds in a row.
    pub(crate) flooded: Notify,
}

struct RateWindow {
    began: Instant,
    count: u32,
    /// Number of seconds in a row in which the plugin has sent too many messages.
    over: u32,
    dropped: u64,
}

impl RateLimit {
    fn new(inner: Arc<MessageRouter>) -> RateLimit {
        let second = RateWindow { began: Instant::now(), count: 0, over: 0, dropped: 0 };
        RateLimit {
            inner,
            per_second: AtomicU32::new(MESSAGES_PER_SECOND),
            second: Mutex::new(second),
            flooded: Notify::new(),
        }
    }

    fn allow_more(&self) {
        self.per_second.fetch_add(MESSAGES_PER_AGENT, Ordering::Relaxed);
    }

    /// Returns the number of messages of the plugin that were dropped so far.
    pub(crate) fn dropped(&self) -> u64 {
        self.second.lock().unwrap_or_else(PoisonError::into_inner).dropped
    }

    /// Counts one message of the plugin. Returns `true` if the message is within the limit.
    fn accepts_message(&self) -> bool {
        let most = self.per_second.load(Ordering::Relaxed);
        let mut second = self.second.lock().unwrap_or_else(PoisonError::into_inner);
        let elapsed = second.began.elapsed();
        if elapsed >= SECOND {
            let was_over = second.count > most && elapsed < SECOND * 2;
            second.over = if was_over { second.over + 1 } else { 0 };
            (second.began, second.count) = (Instant::now(), 0);
            if second.over >= FLOOD_SECONDS {
                second.over = 0;
                self.flooded.notify_one();
            }
        }
        second.count = second.count.saturating_add(1);
        let takes = second.count <= most;
        second.dropped += u64::from(!takes);
        takes
    }
}

impl Inbound for RateLimit {
    fn deliver(&self, delivery: Delivery) {
        if self.accepts_message() {
            self.inner.deliver(delivery);
        }
    }

    fn presence(&self, presence: Presence) {
        // The departure of an agent is always passed on, even above the limit.
        if self.accepts_message() || matches!(presence, Presence::Left(_)) {
            self.inner.presence(presence);
        }
    }

    fn receive_query(&self, question: ReceivedQuery) {
        if self.accepts_message() {
            self.inner.receive_query(question);
        }
    }

    fn rejected(&self, rejected: &Rejected<'_>) {
        self.inner.rejected(rejected);
    }

    fn accepts_answer(&self, answer: &Answer<'_>) -> bool {
        self.inner.accepts_answer(answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_are_bounded_by_what_processes_need() {
        for (processes, sessions) in [(1, 8), (2, 8), (16, 64), (u32::MAX, u32::MAX)] {
            let wire = wire(processes);
            assert_eq!(wire["transport"]["unicast"]["max_sessions"], sessions);
            let ecosystem = EcosystemId::new("test").expect("a name");
            assert_eq!(substrate_zenoh::problems(&ecosystem, &wire, false), [], "Zenoh reads it");
        }
    }
}
