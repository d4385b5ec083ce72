//! What is true in the building, and what has happened in it.
//!
//! [`Truth`] is a value: a snapshot that tests compare with what agents claim.
//! How it changes is decided in `world`; when, in [`Building`](crate::Building).

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::camera::Aim;
use crate::layout::{Device, Layout};
use crate::quantity::Quantity;

/// How many occurrences the log keeps before it forgets the oldest.
///
/// A scenario writes fewer than two hundred, so twenty fit; and at about 150
/// bytes each, a building that runs for a year still holds less than 1 MiB.
pub const LOG_MAX: usize = 4_096;

/// What a temperature sensor measured, and where it truly was.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Reading {
    /// Where the sensor was when it measured.
    pub location: String,
    /// The temperature there, in °C.
    pub celsius: f64,
}

/// How a device is broken.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// Every use of it fails at once, and one that is under way fails too.
    Fails,
    /// Every use of it waits until it is repaired.
    Hangs,
    /// Every use that begins takes this much longer, in the building's time.
    Slow(Duration),
}

/// Something that happened, in the order in which it happened.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Occurrence {
    /// Counts from 0 without gaps.
    pub sequence: u64,
    /// Time since the building was opened, on Tokio's clock.
    pub since_start: Duration,
    /// What happened.
    pub event: Event,
}

