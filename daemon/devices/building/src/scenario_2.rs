//! Scenario 2 of the paper: all temperatures must be kept known while sensors die and two robots
//! share the work. Later a new sensor reduces the work of the robots.
//!
//! Seed 0 is the paper's office with a second robot in the conference room. Every other seed draws
//! two wings, with a distance so great that driving to the other wing is never worthwhile.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::building::Building;
use crate::draw::{CORRIDORS, ROOMS, paper_places, sensor_of};
use crate::error::LayoutError;
use crate::layout::{BuildingDevice, Layout};
use crate::replay::{ConfirmedReading, ReplayedLog, false_reports, replay};
use crate::seeded_random::Random;
use crate::truth::{BuildingEvent, DeviceFault, Truth};

/// Names of the two robots, one in each wing.
const ROBOTS: [&str; 2] = ["turtlebot-1", "turtlebot-2"];

/// A sensor that dies, and the temperature of its room afterwards.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SensorDeath {
    /// Name of the fixed sensor that dies.
    pub sensor: String,
    /// Name of the room of the sensor.
    pub room: String,
    /// Temperature of the room from the death on, in °C. The last value of the sensor is then no
    /// longer true.
    pub celsius_after: f64,
}

/// A building, and the events of scenario 2 in it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MaintenanceScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building, with all devices that are in it at any time.
    pub layout: Layout,
    /// Names of the places of each robot's wing. A robot never has a reason to leave its wing.
    pub wings: [BTreeSet<String>; 2],
    /// The two deaths of sensors, in the order in which they happen.
    pub deaths: [SensorDeath; 2],
    /// Name of the sensor that is added last, to a room without a sensor.
    pub latecomer: String,
}

impl SensorDeath {
    /// Makes the sensor hang and changes the temperature of its room. Returns the sequence number
    /// of the break in the log.
    ///
    /// # Errors
    ///
    /// Returns an error if the building has no such sensor or room.
    pub fn trigger(&self, building: &Building) -> Result<u64, LayoutError> {
        let SensorDeath { sensor, room, celsius_after } = self;
        building.break_and_set_temperature(sensor, DeviceFault::Hangs, room, *celsius_after)
    }
}

