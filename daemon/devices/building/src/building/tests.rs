//! Tests of a building's operations in paused time; each compares the log with the expected one.

use std::time::Duration;

use expect_test::{Expect, expect};
use tokio::time::{Instant, timeout};

use super::Building;
use crate::fixture::{log_lines, office};
use crate::layout::BuildingDevice;
use crate::truth::{BuildingEvent, DeviceFault, LOG_MAX};
use crate::{Layout, LayoutError};

/// Compares the log of the building, one line per occurrence, with the expected text.
#[track_caller]
fn check(building: &Building, expected: Expect) {
    expected.assert_eq(&log_lines(&building.truth()).join("\n"));
}

fn departed(event: &BuildingEvent) -> bool {
    matches!(event, BuildingEvent::Departed { .. })
}

/// Makes a trip of the robot, and runs `fate` during the trip. Returns the outcome and the duration
/// of the trip.
async fn trip_with(
    building: &Building,
    fate: impl AsyncFnOnce(&Building),
) -> (Result<(), String>, Duration) {
    let began = Instant::now();
    let trip = async {
        let arrived = building.navigate("turtlebot-1", "office1").await;
        (arrived.map_err(|error| error.to_string()), began.elapsed())
    };
    let strike = async {
        building.wait_for(|truth| truth.any(departed)).await;
        fate(building).await;
    };
    tokio::join!(trip, strike).0
}

