//! One daemon of an ecosystem: its node, which is connected to the substrate, and the agents that
//! it hosts.
//!
//! The order of use: read the configuration ([`crate::config`]), [`DaemonNode::open`], run,
//! [`DaemonNode::drain`].
//!
//! The submodules launch and supervise agents, simulate the building, choose folders and sockets on
//! this machine, read keys, and restart the process when that is necessary. The behaviour of agents
//! is in their plugins.

mod address_watch;
mod building;
mod building_takeover;
mod credentials;
mod daemon_launcher;
mod daemon_registry;
mod dry_run;
mod fault_injection;
mod file_digests;
mod file_handles;
mod folders;
mod hosted_part;
mod metrics;
mod opened_daemon;
mod panic_watch;
mod plugin_processes;
mod reexec;
mod shared_building;
mod socket_watch;
mod state_format;
mod supervisor;
mod suspend_watch;

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use acl::content::AbsentAgent;
use acl::{AgentId, DaemonId, EcosystemId};
use agent::{
    AdmissionPolicy, Admissions, AgentSettings, ConfiguredModels, ConfiguredNames, EcosystemFolder,
    Host, HostServices, MessageRouter, Mode, Resources, Rights, Spawner, StateFolder, StopRegistry,
};
use substrate::memory::Network;
use substrate::{OverhearToken, OverheardMessage, SendError, Substrate};
use tokio_util::sync::{CancellationToken, DropGuard};
use tokio_util::task::TaskTracker;

use crate::config::{AgentEntry, Ecosystem};
use crate::plugins;

pub(crate) use address_watch::watch_addresses;
pub(crate) use building::{simulate, update_devices};
pub(crate) use credentials::GuestKeys;
pub(crate) use daemon_launcher::{DaemonLauncher, end_daemons, socket_endpoint};
pub(crate) use daemon_registry::{ClosedEntrance, PresenceGuard};
pub(crate) use dry_run::{DryRun, models, whole_models};
pub(crate) use fault_injection::FaultInjector;
pub(crate) use file_digests::{DaemonSelfReport, FileDigests, ReadText, text_digest, watch_files};
pub(crate) use file_handles::{OPEN_FILES_NEEDED, open_files_limit, warn_of_few_file_handles};
pub(crate) use folders::{
    daemon_sockets, is_for_root, plugins_folder, restrict_umask, running_ecosystems, runtime_base,
    runtime_folder, socket_in, state_base, state_folder,
};
pub(crate) use hosted_part::{HostedPart, host_name};
pub(crate) use opened_daemon::{OpenedDaemon, daemon_transport, open_daemon};
pub(crate) use panic_watch::{note_panic, watch_zenoh_panics};
pub(crate) use plugin_processes::{ITSELF, become_plugin, packages_in};
pub(crate) use reexec::restart_process;
pub(crate) use socket_watch::{SocketWatch, watch_socket};
pub(crate) use state_format::{STATE_FORMAT, check_state, claim_state};
use supervisor::SupervisedAgent;
pub(crate) use suspend_watch::watch_suspension;

/// How long the agents may take to cancel their commitments when the daemon shuts down. An agent
/// that takes longer is ended.
const DRAIN_GRACE: Duration = Duration::from_secs(3);

/// The words in the line that `althing up` prints when the agents that it hosts are present. A
/// process that has started `althing up` waits for this line.
pub(crate) const READY: &str = "is ready";

/// How long a daemon may take until it sees all its own agents: `READY_WITHIN`, and
/// `READY_PER_AGENT` more for each agent, because each agent is notified of all others.
const READY_WITHIN: Duration = Duration::from_secs(10);
const READY_PER_AGENT: Duration = Duration::from_millis(300);

/// The transport of the messages of a node.
#[derive(Clone)]
pub(crate) enum MessageTransport {
    /// A network in memory, for daemons within this process.
    Memory(Network),
    /// A network in memory, on which some messages are lost and some of the others are duplicated.
    Unreliable(Network, Arc<FaultInjector>),
    /// Zenoh, with this configuration.
    Zenoh(Box<substrate_zenoh::Config>),
}

impl MessageTransport {
    /// Whether this transport scouts for other daemons on the networks of this machine.
    pub(crate) fn scouts(&self) -> bool {
        matches!(self, MessageTransport::Zenoh(config) if config.scouts())
    }
}

/// The node of a running daemon or guest in an ecosystem.
pub(crate) struct DaemonNode {
    router: Arc<MessageRouter>,
    substrate: Arc<dyn Substrate>,
    agents: Vec<SupervisedAgent>,
    /// The names of these agents, for the report of the daemon's health.
    names: SharedNames,
    /// The context that all agents of the ecosystem file share when they are built; `None` for a
    /// guest, which hosts no agents of the file.
    host: Option<Arc<Host>>,
    tasks: TaskTracker,
    stopping: CancellationToken,
    /// The transport of this node. It is stored here because a network in memory exists only as
    /// long as a handle to it.
    _wire: MessageTransport,
    /// The endpoints on which the daemon actually listens.
    pub(crate) locators: Vec<String>,
}

