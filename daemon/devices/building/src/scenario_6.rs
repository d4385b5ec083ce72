//! A parcel that changes the floor: each floor has a robot that stays on it, and a lift takes the
//! parcel from one to the other. No agent reaches the goal alone.
//!
//! Seed 0 has two floors with a room each. Every other seed draws two or three floors.

use serde::Serialize;

use crate::draw::ROOMS;
use crate::error::LayoutError;
use crate::layout::Layout;
use crate::replay::replay;
use crate::seeded_random::Random;
use crate::truth::{BuildingEvent, Truth};

const LIFT: &str = "lift-1";
const PARCEL: &str = "parcel-1";
const READER: &str = "tag-reader";

/// A building with a lift, and a parcel that is to be brought to another floor.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FloorsScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building, with all devices and the parcel.
    pub layout: Layout,
    /// Name of the room to which the parcel is to be brought.
    pub target: String,
}

impl FloorsScenario {
    /// Returns the scenario of this seed, which is the same on every machine.
    pub fn seeded(seed: u64) -> FloorsScenario {
        let drawn = if seed == 0 { two_floors() } else { draw(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }

    /// Returns the name of the parcel.
    pub fn parcel(&self) -> &'static str {
        PARCEL
    }

    /// Returns the name of the lift.
    pub fn lift(&self) -> &'static str {
        LIFT
    }

    /// Checks the scenario against the truth: the parcel is in the room, two robots have carried it,
    /// and the cabin has moved in between.
    ///
    /// # Errors
    ///
    /// Returns a text for each way in which the scenario failed.
    pub fn check(&self, truth: &Truth) -> Result<(), Vec<String>> {
        let mut problems = replay(&self.layout, truth).problems;
        problems.extend(truth.misplaced(PARCEL, &self.target));
        let mut carriers: Vec<&String> = Vec::new();
        let mut is_moved_between = false;
        for occurrence in truth.occurrences() {
            match &occurrence.event {
                BuildingEvent::TakenUp { robot, .. } if !carriers.contains(&robot) => {
                    carriers.push(robot);
                }
                BuildingEvent::CabinMoved { .. } if carriers.len() == 1 => is_moved_between = true,
                _ => (),
            }
        }
        if carriers.len() != 2 || !is_moved_between {
            problems.push(format!(
                "the parcel did not ride in the cabin from one robot to another: {carriers:?}"
            ));
        }
        if problems.is_empty() { Ok(()) } else { Err(problems) }
    }
}

fn two_floors() -> Result<FloorsScenario, LayoutError> {
    let mut layout = Layout::new();
    layout
        .add_room("store", 18.0)?
        .add_room("lab", 21.5)?
        .add_corridor("landing-0", 19.0)?
        .add_corridor("landing-1", 20.0)?
        .connect("landing-0", "store", 5.0)?
        .connect("landing-1", "lab", 7.0)?;
    layout.add_robot("courier-0", "store", 0.5)?.add_robot("courier-1", "landing-1", 0.5)?;
    layout.add_lift(LIFT, &["landing-0", "landing-1"])?;
    layout.add_parcel(PARCEL, "store")?.add_tag_reader(READER, "landing-0")?;
    Ok(FloorsScenario { seed: 0, layout, target: "lab".to_owned() })
}

fn draw(seed: u64) -> Result<FloorsScenario, LayoutError> {
    let mut random = Random::new(seed);
    let floors = random.between(2, 3);
    let names = random.sample(&ROOMS, floors * 3);
    let mut layout = Layout::new();
    let mut rooms: Vec<Vec<&str>> = Vec::new();
    let landings: Vec<String> = (0..floors).map(|floor| format!("landing-{floor}")).collect();
    for (floor, landing) in landings.iter().enumerate() {
        let celsius = random.between(160, 280) as f64 / 10.0;
        layout.add_corridor(landing, celsius)?;
        let here: Vec<&str> = names[floor * 3..][..random.between(1, 3)].to_vec();
        for room in &here {
            let celsius = random.between(160, 280) as f64 / 10.0;
            let meters = random.between(2, 40) as f64 / 2.0;
            layout.add_room(room, celsius)?.connect(landing, room, meters)?;
        }
        rooms.push(here);
    }
    for (floor, here) in rooms.iter().enumerate() {
        let start = here[random.below(here.len())];
        let speed = random.between(2, 10) as f64 / 10.0;
        layout.add_robot(&format!("courier-{floor}"), start, speed)?;
    }
    let order: Vec<usize> = (0..floors).collect();
    let ends = random.sample(&order, 2);
    let [from, to] = [0, 1].map(|end| {
        let here = &rooms[ends[end]];
        here[random.below(here.len())]
    });
    // The cabin begins at any floor.
    let mut stops: Vec<&str> = landings.iter().map(String::as_str).collect();
    stops.rotate_left(random.below(floors));
    layout.add_lift(LIFT, &stops)?;
    layout.add_parcel(PARCEL, from)?.add_tag_reader(READER, &landings[0])?;
    Ok(FloorsScenario { seed, layout, target: to.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::{FloorsScenario, LIFT, PARCEL};
    use crate::Building;

    #[tokio::test(start_paused = true)]
    async fn a_parcel_that_is_handed_over_passes_the_check() {
        let scenario = FloorsScenario::seeded(0);
        let building = Building::new(scenario.layout.clone(), 0.0).unwrap();
        let (below, above) = ("courier-0", "courier-1");
        building.take_up(below, PARCEL).await.unwrap();
        building.navigate(below, "landing-0").await.unwrap();
        building.set_down(below, Some(LIFT)).await.unwrap();
        building.send_cabin(LIFT, "landing-1").await.unwrap();
        let early = scenario.check(&building.truth()).unwrap_err().join(" ");
        assert!(early.contains("is not at `lab`") && early.contains("did not ride"), "{early}");
        building.take_up(above, PARCEL).await.unwrap();
        building.navigate(above, "lab").await.unwrap();
        building.set_down(above, None).await.unwrap();
        assert_eq!(scenario.check(&building.truth()), Ok(()));
    }

    #[test]
    fn the_parcel_begins_on_another_floor() {
        for seed in 0..200 {
            let FloorsScenario { layout, target, .. } = FloorsScenario::seeded(seed);
            let from = &layout.parcels()[PARCEL];
            assert!(!layout.reachable_from(from).contains(target.as_str()), "{seed}");
        }
    }
}
