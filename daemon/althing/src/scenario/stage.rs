//! The stage of a scenario: a building, and its agents on a wire, in this process or in several.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use ::building::{Building, SeededScenario, Server};
use acl::{AgentId, DaemonId};
use agent::Mode;
use substrate::memory::Network;
use tempfile::TempDir;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};

use super::files;
use crate::config::{self, Ecosystem, Overrides, Variables};
use crate::hosting::{self, Node, Part, Wire};
use crate::plugins;

/// How long a process may take to be ready. Below a fifth of a second on an idle machine.
const READY_WITHIN: Duration = Duration::from_secs(30);

/// Where the agents of a scenario live.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// In this process, on a wire in memory.
    Memory,
    /// In this process, on Zenoh.
    Zenoh,
    /// In one process per machine, on Zenoh.
    Processes,
}

/// A stage that is set: everything on it ends when it is dropped.
pub(crate) struct Set {
    pub(crate) building: Building,
    pub(crate) ecosystem: Ecosystem,
    /// The node in this process: all agents, or the user's keyboard alone.
    pub(crate) node: Node,
    pub(crate) processes: Vec<(String, Child)>,
    _server: Option<Server>,
    _folder: TempDir,
}

/// Sets the stage for a scenario. The error is for a person.
pub(crate) async fn set(
    scenario: &SeededScenario,
    stage: Stage,
    mode: Mode,
    replanning: bool,
) -> Result<Set, String> {
    let folder = tempfile::Builder::new()
        .prefix("althing-")
        .tempdir()
        .map_err(|error| format!("failed to make a folder for the scenario: {error}"))?;
    let socket = (stage == Stage::Processes).then(|| folder.path().join("building.sock"));
    let file = files::write(scenario, folder.path(), socket.as_deref(), replanning)
        .map_err(|error| format!("failed to write the scenario's files: {error}"))?;
    let overrides = Overrides::default().mode(Some(mode));
    // A seed is the same building everywhere, whatever the environment says.
    let ecosystem = Ecosystem::load_with(&file, &Variables::new(), &overrides, &plugins::known())
        .map_err(|error| format!("the scenario's own files are wrong: {error:?}"))?;
    let building = Building::new(scenario.layout.clone(), ecosystem.building.time_scale)
        .map_err(|error| format!("failed to {error}"))?;
    let mut server = None;
    let mut processes = Vec::new();
    if let Some(socket) = &socket {
        let served = ::building::serve(building.handle(), socket).await;
        server = Some(served.map_err(|error| format!("failed to {error}"))?);
        processes = spawn_all(&ecosystem, &file, folder.path(), mode).await?;
    }
    let node = open_node(&ecosystem, &building, stage, mode, folder.path()).await?;
    Ok(Set { building, ecosystem, node, processes, _server: server, _folder: folder })
}

async fn open_node(
    ecosystem: &Ecosystem,
    building: &Building,
    stage: Stage,
    mode: Mode,
    folder: &Path,
) -> Result<Node, String> {
    let name = if stage == Stage::Processes { "spectator" } else { "theater" };
    let daemon = DaemonId::new(name).map_err(|error| error.to_string())?;
    let agents = if stage == Stage::Processes { Vec::new() } else { ecosystem.agents.clone() };
    let wire = match stage {
        Stage::Memory => Wire::Memory(Network::new()),
        Stage::Zenoh => {
            let mut config = substrate_zenoh::Config::new(ecosystem.name.clone(), daemon.clone());
            config.listen = vec![socket_endpoint(folder, name)?];
            Wire::Zenoh(Box::new(config))
        }
        Stage::Processes => {
            let mut config = substrate_zenoh::Config::new(ecosystem.name.clone(), daemon.clone());
            config.mode = substrate_zenoh::Mode::Client;
            let meeting = folder.join(ecosystem.name.as_str());
            config.connect = vec![socket_endpoint(&meeting, files::REASONING)?];
            Wire::Zenoh(Box::new(config))
        }
    };
    let building = Some(building.handle());
    let part = Part { ecosystem, daemon, agents, mode, building, state: None };
    Node::open(part, wire).await.map_err(|error| format!("failed to {error}"))
}