#[tokio::test(start_paused = true)]
async fn a_trip_takes_distance_by_speed_and_carries_the_sensor_along() {
    let building = office();
    assert_eq!(building.place_of("ir-1").unwrap(), "corridor");
    let (arrived, took) = trip_with(&building, async |_| ()).await;
    assert_eq!((arrived, took.as_secs_f64().round()), (Ok(()), (4.0_f64 / 0.3).round()));
    let reading = building.read_temperature("ir-1").await.unwrap();
    assert_eq!((reading.location.as_str(), reading.celsius), ("office1", 20.5));
    check(
        &building,
        expect![[r#"
            turtlebot-1 departs corridor office1
            turtlebot-1 moves corridor office1
            ir-1 is asked
            ir-1 reads office1 20.5"#]],
    );
}

#[tokio::test(start_paused = true)]
async fn time_can_be_scaled_only_within_the_limits() {
    let began = Instant::now();
    let building = Building::new(Layout::seeded(0).layout, 0.1).unwrap();
    building.navigate("turtlebot-1", "conf-room").await.unwrap();
    assert_eq!((began.elapsed().as_secs_f64() * 10.0).round(), (8.0_f64 / 0.3).round());
    for time_scale in [-1.0, f64::NAN, f64::INFINITY, 1_001.0] {
        let refused = Building::new(Layout::new(), time_scale);
        assert!(matches!(refused, Err(LayoutError::BadTimeScale { .. })), "{time_scale}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_trip_to_the_present_location_changes_nothing() {
    let building = office();
    building.navigate("turtlebot-1", "office1").await.unwrap();
    let before = building.truth();
    building.navigate("turtlebot-1", "office1").await.unwrap();
    assert_eq!(building.truth(), before);
}

#[tokio::test(start_paused = true)]
async fn a_refusal_names_the_possible_alternatives() {
    let building = office();
    building.navigate("turtlebot-1", "office1").await.unwrap();
    building.lock_door("corridor", "office1").unwrap();
    let refusals = [
        building.navigate("turtlebot-1", "office2").await.unwrap_err(),
        building.navigate("turtlebot-1", "corridor").await.unwrap_err(),
        building.navigate("turtlebot-1", "offic1").await.unwrap_err(),
        building.navigate("turtlebot-l", "office1").await.unwrap_err(),
        building.navigate("ir-1", "office1").await.unwrap_err(),
        building.read_temperature("turtlebot-1").await.unwrap_err(),
        building.place_of("screen").unwrap_err(),
    ];
    expect![[r#"
        go from `office1` to `office2`: from there a robot can go to `corridor`
        go from `office1` to `corridor`: the door is locked
        find the location `offic1` in the building; did you mean `office1`?
        find the device `turtlebot-l` in the building; did you mean `turtlebot-1`?
        use `ir-1` as a robot: it is a mounted sensor
        use `turtlebot-1` as a sensor: it is a robot
        find the device `screen` in the building"#]]
    .assert_eq(&refusals.map(|refusal| refusal.to_string()).join("\n"));
}

#[tokio::test(start_paused = true)]
async fn a_cancelled_trip_ends_at_its_start_and_frees_the_robot() {
    let building = office();
    let trip = building.navigate("turtlebot-1", "office1");
    assert!(timeout(Duration::from_secs(5), trip).await.is_err());
    building.navigate("turtlebot-1", "office2").await.unwrap();
    check(
        &building,
        expect![[r#"
            turtlebot-1 departs corridor office1
            turtlebot-1 stays corridor
            turtlebot-1 departs corridor office2
            turtlebot-1 moves corridor office2"#]],
    );
}

#[tokio::test(start_paused = true)]
async fn a_robot_makes_one_trip_at_a_time_and_two_robots_pass_each_other() {
    let building = office();
    let robot = |name: &str, start: &str| BuildingDevice::Robot {
        name: name.to_owned(),
        start: start.to_owned(),
        meters_per_second: 0.3,
    };
    building.add_device(robot("turtlebot-2", "office1")).unwrap();
    let (one, again, other) = tokio::join!(
        building.navigate("turtlebot-1", "office1"),
        building.navigate("turtlebot-1", "office2"),
        building.navigate("turtlebot-2", "corridor"),
    );
    assert_eq!((one, other), (Ok(()), Ok(())));
    assert!(again.unwrap_err().to_string().contains("it is driving already"));
    check(
        &building,
        expect![[r#"
            turtlebot-2 is added
            turtlebot-1 departs corridor office1
            turtlebot-2 departs office1 corridor
            turtlebot-2 moves office1 corridor
            turtlebot-1 moves corridor office1"#]],
    );
}

#[tokio::test(start_paused = true)]
async fn changes_during_a_trip_affect_its_outcome() {
    let breaks = office();
    let (arrived, took) = trip_with(&breaks, async |building| {
        building.break_device("turtlebot-1", DeviceFault::Fails).unwrap();
    })
    .await;
    assert_eq!((arrived, took), (Err("use `turtlebot-1`: it is broken".into()), Duration::ZERO));
    assert_eq!(breaks.place_of("turtlebot-1").unwrap(), "corridor");

    let leaves = office();
    let (arrived, _) = trip_with(&leaves, async |building| {
        building.remove_device("turtlebot-1").unwrap();
    })
    .await;
    assert_eq!(arrived, Err("find the device `turtlebot-1` in the building".into()));
    assert!(leaves.place_of("ir-1").is_err(), "what it carried left with it");

    let locked_out = office();
    let (arrived, _) = trip_with(&locked_out, async |building| {
        building.lock_door("office1", "corridor").unwrap();
    })
    .await;
    assert_eq!(arrived, Err("go from `corridor` to `office1`: the door is locked".into()));
    check(
        &locked_out,
        expect![[r#"
            turtlebot-1 departs corridor office1
            corridor office1 is locked
            turtlebot-1 stays corridor"#]],
    );
}

#[tokio::test(start_paused = true)]
async fn a_robot_replaced_during_a_trip_does_not_continue_the_trip() {
    let building = office();
    let (arrived, _) = trip_with(&building, async |building| {
        let robot = building.truth().layout().device("turtlebot-1").cloned().unwrap();
        building.remove_device("turtlebot-1").unwrap();
        building.add_device(robot).unwrap();
    })
    .await;
    assert!(arrived.is_err());
    assert_eq!(building.place_of("turtlebot-1").unwrap(), "corridor");
    building.navigate("turtlebot-1", "office2").await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_hanging_device_continues_after_repair() {
    let building = office();
    let (arrived, took) = trip_with(&building, async |building| {
        building.break_device("turtlebot-1", DeviceFault::Hangs).unwrap();
        let hour = Duration::from_secs(3_600);
        let moved = |event: &BuildingEvent| matches!(event, BuildingEvent::Moved { .. });
        assert!(timeout(hour, building.wait_for(|truth| truth.any(moved))).await.is_err());
        building.repair("turtlebot-1").unwrap();
    })
    .await;
    assert_eq!((arrived, took.as_secs()), (Ok(()), 3_600));
}

#[tokio::test(start_paused = true)]
async fn a_slow_sensor_takes_longer_and_no_fault_can_overflow_time() {
    let building = office();
    let began = Instant::now();
    building.break_device("ir-1", DeviceFault::Slow(Duration::from_secs(2))).unwrap();
    building.read_temperature("ir-1").await.unwrap();
    assert_eq!(began.elapsed(), Duration::from_millis(2_100));
    building.break_device("ir-1", DeviceFault::Slow(Duration::MAX)).unwrap();
    building.read_temperature("ir-1").await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_sensor_can_break_at_its_next_use() {
    let building = office();
    building.break_at_next_use("thermometer-office2", DeviceFault::Fails).unwrap();
    building.set_temperature("office2", 30.0).unwrap();
    assert!(building.read_temperature("thermometer-office2").await.is_err());
    building.repair("thermometer-office2").unwrap();
    let reading = building.read_temperature("thermometer-office2").await.unwrap();
    assert_eq!(reading.celsius, 30.0);
    check(
        &building,
        expect![[r#"
            office2 becomes 30
            thermometer-office2 is asked
            thermometer-office2 breaks Fails
            thermometer-office2 is repaired
            thermometer-office2 is asked
            thermometer-office2 reads office2 30"#]],
    );
}

#[tokio::test(start_paused = true)]
async fn control_operations_report_their_mistakes() {
    let building = office();
    let refusals = [
        building.set_temperature("ofice1", 20.0).unwrap_err(),
        building.set_temperature("office1", f64::INFINITY).unwrap_err(),
        building.break_device("thermometer-office1", DeviceFault::Fails).unwrap_err(),
        building.lock_door("office1", "office2").unwrap_err(),
    ];
    expect![[r#"
        find the location `ofice1`; did you mean `office1`?
        set inf °C in `office1`: between -273.15 and 1000 is possible
        find the device `thermometer-office1`; did you mean `thermometer-office2`?
        find a door between `office1` and `office2`: name two locations that are connected"#]]
    .assert_eq(&refusals.map(|refusal| refusal.to_string()).join("\n"));
    check(&building, expect![""]);
}

#[tokio::test(start_paused = true)]
async fn the_log_drops_the_oldest_occurrences_and_counts_them() {
    let building = office();
    for extra in 0..LOG_MAX + 3 {
        building.set_temperature("office1", extra as f64 / 100.0).unwrap();
    }
    let truth = building.truth();
    let kept: Vec<u64> = truth.occurrences().map(|occurrence| occurrence.sequence).collect();
    assert_eq!((kept.len(), kept[0], truth.forgotten_count()), (LOG_MAX, 3, 3));
}

/// Agents and their drivers run on a multi-threaded runtime, which requires futures that are
/// `Send`.
#[tokio::test]
async fn every_operation_can_be_spawned() {
    fn check(_: impl Send) {}
    let (building, scenario) = (office(), Layout::seeded(0));
    check(building.handle().navigate("turtlebot-1", "office1"));
    check(building.handle().read_temperature("ir-1"));
    check(building.handle().place_of("ir-1"));
    check(building.wait_for(|_| true));
    check(scenario.death(&building, DeviceFault::Fails));
    check(crate::serve(building.handle(), "unused"));
}
