//! The page of real daemons, as a browser reaches it: goals that are asked for and watched to their
//! end, stops during a move, people that answer at once, daemons that die, rights, TLS. The simulated
//! building decides.

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use building::BuildingEvent;
use serde_json::{Value, json};
use simulated_nav2::RobotWire;

use crate::robots::{PLACES, ROBOT, Robot, entry};
use crate::support::page_client::{PASSWORD, PageAddress, add_person, free_port};
use crate::support::{Office, PATIENCE, lab, stderr, stdout};

const MOVER: &str = "[[agent]]\nname = \"turtlebot-1\"\nplugin = \"turtlebot\"\n\
    config = { start = \"corridor\", speed = 2.0 }\n\n[building]\ntime-scale = 0.02\n\n";

/// An office with one daemon that serves a page, with these lines beside the reasoning agents.
fn office(lines: &str) -> (Office, PageAddress) {
    let office = Office::new();
    let port = free_port();
    let web = format!("[web]\nlisten = \"127.0.0.1:{port}\"\n\n");
    let file = office.write("lab.toml", &(lab("centralized") + lines + &web));
    let mut office = office.with_file(file);
    add_person(&office, "ada", &["--role", "operator"]);
    office.up_alone(&[]);
    let page = PageAddress::plain(port);
    page.await_page();
    (office, page)
}

fn moving_office(lines: &str) -> (Office, PageAddress) {
    let (office, page) = office(&(MOVER.to_owned() + lines));
    office.await_devices(1);
    office.await_fact("(at turtlebot-1 corridor)", true);
    (office, page)
}

// === asking, and seeing the end ===

#[test]
fn a_goal_is_tried_asked_for_and_watched_to_its_end() {
    let (office, page) = moving_office("");
    let ada = page.visit("ada");
    let mut events = ada.events("goals,facts,activity");
    events.await_row("facts", |row| row["fact"] == "(at turtlebot-1 corridor)");

    let tried = ada.act(json!({
        "act": "dry-run", "goal": "(at turtlebot-1 office1)", "mode": "reach"
    }));
    let detail = &tried["detail"];
    assert_eq!(detail["plan"][0]["step"], "(move turtlebot-1 corridor office1)", "{tried}");
    assert_eq!(detail["plan"][0]["agent"], "turtlebot-1");
    assert_eq!(detail["undoes"], json!(["(at turtlebot-1 corridor)"]));
    assert_eq!((&detail["already"], &detail["problem"]), (&json!(false), &Value::Null));
    // Nothing was asked for: no goal, and the robot stands where it stood.
    assert_eq!(office.ask_json(&["goals"]), json!({ "goals": [] }));
    office.await_fact("(at turtlebot-1 corridor)", true);
    assert!(events.rows("goals").is_empty());

    let asked = ada.act(json!({
        "act": "goal", "goal": "(at turtlebot-1 office1)", "mode": "reach"
    }));
    let conversation = asked["conversation"].as_str().expect("a conversation").to_owned();
    let done = events.await_row("goals", |row| {
        row["conversation"] == conversation.as_str() && row["stage"] == "done"
    });
    // The goal carries the name of the person.
    let requester = done["requester"].as_str().expect("an agent");
    assert!(requester.starts_with("ada-web-"), "{done}");
    office.await_fact("(at turtlebot-1 office1)", true);
    let shown = ada.get(&format!("/api/goals/{conversation}"));
    assert_eq!(shown.body["row"]["stage"], "done", "{shown:?}");

    // The usual time of the way is known now.
    let back = ada.act(json!({
        "act": "dry-run", "goal": "(at turtlebot-1 corridor)", "mode": "reach"
    }));
    let step = &back["detail"]["plan"][0];
    assert_eq!(step["start"], 0, "{back}");
    assert!(step["duration"].as_u64().is_some(), "{back}");
    let again = ada.act(json!({
        "act": "dry-run", "goal": "(at turtlebot-1 office1)", "mode": "keep"
    }));
    assert_eq!(again["detail"]["already"], true, "{again}");
    // A goal without a plan is explained, and a mistake told.
    let missing = ada.ask(&json!({ "act": "dry-run", "goal": "(at turtlebot-1 attic)",
        "mode": "reach" }));
    assert_eq!(missing.body["ok"], false, "{missing:?}");
    assert!(missing.body["sentence"].to_string().contains("attic"), "{missing:?}");
}

