//! A parcel behind a closed door: a robot carries it, and a door that is an agent of its own has to
//! open. Neither reaches the goal alone.
//!
//! Seed 0 is a store, a laboratory and a hall. Every other seed draws another building, in which each
//! way into the room of the goal has a door.

use serde::Serialize;

use crate::draw::LayoutDraw;
use crate::error::LayoutError;
use crate::layout::Layout;
use crate::replay::replay;
use crate::truth::{BuildingEvent, Truth};

const ROBOT: &str = "courier-1";
const PARCEL: &str = "parcel-1";
const READER: &str = "tag-reader";

/// A building with a parcel that is to be brought into a room behind closed doors.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ParcelScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building, with all devices and the parcel.
    pub layout: Layout,
    /// Name of the room behind the doors.
    pub target: String,
}

impl ParcelScenario {
    /// Returns the scenario of this seed, which is the same on every machine.
    pub fn seeded(seed: u64) -> ParcelScenario {
        let drawn = if seed == 0 { small_building() } else { draw(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }

    /// Returns the name of the parcel.
    pub fn parcel(&self) -> &'static str {
        PARCEL
    }

    /// Returns the name of the robot that carries the parcel.
    pub fn robot(&self) -> &'static str {
        ROBOT
    }

    /// Checks the scenario against the truth: the parcel is in the room, and the robot came there
    /// through a door that was opened for it.
    ///
    /// # Errors
    ///
    /// Returns a text for each way in which the scenario failed.
    pub fn check(&self, truth: &Truth) -> Result<(), Vec<String>> {
        let mut problems = replay(&self.layout, truth).problems;
        problems.extend(truth.misplaced(PARCEL, &self.target));
        let of = |sort: &dyn Fn(&BuildingEvent) -> bool| {
            let found = truth.occurrences().find(|occurrence| sort(&occurrence.event));
            found.map(|occurrence| occurrence.sequence)
        };
        let opened = of(&|event| matches!(event, BuildingEvent::Unlocked { .. }));
        let came = of(
            &|event| matches!(event, BuildingEvent::Moved { robot, to, .. } if robot == ROBOT && *to == self.target),
        );
        match (opened, came) {
            (Some(opened), Some(came)) if opened < came => (),
            _ => problems.push(format!("no door was opened before `{ROBOT}` came")),
        }
        if problems.is_empty() { Ok(()) } else { Err(problems) }
    }
}

fn small_building() -> Result<ParcelScenario, LayoutError> {
    let mut layout = Layout::new();
    layout
        .add_room("store", 18.0)?
        .add_room("lab", 21.5)?
        .add_corridor("hall", 19.0)?
        .connect("hall", "store", 5.0)?
        .connect("hall", "lab", 7.0)?;
    finish(0, layout, ("lab", "store", "hall"), 0.5)
}

fn draw(seed: u64) -> Result<ParcelScenario, LayoutError> {
    let mut draw = LayoutDraw::new(seed);
    let layout = draw.places()?;
    let target = draw.rooms[draw.random.below(draw.rooms.len())];
    let others: Vec<&str> = { draw.rooms.iter().chain(&draw.corridors) }
        .copied()
        .filter(|place| *place != target)
        .collect();
    let start = others[draw.random.below(others.len())];
    // The robot reaches the parcel without passing through the room of the goal.
    let mut reached = vec![start];
    let mut at = 0;
    while at < reached.len() {
        let from = reached[at];
        let next = others.iter().filter(|place| layout.meters(from, place).is_some());
        let next: Vec<&str> = next.copied().filter(|place| !reached.contains(place)).collect();
        reached.extend(next);
        at += 1;
    }
    let parcel = reached[draw.random.below(reached.len())];
    let speed = draw.random.between(2, 10) as f64 / 10.0;
    finish(seed, layout, (target, parcel, start), speed)
}

/// Adds the doors of the room `target`, the robot at `start`, the parcel and the reader of its tag.
fn finish(
    seed: u64,
    mut layout: Layout,
    (target, parcel, start): (&str, &str, &str),
    speed: f64,
) -> Result<ParcelScenario, LayoutError> {
    let sides: Vec<String> = layout.neighbors(target).map(str::to_owned).collect();
    for (index, side) in sides.iter().enumerate() {
        layout.add_door(&format!("door-{}", index + 1), side, target)?;
    }
    layout.add_robot(ROBOT, start, speed)?;
    layout.add_parcel(PARCEL, parcel)?.add_tag_reader(READER, start)?;
    Ok(ParcelScenario { seed, layout, target: target.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::{PARCEL, ParcelScenario, ROBOT};
    use crate::Building;

    #[tokio::test(start_paused = true)]
    async fn leaving_out_an_act_fails_the_check() {
        for (brings, word) in [(true, ""), (false, "is not at `lab`")] {
            let scenario = ParcelScenario::seeded(0);
            let building = Building::new(scenario.layout.clone(), 0.0).unwrap();
            let early = scenario.check(&building.truth()).unwrap_err();
            assert!(early.iter().any(|text| text.contains("no door was opened")), "{early:?}");
            building.navigate(ROBOT, "store").await.unwrap();
            if brings {
                building.take_up(ROBOT, PARCEL).await.unwrap();
            }
            building.navigate(ROBOT, "hall").await.unwrap();
            assert!(building.navigate(ROBOT, "lab").await.is_err(), "the door is closed");
            building.set_door("door-1", true).await.unwrap();
            building.navigate(ROBOT, "lab").await.unwrap();
            let _ = building.set_down(ROBOT, None).await;
            let problems = scenario.check(&building.truth()).err().unwrap_or_default().join(" ");
            assert!(problems.contains(word) && problems.is_empty() == brings, "{problems}");
        }
    }

    #[test]
    fn every_way_into_the_room_has_a_door() {
        for seed in 0..200 {
            let scenario = ParcelScenario::seeded(seed);
            let ParcelScenario { layout, target, .. } = &scenario;
            assert!(layout.neighbors(target).all(|side| layout.has_door(side, target)), "{seed}");
        }
    }
}
