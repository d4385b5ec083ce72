//! The buildings of `ecosystems/` other than the office: each starts from its file alone and
//! reaches its goals.

use std::path::{Path, PathBuf};

use crate::support::{Office, stderr, stdout};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

/// Returns an office for a building, after checking that its files have no mistake.
fn building(name: &str) -> Office {
    let file = root().join(format!("ecosystems/{name}.toml"));
    let building = Office::of(file.clone());
    let checked = building.run(&["check", &file.display().to_string()]);
    assert!(checked.status.success(), "{}{}", stdout(&checked), stderr(&checked));
    building
}

/// Starts a whole building on one machine, and waits until its devices can be planned with.
fn up(name: &str, mode: &str, devices: usize) -> Office {
    let mut building = building(name);
    // Without a daemon name of the file: a machine that is alone hosts everything.
    building.up_alone(&["--mode", mode]);
    building.await_devices(devices);
    building
}

/// Reaches a goal; returns the output.
fn reach(building: &Office, goal: &str) -> String {
    let (code, said) = building.ask(&["goal", goal]);
    assert_eq!(code, Some(0), "{goal}: {said}");
    assert!(said.contains("done     the goal holds"), "{goal}: {said}");
    said
}

/// Returns the known state as JSON.
fn known(building: &Office) -> String {
    building.ask_json(&["state"]).to_string()
}

#[test]
fn robots_of_the_ward_use_the_lift() {
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

/// The smallest file: three rooms, two sensors, one robot, and one goal that is kept.
#[test]
fn the_smallest_file_reaches_its_kept_goal() {
    let file = std::fs::read_to_string(root().join("ecosystems/small-home.toml")).expect("shipped");
    assert!(file.lines().count() <= 25, "{} lines", file.lines().count());
    let mut home = building("small-home");
    home.up_alone(&[]);
    home.await_devices(3);
    for room in ["kitchen", "bedroom", "living-room"] {
        home.await_fact(&format!("(known-temperature {room})"), true);
    }
    let (code, goals) = home.ask(&["goals"]);
    assert_eq!(code, Some(0), "{goals}");
    assert!(goals.contains("to be kept"), "{goals}");
    let (code, said) = home.ask(&["goal", "(at robot kitchen)"]);
    assert_eq!(code, Some(0), "the robot goes through doors: {said}");
}

/// A parcel goes upstairs and through a door: four agents need each other.
#[test]
fn a_parcel_is_delivered_by_four_agents_together() {
    for mode in ["decentralized", "centralized"] {
        let house = up("parcels", mode, 4);
        house.await_fact("(parcel-at parcel-1 store)", true);
        let said = reach(&house, "delivered");
        let words = ["carries parcel-1", "the cabin is at landing-1", "the door is open"];
        for word in words {
            assert!(said.contains(word), "{mode}, no `{word}`: {said}");
        }
        if mode == "decentralized" {
            assert!(said.contains("by itself; "), "{said}");
        }
        assert!(known(&house).contains("parcel-at parcel-1 lab"), "{mode}");
    }
}

/// No report and no answer has the name of a shelf.
#[test]
fn an_arm_loads_a_parcel_and_tells_no_shelf() {
    for mode in ["decentralized", "centralized"] {
        let depot = up("depot", mode, 2);
        depot.await_fact("(stored parcel-1 arm-1)", true);
        let said = reach(&depot, "delivered");
        let words = ["(load arm-1 parcel-1 courier-1 bay)", "(hold-still courier-1 bay)"];
        for word in words {
            assert!(said.contains(word), "{mode}, no `{word}`: {said}");
        }
        let state = known(&depot);
        assert!(state.contains("parcel-at parcel-1 office"), "{mode}: {state}");
        assert!(state.contains("stored parcel-2 arm-1"), "{mode}: {state}");
        let domain = depot.ask(&["domain"]).1;
        let why = depot.ask(&["why", "(parcel-at parcel-1 office)"]).1;
        for text in [said, state, domain, why] {
            assert!(!text.contains("shelf-"), "{mode}: {text}");
        }
    }
}

/// One house of the campus and the reasoning machine: the other houses are not started yet.
#[test]
fn a_house_of_the_campus_is_measured_by_its_own_devices() {
    for mode in ["centralized", "decentralized"] {
        let mut campus = building("campus");
        campus.up(&["reasoning", "house-a"], &["--mode", mode]);
        campus.await_devices(20);
        house_a_is_measured(&campus);
    }
}

/// The whole campus in one process.
#[test]
fn a_campus_of_a_hundred_devices_plans_together() {
    for mode in ["centralized", "decentralized"] {
        let campus = up("campus", mode, 100);
        house_a_is_measured(&campus);
        // The remaining rooms in one goal that spans all houses.
        let all = reach(&campus, "temperatures");
        for house in ["b", "c", "d", "e"] {
            let of_house = |line: &&str| line.contains(&format!(" °C at {house}-"));
            let measured = all.lines().filter(of_house).count();
            assert_eq!(measured, 20, "{mode}, house {house}: {all}");
        }
        assert!(!all.contains(" °C at a-"), "{mode}, measured twice: {all}");
    }
}

fn house_a_is_measured(campus: &Office) {
    let house = reach(campus, "house-a");
    let measured = house.lines().filter(|line| line.contains(" °C at a-")).count();
    assert_eq!(measured, 20, "{house}");
    assert!(house.contains("arrived at a-"), "no robot drove: {house}");
    let known = known(campus);
    for room in ["a-101", "a-110", "a-201", "a-210"] {
        assert!(known.contains(&format!("known-temperature {room}")), "{room}: {known}");
    }
}
