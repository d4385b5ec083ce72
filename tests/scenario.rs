//! `althing scenario` as a user runs it: both flows, in one process and in at least five, in
//! several buildings. The exit code reflects the building's truth.

use serde_json::Value;

use crate::support::{Office, stderr, stdout};

#[track_caller]
fn check(arguments: &[&str]) -> Value {
    check_number("1", arguments)
}

#[track_caller]
fn check_number(number: &str, arguments: &[&str]) -> Value {
    let office = Office::new();
    let all = [&["scenario", number, "--json"], arguments].concat();
    let output = office.run(&all);
    let printed = stdout(&output);
    assert!(output.status.success(), "{all:?}\n{printed}\n{}", stderr(&output));
    let value: Value = serde_json::from_str(&printed).expect("one JSON object");
    assert_eq!(value["holds"], true);
    value
}

#[test]
fn in_one_process() {
    check(&["--mode", "centralized"]);
    let value = check(&["--mode", "decentralized"]);
    assert_eq!(value["told"]["office1"], 20.5, "the paper's office, seed 0");
}

#[test]
fn in_processes_of_which_one_is_killed() {
    for mode in ["centralized", "decentralized"] {
        let value = check(&["--mode", mode, "--processes"]);
        let events = value["events"].to_string();
        assert!(events.contains("in 5 processes"), "{events}");
        assert!(events.contains("was killed (SIGKILL)"), "{events}");
    }
}

#[test]
fn in_processes_in_other_buildings() {
    for (seed, mode) in [("1", "centralized"), ("2", "decentralized"), ("3", "decentralized")] {
        check(&["--mode", mode, "--processes", "--seed", seed]);
    }
}

#[test]
fn on_a_wire_in_memory() {
    check(&["--substrate", "memory", "--seed", "5"]);
}

/// The temperatures stay known while sensors fail and return.
#[test]
fn scenario_2_in_processes() {
    for (seed, mode) in [("0", "decentralized"), ("1", "centralized")] {
        let value = check_number("2", &["--mode", mode, "--processes", "--seed", seed]);
        let events = value["events"].to_string();
        assert_eq!(events.matches("was killed (SIGKILL)").count(), 2, "{events}");
        assert!(events.contains("is plugged in"), "{events}");
    }
}

/// Collects every string in a JSON value.
fn words_of<'v>(value: &'v Value, words: &mut Vec<&'v str>) {
    match value {
        Value::String(text) => words.push(text),
        Value::Array(values) => values.iter().for_each(|each| words_of(each, words)),
        Value::Object(values) => values.values().for_each(|each| words_of(each, words)),
        _ => (),
    }
}

/// Four people come; two are admitted.
#[test]
fn scenario_3_in_processes() {
    for (seed, mode) in [("0", "centralized"), ("1", "decentralized")] {
        let value = check_number("3", &["--mode", mode, "--processes", "--seed", seed]);
        let admissions = value["admissions"].as_array().expect("a list");
        let validated: Vec<_> =
            admissions.iter().filter(|admission| admission["validated"] == true).collect();
        assert_eq!((admissions.len(), validated.len()), (4, 2), "{admissions:?}");
        // Only strings are checked, because a time may happen to have these digits.
        let mut words = Vec::new();
        words_of(&value, &mut words);
        assert!(words.iter().any(|word| word.contains("PIN")), "{words:?}");
        assert!(!words.iter().any(|word| word.contains("2718")), "the PIN is a secret: {words:?}");
    }
}

/// The meeting goes on when the screen fails.
#[test]
fn scenario_4_in_processes() {
    for (seed, mode) in
        [("0", "centralized"), ("0", "decentralized"), ("1", "centralized"), ("2", "decentralized")]
    {
        check_number("4", &["--mode", mode, "--processes", "--seed", seed]);
    }
}

/// A robot and a door, two robots and a lift, a robot and an arm need each other.
#[test]
fn scenarios_5_to_7_in_processes() {
    for (number, seed, mode) in [
        ("5", "0", "decentralized"),
        ("5", "1", "centralized"),
        ("6", "0", "decentralized"),
        ("6", "2", "decentralized"),
        ("6", "0", "centralized"),
        ("7", "0", "decentralized"),
        ("7", "3", "centralized"),
    ] {
        let value = check_number(number, &["--mode", mode, "--processes", "--seed", seed]);
        let events = value["events"].to_string();
        let is_explained = events.contains("by itself; ") && events.contains("do it together");
        assert_eq!(is_explained, mode == "decentralized", "{events}");
    }
}

#[test]
fn all_in_one_process() {
    for (number, mode) in [
        ("2", "centralized"),
        ("3", "decentralized"),
        ("4", "centralized"),
        ("5", "decentralized"),
        ("6", "centralized"),
        ("7", "decentralized"),
    ] {
        check_number(number, &["--mode", mode]);
    }
}