#[test]
fn the_log_tells_the_requests_of_people() {
    let (office, page) = moving_office("");
    let ada = page.visit("ada");
    ada.act(json!({ "act": "action", "agent": "turtlebot-1",
        "action": "(move turtlebot-1 corridor office2)" }));
    office.await_fact("(at turtlebot-1 office2)", true);
    let other = ada.ask(&json!({ "act": "action", "agent": "turtlebot-2",
        "action": "(move turtlebot-1 office2 corridor)" }));
    assert_eq!(other.body["ok"], false, "the step is of another agent: {other:?}");
    let (code, log) = office.ask(&["people", "log"]);
    assert_eq!(code, Some(0), "{log}");
    for told in ["ada", "action of turtlebot-1", "127.0.0.1"] {
        assert!(log.contains(told), "{told}: {log}");
    }
    let deadline = Instant::now() + PATIENCE;
    let setup = loop {
        let setup = ada.get("/api/setup").body;
        if setup["actions"].as_array().is_some_and(|actions| !actions.is_empty()) {
            break setup;
        }
        assert!(Instant::now() < deadline, "{setup}");
    };
    let predicates = setup["predicates"].as_array().expect("a list");
    let at = predicates.iter().find(|it| it["name"] == "at").expect("`at`");
    assert_eq!(at["can_change"], true, "{at}");
    let actions = setup["actions"].as_array().expect("a list");
    let is_move = |it: &&Value| it["agent"] == "turtlebot-1" && it["name"] == "move";
    assert!(actions.iter().any(|it| is_move(&it)), "{actions:?}");
}

#[test]
fn a_goal_that_is_not_reached_in_time_is_cancelled() {
    // The way takes a minute at the pace of the building.
    let (office, page) = office(&MOVER.replace("speed = 2.0", "speed = 0.002"));
    office.await_devices(1);
    office.await_fact("(at turtlebot-1 corridor)", true);
    let ada = page.visit("ada");
    let mut events = ada.events("goals");
    let goal = "(at turtlebot-1 office1)";
    let kept = ada.ask(&json!({ "act": "goal", "goal": goal, "mode": "keep", "within_ms": 300 }));
    assert_eq!(kept.body["ok"], false, "{kept:?}");
    let asked = ada.act(json!({ "act": "goal", "goal": goal, "mode": "reach", "within_ms": 300 }));
    let conversation = asked["conversation"].clone();
    let ended = events
        .await_row("goals", |row| row["conversation"] == conversation && row["ended_at"].is_u64());
    assert_eq!(ended["stage"], "cancelled", "{ended}");
    office.await_fact("(at turtlebot-1 corridor)", true);
}

// === stops ===

#[test]
fn the_stop_button_ends_a_move() {
    let robot = Robot::start(RobotWire::Ros2Dds, "tb1", 1.0);
    let (office, page) = office(&entry(robot.nav2.endpoint(), "ros2dds", &PLACES));
    office.await_devices(1);
    office.await_fact(&format!("(at {ROBOT} corridor)"), true);
    // A stop needs no right but that to sign in.
    add_person(&office, "ben", &["--rights", "look"]);
    let (ada, ben) = (page.visit("ada"), page.visit("ben"));
    let goal = format!("(at {ROBOT} office1)");
    ada.act(json!({ "act": "goal", "goal": goal, "mode": "reach" }));
    robot.await_event(|event| matches!(event, BuildingEvent::Departed { .. }));

    let mut events = ben.events("stops,agents");
    let stopped = ben.act(json!({ "act": "stop", "names": [], "because": "smoke" }));
    let agents = stopped["detail"]["agents"].as_array().expect("a list");
    let of_robot = agents.iter().find(|it| it["agent"] == ROBOT).expect("the robot");
    assert_eq!(of_robot["effect"], "ended", "{stopped}");
    // The answer comes when the robot has confirmed that it stands still.
    assert_eq!(robot.place(), "corridor");
    let row = events.await_row("stops", |row| row["stop"]["why"] == "smoke");
    assert!(row["stop"]["by"].as_str().is_some_and(|by| by.starts_with("ben-stop")), "{row}");
    events.await_row("agents", |row| row["agent"] == ROBOT && row["is_stopped"] == true);

    let id = stopped["detail"]["id"].clone();
    let refused = ben.ask(&json!({ "act": "release", "ids": [id] }));
    assert_eq!(refused.status, 403, "{refused:?}");
    ada.act(json!({ "act": "release", "ids": [id] }));
    let again = ada.ask(&json!({ "act": "release", "ids": [id] }));
    assert_eq!(again.body["ok"], false, "{again:?}");
    office.await_devices(1);
}

