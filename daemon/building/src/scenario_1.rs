//! Did scenario 1 of the paper truly come to pass? Asked of the truth alone.
//!
//! “The goal here is to collect temperature measurements from all rooms …”: each
//! room is measured, one without a sensor by a robot that truly stands in it; a
//! sensor dies; then a robot goes to its room too. The check replays the log, so
//! it believes neither the agents nor the bookkeeping of who was where.

use std::collections::{BTreeMap, BTreeSet};

use crate::layout::{Device, Layout};
use crate::seeded::{Dies, SeededScenario};
use crate::truth::{Event, Occurrence, Truth};

/// How far a value told to the user may be off. Temperatures of the scenarios
/// differ by a tenth of a degree, so this forgives printing and nothing else.
const CELSIUS_TOLERANCE: f64 = 0.001;

/// Checks scenario 1 against the truth; returns every way in which it failed.
///
/// `death` is the sequence number of the occurrence in which the sensor broke,
/// as [`SeededScenario::death`] returns it. `told` is what the user was told
/// last about each room, in °C.
///
/// What must hold:
/// 1. Every room that has a sensor, or that a robot with one can reach, was
///    measured; a room without a sensor by a mounted one whose carrier was there.
///    Where the sensor dies after its report, all this was so before it died.
/// 2. The sensor died when it was meant to, and is silent since.
/// 3. After its death its room was measured by a mounted sensor whose carrier
///    was there. This is what fails when nobody plans anew.
/// 4. What the user was told last about each room is true.
pub fn check_scenario_1(
    scenario: &SeededScenario,
    truth: &Truth,
    death: u64,
    told: &BTreeMap<String, f64>,
) -> Result<(), Vec<String>> {
    let mut check = Check { scenario, death, problems: Vec::new(), readings: Vec::new() };
    check.replay(truth);
    check.death_was_as_planned(truth);
    check.rooms_were_measured();
    check.dead_sensor_was_replaced();
    check.told_values_are_true(truth, told);
    if check.problems.is_empty() { Ok(()) } else { Err(check.problems) }
}

/// A reading that is proven by the replay.
struct Proven {
    sequence: u64,
    sensor: String,
    room: String,
    mounted: bool,
}

struct Check<'a> {
    scenario: &'a SeededScenario,
    death: u64,
    problems: Vec<String>,
    readings: Vec<Proven>,
}

