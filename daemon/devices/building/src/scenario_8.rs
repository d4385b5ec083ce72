//! A table for two: two robots carry a table to another room, which neither of them can do alone.
//!
//! Seed 0 is a store, a conference room and a hall. Every other seed draws another building, with two or
//! three robots.

use serde::Serialize;

use crate::draw::LayoutDraw;
use crate::error::LayoutError;
use crate::layout::Layout;
use crate::replay::replay;
use crate::truth::{BuildingEvent, Truth};

const TABLE: &str = "table-1";
const ROBOTS: [&str; 3] = ["mover-1", "mover-2", "mover-3"];

/// A building with a table that is to be carried to another room.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct TableScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building, with all devices and the table.
    pub layout: Layout,
    /// Name of the room to which the table is to be carried.
    pub target: String,
}

impl TableScenario {
    /// Returns the scenario of this seed, which is the same on every machine.
    pub fn seeded(seed: u64) -> TableScenario {
        let drawn = if seed == 0 { small_building() } else { draw(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }

    /// Returns the name of the table.
    pub fn table(&self) -> &'static str {
        TABLE
    }

    /// Checks the scenario against the truth: the table is in the room, and two different robots have
    /// carried it on each part of its way there.
    ///
    /// # Errors
    ///
    /// Returns a text for each way in which the scenario failed.
    pub fn check(&self, truth: &Truth) -> Result<(), Vec<String>> {
        let mut problems = replay(&self.layout, truth).problems;
        let mut stood = self.layout.tables().get(TABLE).cloned();
        for occurrence in truth.occurrences() {
            let BuildingEvent::TableCarried { robots, table, from, to } = &occurrence.event else {
                continue;
            };
            if robots[0] == robots[1] {
                problems.push(format!("`{}` has carried `{table}` alone", robots[0]));
            }
            if stood.as_ref() != Some(from) {
                problems.push(format!("`{table}` was carried from `{from}`, where it was not"));
            }
            stood = Some(to.clone());
        }
        let is_there = |place: Option<&str>| place == Some(self.target.as_str());
        if !is_there(stood.as_deref()) || !is_there(truth.table(TABLE)) {
            let place = truth.table(TABLE).unwrap_or("no place");
            problems.push(format!("`{TABLE}` is not at `{}`, but at `{place}`", self.target));
        }
        if problems.is_empty() { Ok(()) } else { Err(problems) }
    }
}

fn small_building() -> Result<TableScenario, LayoutError> {
    let mut layout = Layout::new();
    layout
        .add_room("store", 18.0)?
        .add_room("conf-room", 21.5)?
        .add_corridor("hall", 19.0)?
        .connect("hall", "store", 5.0)?
        .connect("hall", "conf-room", 7.0)?;
    layout.add_robot(ROBOTS[0], "hall", 0.5)?.add_robot(ROBOTS[1], "conf-room", 0.4)?;
    layout.add_table(TABLE, "store")?;
    layout.add_tag_reader("tag-reader", "store")?;
    Ok(TableScenario { seed: 0, layout, target: "conf-room".to_owned() })
}

fn draw(seed: u64) -> Result<TableScenario, LayoutError> {
    let mut draw = LayoutDraw::new(seed);
    let mut layout = draw.places()?;
    let rooms = draw.random.sample(&draw.rooms, 2);
    let (store, target) = (rooms[0], rooms[1]);
    let places: Vec<&str> = draw.rooms.iter().chain(&draw.corridors).copied().collect();
    for robot in &ROBOTS[..draw.random.between(2, ROBOTS.len())] {
        let start = places[draw.random.below(places.len())];
        let speed = draw.random.between(2, 10) as f64 / 10.0;
        layout.add_robot(robot, start, speed)?;
    }
    layout.add_table(TABLE, store)?;
    layout.add_tag_reader("tag-reader", store)?;
    Ok(TableScenario { seed, layout, target: target.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::{ROBOTS, TABLE, TableScenario};
    use crate::Building;

    #[tokio::test(start_paused = true)]
    async fn a_table_that_two_robots_have_carried_passes_the_check() {
        let scenario = TableScenario::seeded(0);
        let building = Building::new(scenario.layout.clone(), 0.0).unwrap();
        let problems = || scenario.check(&building.truth()).err().unwrap_or_default().join(" ");
        building.navigate(ROBOTS[0], "store").await.unwrap();
        building.navigate(ROBOTS[1], "hall").await.unwrap();
        building.navigate(ROBOTS[1], "store").await.unwrap();
        for to in ["hall", "conf-room"] {
            assert!(problems().contains("is not at `conf-room`"), "{}", problems());
            let (one, other) = tokio::join!(
                building.carry_table((ROBOTS[0], ROBOTS[1]), TABLE, to),
                building.carry_table((ROBOTS[1], ROBOTS[0]), TABLE, to),
            );
            one.and(other).unwrap();
        }
        assert_eq!(problems(), "");
    }

    #[test]
    fn every_building_has_a_table_in_another_room_and_two_robots() {
        for seed in 0..200 {
            let scenario = TableScenario::seeded(seed);
            let truth = Building::new(scenario.layout.clone(), 0.0).unwrap().truth();
            assert_ne!(truth.table(TABLE), Some(scenario.target.as_str()), "{seed}");
            assert!(ROBOTS[..2].iter().all(|robot| truth.place_of(robot).is_some()), "{seed}");
        }
    }
}