/// The endpoint of a daemon's socket.
fn socket_endpoint(folder: &Path, daemon: &str) -> Result<String, String> {
    let path = hosting::socket_in(folder, daemon).map_err(|error| format!("failed to {error}"))?;
    Ok(format!("unixsock-stream/{}", path.display()))
}

/// Starts one `althing up` per daemon of the ecosystem, and waits until all are ready.
async fn spawn_all(
    ecosystem: &Ecosystem,
    file: &Path,
    folder: &Path,
    mode: Mode,
) -> Result<Vec<(String, Child)>, String> {
    let program = std::env::current_exe()
        .map_err(|error| format!("failed to find this program to start it again: {error}"))?;
    let mut processes = Vec::new();
    for daemon in &ecosystem.daemons {
        let child = spawn(&program, daemon, file, folder, mode)?;
        processes.push((daemon.to_string(), child));
    }
    for (daemon, child) in &mut processes {
        let ready = tokio::time::timeout(READY_WITHIN, until_ready(child)).await;
        ready
            .map_err(|_| format!("daemon `{daemon}` was not ready within {READY_WITHIN:?}"))?
            .map_err(|problem| format!("daemon `{daemon}` {problem}"))?;
    }
    Ok(processes)
}

fn spawn(
    program: &PathBuf,
    daemon: &DaemonId,
    file: &Path,
    folder: &Path,
    mode: Mode,
) -> Result<Child, String> {
    let mode = match mode {
        Mode::Centralized => "centralized",
        Mode::Decentralized => "decentralized",
    };
    let mut command = Command::new(program);
    for setting in config::variables().keys() {
        command.env_remove(setting);
    }
    command
        .arg("up")
        .arg(file)
        .args(["--daemon", daemon.as_str(), "--mode", mode, "--until-stdin-ends"])
        .env("ALTHING_RUNTIME_DIR", folder)
        .env("ALTHING_STATE_DIR", folder.join("state"))
        // Held open as long as we live: however we end, the daemons end too.
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| format!("failed to start daemon `{daemon}`: {error}"))
}

/// Reads until the daemon says that it is ready. What it says later is read and thrown away, so
/// that it never waits for us.
async fn until_ready(child: &mut Child) -> Result<(), String> {
    let stdout = child.stdout.take().ok_or("has no output")?;
    let mut lines = BufReader::new(stdout).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        if line.contains(crate::commands::READY) {
            tokio::spawn(async move { while let Ok(Some(_)) = lines.next_line().await {} });
            return Ok(());
        }
    }
    let status = child.wait().await.map_err(|error| error.to_string())?;
    Err(format!("ended with {status} before it was ready"))
}

impl Set {
    /// Kills what hosts a sensor: the agent in this process, or the process of its machine, by
    /// SIGKILL.
    pub(crate) async fn kill(&mut self, agent: &AgentId) -> Result<(), String> {
        if self.processes.is_empty() {
            self.node.unplug(agent);
            return Ok(());
        }
        let entry = self.ecosystem.agents.iter().find(|entry| entry.name == *agent);
        let daemon = entry.and_then(|entry| entry.daemon.as_ref()).map(ToString::to_string);
        let process = self.processes.iter_mut().find(|(name, _)| Some(name) == daemon.as_ref());
        let (_, child) = process.ok_or_else(|| format!("no process hosts `{agent}`"))?;
        child.kill().await.map_err(|error| format!("failed to kill the process: {error}"))
    }

    /// Ends everything on the stage.
    pub(crate) async fn strike(mut self) {
        self.node.drain().await;
        for (_, child) in &mut self.processes {
            // Ours, by its handle; it may have been killed before.
            let _ = child.start_kill();
            let _ = child.wait().await;
        }
    }
}
