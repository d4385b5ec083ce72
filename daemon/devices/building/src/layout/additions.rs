//! Additions to a layout, and the check of each addition.
//!
//! Every part of a layout is added here, one at a time. Each new part is checked against the
//! existing parts; a refused addition leaves the layout unchanged.

use super::{BuildingDevice, Layout, Location, LocationConnection, LocationKind};
use crate::bounds::{CELSIUS_MAX, CELSIUS_MIN, METERS_MAX, NAME_MAX, SPEED_MAX, SPEED_MIN};
use crate::error::{LayoutError, nearest};
use crate::quantity::Quantity;

// === impl Layout: adding ===

impl Layout {
    /// Returns an empty layout, without locations and devices.
    pub fn new() -> Layout {
        Layout::default()
    }

    /// Adds a room with the true temperature `celsius`, in °C.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if the temperature is out of range.
    pub fn add_room(&mut self, name: &str, celsius: f64) -> Result<&mut Layout, LayoutError> {
        let kind = LocationKind::Room;
        self.add_location(Location { name: name.to_owned(), kind, celsius })
    }

    /// Adds a corridor with the true temperature `celsius`, in °C.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if the temperature is out of range.
    pub fn add_corridor(&mut self, name: &str, celsius: f64) -> Result<&mut Layout, LayoutError> {
        let kind = LocationKind::Corridor;
        self.add_location(Location { name: name.to_owned(), kind, celsius })
    }

    /// Connects two locations in both directions. `meters` is the length of the connection.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Layout::add_connection`].
    pub fn connect(&mut self, a: &str, b: &str, meters: f64) -> Result<&mut Layout, LayoutError> {
        let (from, to) = (a.to_owned(), b.to_owned());
        self.add_connection(LocationConnection { from, to, meters, one_way: false })
    }

    /// Connects two locations in one direction, from the first to the second. `meters` is the
    /// length of the connection.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Layout::add_connection`].
    pub fn connect_one_way(
        &mut self,
        from: &str,
        to: &str,
        meters: f64,
    ) -> Result<&mut Layout, LayoutError> {
        let (from, to) = (from.to_owned(), to.to_owned());
        self.add_connection(LocationConnection { from, to, meters, one_way: true })
    }

    /// Adds a temperature sensor that stays in one location.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such location.
    pub fn add_fixed_sensor(
        &mut self,
        name: &str,
        location: &str,
    ) -> Result<&mut Layout, LayoutError> {
        let (name, location) = (name.to_owned(), location.to_owned());
        self.add_device(BuildingDevice::FixedSensor { name, location })
    }

    /// Adds a sensor that stays in one location and measures a quantity other than temperature.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such location.
    pub fn add_sensor(
        &mut self,
        name: &str,
        location: &str,
        quantity: Quantity,
    ) -> Result<&mut Layout, LayoutError> {
        let (name, location) = (name.to_owned(), location.to_owned());
        self.add_device(BuildingDevice::Sensor { name, location, quantity })
    }

    /// Adds a robot with the location `start`.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, if there is no such location, or if the
    /// speed is out of range.
    pub fn add_robot(
        &mut self,
        name: &str,
        start: &str,
        meters_per_second: f64,
    ) -> Result<&mut Layout, LayoutError> {
        let (name, start) = (name.to_owned(), start.to_owned());
        self.add_device(BuildingDevice::Robot { name, start, meters_per_second })
    }

    /// Adds a temperature sensor that a robot carries.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such robot.
    pub fn mount(&mut self, sensor: &str, robot: &str) -> Result<&mut Layout, LayoutError> {
        let (name, carrier) = (sensor.to_owned(), robot.to_owned());
        self.add_device(BuildingDevice::MountedSensor { name, carrier })
    }

    /// Adds a location.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if the temperature is out of range.
    pub fn add_location(&mut self, location: Location) -> Result<&mut Layout, LayoutError> {
        self.check_new_name(&location.name)?;
        check_temperature(&location.name, location.celsius)?;
        self.locations.push(location);
        Ok(self)
    }

    /// Adds a connection.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such location, if both ends are one location or are
    /// connected already, or if the length is out of range.
    pub fn add_connection(
        &mut self,
        connection: LocationConnection,
    ) -> Result<&mut Layout, LayoutError> {
        let LocationConnection { from, to, meters, one_way } = &connection;
        self.check_location(from)?;
        self.check_location(to)?;
        if from == to {
            return Err(LayoutError::ConnectedToItself { location: from.clone() });
        }
        if !(*meters > 0.0 && *meters <= METERS_MAX) {
            let (from, to, meters) = (from.clone(), to.clone(), *meters);
            return Err(LayoutError::BadDistance { from, to, meters });
        }
        let back = if *one_way { None } else { self.meters(to, from) };
        if let Some(meters) = self.meters(from, to).or(back) {
            let (from, to) = (from.clone(), to.clone());
            return Err(LayoutError::ConnectedTwice { from, to, meters });
        }
        self.connections.push(connection);
        Ok(self)
    }

