//! What a simulated driver holds: the building's devices, near or far.
//!
//! In-process it calls the [`Building`]; over a Unix socket it asks the server
//! of the process that holds the building. The same driver works with both, and
//! with neither can it see or change the truth beyond what its device does.

use std::path::Path;

use crate::building::Building;
use crate::client::Remote;
use crate::error::DeviceError;
use crate::truth::Reading;
use crate::wire::{Answer, Ask};

/// A driver's hold on the devices of a building. Clones share the connection.
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

    /// The building in this process, or else the way to it.
    pub(crate) fn near(&self) -> Result<&Building, &Remote> {
        match &self.way {
            Way::InProcess(building) => Ok(building),
            Way::Socket(remote) => Err(remote),
        }
    }

    /// Connects to a building that another process serves at `socket_path`.
    ///
    /// Should the connection break, what is under way fails as
    /// [`DeviceError::Unreachable`], and the next use connects again.
    pub async fn connect(socket_path: impl AsRef<Path>) -> Result<BuildingHandle, DeviceError> {
        let remote = Remote::connect(socket_path.as_ref()).await?;
        Ok(BuildingHandle { way: Way::Socket(remote) })
    }

    /// As [`connect`](BuildingHandle::connect), but only at the first use: for a
    /// driver that may be there before the building is.
    pub fn at(socket_path: impl AsRef<Path>) -> BuildingHandle {
        BuildingHandle { way: Way::Socket(Remote::at(socket_path.as_ref())) }
    }

    /// Measures the temperature where the sensor truly is.
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

    /// Drives a robot to a location next to where it truly is. Dropping the
    /// future calls the trip off; see [`Building::navigate`].
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

    /// Where a device truly is: robots localize themselves, sensors are labeled.
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
