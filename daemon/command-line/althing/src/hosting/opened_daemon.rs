//! Opens the daemon of a machine: its place in the folder of sockets, its keys, its links, its
//! simulated building and its agents.

use std::path::PathBuf;

use acl::DaemonId;
use serde_json::Value;

use super::credentials::{publish_keys, secure, unpublish_keys, warn_of_expiry};
use super::daemon_registry::{PresenceGuard, register_daemon};
use super::folders::{runtime_folder, socket_in, state_folder};
use super::hosted_part::HostedPart;
use super::plugin_processes::PluginProcesses;
use super::shared_building::{SimulatedBuilding, building_socket, open_building};
use super::{DaemonNode, MessageTransport, NodeOptions};
use crate::config::Ecosystem;

/// Zenoh's retry settings for a lost link to another daemon of this machine: Zenoh tries four times
/// a second as long as the other daemon does not answer. Looking for a socket costs almost nothing,
/// and a daemon that was stopped is reached again as soon as it continues.
const RETRY: &str = "retry_period_init_ms=250;retry_period_max_ms=250";

/// A daemon that is connected to its ecosystem and hosts its agents. The fields are dropped in this
/// order: other daemons must not see that the daemon has left before it has.
pub(crate) struct OpenedDaemon {
    /// The node of the daemon in the ecosystem.
    pub(crate) node: DaemonNode,
    /// The simulated building of the daemon.
    pub(crate) building: SimulatedBuilding,
    /// The presence of the daemon in the folder of sockets.
    pub(crate) presence: PresenceGuard,
    /// Whether the daemon scouts for daemons on other machines.
    pub(crate) scouts: bool,
}

/// Connects this daemon to its ecosystem and launches its agents, those of packages included.
///
/// # Errors
///
/// Returns an error if the daemon cannot be connected, or if an agent cannot be built. The text
/// completes the sentence “failed to …”.
pub(crate) async fn open_daemon(
    ecosystem: &Ecosystem,
    place: &HostedPart,
) -> Result<OpenedDaemon, String> {
    let socket = building_socket(ecosystem, place)?;
    let simulated = open_building(ecosystem, &place.agents, socket.as_ref()).await?;
    let building = simulated.handle.clone();
    let socket = socket.filter(|_| building.is_some());
    let state = state_folder(&ecosystem.name, &place.daemon).map_err(|error| error.to_string())?;
    let (transport, presence) = daemon_transport(ecosystem, &place.daemon).await?;
    let scouts = transport.scouts();
    let part = NodeOptions {
        ecosystem,
        daemon: place.daemon.clone(),
        agents: place.agents.clone(),
        mode: ecosystem.mode,
        building,
        state: Some(state.clone()),
    };
    let node = DaemonNode::open(part, transport).await.map_err(|error| error.to_string())?;
    let processes = PluginProcesses {
        ecosystem,
        agents: &place.agents,
        runtime: runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?,
        state,
        building: socket,
    };
    node.host_processes(processes)?;
    Ok(OpenedDaemon { node, building: simulated, presence, scouts })
}

/// Registers a daemon in the folder of sockets. Returns the Zenoh configuration of the daemon, and
/// its registration. The daemons of one machine find each other by this folder: each connects to
/// those that entered it before.
///
/// # Errors
///
/// Returns an error if a folder or a key cannot be used, or if the name of the daemon is taken. The
/// text completes the sentence “failed to …”.
pub(crate) async fn daemon_transport(
    ecosystem: &Ecosystem,
    daemon: &DaemonId,
) -> Result<(MessageTransport, PresenceGuard), String> {
    let folder = runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?;
    let socket = socket_in(&folder, daemon.as_str()).map_err(|error| error.to_string())?;
    let security = ecosystem.security.as_ref();
    let secured = security.map(|settings| secure(&ecosystem.name, daemon, settings));
    let secured = secured.transpose()?;
    let presence = register_daemon(&folder, daemon).await.map_err(|error| error.to_string())?;
    match security {
        Some(settings) => publish_keys(&socket, &settings.folder)
            .map_err(|error| format!("tell guests where the keys are: {error}"))?,
        None => unpublish_keys(&socket),
    }
    let endpoint = |path: &PathBuf| format!("unixsock-stream/{}", path.display());
    let mut config = substrate_zenoh::Config::new(ecosystem.name.clone(), daemon.clone());
    config.listen = vec![endpoint(&socket)];
    let called = |path: &PathBuf| format!("{}#{RETRY}", endpoint(path));
    config.connect = presence.others.iter().map(called).collect();
    config.zenoh = zenoh_settings(&ecosystem.zenoh);
    if let (Some(secured), Some(settings)) = (&secured, security) {
        let (folder, before) = (settings.folder.clone(), settings.warn_before);
        tokio::spawn(warn_of_expiry(secured.clone(), folder, before));
    }
    config.security = secured;
    Ok((MessageTransport::Zenoh(Box::new(config)), presence))
}

fn zenoh_settings(said: &Value) -> Value {
    match said {
        Value::Object(table) if table.is_empty() => Value::Null,
        other => other.clone(),
    }
}
