//! Launches a scenario: the building, and the agents in it, in this process or in several.

use std::any::Any;
use std::path::{Path, PathBuf};

use ::building::{Building, Server};
use acl::{AgentId, DaemonId, Message};
use agent::Mode;
use bytes::Bytes;
use substrate::BoxFuture;
use substrate::memory::Network;
use substrate_zenoh::OpenError;
use tempfile::TempDir;
use tokio::process::Child;
use tokio::sync::mpsc;

use super::recorded::{ScenarioTap, TapLink};
use super::setting::{REASONING, Setting};
use crate::config::{AgentEntry, Ecosystem, Overrides, Variables};
use crate::hosting::{self, DaemonLauncher, DaemonNode, MessageTransport, NodeOptions};
use crate::plugins;

/// The place where the agents of a scenario run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScenarioSubstrate {
    /// The agents run in this process, on a network in memory.
    Memory,
    /// The agents run in this process, on Zenoh.
    Zenoh,
    /// The agents run in several processes, one per machine of the scenario, on Zenoh.
    Processes,
}

/// A function that puts other devices in the place of simulated ones: it changes the drivers in the
/// ecosystem, and returns the devices, which live as long as the scenario.
pub(crate) type DeviceReplacement =
    fn(Building, Ecosystem) -> BoxFuture<(Ecosystem, Box<dyn Any + Send>)>;

/// A scenario with its launched agents. Dropping this value ends all of them.
pub(crate) struct LaunchedScenario {
    pub(crate) building: Building,
    pub(crate) ecosystem: Ecosystem,
    /// The node in this process. It hosts all agents or, if the agents run in several processes,
    /// only the user's keyboard.
    pub(crate) node: DaemonNode,
    pub(crate) processes: Vec<(String, Child)>,
    /// Starts the processes of the scenario's daemons.
    program: ScenarioDaemons,
    transport: MessageTransport,
    /// The connection of the listener that records the messages, if there is one.
    recording: Option<TapLink>,
    _server: Option<Server>,
    _devices: Option<Box<dyn Any + Send>>,
    _folder: TempDir,
}

/// A receiver of all messages on the network. It stops receiving when this value is dropped.
pub(crate) struct MessageListener {
    pub(crate) heard: mpsc::Receiver<Message>,
    _tap: Option<substrate_zenoh::Tap>,
}

/// Maximum number of messages that wait to be read from a [`MessageListener`]; further ones are
/// lost. A small building sends fewer in a minute.
const HEARD_MAX: usize = 16_384;

/// Launches the building and the agents of a scenario. The error is a message for the user.
pub(crate) async fn launch_scenario(
    setting: &Setting,
    stage: ScenarioSubstrate,
    mode: Mode,
    replacement: Option<DeviceReplacement>,
    listener: Option<&ScenarioTap>,
) -> Result<LaunchedScenario, String> {
    let folder = tempfile::Builder::new()
        .prefix("althing-")
        .tempdir()
        .map_err(|error| format!("failed to make a folder for the scenario: {error}"))?;
    let socket =
        (stage == ScenarioSubstrate::Processes).then(|| folder.path().join("building.sock"));
    let file = setting
        .write(folder.path(), socket.as_deref())
        .map_err(|error| format!("failed to write the scenario's files: {error}"))?;
    let overrides = Overrides::default().mode(Some(mode));
    // The environment is ignored, so that a seed yields the same building everywhere.
    let ecosystem = Ecosystem::load_with(&file, &Variables::new(), &overrides, &plugins::known())
        .map_err(|error| format!("the scenario's own files are wrong: {error:?}"))?;
    let building = Building::new(setting.at_first.clone(), ecosystem.building.time_scale)
        .map_err(|error| format!("failed to {error}"))?;
    let (ecosystem, devices) = match replacement {
        Some(replace) => {
            let (ecosystem, devices) = replace(building.clone(), ecosystem).await;
            (ecosystem, Some(devices))
        }
        None => (ecosystem, None),
    };
    let launcher = DaemonLauncher::new(folder.path(), mode)?;
    let program = ScenarioDaemons { launcher, file };
    let at_first: Vec<AgentEntry> = { ecosystem.agents.iter() }
        .filter(|entry| !setting.comes_later(entry.name.as_str()))
        .cloned()
        .collect();
    let mut server = None;
    let (mut processes, mut recording) = (Vec::new(), None);
    let transport = transport(&ecosystem, stage, folder.path())?;
    if let Some(socket) = &socket {
        let served = ::building::serve(building.handle(), socket).await;
        server = Some(served.map_err(|error| format!("failed to {error}"))?);
        let listening =
            listener.map(|listener| listener.listen_at(&ecosystem.name, endpoint(&transport)));
        let daemons = daemons(&ecosystem, &at_first);
        (processes, recording) = program.spawn_heard(daemons, listening).await?;
    }
    let part = (at_first, transport.clone());
    let early = listener.filter(|_| stage != ScenarioSubstrate::Processes);
    let (node, tapped) = open_node(&ecosystem, &building, stage, mode, part, early).await?;
    recording = recording.or(tapped);
    Ok(LaunchedScenario {
        building,
        ecosystem,
        node,
        processes,
        program,
        transport,
        recording,
        _server: server,
        _devices: devices,
        _folder: folder,
    })
}

