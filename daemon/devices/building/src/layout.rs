//! The plan of a building: locations, the doors between them, the devices in it.
//!
//! A [`Layout`] is plain data that can be read from and written to JSON or TOML. Every way to
//! create a layout makes the same checks, so that every layout is valid: names are unique PDDL
//! names, every reference has a target, every number is within its bounds.
//! [`Building`](crate::Building) implements what happens in the building.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::error::{LayoutError, nearest};
use crate::quantity::Quantity;

mod additions;

pub(crate) use additions::check_temperature;

/// The kind of a location, as a type of the shared ontology.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LocationKind {
    /// A room: a place with a temperature of interest.
    Room,
    /// A corridor: a place that robots pass through.
    Corridor,
}

/// A place where robots can be, with a temperature.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Location {
    /// Name of the location, unique among locations and devices.
    pub name: String,
    /// Whether the location is a room or a corridor.
    pub kind: LocationKind,
    /// True temperature of the location at the start, in °C.
    pub celsius: f64,
}

/// A connection from one location to another.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct LocationConnection {
    /// Name of the location at one end; the start if the connection is one-way.
    pub from: String,
    /// Name of the location at the other end.
    pub to: String,
    /// Length of the connection, in meters.
    pub meters: f64,
    /// Whether robots can go only from `from` to `to`, and not back.
    #[serde(default)]
    pub one_way: bool,
}

/// The direction of a place, seen from a camera.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct PlaceDirection {
    /// Name of the place that lies in this direction.
    pub location: String,
    /// Pan angle of the place, in degrees to the right; negative to the left.
    pub pan: f64,
    /// Tilt angle of the place, in degrees up; negative down.
    pub tilt: f64,
}

/// A robot's battery.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RobotBattery {
    /// Name of the location where the robot can recharge.
    pub dock: String,
    /// Range of a full battery, in meters.
    pub range: f64,
    /// Remaining range of the battery at the start, in meters.
    pub charge: f64,
    /// Time to recharge an empty battery, in seconds of the building's time.
    pub recharge_time: f64,
}

/// A thing in the building that a driver can use.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub enum BuildingDevice {
    /// A temperature sensor on a wall.
    FixedSensor {
        /// Name of the sensor.
        name: String,
        /// Name of the location that the sensor measures.
        location: String,
    },
    /// A sensor that stays in one location and measures a quantity other than temperature.
    Sensor {
        /// Name of the sensor.
        name: String,
        /// Name of the location of the sensor.
        location: String,
        /// The quantity that the sensor measures.
        quantity: Quantity,
    },
    /// A robot: a mobile base that can carry other devices.
    Robot {
        /// Name of the robot.
        name: String,
        /// Name of the location where the robot stands at the start.
        start: String,
        /// Speed of the robot, in meters per second.
        meters_per_second: f64,
    },
    /// A temperature sensor that measures at the location of its carrier.
    MountedSensor {
        /// Name of the sensor.
        name: String,
        /// Name of the robot that carries the sensor.
        carrier: String,
    },
    /// A camera that turns.
    Camera {
        /// Name of the camera.
        name: String,
        /// Name of the location where the camera hangs.
        location: String,
        /// Directions of the places that the camera can see.
        #[serde(default)]
        views: Vec<PlaceDirection>,
    },
    /// A screen on a wall.
    Screen {
        /// Name of the screen.
        name: String,
        /// Name of the location where the screen hangs.
        location: String,
    },
    /// A screen on a robot; the screen is always at the location of the robot.
    MountedScreen {
        /// Name of the screen.
        name: String,
        /// Name of the robot that carries the screen.
        carrier: String,
    },
    /// A door that a motor opens and closes; closed at the start.
    Door {
        /// Name of the door.
        name: String,
        /// Name of the location on one side of the door.
        a: String,
        /// Name of the location on the other side of the door.
        b: String,
    },
    /// A lift, with its cabin at the first landing at the start.
    Lift {
        /// Name of the lift.
        name: String,
        /// Names of the locations where the cabin stops.
        landings: Vec<String>,
    },
    /// A robot arm with shelves within its reach.
    Arm {
        /// Name of the arm.
        name: String,
        /// Name of the location where the arm stands.
        location: String,
        /// Names of its shelves.
        shelves: Vec<String>,
        /// The shelf of each parcel that lies on one at the start, by the parcel's name.
        #[serde(default)]
        stored: BTreeMap<String, String>,
    },
    /// A reader of the tags of parcels, which tells where all parcels are.
    TagReader {
        /// Name of the reader.
        name: String,
        /// Name of the location of the reader.
        location: String,
    },
}

