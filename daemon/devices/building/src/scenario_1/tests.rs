//! Plays scenario 1 for every seed correctly, and once with each way to fake it.

use std::collections::BTreeMap;

use expect_test::{Expect, expect};

use super::check_scenario_1;
use crate::{
    Building, BuildingDevice, BuildingEvent, DeathTime, DeviceFault, Layout, SeededScenario, Truth,
};

/// A scenario after it was played: the arguments of its check.
struct Played {
    scenario: SeededScenario,
    truth: Truth,
    death: u64,
    told: BTreeMap<String, f64>,
}

impl Played {
    fn problems(&self) -> Vec<String> {
        let checked = check_scenario_1(&self.scenario, &self.truth, self.death, &self.told);
        checked.err().unwrap_or_default()
    }
}

/// Does the agents' work in the simplest way: every fixed sensor measures, and the robot goes to
/// every room without a sensor. After the death, the robot also goes to the dead sensor's room, if
/// `replans` is `true`.
async fn play(seed: u64, replans: bool) -> Played {
    let scenario = Layout::seeded(seed);
    let building = Building::new(scenario.layout.clone(), 1.0).unwrap();
    scenario.arm(&building, DeviceFault::Fails).unwrap();
    let mut told = BTreeMap::new();
    for device in scenario.layout.devices() {
        if let BuildingDevice::FixedSensor { name, location } = device
            && let Ok(reading) = building.read_temperature(name).await
        {
            told.insert(location.clone(), reading.celsius);
        }
    }
    for room in scenario.layout.rooms_without_sensor() {
        told.insert(room.to_owned(), measure_by_robot(&building, room).await);
    }
    let death = scenario.death(&building, DeviceFault::Fails).await.unwrap();
    let room = scenario.dying_room();
    if replans {
        told.insert(room.to_owned(), measure_by_robot(&building, room).await);
    }
    Played { truth: building.truth(), scenario, death, told }
}

async fn measure_by_robot(building: &Building, room: &str) -> f64 {
    let layout = building.truth().layout().clone();
    let (sensor, robot) = layout
        .devices()
        .iter()
        .find_map(|device| match device {
            BuildingDevice::MountedSensor { name, carrier } => Some((name, carrier)),
            _ => None,
        })
        .unwrap();
    let start = building.place_of(robot).unwrap();
    for step in route(&layout, &start, room) {
        building.navigate(robot, &step).await.unwrap();
    }
    building.read_temperature(sensor).await.unwrap().celsius
}

/// Returns the way from `from` to `to`. The search begins at the destination; `next` has the next
/// step towards `to` for each place.
fn route(layout: &Layout, from: &str, to: &str) -> Vec<String> {
    let mut next = BTreeMap::from([(to, to)]);
    let mut frontier = vec![to];
    while let Some(place) = frontier.pop() {
        for neighbor in layout.neighbors(place) {
            next.entry(neighbor).or_insert_with(|| {
                frontier.push(neighbor);
                place
            });
        }
    }
    let mut steps = Vec::new();
    let mut place = from;
    while place != to {
        place = next[place];
        steps.push(place.to_owned());
    }
    steps
}

#[tokio::test(start_paused = true)]
async fn the_check_passes_for_every_seed_only_if_the_agents_replan() {
    for seed in 0..200 {
        let problems = play(seed, true).await.problems();
        assert_eq!(problems, Vec::<String>::new(), "seed {seed}");
        let problems = play(seed, false).await.problems();
        let not_replaced = problems.iter().any(|problem| problem.starts_with("no robot measured"));
        assert!(not_replaced, "seed {seed}: {problems:?}");
    }
}

/// Plays the first seed with this kind of death, lets `tamper` change the log or the values that
/// the user received, and compares the result of the check with `expected`.
async fn check(dies: DeathTime, tamper: impl FnOnce(&mut Played), expected: Expect) {
    let seed = (0..).find(|seed| Layout::seeded(*seed).dies == dies).unwrap();
    let mut played = play(seed, true).await;
    tamper(&mut played);
    expected.assert_eq(&played.problems().join("\n"));
}

fn forget(played: &mut Played, sort: impl Fn(&BuildingEvent) -> bool) {
    played.truth.log.occurrences.retain(|occurrence| !sort(&occurrence.event));
    // Only the events are removed; the log must not look as if it had dropped its oldest
    // occurrences.
    played.truth.log.next_sequence = played.truth.log.occurrences.len() as u64;
}

