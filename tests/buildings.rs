//! The buildings of `ecosystems/` beside the office: each comes up from its files alone, and what
//! its goals promise comes to pass.

mod support;

use std::path::{Path, PathBuf};

use serde_json::Value;
use support::{Office, stderr, stdout};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A building's files have no mistake, and its one machine hosts all of it.
fn up(name: &str, mode: &str, devices: usize) -> Office {
    let path = |path: String| root().join(path);
    let file = path(format!("ecosystems/{name}.toml"));
    let mut building = Office::of(file.clone());
    let domain = path(format!("domains/{name}/domain.pddl"));
    let map = path(format!("domains/{name}/map.pddl"));
    let files = [&file, &domain, &map].map(|file| file.display().to_string());
    let checked = building.run(&["check", &files[0], &files[1], &files[2]]);
    assert!(checked.status.success(), "{}{}", stdout(&checked), stderr(&checked));

    // By no name of the file: a machine that is alone hosts everything.
    building.up_alone(&["--mode", mode]);
    building.await_devices(devices);
    building
}

/// The goal is reached; what was said on the way.
fn reach(building: &Office, goal: &str) -> String {
    let (code, said) = building.ask(&["goal", goal]);
    assert_eq!(code, Some(0), "{goal}: {said}");
    assert!(said.contains("done     the goal holds"), "{goal}: {said}");
    said
}

/// What the ecosystem knows, as JSON.
fn known(building: &Office) -> String {
    let (code, json) = building.ask(&["state", "--json"]);
    assert_eq!(code, Some(0), "{json}");
    let state: Value = serde_json::from_str(&json).expect("one JSON object");
    state.to_string()
}

#[test]
fn robots_of_the_ward_ride_the_lift() {
    for mode in ["decentralized", "centralized"] {
        let ward = up("ward", mode, 8);

        let own = reach(&ward, "pharmacy");
        assert!(own.contains("18.5 °C at pharmacy"), "{mode}: {own}");
        assert!(!own.contains("arrived"), "its own thermometer suffices: {own}");

        let isolation = reach(&ward, "isolation");
        for word in ["arrived at lift", "arrived at airlock-in", "24.5 °C at isolation"] {
            assert!(isolation.contains(word), "{mode}, no `{word}`: {isolation}");
        }

        let upstairs = reach(&ward, "upstairs");
        for word in ["arrived at airlock-out", "21.0 °C at room-13", "23.0 °C at room-12"] {
            assert!(upstairs.contains(word), "{mode}, no `{word}`: {upstairs}");
        }
        assert!(!upstairs.contains("arrived at lift"), "a robot is there already: {upstairs}");

        let all = reach(&ward, "temperatures");
        for word in ["22.0 °C at room-2", "17.0 °C at linen"] {
            assert!(all.contains(word), "{mode}, no `{word}`: {all}");
        }
        let known = known(&ward);
        for room in ["room-1", "room-2", "pharmacy", "linen", "room-11", "isolation"] {
            assert!(known.contains(&format!("known-temperature {room}")), "{mode}: {known}");
        }
    }
}
