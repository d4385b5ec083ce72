//! The commands that talk to a running ecosystem, and what wrong wishes get.

mod support;

use std::time::Instant;

use serde_json::Value;
use support::{Office, PATIENCE, stderr, stdout};

fn file() -> String {
    Office::file().display().to_string()
}

/// Runs a command against the office; its exit code and stdout.
fn ask(office: &Office, arguments: &[&str]) -> (Option<i32>, String) {
    let file = file();
    let output = office.run(&[arguments, &["--ecosystem", &file]].concat());
    (output.status.code(), format!("{}{}", stdout(&output), stderr(&output)))
}

/// The office on four machines, when all its devices can be planned with.
fn office() -> Office {
    let mut office = Office::new();
    // The robot's laptop comes before the other boards: it lends them the simulated building.
    office.up(&["reasoning", "turtlebot-laptop", "office2-pi", "conf-room-pi"], &[]);
    let deadline = Instant::now() + PATIENCE;
    let devices = ["thermometer-office2", "thermometer-conf-room", "turtlebot-1", "ir-1"];
    loop {
        let (_, json) = ask(&office, &["domain", "--json"]);
        let snapshot: Value = serde_json::from_str(&json).unwrap_or_default();
        if devices.iter().all(|device| snapshot["offers"].get(device).is_some()) {
            return office;
        }
        assert!(Instant::now() < deadline, "not all devices came: {json}");
    }
}

#[test]
fn an_office_of_four_machines() {
    let office = office();

    let (code, goal) = ask(&office, &["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{goal}");
    assert!(goal.contains("20.5 °C at office1"), "{goal}");
    assert!(goal.contains("done     the goal holds"), "{goal}");

    let (_, again) = ask(&office, &["goal", "temperatures"]);
    assert!(again.contains("it holds already"), "{again}");

    let (_, agents) = ask(&office, &["agents"]);
    for line in ["turtlebot-1", "turtlebot-laptop", "move", "report-temperature"] {
        assert!(agents.contains(line), "{agents}");
    }
    let (_, state) = ask(&office, &["state"]);
    assert!(state.contains("(known-temperature office1)"), "{state}");
    assert!(state.contains("ir-1"), "whose word it is: {state}");

    let (_, domain) = ask(&office, &["domain"]);
    let parsed = pddl::parse_domain(&domain);
    assert!(parsed.is_ok(), "{:?}", parsed.diagnostics);

    let (_, json) = ask(&office, &["domain", "--json"]);
    let snapshot: Value = serde_json::from_str(&json).expect("one JSON object");
    assert!(snapshot["offers"]["turtlebot-1"]["move"].is_object(), "{json}");

    // Wrong wishes: a clear answer each, and the office goes on.
    let (code, unknown) = ask(&office, &["goal", "(known-temprature office1)"]);
    assert_eq!(code, Some(1), "{unknown}");
    assert!(unknown.contains("known-temperature"), "the likely name: {unknown}");

    let (code, broken) = ask(&office, &["goal", "(and (known-temperature office1)"]);
    assert_eq!(code, Some(33), "{broken}");

    let (code, misnamed) = ask(&office, &["goal", "temperature"]);
    assert_eq!(code, Some(33), "{misnamed}");
    assert!(misnamed.contains("did you mean `temperatures`?"), "{misnamed}");

    let (code, never) = ask(&office, &["goal", "(mounted-on thermometer-office2 turtlebot-1)"]);
    assert_eq!(code, Some(1), "{never}");
    assert!(never.contains("(mounted-on thermometer-office2 turtlebot-1)"), "{never}");

    let (code, nothing) = ask(&office, &["goal", "--cancel", "no-such-goal"]);
    assert_eq!(code, Some(1), "{nothing}");
    assert!(nothing.contains("there is no goal `no-such-goal`"), "{nothing}");

    let (code, still) = ask(&office, &["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{still}");
}

#[test]
fn a_frozen_process_is_silence_not_for_ever() {
    let office = office();
    office.signal("office2-pi", "STOP");
    let (code, goal) = ask(&office, &["goal", "temperatures"]);
    office.signal("office2-pi", "CONT");
    assert_eq!(code, Some(0), "the robot measures office2 instead: {goal}");
    assert!(goal.contains("21.5 °C at office2"), "{goal}");
}

#[test]
fn nobody_there_is_said() {
    let office = Office::new();
    for command in [&["agents"][..], &["goal", "temperatures"], &["state"], &["domain"]] {
        let (code, text) = ask(&office, command);
        assert_eq!(code, Some(69), "{text}");
        assert!(text.contains("no daemon of it runs on this machine"), "{text}");
    }
}

#[test]
fn an_unknown_daemon_is_told_the_known_ones() {
    let office = Office::new();
    let output = office.run(&["up", &file(), "--daemon", "office2-pie"]);
    assert_eq!(output.status.code(), Some(78));
    let text = stderr(&output);
    assert!(text.contains("did you mean `office2-pi`?"), "{text}");
}
