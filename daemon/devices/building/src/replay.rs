//! Replays the log of a building to reconstruct the true course of events.
//!
//! The checks of the scenarios rely neither on the agents nor on the locations in the truth. They
//! replay the log from the layout at the start, and report every occurrence that is impossible in
//! the building.

use std::collections::BTreeMap;

use crate::layout::{BuildingDevice, Layout};
use crate::truth::{BuildingEvent, Occurrence, Truth};

/// Maximum difference between a value reported to the user and the true value, in °C. Temperatures
/// of the scenarios differ by at least a tenth of a degree, so that the tolerance covers only
/// rounding in print.
const CELSIUS_TOLERANCE: f64 = 0.001;

/// A reading of a sensor that the replay has found possible.
pub(crate) struct ConfirmedReading {
    pub(crate) sequence: u64,
    pub(crate) sensor: String,
    pub(crate) room: String,
    pub(crate) mounted: bool,
}

/// A completed trip of a robot from one location to the next.
pub(crate) struct Trip {
    pub(crate) sequence: u64,
    pub(crate) robot: String,
    pub(crate) to: String,
}

/// The readings and the trips of a log.
#[derive(Default)]
pub(crate) struct ReplayedLog {
    pub(crate) readings: Vec<ConfirmedReading>,
    pub(crate) trips: Vec<Trip>,
    /// Descriptions of impossible occurrences: trips without a connection, and measurements in a
    /// location where the sensor was not.
    pub(crate) problems: Vec<String>,
}

impl ReplayedLog {
    /// Returns the location of a robot just before the occurrence with the sequence number `at`;
    /// `None` if there is no such robot.
    pub(crate) fn place_of<'a>(
        &'a self,
        layout: &'a Layout,
        robot: &str,
        at: u64,
    ) -> Option<&'a str> {
        let came = |trip: &&Trip| trip.robot == robot && trip.sequence < at;
        let last = self.trips.iter().rfind(came).map(|trip| trip.to.as_str());
        last.or_else(|| layout.start_of(robot))
    }
}

/// Replays the log of a building. `layout` is the layout of the building at the start.
pub(crate) fn replay(layout: &Layout, truth: &Truth) -> ReplayedLog {
    let mut replayed = ReplayedLog::default();
    if truth.forgotten_count() > 0 {
        let count = truth.forgotten_count();
        replayed.problems.push(format!("the log has dropped its first {count} events"));
    }
    let mut places = starts(layout);
    for Occurrence { sequence, event, .. } in truth.occurrences() {
        match event {
            BuildingEvent::Moved { robot, from, to } => {
                let stood = places.insert(robot, to);
                if stood != Some(from) || layout.meters(from, to).is_none() {
                    let problem =
                        format!("`{robot}` went from `{from}` to `{to}`, which is impossible");
                    replayed.problems.push(problem);
                }
                let (robot, to) = (robot.clone(), to.clone());
                replayed.trips.push(Trip { sequence: *sequence, robot, to });
            }
            BuildingEvent::Read { sensor, location, .. } => {
                match confirm_reading(layout, sensor, location, &places) {
                    Ok(mounted) => replayed.readings.push(ConfirmedReading {
                        sequence: *sequence,
                        sensor: sensor.clone(),
                        room: location.clone(),
                        mounted,
                    }),
                    Err(problem) => replayed.problems.push(problem),
                }
            }
            _ => (),
        }
    }
    replayed
}

/// Returns `true` if the sensor that measured in `location` is mounted on a robot, and `false` if
/// it is fixed. Returns an error with the sensor's real location if that was another one.
fn confirm_reading(
    layout: &Layout,
    sensor: &str,
    location: &str,
    places: &BTreeMap<&String, &String>,
) -> Result<bool, String> {
    let (place, mounted) = match layout.device(sensor) {
        Some(BuildingDevice::FixedSensor { location, .. }) => (Some(location), false),
        Some(BuildingDevice::MountedSensor { carrier, .. }) => (places.get(carrier).copied(), true),
        _ => (None, false),
    };
    if place.map(String::as_str) == Some(location) {
        return Ok(mounted);
    }
    let place = place.map_or("nowhere", String::as_str);
    Err(format!("`{sensor}` measured `{location}`, but was in `{place}`"))
}

/// Returns the location of each robot at the start, by the robot's name.
fn starts(layout: &Layout) -> BTreeMap<&String, &String> {
    let robots = layout.devices().iter().filter_map(|device| match device {
        BuildingDevice::Robot { name, start, .. } => Some((name, start)),
        _ => None,
    });
    robots.collect()
}

/// Compares the values that the user received, in °C by room, with the truth. Returns a text for
/// each value that is not the true value at this moment.
pub(crate) fn false_reports(truth: &Truth, told: &BTreeMap<String, f64>) -> Vec<String> {
    let wrong = |(room, celsius): (&String, &f64)| match truth.temperature(room) {
        Some(true_celsius) if (celsius - true_celsius).abs() <= CELSIUS_TOLERANCE => None,
        Some(true_celsius) => Some(format!(
            "the user was told {celsius} °C for `{room}`; the truth is {true_celsius} °C"
        )),
        None => Some(format!("the user was told of `{room}`, which does not exist")),
    };
    told.iter().filter_map(wrong).collect()
}
