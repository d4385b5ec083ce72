//! The history, with real daemons: from a thing to what caused it, up to a person, a sensor or a
//! death; nothing that people answer is kept; what was written outlives SIGKILL; a torn file and a
//! full disk are survived; private facts are for those with the right.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::Value;

use crate::support::{Office, PATIENCE, lab, network, stderr, stdout};

/// Lines of an ecosystem file for a history agent.
fn history(daemon: &str) -> String {
    format!("\n[[agent]]\nname = \"history\"\nplugin = \"history\"\ndaemon = \"{daemon}\"\n")
}

/// Returns the smart office with all agents but those of `office2-pi` on one daemon.
fn office() -> Office {
    let mut office = Office::new();
    office.up(&["reasoning", "turtlebot-laptop", "office2-pi"], &[]);
    office.await_devices(3);
    office
}

/// Asks the history until the answer is as wanted: events are written in batches.
#[track_caller]
fn await_history(
    office: &Office,
    arguments: &[&str],
    is_wanted: impl Fn(&[Value]) -> bool,
) -> Vec<Value> {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let answer = office.ask_json(arguments);
        let events = answer["events"].as_array().cloned().unwrap_or_default();
        if is_wanted(&events) {
            return events;
        }
        assert!(Instant::now() < deadline, "{arguments:?}: {answer:#}");
    }
}

/// Whether a chain of causes is complete: each event is the cause of the one before, and the last
/// has a root.
fn is_complete(chain: &[Value]) -> bool {
    let is_linked = chain.windows(2).all(|pair| pair[0]["cause"] == pair[1]["number"]);
    is_linked && chain.last().is_some_and(|last| last["cause"].is_null() && !last["root"].is_null())
}

fn root(chain: &[Value]) -> &str {
    chain.last().and_then(|last| last["root"].as_str()).unwrap_or_default()
}

fn has_kind(chain: &[Value], kind: &str) -> bool {
    chain.iter().any(|event| event["kind"] == kind)
}

/// Returns all files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    entries
        .flat_map(|entry| {
            let path = entry.path();
            if path.is_dir() { files(&path) } else { vec![path] }
        })
        .collect()
}

#[test]
fn a_step_leads_to_the_person_and_to_the_death_that_caused_it() {
    let mut office = office();
    let goal = "(known-temperature office2)";
    let file = office.file.display().to_string();
    let mut asked = office.command(&["goal", goal, "--maintain", "--ecosystem", &file]);
    let mut asked = asked.stdout(std::process::Stdio::piped()).spawn().expect("a command");
    let step = "(report-temperature thermometer-office2 office2)";
    let chain = await_history(&office, &["why", step], |chain| {
        is_complete(chain) && root(chain) == "person"
    });
    assert!(has_kind(&chain, "plan") && has_kind(&chain, "goal"), "{chain:#?}");
    let (code, said) = office.ask(&["why", step]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("because") && said.contains("a person wanted it"), "{said}");
    // What was measured leads through the step to the person.
    let chain = await_history(&office, &["why", goal], is_complete);
    assert_eq!(root(&chain), "person", "{chain:#?}");
    // And down: the goal led to the step.
    let person = chain.last().expect("a root")["number"].as_u64().expect("a number");
    let effects = await_history(&office, &["why", &format!("#{person}"), "--effects"], |events| {
        events.iter().any(|event| event["subject"].as_str().is_some_and(|text| text == step))
    });
    assert!(effects.len() > 2, "{effects:#?}");

    // The thermometer dies, and the robot takes its place.
    office.kill("office2-pi");
    let step = "(report-temperature ir-1 turtlebot-1 office2)";
    let chain = await_history(&office, &["why", step], is_complete);
    assert_eq!(root(&chain), "death", "{chain:#?}");
    let dead = chain.last().expect("a root");
    assert_eq!(dead["agent"], "thermometer-office2", "{chain:#?}");
    let (code, said) = office.ask(&["why", step]);
    assert!(code == Some(0) && said.contains("thermometer-office2"), "{said}");
    let (code, said) = office.ask(&["history", "thermometer-office2", "--last"]);
    assert!(code == Some(0) && said.contains(" ago: "), "{said}");
    asked.kill().expect("our child");
    asked.wait().expect("our child");
}

