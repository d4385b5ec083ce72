//! Take-over of the simulated building. When the daemon that serves the building is gone, another
//! daemon that uses the building serves it instead. Robots are placed where they were last seen.
//!
//! Temperatures, locked doors and the places of people are reset to those of the ecosystem file,
//! because only the process that is gone had the current ones.

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

/// How often a daemon checks whether the building is still served.
const PERIOD: Duration = Duration::from_secs(1);

/// The plugins of robots. A take-over preserves the place and the charge of a robot, because a
/// robot's entry can set both.
const ROBOTS: [&str; 3] = ["turtlebot", "cleaning-robot", "video-robot"];

/// A task that takes over the building when no process serves it. Dropping this value ends the task
/// and, after a take-over, the server.
#[must_use]
#[derive(Debug)]
pub(crate) struct BuildingTakeover(AbortHandle);

impl Drop for BuildingTakeover {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// The place where a robot was last seen, and its charge at that time: the distance in meters that
/// it could still drive.
#[derive(Debug)]
pub(super) struct RobotState {
    place: String,
    charge: Option<f64>,
}

/// Watches a building that another process serves at the socket `socket`. When no process serves it
/// any more, serves it from this process.
pub(crate) fn watch_building(
    ecosystem: Ecosystem,
    socket: PathBuf,
    building: BuildingHandle,
) -> BuildingTakeover {
    let watch = tokio::spawn(async move {
        let mut seen = BTreeMap::new();
        let mut told = None;
        loop {
            sleep(PERIOD).await;
            if record_robots(&ecosystem, &building, &mut seen).await {
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
                // Another daemon was faster, or the process that serves the building is suspended.
                Ok(None) => (),
                Err(problem) if told.as_ref() != Some(&problem) => {
                    tracing::warn!(problem, "failed to take over the simulated building");
                    told = Some(problem);
                }
                Err(_) => (),
            }
        }
    });
    BuildingTakeover(watch.abort_handle())
}

/// Records in `seen` where the robots are, and their charges. Returns `false` if no process serves
/// the building.
pub(super) async fn record_robots(
    ecosystem: &Ecosystem,
    building: &BuildingHandle,
    seen: &mut BTreeMap<String, RobotState>,
) -> bool {
    let is_gone = |error: &DeviceError| matches!(error, DeviceError::Unreachable { .. });
    let robots = ecosystem.agents.iter().filter(|entry| ROBOTS.contains(&entry.plugin.as_str()));
    for entry in robots {
        let robot = entry.name.as_str();
        match building.place_of(robot).await {
            Ok(place) => {
                let charge = building.charge_of(robot).await.ok().flatten();
                seen.insert(robot.to_owned(), RobotState { place, charge });
            }
            Err(error) if is_gone(&error) => return false,
            Err(_) => (),
        }
    }
    // If there is no robot, the query for a device that does not exist shows whether the building
    // answers.
    !matches!(building.place_of("").await, Err(error) if is_gone(&error))
}

/// Creates the building with the robots where they were last seen, and a server for it; `None` if
/// another process serves the building already.
pub(super) async fn serve(
    ecosystem: &Ecosystem,
    seen: &BTreeMap<String, RobotState>,
    socket: &Path,
) -> Result<Option<(Building, Server)>, String> {
    let mut ecosystem = ecosystem.clone();
    for entry in &mut ecosystem.agents {
        let Some(RobotState { place, charge }) = seen.get(entry.name.as_str()) else { continue };
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