impl BuildingDevice {
    /// Returns the name of the device.
    pub fn name(&self) -> &str {
        match self {
            BuildingDevice::FixedSensor { name, .. }
            | BuildingDevice::Sensor { name, .. }
            | BuildingDevice::Robot { name, .. }
            | BuildingDevice::MountedSensor { name, .. }
            | BuildingDevice::Camera { name, .. }
            | BuildingDevice::Screen { name, .. }
            | BuildingDevice::MountedScreen { name, .. }
            | BuildingDevice::Door { name, .. }
            | BuildingDevice::Lift { name, .. }
            | BuildingDevice::Arm { name, .. }
            | BuildingDevice::TagReader { name, .. } => name,
        }
    }

    /// Returns the kind of the device, in words for an error message.
    pub(crate) fn is(&self) -> &'static str {
        match self {
            BuildingDevice::FixedSensor { .. } => "fixed sensor",
            BuildingDevice::Sensor { .. } => "sensor",
            BuildingDevice::Robot { .. } => "robot",
            BuildingDevice::MountedSensor { .. } => "mounted sensor",
            BuildingDevice::Camera { .. } => "camera",
            BuildingDevice::Screen { .. } => "screen",
            BuildingDevice::MountedScreen { .. } => "mounted screen",
            BuildingDevice::Door { .. } => "door",
            BuildingDevice::Lift { .. } => "lift",
            BuildingDevice::Arm { .. } => "arm",
            BuildingDevice::TagReader { .. } => "tag reader",
        }
    }

    /// Returns the robot that carries the device; `None` for a device that is not mounted.
    pub(crate) fn carrier(&self) -> Option<&str> {
        match self {
            BuildingDevice::MountedSensor { carrier, .. }
            | BuildingDevice::MountedScreen { carrier, .. } => Some(carrier),
            _ => None,
        }
    }
}

/// The plan of a building. Every layout is valid; the description of this module lists the checks.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(try_from = "RawLayout", into = "RawLayout")]
pub struct Layout {
    locations: Vec<Location>,
    connections: Vec<LocationConnection>,
    devices: Vec<BuildingDevice>,
    /// The battery of each robot, by the robot's name; a robot without an entry needs no battery.
    pub(crate) batteries: BTreeMap<String, RobotBattery>,
    /// The location of each parcel at the start, by the parcel's name.
    pub(crate) parcels: BTreeMap<String, String>,
    /// The location of each table at the start, by the table's name.
    pub(crate) tables: BTreeMap<String, String>,
}

/// A layout as read from a file, before it is checked.
#[derive(Deserialize, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawLayout {
    locations: Vec<Location>,
    #[serde(default)]
    connections: Vec<LocationConnection>,
    #[serde(default)]
    devices: Vec<BuildingDevice>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    batteries: BTreeMap<String, RobotBattery>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    parcels: BTreeMap<String, String>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    tables: BTreeMap<String, String>,
}

impl TryFrom<RawLayout> for Layout {
    type Error = LayoutError;

    fn try_from(written: RawLayout) -> Result<Layout, LayoutError> {
        let RawLayout { locations, connections, devices, batteries, parcels, tables } = written;
        let mut layout = Layout::new();
        for location in locations {
            layout.add_location(location)?;
        }
        for connection in connections {
            layout.add_connection(connection)?;
        }
        // Carriers are added first, so that a file may list its devices in any order.
        let (mounted, standing): (Vec<_>, Vec<_>) =
            devices.into_iter().partition(|device| device.carrier().is_some());
        for device in standing.into_iter().chain(mounted) {
            layout.add_device(device)?;
        }
        for (robot, battery) in batteries {
            layout.equip(&robot, battery)?;
        }
        for (parcel, location) in parcels {
            layout.add_parcel(&parcel, &location)?;
        }
        for (table, location) in tables {
            layout.add_table(&table, &location)?;
        }
        Ok(layout)
    }
}

impl From<Layout> for RawLayout {
    fn from(layout: Layout) -> RawLayout {
        let Layout { locations, connections, devices, batteries, parcels, tables } = layout;
        RawLayout { locations, connections, devices, batteries, parcels, tables }
    }
}