#[test]
fn a_device_that_changes_by_itself_is_a_root_and_its_past_outlives_a_kill() {
    let office = Office::new();
    let folder = office.folder().display().to_string();
    let lamp = format!(
        r#"
[[agent]]
name = "lamp-a"
plugin = "switch"
driver = "command"

[agent.config]
location = "office1"
kind = "lamp"
on = ["/bin/sh", "-c", "echo on > {folder}/lamp-a"]
off = ["/bin/sh", "-c", "echo off > {folder}/lamp-a"]
state = ["cat", "{folder}/lamp-a"]
every = "100ms"
"#
    );
    let file = office.write("lab.toml", &(lab("decentralized") + &history("alone") + &lamp));
    office.write("lamp-a", "on\n");
    let mut office = office.with_file(file);
    office.up_alone(&["--daemon", "alone"]);
    office.await_devices(1);
    office.await_fact("(lamp-on lamp-a)", true);
    let chain = await_history(&office, &["why", "(lamp-on lamp-a)"], |chain| {
        is_complete(chain) && root(chain) == "sensor"
    });
    assert_eq!(chain.last().expect("a root")["agent"], "lamp-a", "{chain:#?}");
    // By a goal it is switched off: now a person is the cause.
    let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
    assert_eq!(code, Some(0), "{said}");
    let chain = await_history(&office, &["why", "(lamp-on lamp-a)"], |chain| {
        is_complete(chain) && root(chain) == "person"
    });
    assert!(has_kind(&chain, "step"), "{chain:#?}");

    let before = await_history(&office, &["history", "--limit", "10000"], |all| all.len() > 3);
    office.kill("alone");
    office.up_alone(&["--daemon", "alone"]);
    let after =
        await_history(&office, &["history", "--limit", "10000"], |all| all.len() >= before.len());
    let number = |event: &Value| event["number"].as_u64();
    for event in &before {
        let kept = after.iter().find(|kept| number(kept) == number(event));
        assert_eq!(kept, Some(event), "it was read, so it was written");
    }
    let again = await_history(&office, &["why", &format!("#{}", chain[0]["number"])], is_complete);
    assert_eq!(again, chain);
}

#[test]
fn a_torn_history_is_moved_aside_and_another_one_answers() {
    let office = Office::new();
    let other = history("alone").replace("name = \"history\"", "name = \"history-b\"");
    let file = office.write("lab.toml", &(lab("decentralized") + &history("alone") + &other));
    let mut office = office.with_file(file);
    office.up_alone(&["--daemon", "alone"]);
    // Both answer, and neither knows more than the other.
    let deadline = Instant::now() + PATIENCE;
    while office.ask_json(&["history"])["differences"] != Value::Array(Vec::new()) {
        assert!(Instant::now() < deadline, "{:#}", office.ask_json(&["history"]));
    }
    office.kill("alone");
    let state = office.folder().join("state");
    let is_first = |path: &PathBuf| path.to_string_lossy().contains("/history.history");
    let written: Vec<_> = files(&state).into_iter().filter(is_first).collect();
    assert!(!written.is_empty(), "{:?}", files(&state));
    for path in &written {
        fs::write(path, b"torn").expect("it is ours");
    }
    office.up_alone(&["--daemon", "alone"]);
    let deadline = Instant::now() + PATIENCE;
    loop {
        let answer = office.ask_json(&["history"]);
        let differs = answer["differences"].as_array().is_some_and(|all| !all.is_empty());
        if answer["from"] == "history-b" && differs {
            break;
        }
        assert!(Instant::now() < deadline, "{answer:#}");
    }
    let (code, said) = office.ask(&["history"]);
    assert!(code == Some(0) && said.contains("note: `history-b` answers; `history` "), "{said}");
    let is_torn = |path: &PathBuf| fs::read(path).is_ok_and(|bytes| bytes == b"torn");
    let kept = files(&state).into_iter().filter(is_torn);
    assert!(kept.count() > 0, "what was torn is kept for those who can mend it");
}

