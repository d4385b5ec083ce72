//! The simulated building of a daemon, which several processes may share by a socket.

use std::path::{Path, PathBuf};

use ::building::{Building, BuildingHandle, ServeError, Server};

use super::building_takeover::{self, BuildingTakeover};
use super::hosted_part::HostedPart;
use super::{building, folders};
use crate::config::{AgentEntry, Ecosystem};
use crate::plugins;

/// Returns the socket by which several processes share the simulated building: the one that the
/// ecosystem file names or, if this daemon hosts agents of packages, one in the runtime folder.
pub(super) fn building_socket(
    ecosystem: &Ecosystem,
    place: &HostedPart,
) -> Result<Option<PathBuf>, String> {
    if ecosystem.building.socket.is_some() {
        return Ok(ecosystem.building.socket.clone());
    }
    let is_shared = place.agents.iter().any(|entry| !entry.is_built_in());
    let folder = folders::runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?;
    Ok(is_shared.then(|| folder.join(format!("{}.building", place.daemon))))
}

/// The simulated building as this daemon uses it. All fields are `None` if there is none.
#[derive(Default)]
pub(crate) struct SimulatedBuilding {
    /// The handle that simulated drivers use.
    pub(super) handle: Option<BuildingHandle>,
    /// The building itself; `None` if another process simulates it.
    pub(crate) own: Option<Building>,
    /// The server by which other processes use the building, as long as this daemon runs.
    _server: Option<Server>,
    /// The task that takes over the building when the process that serves it is gone.
    _takeover: Option<BuildingTakeover>,
}

impl SimulatedBuilding {
    fn ours(building: Building, server: Option<Server>) -> SimulatedBuilding {
        let handle = Some(building.handle());
        SimulatedBuilding { handle, own: Some(building), _server: server, _takeover: None }
    }

    /// Returns the simulated building of another process as this daemon uses it. This daemon takes
    /// the building over when that process is gone.
    fn theirs(ecosystem: &Ecosystem, socket: &Path, building: BuildingHandle) -> SimulatedBuilding {
        let takeover = building_takeover::watch_building(
            ecosystem.clone(),
            socket.to_owned(),
            building.clone(),
        );
        SimulatedBuilding {
            handle: Some(building),
            _takeover: Some(takeover),
            ..SimulatedBuilding::default()
        }
    }
}

/// Opens the simulated building in which the simulated drivers of `agents` act: the one that
/// another process serves at `socket`, or else a new one, which is served there. Opens none if no
/// driver is simulated.
///
/// # Errors
///
/// Returns an error, as text for a person, if the building cannot be simulated or served.
pub(super) async fn open_building(
    ecosystem: &Ecosystem,
    agents: &[AgentEntry],
    socket: Option<&PathBuf>,
) -> Result<SimulatedBuilding, String> {
    let has_drivers = |entry: &AgentEntry| {
        plugins::find(&entry.plugin).is_some_and(|plugin| !plugin.drivers.is_empty())
    };
    if !agents.iter().any(has_drivers) {
        return Ok(SimulatedBuilding::default());
    }
    if let Some(socket) = socket
        && let Ok(building) = BuildingHandle::connect(socket).await
    {
        return Ok(SimulatedBuilding::theirs(ecosystem, socket, building));
    }
    let building = building::simulate(ecosystem).map_err(|error| error.to_string())?;
    let Some(socket) = socket else {
        return Ok(SimulatedBuilding::ours(building, None));
    };
    match ::building::serve(building.handle(), socket).await {
        Ok(server) => Ok(SimulatedBuilding::ours(building, Some(server))),
        // Another daemon that started at the same time was faster.
        Err(ServeError::InUse { .. }) => {
            let theirs = BuildingHandle::connect(socket).await;
            let theirs = theirs.map_err(|error| error.to_string())?;
            Ok(SimulatedBuilding::theirs(ecosystem, socket, theirs))
        }
        Err(error) => Err(error.to_string()),
    }
}
