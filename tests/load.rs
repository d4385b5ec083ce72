//! Overload: what is refused is refused at once with a reason, and the end of every accepted goal
//! is reported and kept.

mod support;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::process::{Command, Stdio};
use std::time::Duration;

use substrate::Resource;
use support::Office;
use support::asker::{Asker, Heard};

/// Number of goals requested at once: more than are pursued at a time, and more than a mailbox
/// holds.
const GOALS: usize = 400;

/// Number of ended goals that the Journals keep (docs/reliability.md).
const ENDS_KEPT: usize = 128;

/// Number of commands started at once: several times as many as may join at a time.
const COMMANDS: usize = 12;

/// Time limit of the whole test on a busy machine.
const BUSY: Duration = Duration::from_secs(120);

/// Starts the office with a Journal on each of three machines, and the log of the reasoning daemon
/// in a file.
fn office() -> Office {
    let office = Office::new();
    let text = std::fs::read_to_string(Office::file()).expect("it is there");
    let root = Office::file().canonicalize().expect("it is there");
    let root = root.ancestors().nth(2).expect("a folder").display().to_string();
    let mut text = text.replace("\"../domains", &format!("\"{root}/domains"));
    for (name, daemon) in [("journal-2", "office2-pi"), ("journal-3", "conf-room-pi")] {
        text += &format!(
            "\n[[agent]]\nname = \"{name}\"\nplugin = \"journal\"\ndaemon = \"{daemon}\"\n"
        );
    }
    let file = office.write("office.toml", &text);
    let mut office = office.with_file(file);
    let file = office.file.display().to_string();
    for name in ["reasoning", "turtlebot-laptop", "office2-pi", "conf-room-pi"] {
        let mut command = office.command(&["up", &file, "--daemon", name]);
        command.env("ALTHING_BUILDING__TIME_SCALE", "0.02");
        if name == "reasoning" {
            command.arg("-v");
            command.stderr(File::create(office.folder().join("log")).expect("a file"));
        }
        office.begin_as(name, command);
    }
    office.await_devices(5);
    office
}

/// Returns the lines of the reasoning daemon's log.
fn log(office: &Office) -> Vec<String> {
    let text = std::fs::read_to_string(office.folder().join("log")).expect("a file");
    text.lines().map(str::to_owned).collect()
}

/// Returns goals that can be reached, and one in eight that names an unknown object.
fn goals(count: usize) -> impl Iterator<Item = String> {
    (0..count).map(|number| match number % 8 {
        0 => "(at turtlebot-1 office1)".to_owned(),
        1 | 3 => "(known-temperature conf-room)".to_owned(),
        2 => "(known-co2 conf-room)".to_owned(),
        4 => "(at turtlebot-1 office2)".to_owned(),
        5 => "(known-temperature office2)".to_owned(),
        6 => "(at turtlebot-1 nowhere)".to_owned(),
        _ => "(and (at turtlebot-1 corridor) (known-temperature office2))".to_owned(),
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn every_end_of_hundreds_of_simultaneous_goals_is_reported_and_kept() {
    let office = tokio::task::spawn_blocking(office).await.expect("no panic");
    let asker = Asker::join(&office, "asker").await;
    let heard = asker.ask(goals(GOALS), BUSY).await;

    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for Heard { refused, ended, .. } in heard.values() {
        assert!(refused.is_none() || ended.is_none(), "refused, and done: {refused:?} {ended:?}");
        let refused = refused.iter().map(|why| format!("refused: {why}"));
        let ended = ended.iter().map(|(outcome, why)| format!("{outcome}: {why}"));
        for what in refused.chain(ended) {
            *reasons.entry(what).or_default() += 1;
        }
    }
    eprintln!("{reasons:#?}");
    let open: Vec<_> = heard.iter().filter(|(_, heard)| !heard.is_over()).collect();
    assert!(open.is_empty(), "not told how they ended: {open:?}");
    let is_true = |reason: &str| {
        ["done: ", "failed: 1:17: error: unknown object `nowhere`", "refused: 256 goals"]
            .iter()
            .any(|beginning| reason.starts_with(beginning))
            || (reason.starts_with("refused: ") && reason.ends_with("ask again later"))
    };
    let untrue: Vec<_> = reasons.keys().filter(|reason| !is_true(reason)).collect();
    assert!(untrue.is_empty(), "{untrue:?}");
    let log = log(&office);
    let unkept: Vec<_> = log
        .iter()
        .filter(|line| line.contains("does not keep") || line.contains("is not kept"))
        .collect();
    assert!(unkept.is_empty(), "{unkept:?}");

    // A Journal keeps the last ends and drops older ones, and must not keep any of these goals as
    // running. The requester may receive its answer before that.
    let ended = heard.values().filter(|heard| heard.ended.is_some()).count();
    assert!(ended >= 32, "hardly any was accepted: {reasons:?}");
    let kept = tokio::time::timeout(BUSY, async {
        loop {
            let (open, kept) = records(&asker).await;
            if open == 0 && kept >= ended.min(ENDS_KEPT) {
                return;
            }
            tokio::time::sleep(Duration::from_millis(200)).await;
        }
    });
    kept.await.expect("all ends are on disk");
}

/// Returns how many of the requester's goals the Journals have as running, and of how many they
/// have the end.
async fn records(asker: &Asker) -> (usize, usize) {
    let journals = asker.question(Resource::Journal).await;
    assert!(!journals.is_empty(), "no Journal answers");
    let records =
        journals.iter().flat_map(|records| records.as_array().cloned().unwrap_or_default());
    let is_of_the_asker = |key: &str| key.starts_with("goal/") && key.ends_with("-of-asker");
    let goals = records
        .filter(|record| record["key"].as_str().is_some_and(is_of_the_asker))
        .filter(|record| !record["body"].is_null());
    let (mut open, mut ended) = (0, BTreeSet::new());
    for record in goals {
        match record["body"]["ended"].is_null() {
            true => open += 1,
            false => drop(ended.insert(record["key"].to_string())),
        }
    }
    (open, ended.len())
}

#[test]
fn simultaneous_commands_join_in_turn() {
    let office = office();
    let file = office.file.display().to_string();
    let goals = ["(known-temperature conf-room)", "(known-co2 conf-room)"];
    let mut begun = Vec::new();
    for number in 0..COMMANDS {
        let goal = goals[number % goals.len()];
        let mut command: Command = office.command(&["goal", goal, "--ecosystem", &file]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        begun.push(command.spawn().expect("it begins"));
    }
    for command in begun {
        let output = command.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&output.stdout);
        let noted = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{said}\n{noted}");
    }
}