/// Returns the daemons that run from the start: all except those that host only agents that are
/// launched later.
fn daemons(ecosystem: &Ecosystem, at_first: &[AgentEntry]) -> Vec<DaemonId> {
    let hosts = |entries: &[AgentEntry], daemon: &DaemonId| {
        entries.iter().any(|entry| entry.daemons.contains(daemon))
    };
    let is_there =
        |daemon: &&DaemonId| hosts(at_first, daemon) || !hosts(&ecosystem.agents, daemon);
    ecosystem.daemons.iter().filter(is_there).cloned().collect()
}

/// Returns the transport that the node in this process uses.
fn transport(
    ecosystem: &Ecosystem,
    stage: ScenarioSubstrate,
    folder: &Path,
) -> Result<MessageTransport, String> {
    let daemon = node_name(stage)?;
    let mut config = substrate_zenoh::Config::new(ecosystem.name.clone(), daemon.clone());
    match stage {
        ScenarioSubstrate::Memory => return Ok(MessageTransport::Memory(Network::new())),
        ScenarioSubstrate::Zenoh => {
            config.listen = vec![hosting::socket_endpoint(folder, daemon.as_str())?]
        }
        ScenarioSubstrate::Processes => {
            config.mode = substrate_zenoh::SessionMode::Client;
            let meeting = folder.join(ecosystem.name.as_str());
            config.connect = vec![hosting::socket_endpoint(&meeting, REASONING)?];
        }
    }
    Ok(MessageTransport::Zenoh(Box::new(config)))
}

fn node_name(stage: ScenarioSubstrate) -> Result<DaemonId, String> {
    let name = if stage == ScenarioSubstrate::Processes { "spectator" } else { "theater" };
    DaemonId::new(name).map_err(|error| error.to_string())
}

async fn open_node(
    ecosystem: &Ecosystem,
    building: &Building,
    stage: ScenarioSubstrate,
    mode: Mode,
    (agents, transport): (Vec<AgentEntry>, MessageTransport),
    listener: Option<&ScenarioTap>,
) -> Result<(DaemonNode, Option<TapLink>), String> {
    let agents = if stage == ScenarioSubstrate::Processes { Vec::new() } else { agents };
    let (daemon, building) = (node_name(stage)?, Some(building.handle()));
    let part = NodeOptions { ecosystem, daemon, agents, mode, building, state: None };
    let mut tapped = None;
    let node = DaemonNode::open_heard(part, transport, |node| {
        tapped = listener.map(|listener| listener.listen_here(node)).transpose()?;
        Ok(())
    });
    let node = node.await.map_err(|error| format!("failed to {error}"))?;
    Ok((node, tapped))
}

/// Returns the endpoint of a daemon of the scenario; `None` for a network in memory.
fn endpoint(transport: &MessageTransport) -> Option<String> {
    match transport {
        MessageTransport::Memory(_) | MessageTransport::Unreliable(..) => None,
        MessageTransport::Zenoh(config) => {
            config.listen.first().or(config.connect.first()).cloned()
        }
    }
}

/// Starts the daemons of a scenario, which have one ecosystem file.
struct ScenarioDaemons {
    launcher: DaemonLauncher,
    file: PathBuf,
}

impl ScenarioDaemons {
    /// Starts one process per daemon, and waits until all are ready.
    async fn spawn_all(&self, daemons: &[DaemonId]) -> Result<Vec<(String, Child)>, String> {
        self.launcher.spawn_all(daemons.iter().map(|daemon| (daemon, self.file.as_path()))).await
    }

