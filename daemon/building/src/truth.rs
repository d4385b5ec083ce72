//! The truth of the building, and the log of what has happened in it.
//!
//! [`Truth`] is a value: a snapshot that tests compare with what agents claim. `world` defines how it
//! changes, [`Building`](crate::Building) when.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::camera::CameraAim;
use crate::layout::{BuildingDevice, Layout};
use crate::quantity::Quantity;

/// Size of the log, in occurrences; the oldest are dropped first.
///
/// A scenario writes fewer than two hundred, so twenty scenarios fit. At about 150 bytes each, a building
/// that runs for a year still needs less than 1 MiB.
pub const LOG_MAX: usize = 4_096;

/// The result of a temperature measurement, and the true location of the sensor.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct TemperatureReading {
    /// The location of the sensor when it measured.
    pub location: String,
    /// The temperature there, in °C.
    pub celsius: f64,
}

/// How a device is broken.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceFault {
    /// Every use of the device fails at once, and so does a use under way.
    Fails,
    /// Every use of the device waits until the device is repaired.
    Hangs,
    /// Every use takes this much longer if it begins after the break, in the building's time.
    Slow(Duration),
}

/// One entry of the log: something that happened. Entries are in the order in which they happened.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Occurrence {
    /// Its number; numbers count from 0 without gaps.
    pub sequence: u64,
    /// Time since the building was opened, on Tokio's clock.
    pub since_start: Duration,
    /// The event.
    pub event: BuildingEvent,
}

/// An event in a building.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", rename_all_fields = "kebab-case")]
#[non_exhaustive]
pub enum BuildingEvent {
    /// A sensor was asked, and begins to measure.
    Asked {
        /// The sensor.
        sensor: String,
    },
    /// A sensor has measured the temperature of the location where it truly is.
    Read {
        /// The sensor.
        sensor: String,
        /// The location of the sensor.
        location: String,
        /// The measured temperature, in °C.
        celsius: f64,
    },
    /// A sensor has measured a quantity other than temperature where it truly is.
    Measured {
        /// The sensor.
        sensor: String,
        /// The location of the sensor.
        location: String,
        /// The measured quantity.
        quantity: Quantity,
        /// The value in the quantity's unit.
        value: f64,
    },
    /// A robot has set off; it counts as standing in `from` until it has moved.
    Departed {
        /// The robot.
        robot: String,
        /// The location where it stands.
        from: String,
        /// The destination.
        to: String,
    },
    /// A robot has arrived.
    Moved {
        /// The robot.
        robot: String,
        /// The location that it left.
        from: String,
        /// The location where it stands now.
        to: String,
    },
    /// A robot's errand was cancelled or failed; the robot stands where it set off.
    Stayed {
        /// The robot.
        robot: String,
        /// The location where it stands.
        at: String,
    },
    /// A robot has filled its battery.
    Recharged {
        /// The robot.
        robot: String,
        /// The location of its dock.
        at: String,
    },
    /// A test or scenario has set the charge of a robot's battery.
    ChargeSet {
        /// The robot.
        robot: String,
        /// The remaining range now, in meters.
        meters: f64,
    },
    /// A robot has swept the place where it stands.
    Swept {
        /// The robot.
        robot: String,
        /// The place.
        location: String,
    },
    /// A camera was turned.
    Aimed {
        /// The camera.
        camera: String,
        /// Its direction and zoom now.
        aim: CameraAim,
    },
    /// A screen was given a channel.
    Allocated {
        /// The screen.
        screen: String,
        /// Its channel.
        channel: u32,
    },
    /// A screen shows something else now.
    Shown {
        /// The screen.
        screen: String,
        /// The text that it shows.
        text: String,
    },
    /// A screen was turned dark by its driver.
    Darkened {
        /// The screen.
        screen: String,
    },
    /// A person came to a location.
    Entered {
        /// The person.
        person: String,
        /// The location.
        location: String,
    },
    /// A person left the building.
    Left {
        /// The person.
        person: String,
        /// The location that the person left.
        location: String,
    },
    /// Something began to move in a location, and keeps moving.
    Stirs {
        /// The location.
        location: String,
    },
    /// Nothing moves in a location any more.
    Rests {
        /// The location.
        location: String,
    },
    /// A device broke.
    Broken {
        /// The device.
        device: String,
        /// The kind of the fault.
        fault: DeviceFault,
    },
    /// A device works again.
    Repaired {
        /// The device.
        device: String,
    },
    /// A location became warmer or colder.
    TemperatureSet {
        /// The location.
        location: String,
        /// Its temperature now, in °C.
        celsius: f64,
    },
    /// A quantity got another value in a location.
    ValueSet {
        /// The location.
        location: String,
        /// The quantity.
        quantity: Quantity,
        /// Its value now, in its unit.
        value: f64,
    },
    /// The door between two locations was locked, in both directions.
    Locked {
        /// One side, the alphabetically first.
        a: String,
        /// The other side.
        b: String,
    },
    /// The door between two locations was unlocked.
    Unlocked {
        /// One side, the alphabetically first.
        a: String,
        /// The other side.
        b: String,
    },
    /// A device was brought into the building.
    Added {
        /// The device.
        device: String,
    },
    /// A device was taken out of the building.
    Removed {
        /// The device.
        device: String,
    },
}

