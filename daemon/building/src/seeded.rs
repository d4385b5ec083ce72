//! Another building per seed, in which scenario 1 of the paper can be played.
//!
//! Seed 0 is the paper's own office. Every other seed draws rooms, corridors,
//! doors, distances, temperatures, which rooms lack a sensor, which sensor dies
//! and when, and one or two robots; always so that the scenario can hold.

use serde::Serialize;

use crate::building::Building;
use crate::error::LayoutError;
use crate::layout::{Device, Layout};
use crate::random::Random;
use crate::truth::{Event, Fault, Truth};

const ROOMS: [&str; 16] = [
    "archive",
    "atelier",
    "canteen",
    "clinic",
    "kitchen",
    "lab",
    "library",
    "lounge",
    "office1",
    "office2",
    "office3",
    "server-room",
    "store",
    "studio",
    "ward",
    "workshop",
];
const CORRIDORS: [&str; 6] = ["arcade", "corridor", "gallery", "hall", "lobby", "passage"];
const ROBOTS: [&str; 4] = ["turtlebot-1", "turtlebot-2", "rover", "trolley"];

/// When the sensor dies.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Dies {
    /// When it is first asked: somebody relies on it, and it never answers.
    BeforeReport,
    /// When every room has been measured, its own by it or by a robot.
    AfterReport,
}

/// A building and what fate has in store for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SeededScenario {
    /// The seed that it was drawn from.
    pub seed: u64,
    /// The building.
    pub layout: Layout,
    /// The fixed sensor that dies.
    pub dying_sensor: String,
    /// When it dies.
    pub dies: Dies,
    /// The temperature of its room from then on, where it had reported before:
    /// what it said is then no longer true, and repeating it is noticed.
    pub celsius_after_death: f64,
}