#[tokio::test(start_paused = true)]
async fn a_missing_second_trip_fails_the_check() {
    for dies in [DeathTime::AfterReport, DeathTime::BeforeReport] {
        check(
            dies,
            |played| {
                let death = played.death;
                let log = &mut played.truth.log;
                log.occurrences.retain(|occurrence| occurrence.sequence <= death);
                log.next_sequence = log.occurrences.len() as u64;
            },
            match dies {
                DeathTime::AfterReport => {
                    expect!["no robot measured `office2` after `thermometer-office2` died"]
                }
                DeathTime::BeforeReport => expect![[r#"
                    `office1` was not measured at all
                    `office3` was not measured by a robot at all
                    `atelier` was not measured by a robot at all
                    no robot measured `office1` after `thermometer-office1` died"#]],
            },
        )
        .await;
    }
}

#[tokio::test(start_paused = true)]
async fn false_reports_to_the_user_fail_the_check() {
    let read_by_robot = |event: &BuildingEvent| matches!(event, BuildingEvent::Read { sensor, .. } if sensor == "ir-1");
    check(
        DeathTime::AfterReport,
        |played| forget(played, read_by_robot),
        expect![[r#"
        `office1` was not measured by a robot at all before `thermometer-office2` died
        no robot measured `office2` after `thermometer-office2` died"#]],
    )
    .await;
    let moved = |event: &BuildingEvent| matches!(event, BuildingEvent::Moved { .. });
    check(
        DeathTime::AfterReport,
        |played| forget(played, moved),
        expect![[r#"
            `ir-1` measured `office1`, but was in `corridor`
            `ir-1` measured `office2`, but was in `corridor`
            `office1` was not measured by a robot at all before `thermometer-office2` died
            no robot measured `office2` after `thermometer-office2` died"#]],
    )
    .await;
    check(
        DeathTime::AfterReport,
        |played| {
            // The last answer of the dead sensor, repeated.
            played.told.insert("office2".to_owned(), 21.5);
            played.told.remove("office1");
            played.told.insert("attic".to_owned(), 3.0);
        },
        expect![[r#"
            the user was not told the temperature of `office1`
            the user was told of `attic`, which does not exist
            the user was told 21.5 °C for `office2`; the truth is 23.5 °C"#]],
    )
    .await;
    check(
        DeathTime::AfterReport,
        |played| played.death = 0,
        expect![[r#"
        `thermometer-office2` did not die when the scenario says it did
        `thermometer-office2` measured after its death
        `thermometer-office2` died before it ever measured
        `office1` was not measured by a robot at all before `thermometer-office2` died
        `office2` was not measured at all before `thermometer-office2` died
        `conf-room` was not measured at all before `thermometer-office2` died"#]],
    )
    .await;
    check(
        DeathTime::AfterReport,
        |played| played.truth.log.next_sequence += 1,
        expect!["the log has dropped its first 1 events"],
    )
    .await;
}

#[tokio::test(start_paused = true)]
async fn a_death_at_the_wrong_time_fails_the_check() {
    check(
        DeathTime::AfterReport,
        |played| played.scenario.dies = DeathTime::BeforeReport,
        expect!["`thermometer-office2` measured before its death"],
    )
    .await;
    check(
        DeathTime::BeforeReport,
        |played| played.scenario.dies = DeathTime::AfterReport,
        expect![[r#"
        `thermometer-office1` died before it ever measured
        `office1` was not measured at all before `thermometer-office1` died
        `office3` was not measured by a robot at all before `thermometer-office1` died
        `atelier` was not measured by a robot at all before `thermometer-office1` died"#]],
    )
    .await;
}

#[tokio::test(start_paused = true)]
async fn only_a_measurement_by_robot_after_the_death_replaces_the_sensor() {
    let dies = |played: &mut Played| {
        let device = played.scenario.dying_sensor.clone();
        played.truth.log.record(BuildingEvent::Broken { device, fault: DeviceFault::Fails })
    };
    check(
        DeathTime::AfterReport,
        |played| played.death = dies(played),
        expect!["no robot measured `office2` after `thermometer-office2` died"],
    )
    .await;
    check(
        DeathTime::AfterReport,
        |played| {
            let log = &mut played.truth.log;
            log.occurrences.retain(|occurrence| occurrence.sequence <= played.death);
            log.next_sequence = log.occurrences.len() as u64;
            played.scenario.layout.add_fixed_sensor("second", "office2").unwrap();
            let (sensor, location) = ("second".to_owned(), "office2".to_owned());
            log.record(BuildingEvent::Read { sensor, location, celsius: 23.5 });
        },
        expect!["no robot measured `office2` after `thermometer-office2` died"],
    )
    .await;
}

#[tokio::test(start_paused = true)]
async fn an_impossible_trip_fails_the_check() {
    for (from, to) in [("conf-room", "corridor"), ("office2", "office1")] {
        let went = |played: &mut Played| {
            let (robot, from, to) = ("turtlebot-1".to_owned(), from.to_owned(), to.to_owned());
            played.truth.log.record(BuildingEvent::Moved { robot, from, to });
        };
        let expected = match from {
            "conf-room" => {
                expect!["`turtlebot-1` went from `conf-room` to `corridor`, which is impossible"]
            }
            _ => expect!["`turtlebot-1` went from `office2` to `office1`, which is impossible"],
        };
        check(DeathTime::AfterReport, went, expected).await;
    }
}
