//! Test of Figure 1 of the paper: a screen is plugged in, presents slides, and fails during a
//! meeting; then the video-collaboration robot takes over.

use ::building::{BuildingEvent, DeviceFault, Truth};
use acl::content::Keep;

use super::{MODES, Office, entry};

const MEDIA: &str = "media = { slides = \"Figures of the quarter\", agenda = \"1. Figures\" }";

fn meeting() -> [String; 2] {
    [
        entry("screen-1", "screen", &format!("{{ location = \"conf-room\", {MEDIA} }}")),
        entry("robot-1", "video-robot", &format!("{{ start = \"corridor\", {MEDIA} }}")),
    ]
}

fn presents(truth: &Truth, text: &str) -> bool {
    truth.presented_in("conf-room").any(|shown| shown == text)
}

#[tokio::test(start_paused = true)]
async fn a_screen_that_is_plugged_in_is_set_up_by_itself() {
    for mode in MODES {
        let office = Office::open(&meeting(), mode).await;
        let truth =
            office.until("it has a channel", |truth| truth.channel_of("screen-1").is_some()).await;
        assert!(truth.any(|event| matches!(event, BuildingEvent::Allocated { .. })));
        let mut person = office.person("user");
        assert!(person.reaches("(can-present conf-room)").await, "{:#?}", person.lines);
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn the_robot_takes_over_where_a_screen_fails_in_a_meeting() {
    for mode in MODES {
        let office = Office::open(&meeting(), mode).await;
        let mut person = office.person("user");
        person.wish("(presented slides conf-room)", Keep::Maintain).await;
        assert!(person.hears().await, "{mode:?} {:#?}", person.lines);
        let truth = office.building.truth();
        assert!(presents(&truth, "Figures of the quarter"), "{mode:?}");
        assert_eq!(truth.place_of("robot-1"), Some("corridor"), "the screen is cheaper");
        office.building.break_device("screen-1", DeviceFault::Fails).expect("it is there");
        assert!(!presents(&office.building.truth(), "Figures of the quarter"));
        let truth = office
            .until("somebody else presents", |truth| presents(truth, "Figures of the quarter"))
            .await;
        assert_eq!(truth.place_of("robot-1"), Some("conf-room"), "{mode:?}");
        assert_eq!(truth.shown_on("robot-1-screen"), Some("Figures of the quarter"));
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_robot_that_presents_stays_until_it_is_done() {
    let office = Office::open(&meeting()[1..], super::Mode::Decentralized).await;
    let mut person = office.person("user");
    assert!(person.reaches("(presented agenda conf-room)").await, "{:#?}", person.lines);
    assert!(person.reaches("(at robot-1 corridor)").await, "{:#?}", person.lines);
    let truth = office.building.truth();
    let last = |is_so: fn(&BuildingEvent) -> bool| {
        let found = truth.occurrences().rfind(|occurrence| is_so(&occurrence.event));
        found.map(|occurrence| occurrence.sequence)
    };
    let dark = last(|event| matches!(event, BuildingEvent::Darkened { .. }));
    let departed = last(|event| matches!(event, BuildingEvent::Departed { .. }));
    assert!(dark.is_some() && dark < departed, "dark first: {truth:#?}");
    assert_eq!(truth.shown_on("robot-1-screen"), None);
    office.close().await;
}
