//! Plays scenario 2 for every seed correctly, and once with each way to fake it.

use std::collections::BTreeMap;

use super::{MaintenanceScenario, ROBOTS};
use crate::{Building, BuildingDevice};

/// The part of the scenario that is left out or done wrong.
#[derive(Clone, Copy, PartialEq)]
enum Flaw {
    None,
    NobodyReplans,
    OneRobotDoesAll,
    SensorIsIgnored,
    SensorNeverComes,
    Lies,
}

struct Stage {
    building: Building,
    scenario: MaintenanceScenario,
    told: BTreeMap<String, f64>,
}

impl Stage {
    async fn fixed(&mut self, but: &[&str]) {
        let layout = self.building.truth().layout().clone();
        for device in layout.devices() {
            if let BuildingDevice::FixedSensor { name, location } = device
                && !but.contains(&name.as_str())
            {
                let celsius = self.building.read_temperature(name).await.unwrap().celsius;
                self.told.insert(location.clone(), celsius);
            }
        }
    }

    /// Drives a robot to a room of either wing, through the corridors, and measures there.
    async fn robot(&mut self, index: usize, room: &str) {
        let robot = ROBOTS[index];
        loop {
            let place = self.building.place_of(robot).unwrap();
            if place == room {
                break;
            }
            let layout = self.building.truth().layout().clone();
            // The corridors of the wings are connected, so that the way leads through at most two
            // corridors.
            let next = layout.neighbors(&place).find(|next| *next == room);
            let near = |next: &&str| layout.neighbors(next).any(|further| further == room);
            let next = next.or_else(|| layout.neighbors(&place).find(near));
            let next = next.or_else(|| layout.neighbors(&place).next()).unwrap().to_owned();
            self.building.navigate(robot, &next).await.unwrap();
        }
        let sensor = format!("ir-{}", index + 1);
        let celsius = self.building.read_temperature(&sensor).await.unwrap().celsius;
        self.told.insert(room.to_owned(), celsius);
    }
}

async fn problems(seed: u64, flaw: Flaw) -> Vec<String> {
    let scenario = MaintenanceScenario::seeded(seed);
    let building = Building::new(scenario.initial_layout(), 1.0).unwrap();
    let mut stage = Stage { building, scenario: scenario.clone(), told: BTreeMap::new() };
    let [first, second] = &scenario.deaths;
    let bare = scenario.late_room();
    stage.fixed(&[]).await;
    stage.robot(0, bare).await;
    first.trigger(&stage.building).unwrap();
    if flaw != Flaw::NobodyReplans {
        stage.robot(0, &first.room).await;
    }
    second.trigger(&stage.building).unwrap();
    stage.fixed(&[&first.sensor, &second.sensor]).await;
    stage.robot(0, bare).await;
    stage.robot(0, &first.room).await;
    stage.robot(usize::from(flaw != Flaw::OneRobotDoesAll), &second.room).await;
    if flaw != Flaw::SensorNeverComes {
        stage.scenario.plug_in(&stage.building).unwrap();
    }
    for _ in 0..2 {
        stage.fixed(&[&first.sensor, &second.sensor]).await;
    }
    if flaw == Flaw::SensorIsIgnored {
        stage.robot(0, bare).await;
    }
    stage.robot(0, &first.room).await;
    stage.robot(1, &second.room).await;
    if flaw == Flaw::Lies {
        stage.told.insert(first.room.clone(), 0.0);
    }
    scenario.check(&stage.building.truth(), &stage.told).err().unwrap_or_default()
}

#[tokio::test(start_paused = true)]
async fn the_check_passes_for_every_seed_if_nothing_is_left_out() {
    for seed in 0..200 {
        assert_eq!(problems(seed, Flaw::None).await, [""; 0], "seed {seed}");
    }
}

#[tokio::test(start_paused = true)]
async fn the_check_fails_for_each_flaw() {
    for (flaw, word) in [
        (Flaw::NobodyReplans, "no robot measured"),
        (Flaw::OneRobotDoesAll, "to which the other robot was closer"),
        (Flaw::SensorIsIgnored, "1 times after"),
        (Flaw::SensorNeverComes, "and then a new sensor"),
        (Flaw::Lies, "the user was told 0 °C"),
    ] {
        for seed in 0..20 {
            let problems = problems(seed, flaw).await;
            assert!(problems.iter().any(|problem| problem.contains(word)), "{seed}: {problems:?}");
        }
    }
}