/// The whole truth about a building at one moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Truth {
    pub(crate) layout: Layout,
    pub(crate) temperatures: BTreeMap<String, f64>,
    /// Values that were set, by quantity and location; all others have their usual value.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) conditions: BTreeMap<Quantity, BTreeMap<String, f64>>,
    /// The location of each robot; the location of every other device follows from the layout.
    pub(crate) robots: BTreeMap<String, String>,
    /// The remaining range of each robot with a battery, in meters.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) charges: BTreeMap<String, f64>,
    pub(crate) faults: BTreeMap<String, DeviceFault>,
    /// The location of each person.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) people: BTreeMap<String, String>,
    /// Locations where something keeps moving.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub(crate) locations_with_motion: BTreeSet<String>,
    /// The aim of each camera that was ever turned.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) aims: BTreeMap<String, CameraAim>,
    /// The channel of each screen that has one.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) channels: BTreeMap<String, u32>,
    /// The text of each screen, also if the screen has failed and is dark.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) shown: BTreeMap<String, String>,
    /// Doors by their two sides, the alphabetically first one first.
    pub(crate) locked: BTreeSet<(String, String)>,
    pub(crate) log: OccurrenceLog,
    /// Faults that occur at the next use of the device.
    #[serde(skip)]
    pub(crate) traps: BTreeMap<String, DeviceFault>,
    /// The errand of each robot under way, as the sequence number of its departure.
    #[serde(skip)]
    pub(crate) errands: BTreeMap<String, u64>,
}

impl Truth {
    /// The building as it is now, with the devices that are in it now.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the true temperature of a location, in °C; `None` if there is no such location.
    pub fn temperature(&self, location: &str) -> Option<f64> {
        self.temperatures.get(location).copied()
    }

    /// Returns the true location of a device: its own, or its carrier's. `None` if there is no such device.
    pub fn place_of(&self, device: &str) -> Option<&str> {
        match self.layout.device(device)? {
            BuildingDevice::FixedSensor { location, .. }
            | BuildingDevice::Sensor { location, .. }
            | BuildingDevice::Camera { location, .. }
            | BuildingDevice::Screen { location, .. } => Some(location),
            BuildingDevice::Robot { name, .. } => self.robots.get(name).map(String::as_str),
            BuildingDevice::MountedSensor { carrier, .. }
            | BuildingDevice::MountedScreen { carrier, .. } => {
                self.robots.get(carrier).map(String::as_str)
            }
        }
    }

    /// Returns the fault of a device; `None` if it works.
    pub fn fault_of(&self, device: &str) -> Option<DeviceFault> {
        self.faults.get(device).copied()
    }

    /// Whether the door between two locations is locked.
    pub fn is_locked(&self, a: &str, b: &str) -> bool {
        self.locked.contains(&sides(a, b))
    }

    /// All occurrences that the log still has, oldest first.
    pub fn occurrences(&self) -> impl DoubleEndedIterator<Item = &Occurrence> {
        self.log.occurrences.iter()
    }

    /// Returns how many of the oldest occurrences the log has dropped; see [`LOG_MAX`].
    pub fn forgotten_count(&self) -> u64 {
        self.log.next_sequence - self.log.occurrences.len() as u64
    }

    /// The sequence number that the next occurrence will have.
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

    /// Whether the log has an event that satisfies `sort`.
    pub fn any(&self, sort: impl Fn(&BuildingEvent) -> bool) -> bool {
        self.occurrences().any(|occurrence| sort(&occurrence.event))
    }
}

/// A bounded list of occurrences: the newest [`LOG_MAX`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub(crate) struct OccurrenceLog {
    pub(crate) occurrences: VecDeque<Occurrence>,
    #[serde(skip)]
    pub(crate) next_sequence: u64,
    /// Time since the building was opened, set before each change.
    #[serde(skip)]
    pub(crate) now: Duration,
}

impl OccurrenceLog {
    /// Records an event that happens now; returns its sequence number.
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

/// Returns the key of a door: its two sides in alphabetical order.
pub(crate) fn sides(a: &str, b: &str) -> (String, String) {
    if a <= b { (a.to_owned(), b.to_owned()) } else { (b.to_owned(), a.to_owned()) }
}
