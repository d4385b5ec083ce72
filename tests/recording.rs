//! A day of the office is recorded, from real processes over Zenoh, and replayed into a fresh
//! office: the goals end in the same way, and are reached also if every tenth message is lost and
//! every tenth is duplicated.

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Stdio};

use serde_json::Value;

use crate::support::{Office, PATIENCE, lines, office, stderr, stdout};

/// Starts recording; returns when the recorder receives all messages.
fn record(office: &Office, file: &str) -> Child {
    let ecosystem = Office::file().display().to_string();
    let arguments = ["watch", "--record", file, "--ecosystem", &ecosystem];
    let mut recorder = office.command(&arguments).stderr(Stdio::piped()).spawn().expect("it runs");
    let said = recorder.stderr.take().expect("piped");
    let mut lines = BufReader::new(said).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains("recording `smart-office`")), "it never began");
    // The remaining output is read, so that the recorder never blocks.
    std::thread::spawn(move || lines.for_each(drop));
    recorder
}

/// The paper's first scenario, and some commands of people.
fn a_day() -> (Office, PathBuf) {
    let mut office = office();
    let recorder = record(&office, "day.jsonl");
    let mut recorder = recorder;
    let (code, said) = office.ask(&["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = office.ask(&["act", "(move turtlebot-1 office1 corridor)"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = office.ask(&["goal", "(at turtlebot-1 nowhere)"]);
    assert_ne!(code, Some(0), "{said}");
    give_up(&office, "(at turtlebot-1 corridor)");
    office.terminate(&recorder);
    assert!(recorder.wait().expect("ours").success(), "it ends in order");
    for daemon in ["conf-room-pi", "office2-pi", "turtlebot-laptop", "reasoning"] {
        office.kill(daemon);
    }
    let file = office.write("x", "").with_file_name("day.jsonl");
    (office, file)
}

/// Requests a maintained goal, and cancels it when it holds.
fn give_up(office: &Office, goal: &str) {
    let ecosystem = Office::file().display().to_string();
    let arguments = ["goal", goal, "--maintain", "--ecosystem", &ecosystem];
    let mut asker = office.command(&arguments).stdout(Stdio::piped()).spawn().expect("it runs");
    let said = lines(&mut asker);
    let mut conversation = None;
    loop {
        let line = said.recv_timeout(PATIENCE).expect("it holds");
        if let Some(id) = line.strip_prefix("asked") {
            conversation = Some(id.trim().to_owned());
        }
        if line.starts_with("holds") {
            break;
        }
    }
    let conversation = conversation.expect("it was asked for before it holds");
    let (code, said) = office.ask(&["goal", "--cancel", &conversation]);
    assert!(said.contains("given up"), "{code:?}: {said}");
    asker.wait().expect("ours");
}

fn replay(office: &Office, file: &str, options: &[&str]) -> (Option<i32>, Value) {
    let ecosystem = Office::file().display().to_string();
    let arguments = ["replay", file, "--ecosystem", &ecosystem, "--json"];
    let output = office.run(&[&arguments, options].concat());
    let json = serde_json::from_str(&stdout(&output));
    let json =
        json.unwrap_or_else(|error| panic!("{error}: {}{}", stdout(&output), stderr(&output)));
    (output.status.code(), json)
}

#[test]
fn a_day_is_recorded_and_played_again() {
    let (office, file) = a_day();
    let text = std::fs::read_to_string(&file).expect("it was recorded");
    assert!(text.lines().count() > 50, "{text}");
    let file = file.display().to_string();

    let (code, played) = replay(&office, &file, &["--speed", "2"]);
    assert_eq!(code, Some(0), "{played:#}");
    let plays = played["plays"].as_array().expect("a list");
    let ends: Vec<_> = plays.iter().map(|play| play["now"].as_str().unwrap_or("")).collect();
    assert_eq!(&ends[..2], ["done", "done"], "{played:#}");
    assert_ne!(ends[2], "done", "{played:#}");
    assert_eq!(&ends[3..], ["given up", "given up"], "the goal, and who gave it up: {played:#}");
    assert_eq!(played["messages"]["lost"], 0);

    for seed in ["1", "2"] {
        let faults = ["--lose", "0.1", "--duplicate", "0.1", "--seed", seed, "--speed", "2"];
        let (code, played) = replay(&office, &file, &faults);
        // The faults do not keep a goal from being reached. A single action is planned with the
        // known state, which may be a second old if a heartbeat was lost; then the action may be
        // declined.
        assert_eq!(played["plays"][0]["now"], "done", "seed {seed}: {played:#}");
        let plays = played["plays"].as_array().expect("a list");
        let is_same = plays.iter().all(|play| play["same"] == true);
        assert_eq!(code, Some(if is_same { 0 } else { 1 }), "seed {seed}: {played:#}");
        for count in ["lost", "twice"] {
            assert!(played["messages"][count].as_u64() > Some(5), "{played:#}");
        }
    }

    // Shows that a replay can fail: on a network that loses everything no goal is reached.
    let (code, played) =
        replay(&office, &file, &["--lose", "1", "--speed", "100", "--patience", "2"]);
    assert_eq!(code, Some(1), "{played:#}");
    assert_eq!(played["status"], "otherwise");
    let plays = played["plays"].as_array().expect("a list");
    assert!(plays.iter().all(|play| play["same"] == false), "{played:#}");
}

#[test]
fn an_invalid_recording_is_refused() {
    let office = Office::new();
    let file = office.write("no.jsonl", "{\"hello\": 1}\n").display().to_string();
    let ecosystem = Office::file().display().to_string();
    for file in [file.as_str(), "nowhere.jsonl"] {
        let output = office.run(&["replay", file, "--ecosystem", &ecosystem]);
        assert_eq!(output.status.code(), Some(33), "{}", stderr(&output));
        assert!(stderr(&output).contains("failed to read"), "{}", stderr(&output));
    }
    let output = office.run(&["replay", "x", "--lose", "1.5"]);
    assert_eq!(output.status.code(), Some(64));
}
