//! Robots with a battery, a dock and poses of their own.

use ::building::Event;

use super::{MODES, Mode, Office, entry};

/// A robot that comes 10 m far, from the corridor to a room of 4 m and back and no further.
fn robot(more: &str) -> [String; 1] {
    let config = format!(
        "{{ start = \"corridor\", dock = \"corridor\", battery = {{ range = 10.0{more} }}, \
         poses = {{ entry = \"corridor\", board = {{ near = \"office1\", meters = 2.0 }} }} }}"
    );
    [entry("turtlebot-1", "turtlebot", &config)]
}

fn recharged(event: &Event) -> bool {
    matches!(event, Event::Recharged { .. })
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
        // Back are 6 m, and the dock is there.
        assert!(!person.reaches("(at turtlebot-1 corridor)").await, "{:#?}", person.lines);
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn with_an_empty_battery_it_offers_no_move_until_it_is_charged() {
    let office = Office::open(&robot(""), Mode::Decentralized).await;
    let mut person = office.person("user");
    assert!(person.reaches("(at turtlebot-1 office1)").await, "{:#?}", person.lines);
    office.building.set_charge("turtlebot-1", 0.0).expect("it has a battery");
    // It learns at its next move that the battery is empty, and then does not offer any.
    assert!(!person.reaches("(at turtlebot-1 corridor)").await, "{:#?}", person.lines);
    let before = office.building.truth();
    assert!(!person.reaches("(at turtlebot-1 corridor)").await, "{:#?}", person.lines);
    assert_eq!(office.building.truth(), before, "nobody even tried");
    assert_eq!(before.place_of("turtlebot-1"), Some("office1"));
    office.close().await;
}

#[tokio::test(start_paused = true)]
async fn it_goes_home_and_charges_when_asked_to() {
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
async fn poses_are_places_that_only_it_knows() {
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
