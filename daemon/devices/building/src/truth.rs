//! The truth of the building, and the log of what has happened in it.
//!
//! [`Truth`] is a value: a snapshot that tests compare with the claims of agents. `world` defines
//! how the truth changes, and [`Building`](crate::Building) defines when it changes.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::camera_aim::CameraAim;
use crate::layout::{BuildingDevice, Layout};
use crate::lifted_table::LiftedTable;
use crate::parcel_place::ParcelPlace;
use crate::quantity::Quantity;

/// Capacity of the log, in occurrences; when the log is full, the oldest occurrence is dropped.
///
/// A scenario writes fewer than two hundred occurrences, so that the log holds twenty scenarios. At
/// about 150 bytes per occurrence, a building that runs for a year still needs less than 1 MiB.
pub const LOG_MAX: usize = 4_096;

/// The result of a temperature measurement, and the true location of the sensor.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct TemperatureReading {
    /// Name of the location of the sensor at the time of the measurement.
    pub location: String,
    /// Measured temperature, in °C.
    pub celsius: f64,
}

/// Kind of a device's fault.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceFault {
    /// Every use of the device fails at once, including a use under way.
    Fails,
    /// Every use of the device waits until the device is repaired.
    Hangs,
    /// Every use that begins after the break takes longer by this duration, in the building's time.
    Slow(Duration),
}

/// One entry of the log: an event, with its number and time. Entries are in the order of their
/// events.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Occurrence {
    /// Sequence number of the occurrence; the numbers start at 0 and have no gaps.
    pub sequence: u64,
    /// Time of the occurrence, counted from the opening of the building by Tokio's clock.
    pub since_start: Duration,
    /// The event that happened.
    pub event: BuildingEvent,
}

