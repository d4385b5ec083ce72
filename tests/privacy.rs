//! `privacy = "agents"` between real processes: what an agent declares `:private` is on no socket, in
//! no answer and in no file of another daemon, and the agent acts with it nevertheless.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::support::Office;
use crate::support::left_out::left_out;

/// Marks private words, so that no other text has them by chance.
const MARK: &str = "zq-";

/// Options with which `strace` records whole writes of all threads, beside the traced process.
const STRACE: &str = "-D -f -yy -s 1000000 -e trace=write,writev,sendto,sendmsg,sendmmsg";

/// How long the trace of a process that has ended may take to be complete.
const TRACED_WITHIN: Duration = Duration::from_secs(20);

/// A keeper whose key hangs in a place that is private, and a postman who needs the open gate. The test
/// sets `FOLDER`, `MODE` and `PRIVACY`.
const MANOR: &str = r#"
[ecosystem]
name = "manor"
mode = "MODE"
privacy = "PRIVACY"
reasoning = ["house"]

[rooms]
hall = {}

[[agent]]
name = "keeper"
plugin = "command"
daemon = "lodge"

[agent.config]
model = '''
(define (agent keeper) (:domain smart-office)
  (:types doorkeeper zq-key zq-hook barrier - object)
  (:predicates (barrier-open ?g - barrier)
    (:private (zq-holding ?k - doorkeeper ?i - zq-key) (zq-hanging ?i - zq-key ?h - zq-hook)))
  (:objects keeper - doorkeeper gate1 - barrier (:private zq-brass - zq-key zq-nail - zq-hook))
  (:init (zq-hanging zq-brass zq-nail))
  (:action zq-fetch :agent ?zq-k - doorkeeper :parameters (?zq-i - zq-key ?zq-h - zq-hook)
    :precondition (zq-hanging ?zq-i ?zq-h)
    :effect (and (zq-holding ?zq-k ?zq-i) (not (zq-hanging ?zq-i ?zq-h))
      (increase (total-cost) 1)))
  (:action unlock :agent ?zq-k - doorkeeper :parameters (?g - barrier ?zq-i - zq-key)
    :precondition (zq-holding ?zq-k ?zq-i)
    :effect (and (barrier-open ?g) (increase (total-cost) 1))))
'''

[agent.config.actions]
zq-fetch = { run = ["/bin/sh", "-c", "echo fetch $1 $2 >> FOLDER/log", "fetch", "{zq-i}", "{zq-h}"] }
unlock = { run = ["/bin/sh", "-c", "echo unlock $1 $2 >> FOLDER/log; echo by zq-nail", "unlock", "{g}", "{zq-i}"] }

[[agent]]
name = "postman"
plugin = "command"
daemon = "house"

[agent.config]
model = '''
(define (agent postman) (:domain smart-office)
  (:types postman barrier - object)
  (:predicates (barrier-open ?g - barrier) (delivered ?g - barrier))
  (:objects postman - postman)
  (:action deliver :agent ?p - postman :parameters (?g - barrier)
    :precondition (barrier-open ?g) :effect (and (delivered ?g) (increase (total-cost) 1))))
'''

[agent.config.actions]
deliver = { run = ["/bin/sh", "-c", "echo deliver $1 >> FOLDER/log", "deliver", "{g}"] }
"#;

/// Writes the manor's files. Its types are public, so they have no mark.
fn manor(mode: &str, privacy: &str) -> Office {
    let office = Office::new();
    let folder = office.folder().display().to_string();
    let text = MANOR.replace("FOLDER", &folder).replace("MODE", mode).replace("PRIVACY", privacy);
    let text = text.replace("zq-key", "key").replace("zq-hook", "hook");
    let file = office.write("manor.toml", &text);
    office.with_file(file)
}

/// Starts a daemon whose writes `strace` records in the returned file.
fn up_traced(office: &mut Office, daemon: &str) -> PathBuf {
    let traced = office.folder().join(format!("{daemon}.traced"));
    let mut command = office.program("strace");
    command.args(STRACE.split(' ')).arg("-o").arg(&traced).arg(env!("CARGO_BIN_EXE_althing"));
    command.arg("up").arg(office.folder().join("manor.toml")).args(["--daemon", daemon]);
    command.stdin(Stdio::null());
    office.begin_as(daemon, command);
    traced
}

/// Returns what a process that was killed has written to sockets.
fn on_sockets(traced: &Path) -> String {
    let deadline = Instant::now() + TRACED_WITHIN;
    loop {
        let text = fs::read_to_string(traced).expect("a trace");
        // The last line of a trace is about the process, whose number is the least.
        if text.trim_end().ends_with("+++ killed by SIGKILL +++") {
            let lines = text.lines().filter(|it| it.contains("<UNIX") || it.contains("<TCP"));
            return lines.collect::<Vec<_>>().join("\n");
        }
        assert!(Instant::now() < deadline, "the trace has no end: {} bytes", text.len());
        std::thread::yield_now();
    }
}

