//! `althing scenario 1`, as a user runs it: both flows, in one process and in at least five,
//! several buildings. The exit code is the building's truth.

mod support;

use serde_json::Value;
use support::{Office, stderr, stdout};

#[track_caller]
fn check(arguments: &[&str]) -> Value {
    let office = Office::new();
    let all = [&["scenario", "1", "--json"], arguments].concat();
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

#[test]
fn the_other_scenarios_are_refused_by_name() {
    let output = Office::new().run(&["scenario", "2"]);
    assert_eq!(output.status.code(), Some(69));
    assert!(stderr(&output).contains("scenario 2` is not built yet"), "{}", stderr(&output));
}
