//! The plan of a building: locations, the doors between them, the devices in it.
//!
//! Plain data that can be read from and written to JSON or TOML. Every way to a
//! [`Layout`] goes through the same checks, so whoever holds one may trust it:
//! names are unique PDDL names, every reference is known, every number possible.
//! What happens in the building is [`Building`](crate::Building)'s matter.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::error::{LayoutError, nearest};

/// The coldest and hottest a location can be, in °C: what exists, and a furnace.
pub(crate) const CELSIUS_MIN: f64 = -273.15;
pub(crate) const CELSIUS_MAX: f64 = 1_000.0;
/// The longest connection: a kilometer of tunnel is a building still.
pub(crate) const METERS_MAX: f64 = 1_000.0;
/// From a crawl to a train; bounds every trip to a finite, addable duration.
pub(crate) const SPEED_MIN: f64 = 0.001;
pub(crate) const SPEED_MAX: f64 = 100.0;
/// The longest name: two of them fit into a line on the socket many times over.
pub(crate) const NAME_MAX: usize = 64;

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
}

impl Device {
    /// The device's name.
    pub fn name(&self) -> &str {
        match self {
            Device::FixedSensor { name, .. }
            | Device::Robot { name, .. }
            | Device::MountedSensor { name, .. } => name,
        }
    }

    /// What the device is, in words for a message.
    pub(crate) fn is(&self) -> &'static str {
        match self {
            Device::FixedSensor { .. } => "fixed sensor",
            Device::Robot { .. } => "robot",
            Device::MountedSensor { .. } => "mounted sensor",
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
}

impl TryFrom<Written> for Layout {
    type Error = LayoutError;

    fn try_from(written: Written) -> Result<Layout, LayoutError> {
        let Written { locations, connections, devices } = written;
        let mut layout = Layout::new();
        for location in locations {
            layout.add_location(location)?;
        }
        for connection in connections {
            layout.add_connection(connection)?;
        }
        // Carriers first, so that a file may name its devices in any order.
        let (mounted, standing): (Vec<_>, Vec<_>) =
            devices.into_iter().partition(|device| matches!(device, Device::MountedSensor { .. }));
        for device in standing.into_iter().chain(mounted) {
            layout.add_device(device)?;
        }
        Ok(layout)
    }
}

impl From<Layout> for Written {
    fn from(layout: Layout) -> Written {
        let Layout { locations, connections, devices } = layout;
        Written { locations, connections, devices }
    }
}

// === impl Layout: building ===

impl Layout {
    /// An empty plot of land.
    pub fn new() -> Layout {
        Layout::default()
    }

    /// Adds a room with its true temperature.
    pub fn add_room(&mut self, name: &str, celsius: f64) -> Result<&mut Layout, LayoutError> {
        let kind = LocationKind::Room;
        self.add_location(Location { name: name.to_owned(), kind, celsius })
    }

    /// Adds a corridor with its true temperature.
    pub fn add_corridor(&mut self, name: &str, celsius: f64) -> Result<&mut Layout, LayoutError> {
        let kind = LocationKind::Corridor;
        self.add_location(Location { name: name.to_owned(), kind, celsius })
    }

    /// Connects two locations, both ways.
    pub fn connect(&mut self, a: &str, b: &str, meters: f64) -> Result<&mut Layout, LayoutError> {
        let (from, to) = (a.to_owned(), b.to_owned());
        self.add_connection(Connection { from, to, meters, one_way: false })
    }

    /// Connects two locations from the first to the second only.
    pub fn connect_one_way(
        &mut self,
        from: &str,
        to: &str,
        meters: f64,
    ) -> Result<&mut Layout, LayoutError> {
        let (from, to) = (from.to_owned(), to.to_owned());
        self.add_connection(Connection { from, to, meters, one_way: true })
    }

    /// Adds a temperature sensor that stays in one location.
    pub fn add_fixed_sensor(
        &mut self,
        name: &str,
        location: &str,
    ) -> Result<&mut Layout, LayoutError> {
        let (name, location) = (name.to_owned(), location.to_owned());
        self.add_device(Device::FixedSensor { name, location })
    }

