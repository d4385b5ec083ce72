//! More than an ecosystem can do at once: what is refused is refused at once and with the reason, and
//! of what was accepted every end is told and kept.

mod support;

use std::collections::BTreeMap;
use std::fs::File;
use std::time::Duration;

use acl::content::Outcome;
use substrate::Resource;
use support::asker::{Asker, Heard};
use support::{Office, PATIENCE};

/// Goals that one asker asks for at once.
const GOALS: usize = 1_000;

/// The office with two Journals, with the log of who reasons in a file.
fn office() -> Office {
    let office = Office::new();
    let text = std::fs::read_to_string(Office::file()).expect("it is there");
    let root = Office::file().canonicalize().expect("it is there");
    let root = root.ancestors().nth(2).expect("a folder").display().to_string();
    let text = text.replace("\"../domains", &format!("\"{root}/domains"))
        + "\n[[agent]]\nname = \"journal-2\"\nplugin = \"journal\"\ndaemon = \"turtlebot-laptop\"\n\n[[agent]]\nname = \"journal-3\"\nplugin = \"journal\"\ndaemon = \"office2-pi\"\n\n[[agent]]\nname = \"journal-4\"\nplugin = \"journal\"\ndaemon = \"conf-room-pi\"\n";
    let file = office.write("office.toml", &text);
    let mut office = office.with_file(file);
    let file = office.file.display().to_string();
    let mut command = office.command(&["up", &file, "--daemon", "reasoning", "-v"]);
    let log = File::create(office.folder().join("log")).expect("a file");
    command.stderr(log);
    office.begin_as("reasoning", command);
    for name in ["turtlebot-laptop", "office2-pi", "conf-room-pi"] {
        let mut command = office.command(&["up", &file, "--daemon", name]);
        command
            .env("ALTHING_BUILDING__TIME_SCALE", std::env::var("SCALE").unwrap_or("0.02".into()));
        office.begin_as(name, command);
    }
    office.await_devices(5);
    office
}

fn log(office: &Office) -> String {
    std::fs::read_to_string(office.folder().join("log")).expect("a file")
}

/// Goals of which each is another.
fn goals(count: usize) -> impl Iterator<Item = String> {
    (0..count).map(|number| match number % 8 {
        0 => "(at turtlebot-1 office1)".to_owned(),
        1 => "(known-temperature conf-room)".to_owned(),
        2 => "(known-co2 conf-room)".to_owned(),
        3 => "(known-temperature office1)".to_owned(),
        4 => "(at turtlebot-1 office2)".to_owned(),
        5 => "(at turtlebot-1 conf-room)".to_owned(),
        6 => "(at turtlebot-1 nowhere)".to_owned(),
        _ => "(and (at turtlebot-1 corridor) (known-temperature office2))".to_owned(),
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn of_a_thousand_goals_at_once_every_end_is_told_and_kept() {
    let office = tokio::task::spawn_blocking(office).await.expect("no panic");
    let asker = Asker::join(&office, "asker").await;
    let began = std::time::Instant::now();
    let heard = asker.ask(goals(GOALS), std::time::Duration::from_secs(45)).await;
    let took = began.elapsed();

    let count = |is: fn(&Heard) -> bool| heard.values().filter(|heard| is(heard)).count();
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for heard in heard.values() {
        if let Some(why) = &heard.refused {
            *reasons.entry(format!("refused: {why}")).or_default() += 1;
        }
        if let Some((outcome, why)) = &heard.ended {
            *reasons.entry(format!("{outcome}: {why}")).or_default() += 1;
        }
    }
    let last = heard.values().filter_map(|heard| heard.over_after).max();
    eprintln!(
        "{} receipts, {} accepted, {} refused, {} ended, {} of {GOALS} are not over after {took:?}; last after {last:?}\n{reasons:#?}",
        count(|heard| heard.receipt),
        count(|heard| heard.accepted.is_some()),
        count(|heard| heard.refused.is_some()),
        count(|heard| heard.ended.is_some()),
        count(|heard| !heard.is_over()),
    );
    let log = log(&office);
    let unkept = log.lines().filter(|line| line.contains("did not keep")).count();
    eprintln!("{unkept} times a Journal did not keep");
    let journals = asker.question(Resource::Journal).await;
    let records: Vec<_> =
        journals.iter().flat_map(|records| records.as_array().cloned()).flatten().collect();
    let goal = |record: &&serde_json::Value| {
        record["key"].as_str().is_some_and(|key| key.starts_with("goal/"))
    };
    let kept: Vec<_> = records.iter().filter(goal).collect();
    let ended = kept.iter().filter(|record| !record["body"]["ended"].is_null()).count();
    eprintln!(
        "{} goal records, {ended} ended, {} null",
        kept.len(),
        kept.iter().filter(|record| record["body"].is_null()).count()
    );
    let _ = Outcome::Done;
    std::fs::copy(office.folder().join("log"), "/tmp/load-log").expect("copied");
    assert_eq!(count(|heard| !heard.is_over()), 0);
    assert_eq!(unkept, 0);
}
