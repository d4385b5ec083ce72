//! The plan of a building: locations, the doors between them, the devices in it.
//!
//! Plain data that can be read from and written to JSON or TOML. Every way to a
//! [`Layout`] goes through the same checks, so whoever holds one may trust it:
//! names are unique PDDL names, every reference is known, every number possible.
//! What happens in the building is [`Building`](crate::Building)'s matter.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::battery::Battery;
use crate::camera::View;
use crate::error::{LayoutError, nearest};
use crate::quantity::Quantity;

mod additions;

pub(crate) use additions::{
    CELSIUS_MAX, CELSIUS_MIN, METERS_MAX, NAME_MAX, SPEED_MAX, SPEED_MIN, check_temperature,
};

/// What a location is, in the words of the shared ontology.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LocationKind {
    /// A room: people want to know its temperature.
    Room,
    /// A corridor: robots pass through.
    Corridor,
}

/// A place where robots can be and a temperature reigns.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Location {
    /// Its name, unique among locations and devices.
    pub name: String,
    /// Room or corridor.
    pub kind: LocationKind,
    /// Its true temperature at the start, in °C.
    pub celsius: f64,
}

/// A way from one location to another.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Connection {
    /// One end; the start, where the way is one-way.
    pub from: String,
    /// The other end.
    pub to: String,
    /// Its length in meters.
    pub meters: f64,
    /// Whether it can be gone from `from` to `to` only.
    #[serde(default)]
    pub one_way: bool,
}

/// A thing in the building that a driver can use.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub enum Device {
    /// A temperature sensor on a wall.
    FixedSensor {
        /// Its name.
        name: String,
        /// The location whose temperature it measures.
        location: String,
    },
    /// A sensor in a location, of something else than its temperature.
    Sensor {
        /// Its name.
        name: String,
        /// The location where it is.
        location: String,
        /// What it measures.
        quantity: Quantity,
    },
    /// A mobile base.
    Robot {
        /// Its name.
        name: String,
        /// The location where it stands at the start.
        start: String,
        /// Its speed.
        meters_per_second: f64,
    },
    /// A temperature sensor that measures wherever its carrier is.
    MountedSensor {
        /// Its name.
        name: String,
        /// The robot that carries it.
        carrier: String,
    },
    /// A camera that turns.
    Camera {
        /// Its name.
        name: String,
        /// The location where it hangs.
        location: String,
        /// Where the places that it can see lie.
        #[serde(default)]
        views: Vec<View>,
    },
    /// A screen on a wall.
    Screen {
        /// Its name.
        name: String,
        /// The location where it hangs.
        location: String,
    },
    /// A screen that is wherever its carrier is.
    MountedScreen {
        /// Its name.
        name: String,
        /// The robot that carries it.
        carrier: String,
    },
}

impl Device {
    /// The device's name.
    pub fn name(&self) -> &str {
        match self {
            Device::FixedSensor { name, .. }
            | Device::Sensor { name, .. }
            | Device::Robot { name, .. }
            | Device::MountedSensor { name, .. }
            | Device::Camera { name, .. }
            | Device::Screen { name, .. }
            | Device::MountedScreen { name, .. } => name,
        }
    }

    /// What the device is, in words for a message.
    pub(crate) fn is(&self) -> &'static str {
        match self {
            Device::FixedSensor { .. } => "fixed sensor",
            Device::Sensor { .. } => "sensor",
            Device::Robot { .. } => "robot",
            Device::MountedSensor { .. } => "mounted sensor",
            Device::Camera { .. } => "camera",
            Device::Screen { .. } => "screen",
            Device::MountedScreen { .. } => "mounted screen",
        }
    }

    /// The robot that carries it.
    pub(crate) fn carrier(&self) -> Option<&str> {
        match self {
            Device::MountedSensor { carrier, .. } | Device::MountedScreen { carrier, .. } => {
                Some(carrier)
            }
            _ => None,
        }
    }
}

/// The plan of a building; see the module for what is checked.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Layout {
    locations: Vec<Location>,
    connections: Vec<Connection>,
    devices: Vec<Device>,
    /// By robot; one that is not here needs none.
    pub(crate) batteries: BTreeMap<String, Battery>,
}

/// A layout as it stands in a file, nothing checked yet.
#[derive(Deserialize, Serialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Written {
    locations: Vec<Location>,
    #[serde(default)]
    connections: Vec<Connection>,
    #[serde(default)]
    devices: Vec<Device>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    batteries: BTreeMap<String, Battery>,
}

