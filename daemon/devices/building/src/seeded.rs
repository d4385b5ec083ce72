//! Draws one building per seed in which scenario 1 of the paper can be played.
//!
//! Seed 0 is the paper's own office. For every other seed, these are drawn at random: the rooms,
//! corridors, doors, distances and temperatures, the rooms without a sensor, the sensor that dies,
//! the time of its death, and one or two robots. The scenario can succeed with every choice.

use serde::Serialize;

use crate::building::Building;
use crate::draw::{LayoutDraw, ROBOTS, paper_places, sensor_of};
use crate::error::LayoutError;
use crate::layout::{BuildingDevice, Layout};
use crate::truth::{BuildingEvent, DeviceFault, Truth};

/// The time at which the sensor dies.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeathTime {
    /// The sensor dies at its first request: an agent relies on the sensor, and the sensor never
    /// answers.
    BeforeReport,
    /// The sensor dies after every room has been measured, by its own sensor or by a robot.
    AfterReport,
}

/// A building, and the events of scenario 1 in it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SeededScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building.
    pub layout: Layout,
    /// Name of the fixed sensor that dies.
    pub dying_sensor: String,
    /// The time at which the sensor dies.
    pub dies: DeathTime,
    /// Temperature of the sensor's room from its death on, in °C, if the sensor dies after its
    /// report. The last value of the sensor is then no longer true, so that the check detects an
    /// agent that repeats it.
    pub celsius_after_death: f64,
}

impl Layout {
    /// Returns the scenario of this seed, which is the same on every machine.
    pub fn seeded(seed: u64) -> SeededScenario {
        let drawn = if seed == 0 { paper_office() } else { LayoutDraw::new(seed).scenario(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }
}

// === impl SeededScenario ===

impl SeededScenario {
    /// Returns the name of the room of the sensor that dies.
    pub fn dying_room(&self) -> &str {
        match self.layout.device(&self.dying_sensor) {
            Some(BuildingDevice::FixedSensor { location, .. }) => location,
            _ => unreachable!("invariant: the dying sensor is a fixed one of the layout"),
        }
    }

    /// Prepares the death of the sensor. Must be called before any agent acts.
    ///
    /// # Errors
    ///
    /// Returns an error if the sensor is not in the building.
    pub fn arm(&self, building: &Building, fault: DeviceFault) -> Result<(), LayoutError> {
        match self.dies {
            DeathTime::BeforeReport => building.break_at_next_use(&self.dying_sensor, fault),
            DeathTime::AfterReport => Ok(()),
        }
    }

    /// Waits for the time of death, lets the sensor die, and returns the sequence number of the
    /// death in the log. The wait may last forever; the caller sets a deadline.
    ///
    /// # Errors
    ///
    /// Returns an error if the sensor or its room is not in the building.
    pub async fn death(&self, building: &Building, fault: DeviceFault) -> Result<u64, LayoutError> {
        match self.dies {
            DeathTime::BeforeReport => {
                let truth = building.wait_for(|truth| self.death_in(truth).is_some()).await;
                Ok(self.death_in(&truth).expect("invariant: it was waited for"))
            }
            DeathTime::AfterReport => {
                building
                    .wait_for(|truth| self.layout.rooms().all(|room| truth.was_read(room)))
                    .await;
                building.break_and_set_temperature(
                    &self.dying_sensor,
                    fault,
                    self.dying_room(),
                    self.celsius_after_death,
                )
            }
        }
    }

    fn death_in(&self, truth: &Truth) -> Option<u64> {
        let dies = |event: &BuildingEvent| matches!(event, BuildingEvent::Broken { device, .. } if *device == self.dying_sensor);
        truth.occurrences().find(|occurrence| dies(&occurrence.event)).map(|death| death.sequence)
    }
}

// === Drawing ===

/// Returns the paper's office, with the devices of scenario 1.
fn paper_office() -> Result<SeededScenario, LayoutError> {
    let mut layout = paper_places()?;
    layout
        .add_fixed_sensor("thermometer-office2", "office2")?
        .add_fixed_sensor("thermometer-conf-room", "conf-room")?
        .add_robot("turtlebot-1", "corridor", 0.3)?
        .mount("ir-1", "turtlebot-1")?;
    Ok(SeededScenario {
        seed: 0,
        layout,
        dying_sensor: "thermometer-office2".to_owned(),
        dies: DeathTime::AfterReport,
        celsius_after_death: 23.5,
    })
}

impl LayoutDraw {
    fn scenario(mut self, seed: u64) -> Result<SeededScenario, LayoutError> {
        let mut layout = self.places()?;
        let sensors_count = self.random.between(1, self.rooms.len() - 1);
        let equipped = self.random.sample(&self.rooms, sensors_count);
        for room in &equipped {
            layout.add_fixed_sensor(&sensor_of(room), room)?;
        }
        self.add_robots(&mut layout, &equipped)?;
        let dying_room = equipped[self.random.below(equipped.len())];
        let dies =
            if self.random.once_in(2) { DeathTime::BeforeReport } else { DeathTime::AfterReport };
        Ok(SeededScenario {
            seed,
            layout,
            dying_sensor: sensor_of(dying_room),
            dies,
            celsius_after_death: self.temperatures[self.rooms.len() + self.corridors.len()],
        })
    }

    /// Adds the robots. Each starts in a place without a sensor, so that a measurement by robot
    /// always costs more than one by the sensor of a room.
    fn add_robots(&mut self, layout: &mut Layout, equipped: &[&str]) -> Result<(), LayoutError> {
        let bare = self.rooms.iter().filter(|room| !equipped.contains(room));
        let starts: Vec<&str> = bare.chain(&self.corridors).copied().collect();
        let robots_count = self.random.between(1, 2);
        let robots = self.random.sample(&ROBOTS, robots_count);
        for robot in &robots {
            let start = starts[self.random.below(starts.len())];
            let meters_per_second = self.random.between(2, 10) as f64 / 10.0;
            layout.add_robot(robot, start, meters_per_second)?;
        }
        for (index, robot) in robots.iter().enumerate() {
            layout.mount(&format!("ir-{}", index + 1), robot)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