impl Check<'_> {
    /// Collects the readings, and notes what the building could not have seen:
    /// jumps of robots and sensors that measured where they were not.
    fn replay(&mut self, truth: &Truth) {
        if truth.forgotten_count() > 0 {
            let count = truth.forgotten_count();
            self.problems.push(format!("the log has forgotten its first {count} occurrences"));
        }
        let layout = &self.scenario.layout;
        let mut places = starts(layout);
        for Occurrence { sequence, event, .. } in truth.occurrences() {
            match event {
                Event::Moved { robot, from, to } => {
                    let stood = places.insert(robot, to);
                    if stood != Some(from) || layout.meters(from, to).is_none() {
                        self.problems
                            .push(format!("`{robot}` went from `{from}` to `{to}`: no way it had"));
                    }
                }
                Event::Read { sensor, location, .. } => {
                    self.prove(*sequence, sensor, location, &places);
                }
                _ => (),
            }
        }
    }

    fn prove(
        &mut self,
        sequence: u64,
        sensor: &str,
        location: &str,
        places: &BTreeMap<&String, &String>,
    ) {
        let (place, mounted) = match self.scenario.layout.device(sensor) {
            Some(Device::FixedSensor { location, .. }) => (Some(location), false),
            Some(Device::MountedSensor { carrier, .. }) => (places.get(carrier).copied(), true),
            _ => (None, false),
        };
        if place.map(String::as_str) != Some(location) {
            let place = place.map_or("nowhere", String::as_str);
            self.problems.push(format!("`{sensor}` measured `{location}` and was in `{place}`"));
            return;
        }
        let (sensor, room) = (sensor.to_owned(), location.to_owned());
        self.readings.push(Proven { sequence, sensor, room, mounted });
    }

    fn death_was_as_planned(&mut self, truth: &Truth) {
        let SeededScenario { dying_sensor, dies, .. } = self.scenario;
        let died = truth.occurrences().any(|occurrence| {
            occurrence.sequence == self.death
                && matches!(&occurrence.event, Event::Broken { device, .. } if device == dying_sensor)
        });
        let reports = |after: bool| {
            let by_it = self.readings.iter().filter(|reading| reading.sensor == *dying_sensor);
            by_it.filter(|reading| (reading.sequence > self.death) == after).count()
        };
        let (before, after) = (reports(false), reports(true));
        let mut problem = |text: &str| self.problems.push(format!("`{dying_sensor}` {text}"));
        if !died {
            problem("did not die when the scenario says it did");
        }
        if after > 0 {
            problem("measured after its death");
        }
        match dies {
            Dies::AfterReport if before == 0 => problem("died before it ever measured"),
            Dies::BeforeReport if before > 0 => problem("measured before its death"),
            _ => (),
        }
    }

    fn rooms_were_measured(&mut self) {
        let layout = &self.scenario.layout;
        let bare: BTreeSet<&str> = layout.rooms_without_sensor().collect();
        let (limit, when) = match self.scenario.dies {
            Dies::AfterReport => {
                (self.death, format!(" before `{}` died", self.scenario.dying_sensor))
            }
            // Nothing needs to have been measured yet when it is first asked.
            Dies::BeforeReport => (u64::MAX, String::new()),
        };
        for room in required_rooms(layout) {
            let needs_robot = bare.contains(room);
            // A room without a sensor can only be proven to be measured by a robot.
            let measured = self.readings.iter().any(|by| by.room == room && by.sequence < limit);
            if !measured {
                let by = if needs_robot { "by a robot " } else { "" };
                self.problems.push(format!("`{room}` was not measured {by}at all{when}"));
            }
        }
    }

    fn dead_sensor_was_replaced(&mut self) {
        let room = self.scenario.dying_room();
        let replaced = self.readings.iter().any(|reading| {
            reading.room == room && reading.mounted && reading.sequence > self.death
        });
        if !replaced {
            let sensor = &self.scenario.dying_sensor;
            self.problems.push(format!("no robot measured `{room}` after `{sensor}` died"));
        }
    }

    fn told_values_are_true(&mut self, truth: &Truth, told: &BTreeMap<String, f64>) {
        for room in required_rooms(&self.scenario.layout) {
            if !told.contains_key(room) {
                self.problems.push(format!("the user was not told the temperature of `{room}`"));
            }
        }
        for (room, celsius) in told {
            match truth.temperature(room) {
                Some(true_celsius) if (celsius - true_celsius).abs() <= CELSIUS_TOLERANCE => (),
                Some(true_celsius) => self.problems.push(format!(
                    "the user was told {celsius} °C for `{room}`; the truth is {true_celsius} °C"
                )),
                None => self
                    .problems
                    .push(format!("the user was told of `{room}`, which does not exist")),
            }
        }
    }
}

/// Where each robot stands at the start.
fn starts(layout: &Layout) -> BTreeMap<&String, &String> {
    let robots = layout.devices().iter().filter_map(|device| match device {
        Device::Robot { name, start, .. } => Some((name, start)),
        _ => None,
    });
    robots.collect()
}

/// The rooms whose temperature can be known: by their own sensor or by a robot.
fn required_rooms(layout: &Layout) -> Vec<&str> {
    let measurable = layout.measurable_by_robots();
    let has_sensor = |room: &str| layout.fixed_sensors_in(room).next().is_some();
    layout.rooms().filter(|room| has_sensor(room) || measurable.contains(room)).collect()
}

#[cfg(test)]
mod tests;