/// Returns the files under a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .flat_map(|it| if it.path().is_dir() { files(&it.path()) } else { vec![it.path()] })
        .collect()
}

fn log(office: &Office) -> String {
    fs::read_to_string(office.folder().join("log")).unwrap_or_default()
}

#[test]
fn nothing_private_leaves_its_daemon() {
    for mode in ["decentralized", "centralized"] {
        let mut office = manor(mode, "agents");
        let probe = office.program("strace").args(["-f", "true"]).output();
        if !probe.is_ok_and(|it| it.status.success()) {
            return left_out("strace cannot trace a process here: apt-get install strace");
        }
        let traces = ["lodge", "house"].map(|daemon| up_traced(&mut office, daemon));
        office.await_devices(2);
        let (code, said) = office.ask(&["goal", "(delivered gate1)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        let steps = "fetch zq-brass zq-nail\nunlock gate1 zq-brass\ndeliver gate1\n";
        assert_eq!(log(&office), steps, "{mode}");
        office.await_fact("(barrier-open gate1)", true);
        let mut told = vec![said];
        for command in ["state", "domain", "agents", "goals", "history", "why", "metrics"] {
            told.push(office.ask(&[command]).1);
        }
        told.push(office.ask(&["why", "(delivered gate1)"]).1);
        told.push(office.ask_json(&["state"]).to_string());
        for text in &told {
            assert!(!text.contains(MARK), "{mode}: {text}");
        }
        office.kill("lodge");
        office.kill("house");
        for traced in &traces {
            let sent = on_sockets(traced);
            assert!(sent.contains("unlock"), "{mode}: public words are sent");
            let line = sent.lines().find(|line| line.contains(MARK));
            assert_eq!(line, None, "{mode}: {}", traced.display());
        }
        let kept = files(&office.folder().join("state")).into_iter().filter(|file| {
            let bytes = fs::read(file).unwrap_or_default();
            bytes.windows(MARK.len()).any(|it| it == MARK.as_bytes())
        });
        // The agent's own facts, on its own machine.
        let kept: Vec<_> = kept.map(|it| it.file_name().map(ToOwned::to_owned)).collect();
        assert!(
            kept.iter().flatten().all(|it| it.to_string_lossy().contains("keeper")),
            "{kept:?}"
        );
    }
}

/// A gardener, who can open the gate at a higher cost. The test sets `FOLDER`.
const GARDENER: &str = r#"
[[agent]]
name = "gardener"
plugin = "command"
daemon = "house"

[agent.config]
model = '''
(define (agent gardener) (:domain smart-office)
  (:types gardener barrier - object)
  (:predicates (barrier-open ?g - barrier))
  (:objects gardener - gardener)
  (:action hoist :agent ?a - gardener :parameters (?g - barrier)
    :effect (and (barrier-open ?g) (increase (total-cost) 50))))
'''

[agent.config.actions]
hoist = { run = ["/bin/sh", "-c", "echo hoist $1 >> FOLDER/log", "hoist", "{g}"] }
"#;

/// The keeper has no key, which its announced model does not say. The first plan counts on it, and the
/// next one does not, because the keeper has announced more: still nothing by its name.
#[test]
fn an_agent_that_promised_too_much_announces_more_and_the_goal_is_reached_otherwise() {
    for mode in ["decentralized", "centralized"] {
        let office = manor(mode, "agents");
        let path = office.folder().join("manor.toml");
        let text = fs::read_to_string(&path).expect("the manor");
        let hangs = "(:init (zq-hanging zq-brass zq-nail))";
        assert!(text.contains(hangs));
        let gardener = GARDENER.replace("FOLDER", &office.folder().display().to_string());
        office.write("manor.toml", &(text.replace(hangs, "(:init )") + &gardener));
        let mut office = office;
        office.up_at_once(&["lodge", "house"]);
        office.await_devices(3);
        let before = office.ask(&["domain"]).1;
        assert!(before.contains("unlock") && !before.contains("keeper--p"), "{mode}: {before}");
        let (code, said) = office.ask(&["goal", "(delivered gate1)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert_eq!(log(&office), "hoist gate1\ndeliver gate1\n", "{mode}: {said}");
        let after = office.ask(&["domain"]).1;
        assert!(after.contains("keeper--p"), "{mode}: it has announced more: {after}");
        for text in [said, after, office.ask(&["state"]).1] {
            assert!(!text.contains(MARK), "{mode}: {text}");
        }
    }
}

/// The setting is what keeps the secrets: without it they are told.
#[test]
fn in_an_ecosystem_without_the_setting_private_facts_are_announced() {
    let mut office = manor("decentralized", "ecosystem");
    office.up_at_once(&["lodge", "house"]);
    office.await_devices(2);
    let (_, state) = office.ask(&["state"]);
    assert!(state.contains("zq-hanging zq-brass zq-nail"), "{state}");
}
