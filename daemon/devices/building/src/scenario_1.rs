//! Check whether scenario 1 of the paper took place, based on the truth alone.
//!
//! “The goal here is to collect temperature measurements from all rooms …”: each room is measured,
//! and a room without a sensor is measured by a robot that is truly in it. Then a sensor dies, and
//! a robot measures the room of that sensor as well. The check replays the log, so that it relies
//! neither on the agents nor on the locations in the truth.

use std::collections::{BTreeMap, BTreeSet};

use crate::layout::Layout;
use crate::replay::{ConfirmedReading, ReplayedLog, false_reports, replay};
use crate::seeded::{DeathTime, SeededScenario};
use crate::truth::{BuildingEvent, Truth};

/// Checks scenario 1 against the truth.
///
/// `death` is the sequence number of the occurrence in which the sensor broke, as
/// [`SeededScenario::death`] returns it. `told` has the last value that the user received for each
/// room, in °C.
///
/// The following must hold:
/// 1. Every room that has a sensor, or that a robot with a sensor can reach, was measured. A room
///    without a sensor was measured by a mounted sensor in the room. If the sensor dies after its
///    report, all these measurements were before its death.
/// 2. The sensor died before or after its report, as planned in the scenario, and has not measured
///    since.
/// 3. After the sensor's death, its room was measured by a mounted sensor in the room. This fails
///    if no agent plans again.
/// 4. The last value that the user received for each room is true.
///
/// # Errors
///
/// Returns a text for each way in which the scenario failed.
pub fn check_scenario_1(
    scenario: &SeededScenario,
    truth: &Truth,
    death: u64,
    told: &BTreeMap<String, f64>,
) -> Result<(), Vec<String>> {
    let ReplayedLog { readings, problems, .. } = replay(&scenario.layout, truth);
    let mut check = MeasuringCheck { scenario, death, problems, readings };
    check.death_was_as_planned(truth);
    check.rooms_were_measured();
    check.dead_sensor_was_replaced();
    check.told_values_are_true(truth, told);
    if check.problems.is_empty() { Ok(()) } else { Err(check.problems) }
}

struct MeasuringCheck<'a> {
    scenario: &'a SeededScenario,
    death: u64,
    problems: Vec<String>,
    readings: Vec<ConfirmedReading>,
}

impl MeasuringCheck<'_> {
    fn death_was_as_planned(&mut self, truth: &Truth) {
        let SeededScenario { dying_sensor, dies, .. } = self.scenario;
        let died = truth.occurrences().any(|occurrence| {
            occurrence.sequence == self.death
                && matches!(&occurrence.event, BuildingEvent::Broken { device, .. } if device == dying_sensor)
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
            DeathTime::AfterReport if before == 0 => problem("died before it ever measured"),
            DeathTime::BeforeReport if before > 0 => problem("measured before its death"),
            _ => (),
        }
    }

    fn rooms_were_measured(&mut self) {
        let layout = &self.scenario.layout;
        let bare: BTreeSet<&str> = layout.rooms_without_sensor().collect();
        let (limit, when) = match self.scenario.dies {
            DeathTime::AfterReport => {
                (self.death, format!(" before `{}` died", self.scenario.dying_sensor))
            }
            // If the sensor dies at its first request, no room need have been measured before its
            // death.
            DeathTime::BeforeReport => (u64::MAX, String::new()),
        };
        for room in required_rooms(layout) {
            let needs_robot = bare.contains(room);
            // A room without a fixed sensor can only have a reading by a robot.
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
        self.problems.extend(false_reports(truth, told));
    }
}

/// Returns the rooms that have a temperature sensor or that a robot with a sensor can reach.
fn required_rooms(layout: &Layout) -> Vec<&str> {
    let measurable = layout.measurable_by_robots();
    let has_sensor = |room: &str| layout.fixed_sensors_in(room).next().is_some();
    layout.rooms().filter(|room| has_sensor(room) || measurable.contains(room)).collect()
}

#[cfg(test)]
mod tests;