    /// Adds a device of any kind.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, if there is no such location or robot, or
    /// if the speed of a robot or a view of a camera is out of range.
    pub fn add_device(&mut self, device: BuildingDevice) -> Result<&mut Layout, LayoutError> {
        self.check_new_name(device.name())?;
        match &device {
            BuildingDevice::FixedSensor { location, .. }
            | BuildingDevice::Sensor { location, .. } => {
                self.check_location(location)?;
            }
            BuildingDevice::Robot { name, start, meters_per_second } => {
                self.check_location(start)?;
                check_speed(name, *meters_per_second)?;
            }
            BuildingDevice::MountedSensor { carrier, .. }
            | BuildingDevice::MountedScreen { carrier, .. } => {
                self.check_carrier(carrier)?;
            }
            BuildingDevice::Camera { name, location, views } => {
                self.check_location(location)?;
                self.check_views(name, views)?;
            }
            BuildingDevice::Screen { location, .. }
            | BuildingDevice::TagReader { location, .. } => self.check_location(location)?,
            BuildingDevice::Door { a, b, .. } => {
                if self.meters(a, b).or(self.meters(b, a)).is_none() {
                    return Err(LayoutError::NoDoor { a: a.clone(), b: b.clone() });
                }
            }
            BuildingDevice::Arm { name, location, shelves, stored } => {
                self.check_location(location)?;
                self.check_shelves(name, shelves, stored)?;
            }
            BuildingDevice::Lift { name, landings } => {
                landings.iter().try_for_each(|landing| self.check_location(landing))?;
                if landings.len() < 2 {
                    return Err(LayoutError::FewLandings { lift: name.clone() });
                }
            }
        }
        self.devices.push(device);
        Ok(self)
    }

    /// Removes a device and, if it is a robot, the devices that it carries. Returns the names of
    /// all removed devices; empty if there is no device of this name.
    pub(crate) fn remove_device(&mut self, name: &str) -> Vec<String> {
        let leaves =
            |device: &BuildingDevice| device.name() == name || device.carrier() == Some(name);
        let (gone, kept): (Vec<_>, Vec<_>) = self.devices.drain(..).partition(leaves);
        self.devices = kept;
        self.batteries.remove(name);
        gone.iter().map(|device| device.name().to_owned()).collect()
    }
}

// === impl Layout: checking ===

impl Layout {
    pub(crate) fn check_new_name(&self, name: &str) -> Result<(), LayoutError> {
        let mut letters = name.bytes();
        let starts = letters.next().is_some_and(|first| first.is_ascii_lowercase());
        let goes_on =
            letters.all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-' || b == b'_');
        if !starts || !goes_on || name.len() > NAME_MAX {
            return Err(LayoutError::BadName { name: name.to_owned() });
        }
        let place = self.location(name).map(|_| "location");
        let is_stored = |device: &BuildingDevice| matches!(device, BuildingDevice::Arm { stored, .. } if stored.contains_key(name));
        let is_parcel = self.parcels.contains_key(name) || self.devices.iter().any(is_stored);
        let parcel = is_parcel.then_some("parcel");
        match place.or(parcel).or_else(|| self.device(name).map(BuildingDevice::is)) {
            Some(what) => {
                Err(LayoutError::NameTaken { name: name.to_owned(), taken_by: what.to_owned() })
            }
            None => Ok(()),
        }
    }

    pub(crate) fn check_location(&self, name: &str) -> Result<(), LayoutError> {
        if self.location(name).is_some() {
            return Ok(());
        }
        let nearest = self.nearest_location(name);
        Err(LayoutError::UnknownLocation { name: name.to_owned(), nearest })
    }

    pub(crate) fn check_carrier(&self, name: &str) -> Result<(), LayoutError> {
        match self.device(name) {
            Some(BuildingDevice::Robot { .. }) => Ok(()),
            Some(other) => {
                Err(LayoutError::NotARobot { name: name.to_owned(), is: other.is().to_owned() })
            }
            None => {
                let robots =
                    self.devices.iter().filter(|d| matches!(d, BuildingDevice::Robot { .. }));
                let nearest = nearest(name, robots.map(BuildingDevice::name));
                Err(LayoutError::UnknownRobot { name: name.to_owned(), nearest })
            }
        }
    }
}

/// Returns an error if the temperature is out of range or NaN.
pub(crate) fn check_temperature(location: &str, celsius: f64) -> Result<(), LayoutError> {
    if (CELSIUS_MIN..=CELSIUS_MAX).contains(&celsius) {
        return Ok(());
    }
    Err(LayoutError::BadTemperature { location: location.to_owned(), celsius })
}

fn check_speed(robot: &str, meters_per_second: f64) -> Result<(), LayoutError> {
    if (SPEED_MIN..=SPEED_MAX).contains(&meters_per_second) {
        return Ok(());
    }
    Err(LayoutError::BadSpeed { robot: robot.to_owned(), meters_per_second })
}
