//! `althing view`: the pages of a running ecosystem and of recordings, as text, as JSON, as a
//! picture, and on the screen of a terminal, which is restored however the view ends.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::Value;

use crate::support::terminal::{Terminal, has_tmux};
use crate::support::{Office, PATIENCE, office, stderr, stdout};

const PAGES: [&str; 12] = [
    "overview",
    "goals",
    "goal",
    "agents",
    "agent",
    "world",
    "floor",
    "questions",
    "activity",
    "conversations",
    "conversation",
    "topology",
];

fn file() -> String {
    Office::file().display().to_string()
}

/// Plays a scenario and records it.
#[track_caller]
fn record(office: &Office, arguments: &[&str]) -> String {
    let file = office.folder().join("scenario.jsonl").display().to_string();
    let all = [&["scenario"], arguments, &["--record", &file, "--json"]].concat();
    let output = office.run(&all);
    assert!(output.status.success(), "{all:?}: {}{}", stdout(&output), stderr(&output));
    let played: Value = serde_json::from_str(&stdout(&output)).expect("one JSON object");
    assert_eq!(played["holds"], true, "{played:#}");
    assert!(stderr(&output).contains("messages in"), "{}", stderr(&output));
    file
}

/// Returns what a page of a recording shows.
#[track_caller]
fn page(office: &Office, recording: &str, page: &str, options: &[&str]) -> String {
    let all = [&["view", page, "--recording", recording], options].concat();
    let output = office.run(&all);
    assert!(output.status.success(), "{all:?}: {}{}", stdout(&output), stderr(&output));
    stdout(&output)
}