#[test]
fn what_is_private_is_read_by_those_with_the_right() {
    let folder = Office::file().canonicalize().expect("it is there");
    let root = folder.ancestors().nth(2).expect("a folder");
    let house = fs::read_to_string(root.join("ecosystems/house.toml")).expect("our own");
    let house = house.replace("../domains", &root.join("domains").display().to_string());
    let house = house + &history("caretaker") + "\n[security]\nfolder = \"keys\"\n";
    let office = Office::new();
    let open = office.write("open.toml", &format!("{house}[rights]\nprivate = [\"guests\"]\n"));
    let file = office.write("house.toml", &house);
    let closed = "[rights]\nhistory = [\"plan-requester\"]\n";
    let closed = office.write("closed.toml", &format!("{house}{closed}"));
    for arguments in [
        &["cert", "authority", &file.display().to_string()][..],
        &[
            "cert",
            "daemon",
            "caretaker",
            "sweeper-laptop",
            "--ecosystem",
            &file.display().to_string(),
        ],
    ] {
        let made = office.run(arguments);
        assert!(made.status.success(), "{}", stderr(&made));
    }
    let mut office = office.with_file(file);
    office.up(&["sweeper-laptop", "caretaker"], &[]);
    office.await_devices(1);
    // The names of predicates are public, and what is true of them is not.
    let deadline = Instant::now() + PATIENCE;
    let withheld = loop {
        let answer = office.ask_json(&["history", "bin-free"]);
        if answer["withheld"].as_u64() > Some(0) {
            break answer;
        }
        assert!(Instant::now() < deadline, "{answer:#}");
    };
    assert_eq!(withheld["events"], Value::Array(Vec::new()));
    let (code, said) = office.ask(&["history", "bin-free"]);
    assert!(code == Some(1) && said.contains("private"), "{said}");

    office.kill("caretaker");
    office.up_from(&open, "caretaker");
    let events = await_history(&office, &["history", "bin-free"], |all| !all.is_empty());
    assert!(events.iter().all(|event| event["private"] == true), "{events:#?}");
    office.kill("caretaker");
    office.up_from(&closed, "caretaker");
    let (code, said) = office.ask(&["history", "sweeper-1"]);
    assert!(code == Some(1) && said.contains("`history` in [rights]"), "{said}");
}

#[test]
fn a_full_disk_is_said_and_recording_goes_on_when_there_is_room() {
    if !network::is_permitted() {
        return;
    }
    let office = Office::new();
    let file = office.write("lab.toml", &(lab("decentralized") + &history("alone")));
    let mut office = office.with_file(file.clone());
    let state = office.folder().join("state");
    fs::create_dir(&state).expect("ours");
    // The daemon has a small disk of its own for its state; the shell becomes the daemon.
    let mounted = "echo $$ > pid && mount -t tmpfs -o size=12m,mode=700 disk \"$1\" && shift && \
                   exec \"$@\"";
    let mut daemon = office.program("unshare");
    daemon.args(["--mount", "sh", "-c", mounted, "sh"]).arg(&state);
    daemon.arg(env!("CARGO_BIN_EXE_althing")).arg("up").arg(&file).args(["--daemon", "alone"]);
    daemon.stdin(std::process::Stdio::null());
    office.begin_as("alone", daemon);
    await_history(&office, &["history"], |all| !all.is_empty());
    let process = fs::read_to_string(office.folder().join("pid")).expect("the shell wrote it");
    let disk = PathBuf::from(format!("/proc/{}/root{}", process.trim(), state.display()));
    let filler = disk.join("filler");
    fill(&filler);

    let notices = |office: &Office| office.ask_json(&["history"])["notices"].clone();
    let deadline = Instant::now() + PATIENCE;
    let mut number = 0;
    while !notices(&office).to_string().contains("not kept") {
        // Something has to happen, so that something has to be written. A long name takes room.
        let name = format!("(and (connected office1 office2) (connected office{number} hall))");
        let (_, said) = office.ask(&["stop", "--because", &name.repeat(20)]);
        fill(&filler);
        number += 1;
        assert!(Instant::now() < deadline, "{said}");
    }
    let (code, said) = office.ask(&["history"]);
    assert!(code == Some(0) && said.contains("note: what happens now is not kept"), "{said}");
    fs::remove_file(&filler).expect("ours");
    let deadline = Instant::now() + PATIENCE;
    while notices(&office) != Value::Array(Vec::new()) {
        assert!(Instant::now() < deadline, "{}", notices(&office));
    }
    let (_, said) = office.ask(&["stop", "--because", "there is room"]);
    await_history(&office, &["history", "--kind", "stop"], |all| {
        all.iter().any(|event| event.to_string().contains("there is room"))
    });
    assert!(said.contains("stop "), "{said}");
}