impl MaintenanceScenario {
    /// Returns the scenario of this seed, which is the same on every machine.
    pub fn seeded(seed: u64) -> MaintenanceScenario {
        let drawn = if seed == 0 { paper_office() } else { draw(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }

    /// Returns the layout at the start: without the sensor that is added last.
    pub fn initial_layout(&self) -> Layout {
        let mut layout = self.layout.clone();
        layout.remove_device(&self.latecomer);
        layout
    }

    /// Adds the last sensor to the building.
    ///
    /// # Errors
    ///
    /// Returns an error if the sensor was added before.
    pub fn plug_in(&self, building: &Building) -> Result<(), LayoutError> {
        let (name, location) = (self.latecomer.clone(), self.late_room().to_owned());
        building.add_device(BuildingDevice::FixedSensor { name, location })
    }

    /// Returns the name of the room of the last sensor.
    pub fn late_room(&self) -> &str {
        match self.layout.device(&self.latecomer) {
            Some(BuildingDevice::FixedSensor { location, .. }) => location,
            _ => unreachable!("invariant: the latecomer is a fixed sensor of the layout"),
        }
    }

    /// Checks the scenario against the truth. `told` has the last value that the user received for
    /// each room, in °C.
    ///
    /// The following must hold:
    /// 1. Before the first death, and between the second death and the new sensor, every room was
    ///    measured. After each death, the room of the dead sensor was measured by a robot.
    /// 2. Both robots measured, and neither ever left its wing, because the distance between the
    ///    wings makes that expensive.
    /// 3. From the new sensor's first reading on, no robot measured the room of the new sensor, and
    ///    the rooms of the dead sensors were still measured. This fails if the agents do not
    ///    replace the plan by the cheaper one that the new sensor makes possible.
    /// 4. The dead sensors did not measure again, and the last value that the user received for
    ///    each room is true.
    ///
    /// # Errors
    ///
    /// Returns a text for each way in which the scenario failed.
    pub fn check(&self, truth: &Truth, told: &BTreeMap<String, f64>) -> Result<(), Vec<String>> {
        let ReplayedLog { readings, trips, problems } = replay(&self.layout, truth);
        let mut check = MaintenanceCheck { scenario: self, readings, problems };
        let Some([first, second, plugged]) = check.moments(truth) else {
            return Err(check.problems);
        };
        check.dead_are_silent([first, second]);
        check.rooms_were_measured("before the first sensor died", 0..first);
        check.robot_measured(&self.deaths[0].room, "between the deaths", first..second);
        check.rooms_were_measured("after both sensors died", second..plugged);
        for death in &self.deaths {
            check.robot_measured(&death.room, "after both sensors died", second..plugged);
        }
        check.robots_share(&trips, second..plugged);
        check.latecomer_takes_over(plugged);
        let untold = |room: &&str| !told.contains_key(*room);
        for room in self.layout.rooms().filter(untold) {
            check.problems.push(format!("the user was not told the temperature of `{room}`"));
        }
        check.problems.extend(false_reports(truth, told));
        if check.problems.is_empty() { Ok(()) } else { Err(check.problems) }
    }
}

// === Drawing ===

fn paper_office() -> Result<MaintenanceScenario, LayoutError> {
    let mut layout = paper_places()?;
    layout
        .add_fixed_sensor("thermometer-office2", "office2")?
        .add_fixed_sensor("thermometer-conf-room", "conf-room")?
        .add_robot(ROBOTS[0], "corridor", 0.3)?
        .add_robot(ROBOTS[1], "conf-room", 0.3)?;
    let wing = |places: &[&str]| places.iter().map(|place| (*place).to_owned()).collect();
    let wings = [wing(&["corridor", "office1", "office2"]), wing(&["conf-room"])];
    let deaths = [("office2", 23.5), ("conf-room", 24.5)];
    finish(0, layout, wings, deaths, "office1")
}

/// Draws a scenario with 16 to 20 meters between the wings, and at most 6 meters from a corridor to
/// each of its rooms.
fn draw(seed: u64) -> Result<MaintenanceScenario, LayoutError> {
    let mut random = Random::new(seed);
    let rooms_count = random.between(3, 6);
    let rooms = random.sample(&ROOMS, rooms_count);
    let corridors = random.sample(&CORRIDORS, 2);
    let tenths: Vec<usize> = (160..=280).collect();
    let tenths = random.sample(&tenths, rooms_count + 4);
    let mut temperatures = tenths.iter().map(|tenth| *tenth as f64 / 10.0);
    let mut celsius = || temperatures.next().expect("invariant: one is drawn for each place");
    let mut layout = Layout::new();
    for corridor in &corridors {
        layout.add_corridor(corridor, celsius())?;
    }
    let between = random.between(32, 40) as f64 / 2.0;
    layout.connect(corridors[0], corridors[1], between)?;
    let mut wings = [0, 1].map(|wing: usize| BTreeSet::from([corridors[wing].to_owned()]));
    for (index, room) in rooms.iter().enumerate() {
        // The first wing has the room without a sensor and the room of the sensor that dies first.
        // The other wing has the room of the sensor that dies second.
        let wing = if index < 3 { usize::from(index == 2) } else { random.below(2) };
        layout.add_room(room, celsius())?;
        layout.connect(corridors[wing], room, random.between(2, 12) as f64 / 2.0)?;
        wings[wing].insert((*room).to_owned());
    }
    for room in &rooms[1..] {
        layout.add_fixed_sensor(&sensor_of(room), room)?;
    }
    for (robot, corridor) in ROBOTS.iter().zip(&corridors) {
        layout.add_robot(robot, corridor, random.between(2, 10) as f64 / 10.0)?;
    }
    let deaths = [(rooms[1], celsius()), (rooms[2], celsius())];
    finish(seed, layout, wings, deaths, rooms[0])
}

/// Mounts the robots' sensors, and adds the sensor that is plugged in last.
fn finish(
    seed: u64,
    mut layout: Layout,
    wings: [BTreeSet<String>; 2],
    deaths: [(&str, f64); 2],
    bare: &str,
) -> Result<MaintenanceScenario, LayoutError> {
    for (index, robot) in ROBOTS.iter().enumerate() {
        layout.mount(&format!("ir-{}", index + 1), robot)?;
    }
    let latecomer = sensor_of(bare);
    layout.add_fixed_sensor(&latecomer, bare)?;
    let deaths = deaths.map(|(room, celsius_after)| SensorDeath {
        sensor: sensor_of(room),
        room: room.to_owned(),
        celsius_after,
    });
    Ok(MaintenanceScenario { seed, layout, wings, deaths, latecomer })
}

// === Checking ===

struct MaintenanceCheck<'a> {
    scenario: &'a MaintenanceScenario,
    readings: Vec<ConfirmedReading>,
    problems: Vec<String>,
}

impl MaintenanceCheck<'_> {
    /// Returns the sequence numbers of the first death, the second death, and the addition of the
    /// new sensor. Returns `None` if they did not happen in this order.
    fn moments(&mut self, truth: &Truth) -> Option<[u64; 3]> {
        let when = |sort: &dyn Fn(&BuildingEvent) -> bool| {
            let found = truth.occurrences().find(|occurrence| sort(&occurrence.event));
            found.map(|occurrence| occurrence.sequence)
        };
        let [first, second] = self.scenario.deaths.each_ref().map(|death| {
            when(&|event| matches!(event, BuildingEvent::Broken { device, .. } if *device == death.sensor))
        });
        let latecomer = &self.scenario.latecomer;
        let added =
            when(&|event| matches!(event, BuildingEvent::Added { device } if device == latecomer));
        match (first, second, added) {
            (Some(first), Some(second), Some(added)) if first < second && second < added => {
                Some([first, second, added])
            }
            moments => {
                let problem = format!("expected two deaths and then a new sensor, at: {moments:?}");
                self.problems.push(problem);
                None
            }
        }
    }