    /// Starts daemons as [`ScenarioDaemons::spawn_all`] does. If `listening` is given, the daemon of
    /// the reasoning agents starts first, and `listening` connects a listener through it before the
    /// others start.
    async fn spawn_heard(
        &self,
        daemons: Vec<DaemonId>,
        listening: Option<impl Future<Output = Result<TapLink, OpenError>>>,
    ) -> Result<(Vec<(String, Child)>, Option<TapLink>), String> {
        let Some(listening) = listening else { return Ok((self.spawn_all(&daemons).await?, None)) };
        let is_first = |daemon: &DaemonId| daemon.as_str() == REASONING;
        let (first, others): (Vec<_>, Vec<_>) = daemons.into_iter().partition(is_first);
        let mut processes = self.spawn_all(&first).await?;
        let tapped = listening.await.map_err(|error| format!("failed to {error}"))?;
        processes.extend(self.spawn_all(&others).await?);
        Ok((processes, Some(tapped)))
    }
}

impl LaunchedScenario {
    /// Kills an agent. If the agents run in several processes, kills the process of the agent's
    /// machine by SIGKILL.
    pub(crate) async fn kill(&mut self, agent: &AgentId) -> Result<(), String> {
        if self.processes.is_empty() {
            self.node.abort_agent(agent);
            return Ok(());
        }
        let daemon = self.entry(agent)?.daemons.first().map(ToString::to_string);
        let process = self.processes.iter_mut().find(|(name, _)| Some(name) == daemon.as_ref());
        let (_, child) = process.ok_or_else(|| format!("no process hosts `{agent}`"))?;
        child.kill().await.map_err(|error| format!("failed to kill the process: {error}"))
    }

    /// Launches an agent that was not there from the start. If the agents run in several processes,
    /// starts the process of the agent's machine.
    pub(crate) async fn plug_in(&mut self, agent: &AgentId) -> Result<(), String> {
        let entry = self.entry(agent)?.clone();
        if self.processes.is_empty() {
            return self.node.add_agent(entry).map_err(|error| format!("failed to {error}"));
        }
        let is_there =
            |daemon: &DaemonId| self.processes.iter().any(|(name, _)| name == daemon.as_str());
        match entry.daemons.into_iter().find(|daemon| !is_there(daemon)) {
            Some(daemon) => self.processes.extend(self.program.spawn_all(&[daemon]).await?),
            None => return Err(format!("`{agent}` needs a machine that is not there yet")),
        }
        Ok(())
    }

    fn entry(&self, agent: &AgentId) -> Result<&AgentEntry, String> {
        let entry = self.ecosystem.agents.iter().find(|entry| entry.name == *agent);
        entry.ok_or_else(|| format!("the scenario has no `{agent}`"))
    }

    /// Subscribes to all messages on the network, as a tool outside the ecosystem could do.
    pub(crate) async fn listen(&self) -> Result<MessageListener, String> {
        let (tell, heard) = mpsc::channel(HEARD_MAX);
        // Messages that are not read in time are lost, as for any foreign tool.
        let hear = move |payload: &Bytes| {
            if let Ok(message) = acl::decode(payload) {
                let _ = tell.try_send(message);
            }
        };
        if let MessageTransport::Memory(network) | MessageTransport::Unreliable(network, _) =
            &self.transport
        {
            network.tap(move |_, payload| hear(payload));
            return Ok(MessageListener { heard, _tap: None });
        }
        let name = DaemonId::new("stranger").map_err(|error| error.to_string())?;
        let mut config = substrate_zenoh::Config::new(self.ecosystem.name.clone(), name);
        config.mode = substrate_zenoh::SessionMode::Client;
        config.connect.extend(endpoint(&self.transport));
        let tap = substrate_zenoh::tap(config, move |_, message| hear(&message.payload)).await;
        let tap = tap.map_err(|error| format!("failed to {error}"))?;
        Ok(MessageListener { heard, _tap: Some(tap) })
    }

    /// Ends all agents and processes of the scenario.
    pub(crate) async fn shut_down(mut self) {
        self.node.drain().await;
        hosting::end_daemons(&mut self.processes).await;
        if let Some(recording) = self.recording.take() {
            recording.close().await;
        }
    }
}