impl Layout {
    /// The scenario of this seed: the same on every machine, another per seed.
    pub fn seeded(seed: u64) -> SeededScenario {
        let drawn = if seed == 0 { paper_office() } else { Draw::new(seed).scenario(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }
}

// === impl SeededScenario ===

impl SeededScenario {
    /// The room of the sensor that dies.
    pub fn dying_room(&self) -> &str {
        match self.layout.device(&self.dying_sensor) {
            Some(Device::FixedSensor { location, .. }) => location,
            _ => unreachable!("invariant: the dying sensor is a fixed one of the layout"),
        }
    }

    /// Prepares the building. Call it before any agent acts.
    pub fn arm(&self, building: &Building, fault: Fault) -> Result<(), LayoutError> {
        match self.dies {
            Dies::BeforeReport => building.break_at_next_use(&self.dying_sensor, fault),
            Dies::AfterReport => Ok(()),
        }
    }

    /// Waits for the moment of death, lets the sensor die, and returns the
    /// sequence number of that occurrence. Whoever calls it has a deadline.
    pub async fn death(&self, building: &Building, fault: Fault) -> Result<u64, LayoutError> {
        match self.dies {
            Dies::BeforeReport => {
                let truth = building.wait_for(|truth| self.death_in(truth).is_some()).await;
                Ok(self.death_in(&truth).expect("invariant: it was waited for"))
            }
            Dies::AfterReport => {
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
        let dies = |event: &Event| matches!(event, Event::Broken { device, .. } if *device == self.dying_sensor);
        truth.occurrences().find(|occurrence| dies(&occurrence.event)).map(|death| death.sequence)
    }
}

// === Drawing ===

/// The test bed of the paper: two offices, a conference room, one corridor.
/// The paper gives no distances and temperatures; these are ours.
fn paper_office() -> Result<SeededScenario, LayoutError> {
    let mut layout = Layout::new();
    layout
        .add_room("office1", 20.5)?
        .add_room("office2", 21.5)?
        .add_room("conf-room", 22.5)?
        .add_corridor("corridor", 19.0)?
        .connect("corridor", "office1", 4.0)?
        .connect("corridor", "office2", 6.0)?
        .connect("corridor", "conf-room", 8.0)?
        .add_fixed_sensor("thermometer-office2", "office2")?
        .add_fixed_sensor("thermometer-conf-room", "conf-room")?
        .add_robot("turtlebot-1", "corridor", 0.3)?
        .mount("ir-1", "turtlebot-1")?;
    Ok(SeededScenario {
        seed: 0,
        layout,
        dying_sensor: "thermometer-office2".to_owned(),
        dies: Dies::AfterReport,
        celsius_after_death: 23.5,
    })
}

struct Draw {
    random: Random,
    rooms: Vec<&'static str>,
    corridors: Vec<&'static str>,
    /// All different, so that a value told for the wrong room is noticed.
    temperatures: Vec<f64>,
}

impl Draw {
    fn new(seed: u64) -> Draw {
        let mut random = Random::new(seed);
        let rooms_count = random.between(3, 7);
        let corridors_count = random.between(1, 3);
        let tenths: Vec<usize> = (160..=280).collect();
        // One more than there are locations: the temperature after the death.
        let tenths = random.sample(&tenths, rooms_count + corridors_count + 1);
        Draw {
            rooms: random.sample(&ROOMS, rooms_count),
            corridors: random.sample(&CORRIDORS, corridors_count),
            temperatures: tenths.iter().map(|tenth| *tenth as f64 / 10.0).collect(),
            random,
        }
    }

    fn scenario(mut self, seed: u64) -> Result<SeededScenario, LayoutError> {
        let mut layout = Layout::new();
        self.add_locations(&mut layout)?;
        self.connect_all(&mut layout)?;
        self.add_doors(&mut layout)?;
        let sensors_count = self.random.between(1, self.rooms.len() - 1);
        let equipped = self.random.sample(&self.rooms, sensors_count);
        for room in &equipped {
            layout.add_fixed_sensor(&sensor_of(room), room)?;
        }
        self.add_robots(&mut layout, &equipped)?;
        let dying_room = equipped[self.random.below(equipped.len())];
        let dies = if self.random.once_in(2) { Dies::BeforeReport } else { Dies::AfterReport };
        Ok(SeededScenario {
            seed,
            layout,
            dying_sensor: sensor_of(dying_room),
            dies,
            celsius_after_death: self.temperatures[self.rooms.len() + self.corridors.len()],
        })
    }

    fn add_locations(&self, layout: &mut Layout) -> Result<(), LayoutError> {
        let mut temperatures = self.temperatures.iter();
        for (room, celsius) in self.rooms.iter().zip(&mut temperatures) {
            layout.add_room(room, *celsius)?;
        }
        for (corridor, celsius) in self.corridors.iter().zip(&mut temperatures) {
            layout.add_corridor(corridor, *celsius)?;
        }
        Ok(())
    }

    /// A tree: corridors hang on corridors, rooms on a corridor or, one in four,
    /// on another room. So every location can be reached from every other.
    fn connect_all(&mut self, layout: &mut Layout) -> Result<(), LayoutError> {
        for index in 1..self.corridors.len() {
            let to = self.random.below(index);
            let meters = self.meters();
            layout.connect(self.corridors[to], self.corridors[index], meters)?;
        }
        for index in 0..self.rooms.len() {
            let through_a_room = index > 0 && self.random.once_in(4);
            let from = if through_a_room {
                self.rooms[self.random.below(index)]
            } else {
                self.corridors[self.random.below(self.corridors.len())]
            };
            let meters = self.meters();
            layout.connect(from, self.rooms[index], meters)?;
        }
        Ok(())
    }

    /// A few more doors, which make circles.
    fn add_doors(&mut self, layout: &mut Layout) -> Result<(), LayoutError> {
        let places: Vec<&str> = self.rooms.iter().chain(&self.corridors).copied().collect();
        for _ in 0..self.random.below(self.rooms.len()) {
            let ends = self.random.sample(&places, 2);
            let meters = self.meters();
            if layout.meters(ends[0], ends[1]).is_none() {
                layout.connect(ends[0], ends[1], meters)?;
            }
        }
        Ok(())
    }

    /// Robots start where no sensor is, so that driving there and measuring is
    /// never as good as asking the sensor of the room.
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

    /// From 1 to 20 meters, in half meters.
    fn meters(&mut self) -> f64 {
        self.random.between(2, 40) as f64 / 2.0
    }
}

fn sensor_of(room: &str) -> String {
    format!("thermometer-{room}")
}

#[cfg(test)]
mod tests;
