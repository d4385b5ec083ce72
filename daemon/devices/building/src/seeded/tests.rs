//! Tests of the properties that hold for every seed, and of the differences between seeds.

use std::collections::BTreeSet;

use expect_test::expect;

use super::DeathTime;
use crate::{BuildingDevice, Layout, LocationKind};

const SEEDS: u64 = 200;

/// Checks everything that holds for the scenario of every seed.
#[track_caller]
fn check(seed: u64) {
    let scenario = Layout::seeded(seed);
    assert_eq!(scenario, Layout::seeded(seed), "seed {seed} is not deterministic");
    let layout = &scenario.layout;
    let places: BTreeSet<&str> =
        layout.locations().iter().map(|place| place.name.as_str()).collect();
    let rooms_count = layout.rooms().count();
    let corridors_count = places.len() - rooms_count;
    let bare_count = layout.rooms_without_sensor().count();
    assert!((3..=7).contains(&rooms_count) && (1..=3).contains(&corridors_count), "{seed}");
    assert!((1..rooms_count).contains(&bare_count), "seed {seed}: {bare_count} bare rooms");
    assert_eq!(layout.measurable_by_robots(), places, "seed {seed}: robots reach everything");
    for way in layout.connections() {
        assert!((1.0..=20.0).contains(&way.meters), "seed {seed}: {way:?}");
    }
    assert!(layout.fixed_sensors_in(scenario.dying_room()).eq([&scenario.dying_sensor]));
    let mut tenths: Vec<i64> =
        layout.locations().iter().map(|place| (place.celsius * 10.0) as i64).collect();
    tenths.push((scenario.celsius_after_death * 10.0) as i64);
    assert_eq!(tenths.iter().collect::<BTreeSet<_>>().len(), tenths.len(), "seed {seed}");
    let robots = layout.devices().iter().filter(|d| matches!(d, BuildingDevice::Robot { .. }));
    let mounted =
        layout.devices().iter().filter(|d| matches!(d, BuildingDevice::MountedSensor { .. }));
    let (robots_count, mounted_count) = (robots.count(), mounted.count());
    assert!((1..=2).contains(&robots_count) && robots_count == mounted_count, "seed {seed}");
}

#[test]
fn the_scenario_is_possible_in_the_building_of_every_seed() {
    for seed in (0..SEEDS).chain([u64::MAX]) {
        check(seed);
    }
}

/// If the buildings of different seeds were equal, a hundred seeds would test little more than one.
#[test]
fn seeds_differ_in_everything_that_they_draw() {
    let scenarios: Vec<_> = (1..SEEDS).map(Layout::seeded).collect();
    let count = |text: &dyn Fn(&super::SeededScenario) -> String| {
        scenarios.iter().map(text).collect::<BTreeSet<_>>().len()
    };
    assert_eq!(count(&|scenario| scenario.layout.map_pddl("d")), scenarios.len());
    assert_eq!(count(&|scenario| scenario.layout.rooms().count().to_string()), 5);
    assert_eq!(count(&|scenario| format!("{:?}", scenario.dies)), 2);
    let robots = |scenario: &super::SeededScenario| {
        let devices = scenario.layout.devices().iter();
        devices.filter(|device| matches!(device, BuildingDevice::Robot { .. })).count().to_string()
    };
    assert_eq!(count(&robots), 2);
    let circles = |scenario: &super::SeededScenario| {
        let layout = &scenario.layout;
        (layout.connections().len() >= layout.locations().len()).to_string()
    };
    assert_eq!(count(&circles), 2);
}

#[test]
fn seed_0_is_the_office_of_the_paper() {
    let scenario = Layout::seeded(0);
    assert_eq!(scenario.layout.rooms_without_sensor().collect::<Vec<_>>(), ["office1"]);
    assert_eq!((scenario.dying_room(), scenario.dies), ("office2", DeathTime::AfterReport));
    let corridors = scenario.layout.locations().iter();
    assert_eq!(corridors.filter(|place| place.kind == LocationKind::Corridor).count(), 1);
    let devices: Vec<&str> = scenario.layout.devices().iter().map(BuildingDevice::name).collect();
    assert_eq!(devices, ["thermometer-office2", "thermometer-conf-room", "turtlebot-1", "ir-1"]);
}

/// A failure of this test means that the buildings of all existing seeds have changed.
#[test]
fn the_building_of_seed_1_never_changes() {
    expect![[r#"
        seed = 1
        dying-sensor = "thermometer-office1"
        dies = "before-report"
        celsius-after-death = 25.7

        [[layout.locations]]
        name = "office1"
        kind = "room"
        celsius = 20.4

        [[layout.locations]]
        name = "office3"
        kind = "room"
        celsius = 19.5

        [[layout.locations]]
        name = "atelier"
        kind = "room"
        celsius = 21.4

        [[layout.locations]]
        name = "lobby"
        kind = "corridor"
        celsius = 19.2

        [[layout.locations]]
        name = "passage"
        kind = "corridor"
        celsius = 26.8

        [[layout.connections]]
        from = "lobby"
        to = "passage"
        meters = 18.0
        one-way = false

        [[layout.connections]]
        from = "passage"
        to = "office1"
        meters = 8.5
        one-way = false

        [[layout.connections]]
        from = "lobby"
        to = "office3"
        meters = 2.5
        one-way = false

        [[layout.connections]]
        from = "lobby"
        to = "atelier"
        meters = 14.5
        one-way = false

        [[layout.devices]]
        kind = "fixed-sensor"
        name = "thermometer-office1"
        location = "office1"

        [[layout.devices]]
        kind = "robot"
        name = "turtlebot-1"
        start = "office3"
        meters-per-second = 0.4

        [[layout.devices]]
        kind = "robot"
        name = "trolley"
        start = "atelier"
        meters-per-second = 0.4

        [[layout.devices]]
        kind = "mounted-sensor"
        name = "ir-1"
        carrier = "turtlebot-1"

        [[layout.devices]]
        kind = "mounted-sensor"
        name = "ir-2"
        carrier = "trolley"
    "#]]
    .assert_eq(&toml::to_string(&Layout::seeded(1)).unwrap());
}