// === questions ===

#[test]
fn of_two_people_that_answer_at_once_one_is_told_that_it_is_answered() {
    let confirm = "[safeguards.turtlebot-1]\nmove = { confirm = true, patience = \"1min\" }\n\n";
    let (office, page) = moving_office(confirm);
    add_person(&office, "ben", &["--role", "visitor"]);
    let (ada, ben) = (page.visit("ada"), page.visit("ben"));
    let mut events = ben.events("questions");
    ada.act(json!({ "act": "goal", "goal": "(at turtlebot-1 office1)", "mode": "reach" }));
    let question = events.await_row("questions", |row| row["id"].is_string());
    // No file of the office names a keyboard: the daemon of the page keeps the question.
    let keyboard = question["keyboard"].as_str().expect("a keyboard").to_owned();
    assert!(keyboard.starts_with("web-"), "{question}");
    let number: u64 = { question["id"].as_str().expect("an id") }
        .rsplit('/')
        .next()
        .and_then(|number| number.parse().ok())
        .expect("a number");
    let answer = json!({
        "act": "answer", "keyboard": keyboard, "question": number, "text": "yes"
    });
    let both = std::thread::scope(|scope| {
        let one = scope.spawn(|| ada.ask(&answer));
        let other = scope.spawn(|| ben.ask(&answer));
        [one.join().expect("an answer"), other.join().expect("an answer")]
    });
    let counted: Vec<_> = both.iter().filter(|answer| answer.body["ok"] == true).collect();
    assert_eq!(counted.len(), 1, "{both:?}");
    let late = both.iter().find(|answer| answer.body["ok"] == false).expect("the other");
    let sentence = late.body["sentence"].as_str().unwrap_or_default();
    let first = late.body["message"]["values"]["person"].as_str().unwrap_or_default();
    assert!(["ada", "ben"].contains(&first), "{late:?}");
    assert_eq!(sentence, format!("{first} answered this already"), "{late:?}");
    // Whoever asks for the same once more, long after that, is told the same.
    let of_late = if first == "ada" { &ben } else { &ada };
    let again = of_late.ask(&answer);
    assert_eq!(again.body["message"]["key"], "answer.late", "{again:?}");
    office.await_fact("(at turtlebot-1 office1)", true);
    let (_, log) = office.ask(&["people", "log"]);
    assert!(log.contains("answer to the question") && !log.contains("yes"), "{log}");
}

// === daemons that die ===

