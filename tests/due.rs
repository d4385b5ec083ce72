//! Goals by the clock with real daemons: a goal whose time is some seconds ahead is kept on disk over
//! the death of its daemon and then pursued; the file asks for goals by itself; mistakes are answered
//! before anything is asked for.

use std::time::{Duration, Instant};

use jiff::{ToSpan as _, Zoned};

use crate::support::{Office, PATIENCE, lab};

/// How far ahead a due time is: longer than a command takes on a machine that is busy.
const AHEAD_SECONDS: i64 = 6;

/// Returns the file of a room with a lamp, whose state is in a file of the office's folder, and with a
/// Journal.
fn room(office: &Office, goals: &str) -> String {
    let lamp = office.folder().join("lamp").display().to_string();
    let turned = |word: &str| format!(r#"["/bin/sh", "-c", "echo {word} > {lamp}"]"#);
    format!(
        r#"{lab}
[[agent]]
name = "journal"
plugin = "journal"

[[agent]]
name = "lamp"
plugin = "switch"
driver = "command"

[agent.config]
location = "office1"
kind = "lamp"
on = {on}
off = {off}
state = ["cat", "{lamp}"]
every = "100ms"

[goals]
{goals}
"#,
        lab = lab("centralized"),
        on = turned("on"),
        off = turned("off"),
    )
}

/// Starts a daemon with the room, dark at first.
fn open(goals: &str) -> Office {
    let office = Office::new();
    office.write("lamp", "off\n");
    let file = office.write("room.toml", &room(&office, goals));
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    office
}

/// Waits until no goal is left.
fn await_no_goal(office: &Office) {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let goals = office.ask_json(&["goals"]);
        if goals["goals"].as_array().is_some_and(Vec::is_empty) {
            return;
        }
        assert!(Instant::now() < deadline, "{goals}");
    }
}

#[test]
fn a_goal_is_pursued_at_its_time_although_its_daemon_died_before() {
    let mut office = open("");
    let at = Zoned::now().checked_add(AHEAD_SECONDS.seconds()).expect("a time");
    let text = at.strftime("%H:%M:%S").to_string();
    let (code, said) = office.ask(&["goal", "(lit office1)", "--at", &text]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("kept by `journal`") && said.contains("next: "), "{said}");
    assert!(said.contains(&text[..5]), "{said}");
    office.kill("alone");
    office.up_alone(&[]);
    office.await_fact("(lit office1)", true);
    assert!(Zoned::now() >= at.round(jiff::Unit::Second).expect("a time") - 1.second());
    await_no_goal(&office);
}

#[test]
fn what_is_due_is_shown_and_cancelled() {
    let office = open("");
    let arguments = ["goal", "(lit office1)", "--every", "day 03:00", "--on", "workdays"];
    let (code, said) = office.ask(&arguments);
    assert_eq!(code, Some(0), "{said}");
    let shown = office.ask_json(&["goals"]);
    let goal = &shown["goals"][0];
    let next = goal["due"]["next-ms"].as_u64().expect("a time");
    let next = Duration::from_millis(next);
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("a time");
    assert!(next > now && next < now + Duration::from_secs(4 * 86_400), "{goal}");
    let (_, text) = office.ask(&["goals"]);
    assert!(
        text.contains("next: ") && text.contains("03:00 (every day 03:00, on workdays)"),
        "{text}"
    );
    let id = goal["conversation"].as_str().expect("an id");
    let (code, said) = office.ask(&["goal", "--cancel", id]);
    assert_eq!(code, Some(0), "{said}");
    await_no_goal(&office);

    for (arguments, part) in [
        (["--every", "fortnight"], "--every: `fortnight` is no recurrence"),
        (["--every", "year 02-30 08:00"], "never comes"),
        (["--at", "2001-01-01T08:00"], "is past"),
        (["--on", "workdays"], "needs `every`"),
    ] {
        let arguments = [&["goal", "(lit office1)"], &arguments[..]].concat();
        let (code, said) = office.ask(&arguments);
        assert_eq!(code, Some(33), "{said}");
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn the_file_asks_for_goals_by_itself() {
    let mut office = open(
        "bright = { goal = \"(lit office1)\", keep = \"maintain\", ask = \"always\" }\n\
         night = { goal = \"(not (lit office1))\", every = \"day 03:00\" }",
    );
    office.await_fact("(lit office1)", true);
    let ids = |office: &Office| {
        let goals = office.ask_json(&["goals"]);
        let goals = goals["goals"].as_array().cloned().unwrap_or_default();
        let id = |goal: &serde_json::Value| goal["conversation"].as_str().map(str::to_owned);
        goals.iter().filter_map(id).collect::<Vec<_>>()
    };
    let before = ids(&office);
    assert!(before.iter().any(|id| id == "goals.night"), "{before:?}");
    // After a restart it is the same goal, asked for once.
    office.kill("alone");
    office.write("lamp", "off\n");
    office.up_alone(&[]);
    office.await_fact("(lit office1)", true);
    assert_eq!(ids(&office), before);
}