/// What can happen in a building.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", rename_all_fields = "kebab-case")]
#[non_exhaustive]
pub enum Event {
    /// A sensor was asked, and begins to measure.
    Asked {
        /// The sensor.
        sensor: String,
    },
    /// A sensor has measured the temperature of the location where it truly is.
    Read {
        /// The sensor.
        sensor: String,
        /// Where it is.
        location: String,
        /// What it measured, in °C.
        celsius: f64,
    },
    /// A sensor has measured something else than a temperature where it truly is.
    Measured {
        /// The sensor.
        sensor: String,
        /// Where it is.
        location: String,
        /// What it measured.
        quantity: Quantity,
        /// In the quantity's unit.
        value: f64,
    },
    /// A robot set off; it stands in `from` until it has moved.
    Departed {
        /// The robot.
        robot: String,
        /// Where it stands.
        from: String,
        /// Where it wants to go.
        to: String,
    },
    /// A robot has arrived.
    Moved {
        /// The robot.
        robot: String,
        /// Where it stood.
        from: String,
        /// Where it stands now.
        to: String,
    },
    /// A robot's errand was called off or failed; it stands where it set off.
    Stayed {
        /// The robot.
        robot: String,
        /// Where it stands.
        at: String,
    },
    /// A robot has filled its battery.
    Recharged {
        /// The robot.
        robot: String,
        /// Where its dock is.
        at: String,
    },
    /// Fate filled or emptied a robot's battery.
    ChargeSet {
        /// The robot.
        robot: String,
        /// How far it can drive now, in meters.
        meters: f64,
    },
    /// A robot has swept the place where it stands.
    Swept {
        /// The robot.
        robot: String,
        /// Where.
        location: String,
    },
    /// A camera was turned.
    Aimed {
        /// The camera.
        camera: String,
        /// Where it looks now.
        aim: Aim,
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
        /// What it shows.
        text: String,
    },
    /// A screen went dark as it was told to.
    Darkened {
        /// The screen.
        screen: String,
    },
    /// A person came to a location.
    Entered {
        /// The person.
        person: String,
        /// Where.
        location: String,
    },
    /// A person left the building.
    Left {
        /// The person.
        person: String,
        /// Where from.
        location: String,
    },
    /// Something began to move, and goes on.
    Stirs {
        /// Where.
        location: String,
    },
    /// It moves no more.
    Rests {
        /// Where.
        location: String,
    },
    /// A device broke.
    Broken {
        /// The device.
        device: String,
        /// How.
        fault: Fault,
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
    /// A quantity became another in a location.
    ValueSet {
        /// The location.
        location: String,
        /// The quantity.
        quantity: Quantity,
        /// What it is now, in its unit.
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
    /// What else was said to be so, by quantity and location; the rest is as usual.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) conditions: BTreeMap<Quantity, BTreeMap<String, f64>>,
    /// Where each robot stands; everything else follows from the layout.
    pub(crate) robots: BTreeMap<String, String>,
    /// How far each robot with a battery can still drive, in meters.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) charges: BTreeMap<String, f64>,
    pub(crate) faults: BTreeMap<String, Fault>,
    /// Where each person is.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) people: BTreeMap<String, String>,
    /// Locations where something keeps moving.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub(crate) stirring: BTreeSet<String>,
    /// Where each camera looks that was ever turned.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) aims: BTreeMap<String, Aim>,
    /// The channel of each screen that has one.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) channels: BTreeMap<String, u32>,
    /// What each screen shows, or would if it worked.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) shown: BTreeMap<String, String>,
    /// Doors by their two sides, the alphabetically first one first.
    pub(crate) locked: BTreeSet<(String, String)>,
    pub(crate) log: Log,
    /// Faults that strike when the device is used next.
    #[serde(skip)]
    pub(crate) traps: BTreeMap<String, Fault>,
    /// The errand each robot is on, by the sequence number of its departure.
    #[serde(skip)]
    pub(crate) errands: BTreeMap<String, u64>,
}

impl Truth {
    /// The building as it is now, with the devices that are in it now.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The true temperature of a location, in °C.
    pub fn temperature(&self, location: &str) -> Option<f64> {
        self.temperatures.get(location).copied()
    }

    /// Where a device truly is: its own place, or its carrier's.
    pub fn place_of(&self, device: &str) -> Option<&str> {
        match self.layout.device(device)? {
            Device::FixedSensor { location, .. }
            | Device::Sensor { location, .. }
            | Device::Camera { location, .. }
            | Device::Screen { location, .. } => Some(location),
            Device::Robot { name, .. } => self.robots.get(name).map(String::as_str),
            Device::MountedSensor { carrier, .. } | Device::MountedScreen { carrier, .. } => {
                self.robots.get(carrier).map(String::as_str)
            }
        }
    }

    /// How a device is broken, if it is.
    pub fn fault_of(&self, device: &str) -> Option<Fault> {
        self.faults.get(device).copied()
    }

    /// Whether the door between two locations is locked.
    pub fn is_locked(&self, a: &str, b: &str) -> bool {
        self.locked.contains(&sides(a, b))
    }

    /// What happened, oldest first.
    pub fn occurrences(&self) -> impl DoubleEndedIterator<Item = &Occurrence> {
        self.log.kept.iter()
    }

    /// How many of the oldest occurrences the log has forgotten; see [`LOG_MAX`].
    pub fn forgotten_count(&self) -> u64 {
        self.log.next_sequence - self.log.kept.len() as u64
    }

    /// The sequence number that the next occurrence will have.
    pub fn next_sequence(&self) -> u64 {
        self.log.next_sequence
    }

    /// Whether the sensor has measured at least once.
    pub fn has_read(&self, sensor: &str) -> bool {
        self.any(|event| matches!(event, Event::Read { sensor: by, .. } if by == sensor))
    }

    /// Whether the location's temperature was measured at least once, by whomever.
    pub fn was_read(&self, location: &str) -> bool {
        self.any(|event| matches!(event, Event::Read { location: place, .. } if place == location))
    }

    /// Whether something of this sort has happened and is not forgotten.
    pub fn any(&self, sort: impl Fn(&Event) -> bool) -> bool {
        self.occurrences().any(|occurrence| sort(&occurrence.event))
    }
}

/// A bounded list of occurrences: the newest [`LOG_MAX`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub(crate) struct Log {
    pub(crate) kept: VecDeque<Occurrence>,
    #[serde(skip)]
    pub(crate) next_sequence: u64,
    /// Time since the building was opened, set before each change.
    #[serde(skip)]
    pub(crate) now: Duration,
}

impl Log {
    /// Writes down what happened just now; returns its sequence number.
    pub(crate) fn record(&mut self, event: Event) -> u64 {
        let sequence = self.next_sequence;
        self.next_sequence += 1;
        if self.kept.len() == LOG_MAX {
            self.kept.pop_front();
        }
        self.kept.push_back(Occurrence { sequence, since_start: self.now, event });
        sequence
    }
}

/// A door's name: its two sides in alphabetical order.
pub(crate) fn sides(a: &str, b: &str) -> (String, String) {
    if a <= b { (a.to_owned(), b.to_owned()) } else { (b.to_owned(), a.to_owned()) }
}