#[test]
fn a_page_sees_a_daemon_die_and_outlives_its_own() {
    let port = free_port();
    let mut office = Office::new();
    let text = fs::read_to_string(Office::file()).expect("the repository's own");
    let folder = Office::file().canonicalize().expect("it is there");
    let domains = folder.ancestors().nth(2).expect("a folder").join("domains");
    let text = text.replace("../domains", &domains.display().to_string());
    let web = format!("\n[web]\nlisten = \"127.0.0.1:{port}\"\ndaemons = [\"reasoning\"]\n");
    let file = office.write("office.toml", &(text + &web));
    office = office.with_file(file);
    add_person(&office, "ada", &["--role", "caretaker"]);
    office.up(&["reasoning", "turtlebot-laptop", "office2-pi"], &[]);
    let page = PageAddress::plain(port);
    page.await_page();
    let ada = page.visit("ada");
    let mut events = ada.events("agents,daemons");
    let is_there =
        |row: &Value| row["agent"] == "thermometer-office2" && row["presence"] == "present";
    events.await_row("agents", is_there);
    office.kill("office2-pi");
    events.await_row("agents", |row| {
        row["agent"] == "thermometer-office2" && row["presence"] == "gone"
    });

    office.kill("reasoning");
    events.await_end();
    office.up(&["reasoning"], &[]);
    page.await_page();
    // Sessions are in memory: people sign in again.
    assert_eq!(ada.get("/api/me").status, 401);
    let ada = page.visit("ada");
    let mut events = ada.events("agents,goals");
    events.await_row("agents", |row| row["agent"] == ROBOT && row["presence"] == "present");
    ada.act(json!({ "act": "goal", "goal": "(at turtlebot-1 office1)", "mode": "reach" }));
    events.await_row("goals", |row| row["stage"] == "done");
}

// === rights and people ===

#[test]
fn a_person_without_the_right_is_refused_and_one_that_is_removed_sees_no_more() {
    let (office, page) = moving_office("");
    add_person(&office, "eve", &["--rights", "look"]);
    let eve = page.visit("eve");
    let goal = json!({ "act": "goal", "goal": "(at turtlebot-1 office1)", "mode": "reach" });
    let refused = eve.ask(&goal);
    assert_eq!(refused.status, 403, "{refused:?}");
    assert!(refused.body["problem"].to_string().contains("ask"), "{refused:?}");
    let refused = eve.ask(&json!({ "act": "set", "fact": "(at turtlebot-1 office1)" }));
    assert_eq!(refused.status, 403, "{refused:?}");
    assert_eq!(office.ask_json(&["goals"]), json!({ "goals": [] }));

    let mut events = eve.events("agents");
    events.await_row("agents", |row| row["agent"] == ROBOT);
    let (code, said) = office.ask(&["people", "remove", "eve"]);
    assert_eq!(code, Some(0), "{said}");
    events.await_end();
    assert_eq!(eve.get("/api/me").status, 401);
    assert!(page.sign_in("eve", PASSWORD).is_err());
}

/// The smart office, secured, with a page on the daemon `reasoning`.
pub(crate) fn secured(rights: &str) -> (Office, PathBuf, PageAddress) {
    let (office, port) = (Office::new(), free_port());
    let text = fs::read_to_string(Office::file()).expect("the repository's own");
    let folder = Office::file().canonicalize().expect("it is there");
    let domains = folder.ancestors().nth(2).expect("a folder").join("domains");
    let text = text.replace("../domains", &domains.display().to_string());
    let file = office.write(
        "secured.toml",
        &format!(
            "{text}\n[security]\nfolder = \"keys\"\n{rights}\n\
             [web]\nlisten = \"0.0.0.0:{port}\"\ndaemons = [\"reasoning\"]\n"
        ),
    );
    let office = office.with_file(file);
    for made in [
        &["cert", "authority", &office.file.display().to_string()][..],
        &["cert", "daemon", "reasoning", "turtlebot-laptop"],
        &["cert", "page", "reasoning", "--host", "192.168.1.7"],
    ] {
        let file = office.file.display().to_string();
        let named = if made[1] == "authority" { vec![] } else { vec!["--ecosystem", &file] };
        let output = office.run(&[made, &named].concat());
        assert!(output.status.success(), "{made:?}: {}", stderr(&output));
    }
    let authority = office.folder().join("keys/page/authority.pem");
    let page = PageAddress::encrypted(port, &authority);
    (office, authority, page)
}

