//! A parcel on a shelf that only an arm reaches: the arm loads it on a robot that stands still before
//! it, and the robot brings it to another room. No agent reaches the goal alone, and where the arm
//! keeps its parcels is its own business.
//!
//! Seed 0 is a bay, a laboratory and a hall. Every other seed draws another building, with one to three
//! parcels, and one or two robots.

use serde::Serialize;

use crate::draw::LayoutDraw;
use crate::error::LayoutError;
use crate::layout::{BuildingDevice, Layout};
use crate::replay::replay;
use crate::truth::{BuildingEvent, Truth};

const ARM: &str = "arm-1";
const SHELVES: [&str; 4] = ["shelf-1", "shelf-2", "shelf-3", "shelf-4"];
const PARCELS: [&str; 3] = ["parcel-1", "parcel-2", "parcel-3"];
const ROBOTS: [&str; 2] = ["courier-1", "courier-2"];

/// A building with an arm, and a parcel on one of its shelves that is to be brought to another room.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ArmScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building, with all devices and parcels.
    pub layout: Layout,
    /// Name of the parcel.
    pub parcel: String,
    /// Name of the room to which the parcel is to be brought.
    pub target: String,
}

impl ArmScenario {
    /// Returns the scenario of this seed, which is the same on every machine.
    pub fn seeded(seed: u64) -> ArmScenario {
        let drawn = if seed == 0 { small_building() } else { draw(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }

    /// Returns the name of the arm.
    pub fn arm(&self) -> &'static str {
        ARM
    }

    /// Returns the names of the arm's shelves, which other agents never learn.
    pub fn shelves(&self) -> &[String] {
        match self.layout.device(ARM) {
            Some(BuildingDevice::Arm { shelves, .. }) => shelves,
            _ => &[],
        }
    }

    /// Checks the scenario against the truth: the parcel is in the room, the arm has loaded it on a
    /// robot, and the robot that it loaded last has come to the room afterwards.
    ///
    /// # Errors
    ///
    /// Returns a text for each way in which the scenario failed.
    pub fn check(&self, truth: &Truth) -> Result<(), Vec<String>> {
        let mut problems = replay(&self.layout, truth).problems;
        problems.extend(truth.misplaced(&self.parcel, &self.target));
        let loaded = truth.occurrences().rev().find_map(|occurrence| match &occurrence.event {
            BuildingEvent::Loaded { robot, parcel, .. } if *parcel == self.parcel => {
                Some((robot, occurrence.sequence))
            }
            _ => None,
        });
        let Some((carrier, sequence)) = loaded else {
            problems.push(format!("`{ARM}` has loaded `{}` on no robot", self.parcel));
            return Err(problems);
        };
        let is_arrival = |event: &BuildingEvent| matches!(event, BuildingEvent::Moved { robot, to, .. } if robot == carrier && *to == self.target);
        let mut later = truth.occurrences().filter(|it| it.sequence > sequence);
        if !later.any(|occurrence| is_arrival(&occurrence.event)) {
            problems.push(format!("`{carrier}` did not come to `{}` with it", self.target));
        }
        if problems.is_empty() { Ok(()) } else { Err(problems) }
    }
}

fn small_building() -> Result<ArmScenario, LayoutError> {
    let mut layout = Layout::new();
    layout
        .add_room("bay", 18.0)?
        .add_room("lab", 21.5)?
        .add_corridor("hall", 19.0)?
        .connect("hall", "bay", 5.0)?
        .connect("hall", "lab", 7.0)?;
    layout.add_arm(ARM, "bay", &SHELVES[..2], &[(PARCELS[0], SHELVES[1])])?;
    layout.add_robot(ROBOTS[0], "hall", 0.5)?;
    let (parcel, target) = (PARCELS[0].to_owned(), "lab".to_owned());
    Ok(ArmScenario { seed: 0, layout, parcel, target })
}

fn draw(seed: u64) -> Result<ArmScenario, LayoutError> {
    let mut draw = LayoutDraw::new(seed);
    let mut layout = draw.places()?;
    let rooms = draw.random.sample(&draw.rooms, 2);
    let (bay, target) = (rooms[0], rooms[1]);
    let shelves = &SHELVES[..draw.random.between(2, SHELVES.len())];
    let count = draw.random.between(1, PARCELS.len().min(shelves.len()));
    let places = draw.random.sample(shelves, count);
    let stored: Vec<(&str, &str)> = PARCELS.into_iter().zip(places).collect();
    layout.add_arm(ARM, bay, shelves, &stored)?;
    let places: Vec<&str> = draw.rooms.iter().chain(&draw.corridors).copied().collect();
    for robot in &ROBOTS[..draw.random.between(1, ROBOTS.len())] {
        let start = places[draw.random.below(places.len())];
        let speed = draw.random.between(2, 10) as f64 / 10.0;
        layout.add_robot(robot, start, speed)?;
    }
    let parcel = stored[draw.random.below(stored.len())].0.to_owned();
    Ok(ArmScenario { seed, layout, parcel, target: target.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::{ARM, ArmScenario, PARCELS, ROBOTS};
    use crate::Building;

    #[tokio::test(start_paused = true)]
    async fn a_parcel_that_is_loaded_and_brought_passes_the_check() {
        let scenario = ArmScenario::seeded(0);
        let building = Building::new(scenario.layout.clone(), 0.0).unwrap();
        let problems = || scenario.check(&building.truth()).err().unwrap_or_default().join(" ");
        assert!(problems().contains("has loaded `parcel-1` on no robot"), "{}", problems());
        building.grip(ARM, PARCELS[0]).await.unwrap();
        building.navigate(ROBOTS[0], "bay").await.unwrap();
        building.load(ARM, PARCELS[0], ROBOTS[0]).await.unwrap();
        assert!(problems().contains("did not come to `lab` with it"), "{}", problems());
        building.navigate(ROBOTS[0], "hall").await.unwrap();
        building.navigate(ROBOTS[0], "lab").await.unwrap();
        assert!(problems().contains("is not at `lab`"), "{}", problems());
        building.set_down(ROBOTS[0], None).await.unwrap();
        assert_eq!(problems(), "");
    }

    #[test]
    fn every_building_has_an_arm_with_the_parcel_in_another_room() {
        for seed in 0..200 {
            let scenario = ArmScenario::seeded(seed);
            let truth = Building::new(scenario.layout.clone(), 0.0).unwrap().truth();
            assert!(!scenario.shelves().is_empty(), "{seed}");
            assert!(truth.parcel(&scenario.parcel).is_some(), "{seed}");
            assert_ne!(truth.place_of(ARM), Some(scenario.target.as_str()), "{seed}");
        }
    }
}