/// An event in a building.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", rename_all_fields = "kebab-case")]
#[non_exhaustive]
pub enum BuildingEvent {
    /// A sensor was requested to measure, and begins the measurement.
    Asked {
        /// Name of the sensor.
        sensor: String,
    },
    /// A sensor has measured the temperature of its true location.
    Read {
        /// Name of the sensor.
        sensor: String,
        /// Name of the location of the sensor.
        location: String,
        /// The measured temperature, in °C.
        celsius: f64,
    },
    /// A sensor has measured a quantity other than temperature at its true location.
    Measured {
        /// Name of the sensor.
        sensor: String,
        /// Name of the location of the sensor.
        location: String,
        /// The measured quantity.
        quantity: Quantity,
        /// The measured value, in the quantity's unit.
        value: f64,
    },
    /// A robot has begun a trip. Until it has moved, its location is `from`.
    Departed {
        /// Name of the robot.
        robot: String,
        /// Name of the location of the robot.
        from: String,
        /// Name of the destination.
        to: String,
    },
    /// A robot has arrived at its destination.
    Moved {
        /// Name of the robot.
        robot: String,
        /// Name of the location that the robot left.
        from: String,
        /// Name of the new location of the robot.
        to: String,
    },
    /// A robot's trip was cancelled or failed; the robot is still at the start of the trip.
    Stayed {
        /// Name of the robot.
        robot: String,
        /// Name of the location of the robot.
        at: String,
    },
    /// A robot has filled its battery.
    Recharged {
        /// Name of the robot.
        robot: String,
        /// Name of the location of the robot's dock.
        at: String,
    },
    /// A test or a scenario has set the charge of a robot's battery.
    ChargeSet {
        /// Name of the robot.
        robot: String,
        /// Remaining range of the robot now, in meters.
        meters: f64,
    },
    /// A robot has swept its location.
    Swept {
        /// Name of the robot.
        robot: String,
        /// Name of the swept place.
        location: String,
    },
    /// A camera was turned.
    Aimed {
        /// Name of the camera.
        camera: String,
        /// New direction and zoom of the camera.
        aim: CameraAim,
    },
    /// A channel was allocated to a screen.
    Allocated {
        /// Name of the screen.
        screen: String,
        /// The allocated channel.
        channel: u32,
    },
    /// A screen shows another text.
    Shown {
        /// Name of the screen.
        screen: String,
        /// The text that the screen shows.
        text: String,
    },
    /// A driver has turned off the text of its screen.
    Darkened {
        /// Name of the screen.
        screen: String,
    },
    /// A person came to a location, from outside or from another location.
    Entered {
        /// Name of the person.
        person: String,
        /// Name of the location that the person came to.
        location: String,
    },
    /// A person left the building.
    Left {
        /// Name of the person.
        person: String,
        /// Name of the location that the person left.
        location: String,
    },
    /// Continuous motion began in a location.
    Stirs {
        /// Name of the location with motion.
        location: String,
    },
    /// The continuous motion in a location ended.
    Rests {
        /// Name of the location without motion.
        location: String,
    },
    /// A device broke.
    Broken {
        /// Name of the broken device.
        device: String,
        /// The kind of the fault.
        fault: DeviceFault,
    },
    /// A device works again.
    Repaired {
        /// Name of the repaired device.
        device: String,
    },
    /// A test or a scenario has set the temperature of a location.
    TemperatureSet {
        /// Name of the location.
        location: String,
        /// New temperature of the location, in °C.
        celsius: f64,
    },
    /// A test or a scenario has set the value of a quantity in a location.
    ValueSet {
        /// Name of the location.
        location: String,
        /// The quantity with the new value.
        quantity: Quantity,
        /// New value of the quantity, in its unit.
        value: f64,
    },
    /// The door between two locations was locked, in both directions.
    Locked {
        /// Name of the location on one side of the door: the first in alphabetical order.
        a: String,
        /// Name of the location on the other side of the door.
        b: String,
    },
    /// The door between two locations was unlocked.
    Unlocked {
        /// Name of the location on one side of the door: the first in alphabetical order.
        a: String,
        /// Name of the location on the other side of the door.
        b: String,
    },
    /// The cabin of a lift has arrived at another landing.
    CabinMoved {
        /// Name of the lift.
        lift: String,
        /// Name of the landing that the cabin left.
        from: String,
        /// Name of the landing where the cabin is.
        to: String,
    },
    /// A robot has taken up a parcel.
    TakenUp {
        /// Name of the robot.
        robot: String,
        /// Name of the parcel.
        parcel: String,
        /// Name of the location of the robot.
        at: String,
    },
    /// A robot has set down a parcel, at its location or in a cabin there.
    SetDown {
        /// Name of the robot.
        robot: String,
        /// Name of the parcel.
        parcel: String,
        /// Name of the location of the robot.
        at: String,
    },
    /// An arm has gripped a parcel on one of its shelves.
    Gripped {
        /// Name of the arm.
        arm: String,
        /// Name of the parcel.
        parcel: String,
    },
    /// An arm has put the parcel that it had gripped on one of its shelves.
    PutBack {
        /// Name of the arm.
        arm: String,
        /// Name of the parcel.
        parcel: String,
    },
    /// An arm has loaded the parcel that it had gripped on a robot.
    Loaded {
        /// Name of the arm.
        arm: String,
        /// Name of the robot.
        robot: String,
        /// Name of the parcel.
        parcel: String,
        /// Name of the location of both.
        at: String,
    },
    /// Two robots have carried a table to another location.
    TableCarried {
        /// Names of the robots.
        robots: [String; 2],
        /// Name of the table.
        table: String,
        /// Name of the location that it left.
        from: String,
        /// Name of the location where it is.
        to: String,
    },
    /// A device was added to the building.
    Added {
        /// Name of the added device.
        device: String,
    },
    /// A device was removed from the building.
    Removed {
        /// Name of the removed device.
        device: String,
    },
}

/// The whole truth about a building at one moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Truth {
    pub(crate) layout: Layout,
    pub(crate) temperatures: BTreeMap<String, f64>,
    /// Values that were set, by quantity and location. In all other locations a quantity has its
    /// usual value.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) conditions: BTreeMap<Quantity, BTreeMap<String, f64>>,
    /// Location of each robot, by name. The location of every other device follows from the layout.
    pub(crate) robots: BTreeMap<String, String>,
    /// The remaining range of each robot with a battery, in meters.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) charges: BTreeMap<String, f64>,
    pub(crate) faults: BTreeMap<String, DeviceFault>,
    /// Location of each person, by the person's name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) people: BTreeMap<String, String>,
    /// Names of the locations with continuous motion.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub(crate) locations_with_motion: BTreeSet<String>,
    /// Aim of each camera that was turned at least once; any other camera has the default aim.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) aims: BTreeMap<String, CameraAim>,
    /// The channel of each screen that has a channel.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) channels: BTreeMap<String, u32>,
    /// Text of each screen, including a screen that has failed and is dark.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) shown: BTreeMap<String, String>,
    /// Locked doors. Each is a pair of the locations on its two sides, in alphabetical order.
    pub(crate) locked: BTreeSet<(String, String)>,
    /// Location of the cabin of each lift, by the lift's name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) cabins: BTreeMap<String, String>,
    /// Where each parcel is, by the parcel's name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) parcels: BTreeMap<String, ParcelPlace>,
    /// Location of each table, by the table's name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) tables: BTreeMap<String, String>,
    /// The tables that robots carry, by name.
    #[serde(skip)]
    pub(crate) lifted_tables: BTreeMap<String, LiftedTable>,
    pub(crate) log: OccurrenceLog,
    /// Faults that occur at the next use of a device, by the name of the device.
    #[serde(skip)]
    pub(crate) traps: BTreeMap<String, DeviceFault>,
    /// The trip under way of each robot, as the sequence number of its departure, by the robot's
    /// name.
    #[serde(skip)]
    pub(crate) errands: BTreeMap<String, u64>,
}