/// Appends to a file until its disk is full.
fn fill(path: &Path) {
    let mut file = fs::OpenOptions::new().create(true).append(true).open(path).expect("a file");
    for chunk in [1 << 20, 1 << 12, 1] {
        while file.write_all(&vec![0; chunk]).is_ok() {}
    }
}

#[test]
fn what_people_answer_is_not_kept_and_what_they_write_is_shown_as_text() {
    const SECRET: &str = "swordfish-2718";
    let office = Office::new();
    let keyboard = "\n[[agent]]\nname = \"hall\"\nplugin = \"keyboard\"\n";
    let file = office.write("lab.toml", &(lab("decentralized") + &history("alone") + keyboard));
    let mut office = office.with_file(file.clone());
    office.up_alone(&["--daemon", "alone"]);
    await_history(&office, &["history"], |all| !all.is_empty());
    let message = office.write(
        "question.json",
        r#"{"performative": "query-ref", "receiver": "hall", "reply_within": 60000,
            "content": {"text": "PIN of the \u001b[2Jvault?"}}"#,
    );
    let (message, path) = (message.display().to_string(), file.display().to_string());
    let mut asker = office.command(&["send", &message, "--ecosystem", &path]);
    let mut asker = asker.stdout(std::process::Stdio::null()).spawn().expect("a command");
    office.answer("vault", SECRET);
    assert!(asker.wait().expect("our child").success());
    let (code, said) = office.ask(&["stop", "--because", "\u{1b}]0;owned\u{7} \u{202e}evil"]);
    assert!(code == Some(0) || code == Some(1), "{said}");

    await_history(&office, &["history", "--kind", "question"], |all| all.len() > 1);
    await_history(&office, &["history", "--kind", "stop"], |all| !all.is_empty());
    for arguments in [&["history", "--limit", "10000"][..], &["history", "--csv"], &["why", "hall"]]
    {
        let output = office.run(&[arguments, &["--ecosystem", &path]].concat());
        let said = format!("{}{}", stdout(&output), stderr(&output));
        assert!(output.status.success(), "{said}");
        assert!(!said.contains(SECRET), "{said}");
        let is_obeyed = |c: char| c != '\n' && (c.is_control() || c == '\u{202e}');
        assert!(!said.contains(is_obeyed), "{said:?}");
    }
    let (_, all) = office.ask(&["history"]);
    assert!(all.contains("␛]0;owned␇"), "{all}");
    office.kill("alone");
    for path in files(&office.folder().join("state")) {
        let bytes = fs::read(&path).expect("it is ours");
        let secret = SECRET.as_bytes();
        let is_in = bytes.windows(secret.len()).any(|part| part == secret);
        assert!(!is_in, "{}", path.display());
    }
}

#[test]
fn unclear_words_and_a_missing_history_are_explained() {
    let office = Office::new();
    let with = office.write("lab.toml", &(lab("decentralized") + &history("alone")));
    let without = office.write("without.toml", &lab("decentralized"));
    let mut office = office.with_file(with);
    office.up_alone(&["--daemon", "alone"]);
    await_history(&office, &["history", "plan-requester"], |all| !all.is_empty());
    let (code, said) = office.ask(&["why", "plan-requestr"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("did you mean `plan-requester`?"), "{said}");
    let (code, said) = office.ask(&["history", "--since", "tomorrow"]);
    assert!(code == Some(64) && said.contains("2h, 30min, 7days"), "{said}");
    let (code, said) = office.ask(&["history", "--kind", "sound"]);
    assert!(code == Some(64) && said.contains("possible values: fact, goal"), "{said}");
    // The history that runs is not one that this file knows.
    let office = office.with_file(without);
    let (code, said) = office.ask(&["history"]);
    assert_eq!(code, Some(69), "{said}");
    assert!(said.contains("plugin = \"history\"") && said.contains("[[agent]]"), "{said}");
}

#[test]
fn a_wrong_limit_is_found_by_check() {
    let office = Office::new();
    let wrong = history("alone") + "config = { keep = \"30 fortnights\" }\n";
    let file = office.write("lab.toml", &(lab("decentralized") + &wrong));
    let checked = office.run(&["check", &file.display().to_string()]);
    let said = format!("{}{}", stdout(&checked), stderr(&checked));
    assert_eq!(checked.status.code(), Some(33), "{said}");
    assert!(said.contains("30 fortnights") && said.contains("keep"), "{said}");
}
