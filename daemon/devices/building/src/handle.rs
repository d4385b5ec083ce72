//! Access of a simulated driver to the building's devices, in this process or in another one.
//!
//! For a building in this process, the handle calls the [`Building`]. For another process, the
//! handle sends requests over a Unix socket to the server in the building's process. The same
//! driver works in both cases. In both cases the driver can see and change only the part of the
//! truth that its device can.

use std::path::Path;

use crate::building::Building;
use crate::client::RemoteBuilding;
use crate::driver_requests::{DriverAnswer, DriverRequest};
use crate::error::DeviceError;
use crate::truth::TemperatureReading;

/// A driver's access to the devices of a building. Clones share one connection.
#[derive(Clone, Debug)]
pub struct BuildingHandle {
    pub(crate) access: BuildingAccess,
}

#[derive(Clone, Debug)]
pub(crate) enum BuildingAccess {
    InProcess(Building),
    Socket(RemoteBuilding),
}

impl Building {
    /// Returns the access for a driver in this process: to the devices, but not to the truth.
    pub fn handle(&self) -> BuildingHandle {
        BuildingHandle { access: BuildingAccess::InProcess(self.clone()) }
    }
}

impl BuildingHandle {
    /// Returns the building if it is in this process; otherwise returns the client of the
    /// building's socket as the error.
    pub(crate) fn local(&self) -> Result<&Building, &RemoteBuilding> {
        match &self.access {
            BuildingAccess::InProcess(building) => Ok(building),
            BuildingAccess::Socket(remote) => Err(remote),
        }
    }

    /// Connects to a building that another process serves at `socket_path`.
    ///
    /// If the connection breaks, the requests under way fail with [`DeviceError::Unreachable`], and
    /// the next use connects again.
    ///
    /// # Errors
    ///
    /// Returns [`DeviceError::Unreachable`] if no server answers at the socket.
    pub async fn connect(socket_path: impl AsRef<Path>) -> Result<BuildingHandle, DeviceError> {
        let remote = RemoteBuilding::connect(socket_path.as_ref()).await?;
        Ok(BuildingHandle { access: BuildingAccess::Socket(remote) })
    }

    /// Returns a handle like [`connect`](BuildingHandle::connect), but connects at its first use.
    /// This is for a driver that may start earlier than the building.
    pub fn at(socket_path: impl AsRef<Path>) -> BuildingHandle {
        BuildingHandle { access: BuildingAccess::Socket(RemoteBuilding::at(socket_path.as_ref())) }
    }

    /// Measures the temperature at the true location of the sensor.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::read_temperature`], and if the server of
    /// the building cannot be reached or refuses the request.
    pub async fn read_temperature(&self, sensor: &str) -> Result<TemperatureReading, DeviceError> {
        match &self.access {
            BuildingAccess::InProcess(building) => building.read_temperature(sensor).await,
            BuildingAccess::Socket(remote) => {
                match remote
                    .ask(DriverRequest::ReadTemperature { sensor: sensor.to_owned() })
                    .await?
                {
                    DriverAnswer::Reading(reading) => Ok(reading),
                    other => Err(other.unexpected()),
                }
            }
        }
    }

    /// Drives a robot to a neighbor of its true location. Dropping the future cancels the trip; see
    /// [`Building::navigate`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::navigate`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn navigate(&self, robot: &str, to: &str) -> Result<(), DeviceError> {
        match &self.access {
            BuildingAccess::InProcess(building) => building.navigate(robot, to).await,
            BuildingAccess::Socket(remote) => {
                let (robot, to) = (robot.to_owned(), to.to_owned());
                match remote.ask(DriverRequest::Navigate { robot, to }).await? {
                    DriverAnswer::Arrived => Ok(()),
                    other => Err(other.unexpected()),
                }
            }
        }
    }

    /// Returns the true location of a device; see [`Building::place_of`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::place_of`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn place_of(&self, device: &str) -> Result<String, DeviceError> {
        match &self.access {
            BuildingAccess::InProcess(building) => building.place_of(device),
            BuildingAccess::Socket(remote) => {
                match remote.ask(DriverRequest::PlaceOf { device: device.to_owned() }).await? {
                    DriverAnswer::Place(place) => Ok(place),
                    other => Err(other.unexpected()),
                }
            }
        }
    }
}