#[test]
fn in_a_secured_ecosystem_the_page_is_encrypted_and_the_rights_decide() {
    let (mut office, _, page) = secured("[rights]\ngoals = [\"camera-1\"]\n");
    add_person(&office, "ada", &["--role", "operator"]);
    office.up(&["reasoning", "turtlebot-laptop"], &[]);
    page.await_page();
    // Without TLS nothing is served.
    let plain = PageAddress::plain(page.port).request("GET", "/", "", None);
    assert!(plain.is_none_or(|answer| answer.status != 200));
    let ada = page.visit("ada");
    let goal = json!({ "act": "goal", "goal": "(at turtlebot-1 office1)", "mode": "reach" });
    let refused = ada.ask(&goal);
    assert_eq!((refused.status, &refused.body["ok"]), (200, &json!(false)), "{refused:?}");
    let sentence = refused.body["sentence"].as_str().unwrap_or_default();
    assert!(sentence.contains("does not let `ada-web-reasoning`"), "{refused:?}");
    assert_eq!(office.ask_json(&["goals"]), json!({ "goals": [] }));
}

#[test]
fn in_a_secured_ecosystem_a_person_is_a_guest_of_the_daemon() {
    let (mut office, _, page) = secured("");
    add_person(&office, "ada", &["--role", "operator"]);
    office.up(&["reasoning", "turtlebot-laptop"], &[]);
    page.await_page();
    let ada = page.visit("ada");
    let mut events = ada.events("agents,goals");
    events.await_row("agents", |row| row["agent"] == ROBOT && row["presence"] == "present");
    // Goals can be about the robot when the Domain Maintainer knows it, too.
    let deadline = Instant::now() + PATIENCE;
    let knows = |setup: &Value| {
        let objects = setup["objects"].as_array().into_iter().flatten();
        objects.into_iter().any(|object| object["name"] == ROBOT)
    };
    while !knows(&ada.get("/api/setup").body) {
        assert!(Instant::now() < deadline, "the robot is unknown");
    }
    ada.act(json!({ "act": "goal", "goal": "(at turtlebot-1 office1)", "mode": "reach" }));
    let done = events.await_row("goals", |row| row["stage"] == "done");
    assert_eq!(done["requester"], "ada-web-reasoning", "{done}");
}

// === the command, and mistakes ===

#[test]
fn a_dry_run_of_the_command_changes_nothing() {
    let (office, _) = moving_office("");
    let goal = ["goal", "(at turtlebot-1 office1)", "--dry-run"];
    let found = office.ask_json(&goal);
    assert_eq!(found["plan"][0]["step"], "(move turtlebot-1 corridor office1)", "{found}");
    assert_eq!(found["undoes"], json!(["(at turtlebot-1 corridor)"]), "{found}");
    let (code, said) = office.ask(&goal);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("nothing is asked for") && said.contains("a plan of 1 step"), "{said}");
    let (code, said) = office.ask(&["goal", "(at turtlebot-1 corridor)", "--dry-run"]);
    assert!(code == Some(0) && said.contains("it holds already"), "{said}");
    let (code, said) = office.ask(&["goal", "(known-temperature office2)", "--dry-run"]);
    assert!(code == Some(1) && said.contains("no plan"), "{said}");
    // What is kept is not undone, and the dry run says so.
    let mut keeping = office.command(&["goal", "(at turtlebot-1 corridor)", "--maintain"]);
    let file = office.file.display().to_string();
    let mut keeping = keeping.args(["--ecosystem", &file]).spawn().expect("a command");
    let deadline = Instant::now() + PATIENCE;
    while office.ask_json(&["goals"])["goals"].as_array().is_none_or(Vec::is_empty) {
        assert!(Instant::now() < deadline, "no goal is kept");
    }
    let (code, said) = office.ask(&goal);
    assert!(code == Some(1) && said.contains("what is kept"), "{said}");
    assert_eq!(office.ask_json(&["goals"])["goals"].as_array().map(Vec::len), Some(1));
    office.await_fact("(at turtlebot-1 corridor)", true);
    office.terminate(&keeping);
    keeping.wait().expect("it ends");
}

