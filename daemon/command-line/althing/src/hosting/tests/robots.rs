//! Tests of robots with a battery, a dock, and poses of their own.

use ::building::BuildingEvent;

use super::{MODES, Mode, Office, entry};

/// Returns the entry of a robot with a range of 10 m: enough to drive from the corridor to a room 4
/// m away and back, and no further.
fn robot(more: &str) -> [String; 1] {
    let config = format!(
        "{{ start = \"corridor\", dock = \"corridor\", battery = {{ range = 10.0{more} }}, \
         poses = {{ entry = \"corridor\", board = {{ near = \"office1\", meters = 2.0 }} }} }}"
    );
    [entry("turtlebot-1", "turtlebot", &config)]
}

fn recharged(event: &BuildingEvent) -> bool {
    matches!(event, BuildingEvent::Recharged { .. })
}

#[tokio::test(start_paused = true)]
async fn a_plan_drives_past_the_dock_where_the_battery_does_not_last() {
    for mode in MODES {
        let office = Office::open(&robot(", charge = 5.0"), mode).await;
        let mut person = office.person("user");
        let reached = person.reaches("(at turtlebot-1 office2)").await;
        let truth = office.building.truth();
        assert!(reached, "{mode:?} {:#?}", person.lines);
        assert!(truth.any(recharged), "6 m are further than 5 m last");
        assert_eq!(truth.charge("turtlebot-1"), Some(4.0), "{mode:?}");
        assert_eq!(truth.place_of("turtlebot-1"), Some("office2"));
        // The way back is 6 m, and the dock is there.
        assert!(!person.reaches("(at turtlebot-1 corridor)").await, "{:#?}", person.lines);
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_robot_with_an_empty_battery_offers_no_move_until_charged() {
    let office = Office::open(&robot(""), Mode::Decentralized).await;
    let mut person = office.person("user");
    assert!(person.reaches("(at turtlebot-1 office1)").await, "{:#?}", person.lines);
    office.building.set_charge("turtlebot-1", 0.0).expect("it has a battery");
    // The robot finds out at its next move that the battery is empty, and then offers no move.
    assert!(!person.reaches("(at turtlebot-1 corridor)").await, "{:#?}", person.lines);
    let before = office.building.truth();
    assert!(!person.reaches("(at turtlebot-1 corridor)").await, "{:#?}", person.lines);
    assert_eq!(office.building.truth(), before, "nobody even tried");
    assert_eq!(before.place_of("turtlebot-1"), Some("office1"));
    office.close().await;
}

#[tokio::test(start_paused = true)]
async fn a_robot_charges_on_request() {
    for mode in MODES {
        let office = Office::open(&robot(""), mode).await;
        let mut person = office.person("user");
        assert!(person.reaches("(at turtlebot-1 office1)").await, "{:#?}", person.lines);
        assert!(person.reaches("(charged turtlebot-1)").await, "{:#?}", person.lines);
        let truth = office.building.truth();
        assert_eq!(truth.charge("turtlebot-1"), Some(10.0));
        assert_eq!(truth.place_of("turtlebot-1"), Some("corridor"));
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_robot_reaches_its_own_poses() {
    for mode in MODES {
        let office = Office::open(&robot(""), mode).await;
        let mut person = office.person("user");
        for pose in ["entry", "board"] {
            let reached = person.reaches(&format!("(at turtlebot-1 {pose})")).await;
            assert!(reached, "{mode:?} {:#?}", person.lines);
            assert_eq!(office.building.truth().place_of("turtlebot-1"), Some(pose));
        }
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_robot_docks_before_its_battery_is_empty() {
    for mode in MODES {
        let config = "{ start = \"corridor\", dock = \"corridor\", \
                      battery = { range = 20.0, charge = 8.5 } }";
        let office = Office::open(&[entry("turtlebot-1", "turtlebot", config)], mode).await;
        let mut person = office.person("user");
        // 4 m of way leave 4.5 m: less than a quarter of its range, and enough for the way back.
        assert!(person.reaches("(at turtlebot-1 office1)").await, "{:#?}", person.lines);
        let truth =
            office.until("it charges, and nobody asked for it", |truth| truth.any(recharged));
        let truth = truth.await;
        assert_eq!(truth.place_of("turtlebot-1"), Some("corridor"), "{mode:?}");
        assert_eq!(truth.charge("turtlebot-1"), Some(20.0), "{mode:?}");
        office.close().await;
    }
}

/// Returns the entries of a robot that visits the corridor every minute, and carries a thermometer.
fn patrol() -> [String; 2] {
    let config = "{ start = \"office2\", patrol = { places = [\"corridor\"], every = \"1m\" } }";
    [
        entry("turtlebot-1", "turtlebot", config),
        entry("ir-1", "ir-temperature-sensor", "{ mounted-on = \"turtlebot-1\" }"),
    ]
}

/// Returns how often the robot has arrived in the corridor.
fn came(truth: &::building::Truth) -> usize {
    let is_there = |event: &BuildingEvent| matches!(event, BuildingEvent::Moved { to, .. } if to == "corridor");
    truth.occurrences().filter(|occurrence| is_there(&occurrence.event)).count()
}

#[tokio::test(start_paused = true)]
async fn a_robot_resumes_its_patrol_after_a_goal() {
    for mode in MODES {
        let office = Office::open(&patrol(), mode).await;
        office.until("it sets out by itself", |truth| came(truth) == 1).await;
        let mut person = office.person("user");
        let reached = person.reaches("(known-temperature conf-room)").await;
        assert!(reached, "{mode:?}: it gives way: {:#?}", person.lines);
        assert_eq!(office.building.truth().place_of("turtlebot-1"), Some("conf-room"));
        office.until("it passes by again", |truth| came(truth) == 2).await;
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_patrol_is_interrupted_for_a_goal() {
    for mode in MODES {
        let office = Office::open(&patrol(), mode).await;
        office.until("it sets out by itself", |truth| came(truth) == 1).await;
        let mut person = office.person("user");
        assert!(person.reaches("(at turtlebot-1 conf-room)").await, "{:#?}", person.lines);
        // The robot must return to the corridor, and is on its way.
        let departed = |truth: &::building::Truth| {
            let departs = |event: &BuildingEvent| matches!(event, BuildingEvent::Departed { to, .. } if to == "corridor");
            truth.occurrences().filter(|occurrence| departs(&occurrence.event)).count() == 2
        };
        office.until("it goes back to its patrol", departed).await;
        let reached = person.reaches("(known-temperature conf-room)").await;
        assert!(reached, "{mode:?}: {:#?}", person.lines);
        assert_eq!(came(&office.building.truth()), 1, "{mode:?}: it left off and turned round");
        office.until("it passes by again", |truth| came(truth) == 2).await;
        office.close().await;
    }
}