    /// Adds a robot that stands at `start`.
    pub fn add_robot(
        &mut self,
        name: &str,
        start: &str,
        meters_per_second: f64,
    ) -> Result<&mut Layout, LayoutError> {
        let (name, start) = (name.to_owned(), start.to_owned());
        self.add_device(Device::Robot { name, start, meters_per_second })
    }

    /// Adds a temperature sensor that rides on a robot.
    pub fn mount(&mut self, sensor: &str, robot: &str) -> Result<&mut Layout, LayoutError> {
        let (name, carrier) = (sensor.to_owned(), robot.to_owned());
        self.add_device(Device::MountedSensor { name, carrier })
    }

    /// Adds a location.
    pub fn add_location(&mut self, location: Location) -> Result<&mut Layout, LayoutError> {
        self.check_new_name(&location.name)?;
        check_temperature(&location.name, location.celsius)?;
        self.locations.push(location);
        Ok(self)
    }

    /// Adds a connection.
    pub fn add_connection(&mut self, connection: Connection) -> Result<&mut Layout, LayoutError> {
        let Connection { from, to, meters, one_way } = &connection;
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

    /// Adds a device.
    pub fn add_device(&mut self, device: Device) -> Result<&mut Layout, LayoutError> {
        self.check_new_name(device.name())?;
        match &device {
            Device::FixedSensor { location, .. } => self.check_location(location)?,
            Device::Robot { name, start, meters_per_second } => {
                self.check_location(start)?;
                check_speed(name, *meters_per_second)?;
            }
            Device::MountedSensor { carrier, .. } => self.check_carrier(carrier)?,
        }
        self.devices.push(device);
        Ok(self)
    }

    /// Removes a device, and with a robot what it carries. Returns their names.
    pub(crate) fn remove_device(&mut self, name: &str) -> Vec<String> {
        let leaves = |device: &Device| {
            device.name() == name
                || matches!(device, Device::MountedSensor { carrier, .. } if carrier == name)
        };
        let (gone, kept): (Vec<_>, Vec<_>) = self.devices.drain(..).partition(leaves);
        self.devices = kept;
        gone.iter().map(|device| device.name().to_owned()).collect()
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

// === impl Layout: checking ===

impl Layout {
    fn check_new_name(&self, name: &str) -> Result<(), LayoutError> {
        let mut letters = name.bytes();
        let starts = letters.next().is_some_and(|first| first.is_ascii_lowercase());
        let goes_on =
            letters.all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-' || b == b'_');
        if !starts || !goes_on || name.len() > NAME_MAX {
            return Err(LayoutError::BadName { name: name.to_owned() });
        }
        let place = self.location(name).map(|_| "location");
        match place.or_else(|| self.device(name).map(Device::is)) {
            Some(what) => {
                Err(LayoutError::NameTaken { name: name.to_owned(), taken_by: what.to_owned() })
            }
            None => Ok(()),
        }
    }

    fn check_location(&self, name: &str) -> Result<(), LayoutError> {
        if self.location(name).is_some() {
            return Ok(());
        }
        let nearest = self.nearest_location(name);
        Err(LayoutError::UnknownLocation { name: name.to_owned(), nearest })
    }

    fn check_carrier(&self, name: &str) -> Result<(), LayoutError> {
        match self.device(name) {
            Some(Device::Robot { .. }) => Ok(()),
            Some(other) => {
                Err(LayoutError::NotARobot { name: name.to_owned(), is: other.is().to_owned() })
            }
            None => {
                let robots = self.devices.iter().filter(|d| matches!(d, Device::Robot { .. }));
                let nearest = nearest(name, robots.map(Device::name));
                Err(LayoutError::UnknownRobot { name: name.to_owned(), nearest })
            }
        }
    }
}

/// Fails for a temperature that no location can have, NaN included.
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