#[track_caller]
fn data(office: &Office, recording: &str, name: &str, options: &[&str]) -> Value {
    let text = page(office, recording, name, &[&["--json"], options].concat());
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// Checks that a scenario is seen to its end: every page shows something, and the goals end as the
/// building's own truth says.
#[track_caller]
fn check(arguments: &[&str], goals: usize, stages: &[&str]) {
    let office = Office::new();
    let recording = record(&office, arguments);
    for name in PAGES {
        let text = page(&office, &recording, name, &["--once"]);
        assert!(!text.trim().is_empty(), "{arguments:?}: {name} is empty: {text}");
        assert!(!text.contains('\u{1b}'), "{name}: {text:?}");
    }
    let shown = data(&office, &recording, "goals", &[]);
    let rows = shown["data"].as_array().expect("a list");
    assert!(rows.len() >= goals, "{arguments:?}: {shown:#}");
    for row in rows {
        let stage = row["stage"].as_str().unwrap_or_default();
        assert!(stages.contains(&stage), "{arguments:?}: {row:#}");
    }
}

#[test]
fn scenario_1_is_watched_to_its_end() {
    check(&["1"], 1, &["holding"]);
    check(&["1", "--substrate", "memory", "--mode", "centralized"], 1, &["holding"]);
}

#[test]
fn scenario_1_in_processes_is_watched_to_its_end() {
    check(&["1", "--processes"], 1, &["holding"]);
}

/// The scenario ends when the building is as it must be, which the user is told a moment later. The
/// kept goal has not ended.
#[test]
fn scenario_2_is_watched_to_its_end() {
    check(&["2"], 1, &["holding", "running", "planning", "waiting"]);
}

/// Some visitors give no right answer, so that the camera's goal about them fails.
#[test]
fn scenario_3_is_watched_to_its_end() {
    check(&["3"], 4, &["done", "failed"]);
}

#[test]
fn scenario_4_is_watched_to_its_end() {
    check(&["4"], 2, &["holding", "done"]);
}

#[test]
fn a_recording_begins_with_the_first_messages_and_ends_with_the_last() {
    let office = Office::new();
    for options in [&["1"][..], &["1", "--substrate", "memory"], &["1", "--processes"]] {
        let is_here = !options.contains(&"--processes");
        let recording = record(&office, options);
        let text = std::fs::read_to_string(&recording).expect("it was recorded");
        let messages: Vec<Value> =
            text.lines().skip(1).map(|line| serde_json::from_str(line).expect("JSON")).collect();
        let models = messages.iter().filter(|it| it["message"]["content"]["of"] == "model");
        let senders: std::collections::BTreeSet<_> =
            models.map(|it| it["message"]["sender"].to_string()).collect();
        // Daemons that find each other query the models, which are announced before that.
        assert!(senders.len() >= 4 || !is_here, "{options:?}: each device: {senders:?}");
        let holds = |it: &&Value| it["message"]["content"]["outcome"] == "holds";
        assert!(messages.iter().filter(holds).count() >= 2, "{options:?}: it holds twice");
    }
}

#[test]
fn a_recording_is_shown_at_any_second() {
    let office = Office::new();
    let recording = record(&office, &["1", "--substrate", "memory"]);
    let early = data(&office, &recording, "goals", &["--at", "0.001"]);
    assert_eq!(early["data"].as_array().map(Vec::len), Some(0), "{early:#}");
    let late = data(&office, &recording, "goals", &["--at", "1000"]);
    assert_eq!(late["data"].as_array().map(Vec::len), Some(1), "{late:#}");

    let picture = office.folder().join("goal.svg");
    let path = picture.display().to_string();
    page(&office, &recording, "goal", &["--picture", &path]);
    let svg = std::fs::read_to_string(&picture).expect("a picture");
    assert!(svg.contains("<svg") && svg.trim_end().ends_with("</svg>"), "{svg}");
    let output = office.run(&["view", "--recording", &recording, "--picture", "/nowhere/x.svg"]);
    assert_eq!(output.status.code(), Some(74), "{}", stderr(&output));
}

#[test]
fn invalid_recordings_and_names_are_refused() {
    let office = Office::new();
    let newer = office.write("newer.jsonl", "{\"recording\":7,\"ecosystem\":\"office\"}\n");
    let newer = newer.display().to_string();
    for (file, word) in [("nowhere.jsonl", "failed to read"), (newer.as_str(), "version 7")] {
        let output = office.run(&["view", "--recording", file, "--once"]);
        assert_eq!(output.status.code(), Some(33), "{}", stderr(&output));
        assert!(stderr(&output).contains(word), "{}", stderr(&output));
    }
    let garbled = "{\"recording\":1,\"ecosystem\":\"office\"}\n{\"at_ms\":1,\"key\":\"\",\"mess";
    let garbled = office.write("garbled.jsonl", garbled).display().to_string();
    for name in PAGES {
        page(&office, &garbled, name, &["--once"]);
    }
    let output = office.run(&["view", "agent", "robbie", "--recording", &garbled, "--once"]);
    assert_eq!(output.status.code(), Some(33), "{}", stderr(&output));
    let output = office.run(&["view", "--recording", &garbled]);
    assert_eq!(output.status.code(), Some(69), "no terminal: {}", stderr(&output));
    assert!(stderr(&output).contains("--once"), "{}", stderr(&output));
    let output = office.run(&["view", "overvew", "--once"]);
    assert_eq!(output.status.code(), Some(64), "{}", stderr(&output));
}

#[test]
fn a_running_office_is_shown_once() {
    let office = office();
    let (code, said) = office.ask(&["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{said}");
    for name in PAGES {
        let (code, text) = office.ask(&["view", name, "--once"]);
        assert_eq!(code, Some(0), "{name}: {text}");
    }
    let agents = office.ask_json(&["view", "agents"]);
    let agents = agents["data"].as_array().expect("a list").clone();
    let is_here =
        |name: &str| agents.iter().any(|row| row["agent"] == name && row["presence"] == "present");
    assert!(is_here("turtlebot-1") && is_here("thermometer-office2"), "{agents:#?}");
    let daemons = office.ask_json(&["view", "topology"]);
    let daemons = daemons["data"].as_array().expect("a list");
    assert_eq!(daemons.len(), 5, "the file names one that does not run: {daemons:#?}");
    let is_measured = |row: &&Value| row["round_trip_micros"].as_u64() > Some(0);
    assert_eq!(daemons.iter().filter(is_measured).count(), 4, "{daemons:#?}");
    let facts = office.ask_json(&["view", "world"]).to_string();
    assert!(facts.contains("(known-temperature office1)"), "{facts}");
    let goals = office.ask_json(&["view", "goals"]);
    let is_kept = |row: &Value| row["goal"] == "(patrolled corridor)" && row["keep"] == "maintain";
    assert!(goals["data"].as_array().expect("a list").iter().any(is_kept), "{goals:#}");
}

#[test]
fn one_goal_is_watched_live_in_terminals_of_two_sizes() {
    if !has_tmux() {
        return;
    }
    let office = office();
    let arguments = format!("view overview --ecosystem '{}'", file());
    let large = Terminal::open(&office, &arguments);
    let small = Terminal::of_size(&office, &arguments, (40, 15));
    for terminal in [&large, &small] {
        terminal.await_text("smart-office");
        terminal.press("2");
    }
    let (code, said) = office.ask(&["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{said}");
    for terminal in [&large, &small] {
        terminal.await_text("(forall");
        // The goal is not the only one: the file names another.
        terminal.press("/");
        terminal.type_text("forall");
        terminal.press("Enter");
        terminal.press("Enter");
        terminal.await_text("Plan 1");
        // Back to the goals, and without the filter.
        terminal.press("Escape");
        terminal.await_text("1 row with");
        terminal.press("Escape");
        terminal.await_text("(patrolled");
    }
    // A goal is asked for without leaving the screen.
    large.press("g");
    large.await_text("What is wanted?");
    large.type_text("(at turtlebot-1 corridor)");
    large.press("Enter");
    // Its plan is shown first, or that it holds already.
    large.await_text("a dry run: nothing is asked for");
    large.press("Enter");
    let is_done = |line: &str| line.contains("(at turtlebot-1") && line.contains("done");
    large.await_screen("the goal, done", |screen| screen.lines().any(is_done));
    for terminal in [large, small] {
        // Esc closes what is open; then `q` quits.
        terminal.press("Escape");
        terminal.press("C-c");
        let screen = terminal.await_text("ended with");
        assert!(screen.contains("ended with 0,  echo"), "{screen}");
    }
}

#[test]
fn the_terminal_is_restored_however_the_view_ends() {
    if !has_tmux() {
        return;
    }
    let office = Office::new();
    let recording = record(&office, &["1", "--substrate", "memory"]);
    let arguments = format!("view --recording '{recording}'");
    for (signal, code) in [("TERM", 143), ("INT", 130), ("HUP", 129)] {
        let terminal = Terminal::open(&office, &arguments);
        terminal.await_text("scenario-1");
        let arguments = [format!("-{signal}"), id_of_view(&recording)];
        let sent = Command::new("kill").args(arguments).status();
        assert!(sent.expect("kill is there").success());
        let screen = terminal.await_text("ended with");
        assert!(screen.contains(&format!("ended with {code},  echo")), "{signal}: {screen}");
    }
}

#[test]
fn a_view_ends_with_its_terminal() {
    if !has_tmux() {
        return;
    }
    let office = Office::new();
    let recording = record(&office, &["1", "--substrate", "memory"]);
    let terminal = Terminal::open(&office, &format!("view --recording '{recording}'"));
    terminal.await_text("scenario-1");
    let process = id_of_view(&recording);
    drop(terminal);
    let deadline = Instant::now() + PATIENCE;
    while Path::new("/proc").join(&process).exists() {
        assert!(Instant::now() < deadline, "process {process} stays");
        std::thread::yield_now();
    }
}

#[test]
fn a_view_waits_for_an_ecosystem_and_finds_it_again() {
    if !has_tmux() {
        return;
    }
    let office = Office::new();
    let terminal = Terminal::open(&office, &format!("view --ecosystem '{}'", file()));
    let is_reached = |screen: &str| !screen.contains("this is how it was before");
    for _ in 0..2 {
        terminal.await_screen("that it is not reached", |screen| !is_reached(screen));
        let mut daemon = office.command(&["up", &file()]);
        let mut daemon = daemon.stdout(Stdio::null()).spawn().expect("the binary is built");
        terminal.await_screen("that it is reached", is_reached);
        daemon.kill().expect("our child");
        daemon.wait().expect("our child");
    }
    terminal.press("q");
    terminal.await_text("ended with 0,  echo");
}

/// Returns the process id of the view that shows a recording.
fn id_of_view(recording: &str) -> String {
    let processes = std::fs::read_dir("/proc").expect("processes").flatten();
    let is_it = |process: &Path| {
        let arguments = std::fs::read(process.join("cmdline")).unwrap_or_default();
        let arguments = String::from_utf8_lossy(&arguments).into_owned();
        let program = arguments.split('\0').next().unwrap_or_default();
        program.ends_with("/althing") && arguments.contains(recording)
    };
    let found = processes.map(|process| process.path()).find(|process| is_it(process));
    let found = found.expect("a view");
    found.file_name().expect("a number").to_string_lossy().into_owned()
}
