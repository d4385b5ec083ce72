//! Access of a simulated driver to the building's devices, in this process or another.
//!
//! In-process it calls the [`Building`]; over a Unix socket it asks the server of the process that has the
//! building. The same driver works with both. With neither can it see or change the truth beyond what its
//! device does.

use std::path::Path;

use crate::building::Building;
use crate::client::Remote;
use crate::error::DeviceError;
use crate::truth::Reading;
use crate::wire::{Answer, Ask};

/// A driver's access to the devices of a building. Clones share the connection.
#[derive(Clone, Debug)]
pub struct BuildingHandle {
    pub(crate) way: Way,
}

#[derive(Clone, Debug)]
pub(crate) enum Way {
    InProcess(Building),
    Socket(Remote),
}

impl BuildingHandle {
    pub(crate) fn in_process(building: Building) -> BuildingHandle {
        BuildingHandle { way: Way::InProcess(building) }
    }

    /// Returns the building if it is in this process; otherwise, as the error, the client of its socket.
    pub(crate) fn near(&self) -> Result<&Building, &Remote> {
        match &self.way {
            Way::InProcess(building) => Ok(building),
            Way::Socket(remote) => Err(remote),
        }
    }

    /// Connects to a building that another process serves at `socket_path`.
    ///
    /// If the connection breaks, the requests under way fail with [`DeviceError::Unreachable`], and the
    /// next use connects again.
    pub async fn connect(socket_path: impl AsRef<Path>) -> Result<BuildingHandle, DeviceError> {
        let remote = Remote::connect(socket_path.as_ref()).await?;
        Ok(BuildingHandle { way: Way::Socket(remote) })
    }

    /// Like [`connect`](BuildingHandle::connect), but connects at the first use: for a driver that may
    /// start before the building does.
    pub fn at(socket_path: impl AsRef<Path>) -> BuildingHandle {
        BuildingHandle { way: Way::Socket(Remote::at(socket_path.as_ref())) }
    }

    /// Measures the temperature at the true location of the sensor.
    pub async fn read_temperature(&self, sensor: &str) -> Result<Reading, DeviceError> {
        match &self.way {
            Way::InProcess(building) => building.read_temperature(sensor).await,
            Way::Socket(remote) => {
                match remote.ask(Ask::ReadTemperature { sensor: sensor.to_owned() }).await? {
                    Answer::Reading(reading) => Ok(reading),
                    other => Err(other.unexpected()),
                }
            }
        }
    }

    /// Drives a robot to a neighbor of its true location. Dropping the future cancels the trip; see
    /// [`Building::navigate`].
    pub async fn navigate(&self, robot: &str, to: &str) -> Result<(), DeviceError> {
        match &self.way {
            Way::InProcess(building) => building.navigate(robot, to).await,
            Way::Socket(remote) => {
                let (robot, to) = (robot.to_owned(), to.to_owned());
                match remote.ask(Ask::Navigate { robot, to }).await? {
                    Answer::Arrived => Ok(()),
                    other => Err(other.unexpected()),
                }
            }
        }
    }

    /// Returns the true location of a device; see [`Building::place_of`].
    pub async fn place_of(&self, device: &str) -> Result<String, DeviceError> {
        match &self.way {
            Way::InProcess(building) => building.place_of(device),
            Way::Socket(remote) => {
                match remote.ask(Ask::PlaceOf { device: device.to_owned() }).await? {
                    Answer::Place(place) => Ok(place),
                    other => Err(other.unexpected()),
                }
            }
        }
    }
}