    fn within(
        &self,
        span: &std::ops::Range<u64>,
    ) -> impl Iterator<Item = &ConfirmedReading> + use<'_> {
        let span = span.clone();
        self.readings.iter().filter(move |reading| span.contains(&reading.sequence))
    }

    fn dead_are_silent(&mut self, deaths: [u64; 2]) {
        for (death, at) in self.scenario.deaths.iter().zip(deaths) {
            if self.within(&(at..u64::MAX)).any(|reading| reading.sensor == death.sensor) {
                self.problems.push(format!("`{}` measured after its death", death.sensor));
            }
        }
    }

    fn rooms_were_measured(&mut self, when: &str, span: std::ops::Range<u64>) {
        for room in self.scenario.layout.rooms() {
            if !self.within(&span).any(|reading| reading.room == room) {
                self.problems.push(format!("`{room}` was not measured {when}"));
            }
        }
    }

    fn robot_measured(&mut self, room: &str, when: &str, span: std::ops::Range<u64>) {
        if !self.within(&span).any(|reading| reading.room == room && reading.mounted) {
            self.problems.push(format!("no robot measured `{room}` {when}"));
        }
    }

    fn robots_share(&mut self, trips: &[crate::replay::Trip], span: std::ops::Range<u64>) {
        for (index, robot) in ROBOTS.iter().enumerate() {
            let sensor = format!("ir-{}", index + 1);
            if !self.within(&span).any(|reading| reading.sensor == sensor) {
                self.problems.push(format!("`{robot}` measured nothing"));
            }
            let wing = &self.scenario.wings[index];
            let away = trips.iter().find(|trip| trip.robot == *robot && !wing.contains(&trip.to));
            if let Some(trip) = away {
                let to = &trip.to;
                self.problems.push(format!(
                    "`{robot}` drove to `{to}`, to which the other robot was closer"
                ));
            }
        }
    }

    fn latecomer_takes_over(&mut self, plugged: u64) {
        let (latecomer, room) = (&self.scenario.latecomer, self.scenario.late_room());
        let by_it: Vec<_> = self
            .within(&(plugged..u64::MAX))
            .filter(|reading| reading.sensor == *latecomer)
            .map(|reading| reading.sequence)
            .collect();
        let Some(first) = by_it.first() else {
            return self.problems.push(format!("`{latecomer}` never measured"));
        };
        let since = *first..u64::MAX;
        let in_vain = self.within(&since).filter(|by| by.mounted && by.room == room).count();
        if by_it.len() == 1 {
            self.problems.push(format!("`{room}` was not measured again by `{latecomer}`"));
        }
        if in_vain > 0 {
            let problem =
                format!("robots measured `{room}` {in_vain} times after `{latecomer}` did");
            self.problems.push(problem);
        }
        for death in &self.scenario.deaths {
            self.robot_measured(&death.room, "after the new sensor came", since.clone());
        }
    }
}

#[cfg(test)]
mod tests;