impl Truth {
    /// Returns the layout of the building at this moment, with its present devices.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the true temperature of a location, in °C; `None` if there is no such location.
    pub fn temperature(&self, location: &str) -> Option<f64> {
        self.temperatures.get(location).copied()
    }

    /// Returns the true location of a device; that of a mounted device is the location of its
    /// carrier. Returns `None` if there is no such device.
    pub fn place_of(&self, device: &str) -> Option<&str> {
        match self.layout.device(device)? {
            BuildingDevice::FixedSensor { location, .. }
            | BuildingDevice::Sensor { location, .. }
            | BuildingDevice::Camera { location, .. }
            | BuildingDevice::Screen { location, .. }
            | BuildingDevice::TagReader { location, .. }
            | BuildingDevice::Arm { location, .. }
            | BuildingDevice::Door { a: location, .. } => Some(location),
            BuildingDevice::Lift { name, .. } => self.cabins.get(name).map(String::as_str),
            BuildingDevice::Robot { name, .. } => self.robots.get(name).map(String::as_str),
            BuildingDevice::MountedSensor { carrier, .. }
            | BuildingDevice::MountedScreen { carrier, .. } => {
                self.robots.get(carrier).map(String::as_str)
            }
        }
    }

    /// Returns the fault of a device; `None` if the device works.
    pub fn fault_of(&self, device: &str) -> Option<DeviceFault> {
        self.faults.get(device).copied()
    }

    /// Whether the door between two locations is locked.
    pub fn is_locked(&self, a: &str, b: &str) -> bool {
        self.locked.contains(&sides(a, b))
    }

    /// Returns all occurrences that the log still has, oldest first.
    pub fn occurrences(&self) -> impl DoubleEndedIterator<Item = &Occurrence> {
        self.log.occurrences.iter()
    }

    /// Returns the number of occurrences that the log has dropped; see [`LOG_MAX`].
    pub fn forgotten_count(&self) -> u64 {
        self.log.next_sequence - self.log.occurrences.len() as u64
    }

    /// Returns the sequence number of the next occurrence.
    pub fn next_sequence(&self) -> u64 {
        self.log.next_sequence
    }

    /// Whether the sensor has measured at least once.
    pub fn has_read(&self, sensor: &str) -> bool {
        self.any(|event| matches!(event, BuildingEvent::Read { sensor: by, .. } if by == sensor))
    }

    /// Whether any sensor has measured the location's temperature at least once.
    pub fn was_read(&self, location: &str) -> bool {
        self.any(|event| matches!(event, BuildingEvent::Read { location: place, .. } if place == location))
    }

    /// Whether the log has an event for which `sort` returns `true`.
    pub fn any(&self, sort: impl Fn(&BuildingEvent) -> bool) -> bool {
        self.occurrences().any(|occurrence| sort(&occurrence.event))
    }
}

/// A bounded list of occurrences, which keeps the newest [`LOG_MAX`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub(crate) struct OccurrenceLog {
    pub(crate) occurrences: VecDeque<Occurrence>,
    #[serde(skip)]
    pub(crate) next_sequence: u64,
    /// Time since the opening of the building; updated before each change of the truth.
    #[serde(skip)]
    pub(crate) now: Duration,
}

impl OccurrenceLog {
    /// Records an event at the present time; returns its sequence number.
    pub(crate) fn record(&mut self, event: BuildingEvent) -> u64 {
        let sequence = self.next_sequence;
        self.next_sequence += 1;
        if self.occurrences.len() == LOG_MAX {
            self.occurrences.pop_front();
        }
        self.occurrences.push_back(Occurrence { sequence, since_start: self.now, event });
        sequence
    }
}

/// Returns the key of the door between two locations: their names in alphabetical order.
pub(crate) fn sides(a: &str, b: &str) -> (String, String) {
    if a <= b { (a.to_owned(), b.to_owned()) } else { (b.to_owned(), a.to_owned()) }
}