impl TryFrom<Written> for Layout {
    type Error = LayoutError;

    fn try_from(written: Written) -> Result<Layout, LayoutError> {
        let Written { locations, connections, devices, batteries } = written;
        let mut layout = Layout::new();
        for location in locations {
            layout.add_location(location)?;
        }
        for connection in connections {
            layout.add_connection(connection)?;
        }
        // Carriers first, so that a file may name its devices in any order.
        let (mounted, standing): (Vec<_>, Vec<_>) =
            devices.into_iter().partition(|device| device.carrier().is_some());
        for device in standing.into_iter().chain(mounted) {
            layout.add_device(device)?;
        }
        for (robot, battery) in batteries {
            layout.equip(&robot, battery)?;
        }
        Ok(layout)
    }
}

impl From<Layout> for Written {
    fn from(layout: Layout) -> Written {
        let Layout { locations, connections, devices, batteries } = layout;
        Written { locations, connections, devices, batteries }
    }
}

// === impl Layout: looking ===

impl Layout {
    /// All locations, in the order they were added.
    pub fn locations(&self) -> &[Location] {
        &self.locations
    }

    /// The names of all rooms, in the order they were added.
    pub fn rooms(&self) -> impl Iterator<Item = &str> {
        self.locations
            .iter()
            .filter(|location| location.kind == LocationKind::Room)
            .map(|location| location.name.as_str())
    }

    /// All connections, in the order they were added.
    pub fn connections(&self) -> &[Connection] {
        &self.connections
    }

    /// All devices; what is mounted comes after its carrier.
    pub fn devices(&self) -> &[Device] {
        &self.devices
    }

    /// The device of that name.
    pub fn device(&self, name: &str) -> Option<&Device> {
        self.devices.iter().find(|device| device.name() == name)
    }

    /// Where the robot of that name stands at the start.
    pub(crate) fn start_of(&self, robot: &str) -> Option<&str> {
        match self.device(robot)? {
            Device::Robot { start, .. } => Some(start),
            _ => None,
        }
    }

    /// The location of that name.
    pub fn location(&self, name: &str) -> Option<&Location> {
        self.locations.iter().find(|location| location.name == name)
    }

    /// The sensors that are fixed in `location`.
    pub fn fixed_sensors_in<'a>(&'a self, location: &'a str) -> impl Iterator<Item = &'a str> {
        self.devices.iter().filter_map(move |device| match device {
            Device::FixedSensor { name, location: place } if place == location => {
                Some(name.as_str())
            }
            _ => None,
        })
    }

    /// The rooms that no fixed sensor measures.
    pub fn rooms_without_sensor(&self) -> impl Iterator<Item = &str> {
        self.rooms().filter(|room| self.fixed_sensors_in(room).next().is_none())
    }

    /// The length of the way from one location to its neighbor, if there is one.
    pub fn meters(&self, from: &str, to: &str) -> Option<f64> {
        self.connections
            .iter()
            .find(|way| {
                way.from == from && way.to == to || !way.one_way && way.from == to && way.to == from
            })
            .map(|way| way.meters)
    }

    /// The locations one step away from `from`, in the order of the connections.
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

    /// Every location a robot can come to from `from`, itself included.
    pub fn reachable_from<'a>(&'a self, from: &'a str) -> BTreeSet<&'a str> {
        let mut reached = BTreeSet::from([from]);
        let mut frontier = vec![from];
        while let Some(place) = frontier.pop() {
            frontier.extend(self.neighbors(place).filter(|next| reached.insert(next)));
        }
        reached
    }

    /// Every location that a robot with a sensor on it can come to.
    pub(crate) fn measurable_by_robots(&self) -> BTreeSet<&str> {
        let carriers = self.devices.iter().filter_map(|device| match device {
            Device::MountedSensor { carrier, .. } => self.device(carrier),
            _ => None,
        });
        carriers
            .filter_map(|carrier| match carrier {
                Device::Robot { start, .. } => Some(self.reachable_from(start)),
                _ => None,
            })
            .flatten()
            .collect()
    }

    /// The location most similar to a name that is none.
    pub(crate) fn nearest_location(&self, name: &str) -> Option<String> {
        nearest(name, self.locations.iter().map(|location| location.name.as_str()))
    }

    /// The device most similar to a name that is none.
    pub(crate) fn nearest_device(&self, name: &str) -> Option<String> {
        nearest(name, self.devices.iter().map(Device::name))
    }
}

#[cfg(test)]
mod tests;