/// The names of the agents that a daemon hosts. Clones share the names.
#[derive(Clone, Debug, Default)]
struct SharedNames(Arc<Mutex<BTreeSet<AgentId>>>);

impl SharedNames {
    fn lock(&self) -> MutexGuard<'_, BTreeSet<AgentId>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The reason why a node could not be opened or an agent not be built. The message completes the
/// sentence “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum HostError {
    /// The substrate could not be opened.
    #[error("{0}")]
    Substrate(#[from] substrate_zenoh::OpenError),
    /// The substrate was closed.
    #[error("{0}")]
    Closed(#[from] SendError),
    /// An agent could not be built.
    #[error("{0}")]
    Build(#[from] agent::BuildError),
    /// The entry of an agent names a plugin that is not built in.
    #[error("find plugin `{plugin}` for `{agent}`")]
    UnknownPlugin {
        /// Name of the agent that has the entry.
        agent: AgentId,
        /// Name of the plugin in the entry.
        plugin: String,
    },
    /// A guest was asked to host an agent of an ecosystem file, which guests cannot do.
    #[error("host `{agent}`: a guest hosts no agents")]
    Guest {
        /// Name of the agent that the guest was asked to host.
        agent: AgentId,
    },
    /// Some of the daemon's own agents were not seen in time.
    #[error("see its own agents within {patience:?}: {missing:?} are missing")]
    NotReady {
        /// How long the daemon waited for its agents.
        patience: Duration,
        /// Names of the agents that were not seen.
        missing: Vec<AgentId>,
    },
}

/// The arguments of [`DaemonNode::open`].
pub(crate) struct NodeOptions<'a> {
    /// The ecosystem that the daemon belongs to.
    pub(crate) ecosystem: &'a Ecosystem,
    /// The name of this daemon in the ecosystem.
    pub(crate) daemon: DaemonId,
    /// The entries of the agents that the daemon hosts.
    pub(crate) agents: Vec<AgentEntry>,
    /// The planning mode: centralised or decentralised.
    pub(crate) mode: Mode,
    /// The simulated building, for agents with simulated drivers; `None` if there is none.
    pub(crate) building: Option<::building::BuildingHandle>,
    /// The folder in which agents store what must survive a restart; with `None`, nothing outlives
    /// the process.
    pub(crate) state: Option<std::path::PathBuf>,
}

/// Launches an agent that no ecosystem file names, for as long as the returned guard lives.
pub(crate) fn launch_guest(
    router: &Arc<MessageRouter>,
    id: AgentId,
    agent: impl agent::Agent,
    ontology: &str,
) -> DropGuard {
    let stopping = CancellationToken::new();
    let launch_context = supervisor::launch_context(&id, router, ontology, &stopping, false);
    let task = agent::LaunchableAgent::launch(Box::new(agent), launch_context);
    tokio::spawn(async move {
        if let Ok(Err(error)) = task.await {
            tracing::error!(%id, "failed to {error}");
        }
    });
    stopping.drop_guard()
}

impl DaemonNode {
    /// Opens the substrate and launches the agents. Returns as soon as the daemon sees all of its
    /// agents.
    ///
    /// # Errors
    ///
    /// Returns an error if the substrate does not open, an agent cannot be built, or the agents are
    /// not seen in time. An agent that fails later is restarted.
    pub(crate) async fn open(
        part: NodeOptions<'_>,
        transport: MessageTransport,
    ) -> Result<DaemonNode, HostError> {
        DaemonNode::open_heard(part, transport, |_| Ok(())).await
    }

    /// Opens the substrate and launches the agents as [`DaemonNode::open`] does, and calls `heard`
    /// in between: a listener that is connected there receives also the first messages of the
    /// agents.
    ///
    /// # Errors
    ///
    /// Returns an error if [`DaemonNode::open`] would, or if `heard` does.
    pub(crate) async fn open_heard(
        part: NodeOptions<'_>,
        transport: MessageTransport,
        heard: impl FnOnce(&DaemonNode) -> Result<(), SendError>,
    ) -> Result<DaemonNode, HostError> {
        let NodeOptions { ecosystem, daemon, agents, mode, building, state } = part;
        let (name, settings) = (ecosystem.name.clone(), ecosystem.settings.clone());
        let rights = ecosystem.security.as_ref().map(|_| ecosystem.rights.clone());
        let machine = HostServices::new(state.clone());
        let mut node = DaemonNode::join(machine, name, daemon, settings, rights, transport).await?;
        node.tell_certificate();
        let mut resources = Resources::default();
        building.into_iter().for_each(|building| resources.insert(building));
        let admit = ecosystem.plugins.admit;
        resources.insert(Admissions::new(admit));
        resources.insert(ecosystem.safeguards.clone());
        resources.insert(ecosystem.goals.by_themselves.clone());
        ecosystem.stop_buttons().into_iter().for_each(|buttons| resources.insert(buttons));
        let named = ecosystem.agents.iter().map(|entry| entry.name.to_string());
        resources.insert(ConfiguredNames(named.collect()));
        let uses_models = |entry: &AgentEntry| {
            [domain_maintainer::PLUGIN.name, plan_requester::PLUGIN.name]
                .contains(&entry.plugin.as_str())
        };
        if agents.iter().any(uses_models) {
            resources.insert(ConfiguredModels(models(ecosystem).into_values().collect()));
        }
        resources.insert(EcosystemFolder(ecosystem.folder.clone()));
        let stops = state.as_deref().map(StopRegistry::open).unwrap_or_default();
        resources.insert(stops);
        state.into_iter().for_each(|folder| resources.insert(StateFolder(folder)));
        let host = Arc::new(Host {
            ontology: Arc::clone(&ecosystem.domain),
            map: Arc::clone(&ecosystem.problem),
            mode,
            settings: ecosystem.settings.clone(),
            journals: ecosystem.journals().cloned().collect(),
            resources,
        });
        node.host = Some(host);
        node.expect_agents(ecosystem);
        heard(&node)?;
        // Agents of packages are launched when their package is ready, so a plugin that fails
        // delays no other agent.
        for entry in agents.into_iter().filter(AgentEntry::is_built_in) {
            node.add_agent(entry)?;
        }
        if admit == AdmissionPolicy::Ask {
            node.add_agent(plugins::doorkeeper(node.router.daemon()))?;
        }
        node.await_agents().await?;
        Ok(node)
    }

    /// Joins an ecosystem as a guest, without agents of an ecosystem file, as commands do. If
    /// `rights` is given, messages of other daemons are checked against these rights.
    ///
    /// # Errors
    ///
    /// Returns an error if the substrate does not open.
    pub(crate) async fn join(
        machine: HostServices,
        ecosystem: EcosystemId,
        daemon: DaemonId,
        settings: AgentSettings,
        rights: Option<Rights>,
        transport: MessageTransport,
    ) -> Result<DaemonNode, HostError> {
        let router = MessageRouter::on(machine, ecosystem, daemon.clone(), settings);
        rights.into_iter().for_each(|rights| router.set_rights(rights));
        let (substrate, locators) = connect(&router, daemon, transport.clone()).await?;
        router.connect(Arc::clone(&substrate));
        Ok(DaemonNode {
            router,
            substrate,
            agents: Vec::new(),
            names: SharedNames::default(),
            host: None,
            tasks: TaskTracker::new(),
            stopping: CancellationToken::new(),
            _wire: transport,
            locators,
        })
    }

    /// Lets the daemon report for how long its certificate is valid, if it has one.
    fn tell_certificate(&self) {
        if let Some(security) = self.security() {
            let certificate = security.identity.certificate().clone();
            self.router.tell_certificate(move || certificate.remaining(SystemTime::now()));
        }
    }

    /// Lets the daemon report which agents of the ecosystem file are absent.
    pub(crate) fn expect_agents(&self, ecosystem: &Ecosystem) {
        let expected = ecosystem
            .agents
            .iter()
            .map(|entry| AbsentAgent { agent: entry.name.clone(), daemons: entry.daemons.clone() });
        self.router.expect_agents(expected.collect());
    }

    /// Returns the message router of this daemon.
    pub(crate) fn router(&self) -> &Arc<MessageRouter> {
        &self.router
    }

    /// Passes every message of the ecosystem to `listener`; see
    /// [`Substrate::overhear`].
    ///
    /// # Errors
    ///
    /// Returns an error if the substrate is closed.
    pub(crate) fn overhear(
        &self,
        listener: impl Fn(OverheardMessage) + Send + Sync + 'static,
    ) -> Result<OverhearToken, SendError> {
        self.substrate.overhear(Arc::new(listener))
    }

    /// Returns the context for launching agents that no ecosystem file names; `None` for a guest.
    pub(crate) fn spawner(&self) -> Option<Spawner> {
        Some(Spawner {
            router: Arc::clone(&self.router),
            host: Arc::clone(self.host.as_ref()?),
            stopping: self.stopping.clone(),
            tasks: self.tasks.clone(),
            records_via: true,
        })
    }

    /// Returns the names of the agents of the ecosystem file that this daemon hosts.
    pub(crate) fn agents(&self) -> impl Iterator<Item = &AgentId> {
        self.agents.iter().map(|agent| &agent.id)
    }

    /// Launches one more agent, by its entry.
    ///
    /// # Errors
    ///
    /// Returns an error if the agent cannot be built, or if this node is a guest. An agent that
    /// fails later is restarted.
    pub(crate) fn add_agent(&mut self, entry: AgentEntry) -> Result<(), HostError> {
        let Some(host) = &self.host else {
            return Err(HostError::Guest { agent: entry.name });
        };
        let supervised =
            supervisor::supervise(entry, host, &self.router, &self.stopping, &self.tasks)?;
        self.names.lock().insert(supervised.id.clone());
        self.agents.push(supervised);
        Ok(())
    }

    /// Launches one agent that no ecosystem file names, such as the keyboard of a person. If the
    /// agent fails, it is not restarted.
    pub(crate) fn launch(&self, id: AgentId, agent: impl agent::Agent, ontology: &str) {
        let launch_context =
            supervisor::launch_context(&id, &self.router, ontology, &self.stopping, false);
        let task = agent::LaunchableAgent::launch(Box::new(agent), launch_context);
        self.tasks.spawn(async move {
            if let Ok(Err(error)) = task.await {
                tracing::error!(%id, "failed to {error}");
            }
        });
    }

    /// Ends an agent as if its process were killed: it sends no farewell and is not restarted.
    pub(crate) fn abort_agent(&self, agent: &AgentId) {
        for supervised in self.agents.iter().filter(|supervised| supervised.id == *agent) {
            supervised.aborted.cancel();
        }
    }

    /// Lets the agents in `leaving` cancel their commitments and leave, while all others continue.
    /// An agent that does not finish within [`DRAIN_GRACE`] is aborted.
    pub(crate) async fn stop_agents(&mut self, leaving: &BTreeSet<AgentId>) {
        let is_leaving = |agent: &SupervisedAgent| leaving.contains(&agent.id);
        let (left, presence): (Vec<_>, _) =
            std::mem::take(&mut self.agents).into_iter().partition(is_leaving);
        self.agents = presence;
        self.names.lock().retain(|name| !leaving.contains(name));
        left.iter().for_each(|agent| agent.stopping.cancel());
        let deadline = tokio::time::Instant::now() + DRAIN_GRACE;
        for SupervisedAgent { id, aborted: unplugged, mut supervision, .. } in left {
            // A supervision that panicked has ended as well.
            if tokio::time::timeout_at(deadline, &mut supervision).await.is_err() {
                tracing::warn!(%id, "did not finish in time; it is ended");
                unplugged.cancel();
                let _ = supervision.await;
            }
        }
    }

    /// Waits until the daemon sees all its own agents.
    async fn await_agents(&self) -> Result<(), HostError> {
        let (mut directory, mut changes) = self.router.presence_changes();
        let count = u32::try_from(self.agents.len()).unwrap_or(u32::MAX);
        let patience = READY_WITHIN + READY_PER_AGENT.saturating_mul(count);
        let deadline = tokio::time::Instant::now() + patience;
        let missing = |directory: &agent::Directory| -> Vec<AgentId> {
            let is_missing = |id: &&AgentId| directory.find(id).is_none();
            self.agents().filter(is_missing).cloned().collect()
        };
        while !missing(&directory).is_empty() {
            if tokio::time::timeout_at(deadline, changes.recv()).await.is_err() {
                return Err(HostError::NotReady { patience, missing: missing(&directory) });
            }
            directory = self.router.directory();
        }
        Ok(())
    }

    /// Asks each agent to cancel its commitments, waits for all agents, and closes the substrate.
    ///
    /// Returns `false` if [`DRAIN_GRACE`] ended before all agents had finished; the caller reports
    /// that and exits.
    pub(crate) async fn drain(self) -> bool {
        self.stopping.cancel();
        self.tasks.close();
        let all = tokio::time::timeout(DRAIN_GRACE, self.tasks.wait()).await.is_ok();
        self.substrate.close().await;
        all
    }
}

async fn connect(
    router: &Arc<MessageRouter>,
    daemon: DaemonId,
    transport: MessageTransport,
) -> Result<(Arc<dyn Substrate>, Vec<String>), HostError> {
    let inbound = Arc::<MessageRouter>::clone(router);
    match transport {
        MessageTransport::Memory(network) => Ok((network.open(daemon, inbound), Vec::new())),
        MessageTransport::Unreliable(network, mishaps) => {
            let reliable = network.open(daemon, inbound);
            Ok((fault_injection::make_unreliable(reliable, mishaps), Vec::new()))
        }
        MessageTransport::Zenoh(config) => {
            let substrate = config.open(inbound).await?;
            let locators = substrate.locators();
            Ok((substrate, locators))
        }
    }
}

#[cfg(test)]
mod tests;
