//! The simulated building outlives the daemon that serves it: another daemon that uses it serves it
//! on, with its robots where they were seen last.
//!
//! Temperatures, locked doors and who is where are those of the ecosystem file again: only the process
//! that is gone knew them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use ::building::{Building, BuildingHandle, DeviceError, ServeError, Server};
use serde_json::{Value, json};
use tokio::task::AbortHandle;
use tokio::time::sleep;

use super::building::simulate;
use crate::config::Ecosystem;

/// How often a daemon looks whether the building is served.
const PERIOD: Duration = Duration::from_secs(1);

/// What is kept of the robots: as much as a robot's entry says of its start.
const ROBOTS: [&str; 3] = ["turtlebot", "cleaning-robot", "video-robot"];

/// A daemon's readiness to serve the building on. It ends when this is dropped, and with it what it
/// serves.
#[must_use]
#[derive(Debug)]
pub(crate) struct Succession(AbortHandle);

impl Drop for Succession {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Where a robot was seen last, and for how many meters it was charged.
#[derive(Debug)]
pub(super) struct Seen {
    place: String,
    charge: Option<f64>,
}

/// Watches a building that another process serves at this socket, and serves it on when nobody does.
pub(crate) fn succeed(
    ecosystem: Ecosystem,
    socket: PathBuf,
    building: BuildingHandle,
) -> Succession {
    let watch = tokio::spawn(async move {
        let mut seen = BTreeMap::new();
        let mut told = None;
        loop {
            sleep(PERIOD).await;
            if look(&ecosystem, &building, &mut seen).await {
                continue;
            }
            match serve(&ecosystem, &seen, &socket).await {
                Ok(Some(_served)) => {
                    tracing::warn!(
                        "the daemon that served the simulated building is gone: this one serves it now, \
                         with its robots where they were seen last, and all else as the ecosystem \
                         file says"
                    );
                    std::future::pending().await
                }
                // Another daemon was faster, or the one that serves it stands still.
                Ok(None) => (),
                Err(problem) if told.as_ref() != Some(&problem) => {
                    tracing::warn!(problem, "cannot serve the simulated building on");
                    told = Some(problem);
                }
                Err(_) => (),
            }
        }
    });
    Succession(watch.abort_handle())
}

/// Notes where the robots are; whether the building is served.
pub(super) async fn look(
    ecosystem: &Ecosystem,
    building: &BuildingHandle,
    seen: &mut BTreeMap<String, Seen>,
) -> bool {
    let is_gone = |error: &DeviceError| matches!(error, DeviceError::Unreachable { .. });
    let robots = ecosystem.agents.iter().filter(|entry| ROBOTS.contains(&entry.plugin.as_str()));
    for entry in robots {
        let robot = entry.name.as_str();
        match building.place_of(robot).await {
            Ok(place) => {
                let charge = building.charge_of(robot).await.ok().flatten();
                seen.insert(robot.to_owned(), Seen { place, charge });
            }
            Err(error) if is_gone(&error) => return false,
            Err(_) => (),
        }
    }
    // Without a robot, a device that is not there is asked for.
    !matches!(building.place_of("").await, Err(error) if is_gone(&error))
}

/// The building and its server; nothing where it is served already.
pub(super) async fn serve(
    ecosystem: &Ecosystem,
    seen: &BTreeMap<String, Seen>,
    socket: &Path,
) -> Result<Option<(Building, Server)>, String> {
    let mut ecosystem = ecosystem.clone();
    for entry in &mut ecosystem.agents {
        let Some(Seen { place, charge }) = seen.get(entry.name.as_str()) else { continue };
        let Value::Object(config) = Arc::make_mut(&mut entry.config) else { continue };
        config.insert("start".to_owned(), json!(place));
        if let (Some(Value::Object(battery)), Some(charge)) = (config.get_mut("battery"), charge) {
            battery.insert("charge".to_owned(), json!(charge));
        }
    }
    let building = simulate(&ecosystem).map_err(|error| error.to_string())?;
    match ::building::serve(building.handle(), socket).await {
        Ok(server) => Ok(Some((building, server))),
        Err(ServeError::InUse { .. }) => Ok(None),
        Err(error) => Err(error.to_string()),
    }
}