#[test]
fn whoever_has_the_right_sees_what_happened_to_private_facts() {
    let folder = Office::file().canonicalize().expect("it is there");
    let root = folder.ancestors().nth(2).expect("a folder");
    let house = fs::read_to_string(root.join("ecosystems/house.toml")).expect("our own");
    let house = house.replace("../domains", &root.join("domains").display().to_string());
    let (office, port) = (Office::new(), free_port());
    let file = office.write(
        "house.toml",
        &format!(
            "{house}\n[[agent]]\nname = \"history\"\nplugin = \"history\"\ndaemon = \"caretaker\"\n\n\
             [security]\nfolder = \"keys\"\n\n[rights]\nprivate = [\"guests\"]\n\n\
             [web]\nlisten = \"127.0.0.1:{port}\"\ndaemons = [\"caretaker\"]\n"
        ),
    );
    let named = file.display().to_string();
    for arguments in [
        &["cert", "authority", &named][..],
        &["cert", "daemon", "caretaker", "sweeper-laptop", "--ecosystem", &named],
    ] {
        let made = office.run(arguments);
        assert!(made.status.success(), "{}", stderr(&made));
    }
    let mut office = office.with_file(file);
    add_person(&office, "ada", &["--rights", "look,secrets"]);
    add_person(&office, "ben", &["--role", "operator"]);
    office.up(&["sweeper-laptop", "caretaker"], &[]);
    office.await_devices(1);
    let page = PageAddress::plain(port);
    page.await_page();
    let (ada, ben) = (page.visit("ada"), page.visit("ben"));
    let deadline = Instant::now() + PATIENCE;
    let is_private = |event: &Value| event["private"] == true;
    let of = |answer: &Value| answer["events"].as_array().cloned().unwrap_or_default();
    loop {
        let seen = ada.get("/api/history?about=bin-free").body;
        if of(&seen).iter().any(is_private) {
            break;
        }
        assert!(Instant::now() < deadline, "{seen:#}");
    }
    // An operator does everything, and does not see it: only that there is something.
    let seen = ben.get("/api/history?about=bin-free").body;
    assert!(!of(&seen).iter().any(is_private), "{seen:#}");
    assert!(seen["withheld"].as_u64() > Some(0), "{seen:#}");
    // One agent has made all these reads, and the history records that it joined.
    let about = |reader: &str| of(&ada.get(&format!("/api/history?about={reader}")).body);
    while about("page-reader1-caretaker").is_empty() {
        assert!(Instant::now() < deadline, "the history has no first reader");
    }
    assert_eq!(about("page-reader2-caretaker"), Vec::<Value>::new());
}

#[test]
fn mistakes_in_the_settings_of_the_page_are_told_at_their_places() {
    let office = Office::new();
    let refused = |web: &str, expected: &str| {
        let file = office.write("lab.toml", &format!("{}{web}\n", lab("centralized")));
        let output = office.run(&["check", &file.display().to_string()]);
        let said = format!("{}{}", stdout(&output), stderr(&output));
        assert!(!output.status.success() && said.contains(expected), "{web}: {said}");
    };
    refused("[web]", "`listen` is missing");
    refused("[web]\nlisten = \"0.0.0.0:8650\"", "is not an address of this machine alone");
    refused("[web]\nlisten = \"8650\"", "127.0.0.1:8650");
    refused("[web]\nlisten = \"127.0.0.1:0\"\nnames = [\"https://pi\"]", "is not a host name");
    refused("[web]\nlisten = \"127.0.0.1:0\"\ncertificate = \"a.pem\"", "`key` is missing");
    refused("[web]\nlisten = \"127.0.0.1:0\"\nport = 8", "`port`");
}

#[test]
fn a_certificate_of_a_page_names_hosts_of_the_building_only() {
    let (office, authority, _) = secured("");
    assert!(authority.is_file());
    let file = office.file.display().to_string();
    let refused =
        office.run(&["cert", "page", "reasoning", "--host", "bank.example", "--ecosystem", &file]);
    assert!(!refused.status.success(), "{}", stdout(&refused));
    assert!(stderr(&refused).contains("`bank.example`"), "{}", stderr(&refused));
    // The certificates of daemons are those from before.
    let shown = office.run(&["cert", "show", "--json", "--ecosystem", &file]);
    let shown: Value = serde_json::from_str(&stdout(&shown)).expect("JSON");
    assert_eq!(shown["certificates"].as_array().map(Vec::len), Some(3), "{shown}");
}