// === impl Layout: reading ===

impl Layout {
    /// Returns all locations, in the order in which they were added.
    pub fn locations(&self) -> &[Location] {
        &self.locations
    }

    /// Returns the names of all rooms, in the order in which they were added.
    pub fn rooms(&self) -> impl Iterator<Item = &str> {
        self.locations
            .iter()
            .filter(|location| location.kind == LocationKind::Room)
            .map(|location| location.name.as_str())
    }

    /// Returns all connections, in the order in which they were added.
    pub fn connections(&self) -> &[LocationConnection] {
        &self.connections
    }

    /// Returns all devices, in the order in which they were added. In a layout that was read from a
    /// file, mounted devices come last.
    pub fn devices(&self) -> &[BuildingDevice] {
        &self.devices
    }

    /// Returns the device of this name; `None` if there is none.
    pub fn device(&self, name: &str) -> Option<&BuildingDevice> {
        self.devices.iter().find(|device| device.name() == name)
    }

    /// Returns the location where the robot of this name stands at the start; `None` if there is no
    /// such robot.
    pub(crate) fn start_of(&self, robot: &str) -> Option<&str> {
        match self.device(robot)? {
            BuildingDevice::Robot { start, .. } => Some(start),
            _ => None,
        }
    }

    /// Returns the location of this name; `None` if there is none.
    pub fn location(&self, name: &str) -> Option<&Location> {
        self.locations.iter().find(|location| location.name == name)
    }

    /// Returns the names of the temperature sensors that are fixed in `location`.
    pub fn fixed_sensors_in<'a>(&'a self, location: &'a str) -> impl Iterator<Item = &'a str> {
        self.devices.iter().filter_map(move |device| match device {
            BuildingDevice::FixedSensor { name, location: place } if place == location => {
                Some(name.as_str())
            }
            _ => None,
        })
    }

    /// Returns the names of the rooms without a fixed temperature sensor.
    pub fn rooms_without_sensor(&self) -> impl Iterator<Item = &str> {
        self.rooms().filter(|room| self.fixed_sensors_in(room).next().is_none())
    }

    /// Returns the length of the connection from `from` to `to`, in meters; `None` if robots cannot
    /// go from `from` to `to` directly.
    pub fn meters(&self, from: &str, to: &str) -> Option<f64> {
        self.connections
            .iter()
            .find(|way| {
                way.from == from && way.to == to || !way.one_way && way.from == to && way.to == from
            })
            .map(|way| way.meters)
    }

    /// Returns the locations to which robots can go from `from` directly, in the order of the
    /// connections.
    pub fn neighbors<'a>(&'a self, from: &'a str) -> impl Iterator<Item = &'a str> {
        self.connections.iter().filter_map(move |way| {
            if way.from == from {
                Some(way.to.as_str())
            } else if !way.one_way && way.to == from {
                Some(way.from.as_str())
            } else {
                None
            }
        })
    }

    /// Returns all locations that a robot at `from` can reach, including `from`.
    pub fn reachable_from<'a>(&'a self, from: &'a str) -> BTreeSet<&'a str> {
        let mut reached = BTreeSet::from([from]);
        let mut frontier = vec![from];
        while let Some(place) = frontier.pop() {
            frontier.extend(self.neighbors(place).filter(|next| reached.insert(next)));
        }
        reached
    }

    /// Returns all locations that a robot with a temperature sensor can reach.
    pub(crate) fn measurable_by_robots(&self) -> BTreeSet<&str> {
        let carriers = self.devices.iter().filter_map(|device| match device {
            BuildingDevice::MountedSensor { carrier, .. } => self.device(carrier),
            _ => None,
        });
        carriers
            .filter_map(|carrier| match carrier {
                BuildingDevice::Robot { start, .. } => Some(self.reachable_from(start)),
                _ => None,
            })
            .flatten()
            .collect()
    }

    /// Returns the name of the location most similar to `name`; `None` if no name is similar.
    pub(crate) fn nearest_location(&self, name: &str) -> Option<String> {
        nearest(name, self.locations.iter().map(|location| location.name.as_str()))
    }

    /// Returns the name of the device most similar to `name`; `None` if no name is similar.
    pub(crate) fn nearest_device(&self, name: &str) -> Option<String> {
        nearest(name, self.devices.iter().map(BuildingDevice::name))
    }
}

#[cfg(test)]
mod tests;
