//! `althing joint`: a factored task with a daemon for each agent, over Zenoh.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

use crate::support::left_out::left_out;
use crate::support::{Office, finish, stderr, stdout};

/// The example task of the repository: a robot and a doorkeeper.
fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../domains/parcel-apart")
}

/// A copy of the example task, in which `from` is replaced by `to` in one file.
fn changed(file: &str, from: &str, to: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for entry in fs::read_dir(example()).expect("the example").flatten() {
        let text = fs::read_to_string(entry.path()).expect("a text");
        let name = entry.file_name();
        let text = match name == *file {
            true => {
                assert!(text.contains(from), "{file}: {from}");
                text.replacen(from, to, 1)
            }
            false => text,
        };
        fs::write(folder.path().join(name), text).expect("written");
    }
    folder
}

fn joint(folder: &Path, more: &[&str]) -> (Output, Value) {
    let office = Office::new();
    let folder = folder.to_str().expect("a path in UTF-8");
    let output = office.run(&[&["joint", folder, "--json"], more].concat());
    let value = serde_json::from_str(&stdout(&output)).unwrap_or(Value::Null);
    (output, value)
}

#[test]
fn daemons_plan_together_and_the_plan_holds() {
    let (output, value) = joint(&example(), &[]);
    assert!(output.status.success(), "{value} {}", stderr(&output));
    assert_eq!((&value["valid"], &value["cost"]), (&true.into(), &7.0.into()));
    let plan = value["plan"].as_str().expect("a plan");
    for step in ["(unlock gate brass)", "(swing gate)", "(drive hall lab gate full half)"] {
        assert!(plan.contains(step), "{plan}");
    }
    // Two projections, one of them once more, and two parts in one or two rounds.
    let messages = value["messages"].as_u64().expect("a number");
    assert!((8..=24).contains(&messages), "{messages}");
}

#[test]
fn the_plan_is_written_to_a_file_that_the_validator_accepts() {
    let (office, folder) = (Office::new(), tempfile::tempdir().expect("a folder"));
    let (task, plan) = (example(), folder.path().join("plan.txt"));
    let [task, file] = [&task, &plan].map(|path| path.to_str().expect("a path in UTF-8"));
    let output = office.run(&["joint", task, "--plan", file]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(stdout(&output), "");
    assert!(stderr(&output).contains("valid plan of cost 7"), "{}", stderr(&output));
    let written = fs::read_to_string(&plan).expect("the plan");
    assert!(written.ends_with("(put box hall)\n; cost = 7\n"), "{written}");
}

#[test]
fn a_task_is_planned_many_times_by_the_same_daemons() {
    let (output, value) = joint(&example(), &["--runs", "20"]);
    assert!(output.status.success(), "{value} {}", stderr(&output));
    assert_eq!((&value["valid"], &value["runs"]), (&true.into(), &20.into()));
    // The projections are as sharp as they were at the end of the first planning.
    assert_eq!(value["rounds"], 1);
    let time = |name: &str| value[name].as_f64().expect("a time");
    assert!(0.0 < time("p50_ms") && time("p50_ms") <= time("p99_ms"), "{value}");
}

/// Words of the example that are private to an agent: predicates, objects, and actions without a public
/// effect.
const PRIVATE: &str = "standing holding hands-free charge next full half empty hangs pocketed fits \
    unlocked brass iron fetch unlock";

/// Marks private words, so that no other text has them by chance.
const MARK: &str = "zq-";

/// Options with which `strace` records whole writes of all processes, and where to.
const STRACE: &str = "-f -yy -s 1000000 -e trace=write,writev,sendto,sendmsg,sendmmsg";

/// The kernel's own record of what all processes write to sockets.
#[test]
fn no_private_word_is_written_to_a_socket() {
    let office = Office::new();
    let probe = office.program("strace").args(["-f", "true"]).output();
    if !probe.is_ok_and(|it| it.status.success()) {
        return left_out("strace cannot trace a process here: apt-get install strace");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let is_private = |word: &str| PRIVATE.split(' ').any(|it| it == word);
    for entry in fs::read_dir(example()).expect("the example").flatten() {
        let text = fs::read_to_string(entry.path()).expect("a text");
        let is_word = |it: char| it.is_alphanumeric() || it == '-';
        let marked: String = text
            .split_inclusive(|it| !is_word(it))
            .map(|piece| match is_private(piece.trim_end_matches(|it| !is_word(it))) {
                true => format!("{MARK}{piece}"),
                false => piece.to_owned(),
            })
            .collect();
        fs::write(folder.path().join(entry.file_name()), marked).expect("written");
    }
    let traced = folder.path().join("traced");
    let mut command = office.program("strace");
    command.args(STRACE.split(' '));
    command
        .stdin(Stdio::null())
        .arg("-o")
        .arg(&traced)
        .arg(env!("CARGO_BIN_EXE_althing"))
        .arg("joint")
        .arg(folder.path());
    let output = finish(&mut command);
    assert!(output.status.success(), "{}", stderr(&output));
    // The one who asked for the plan sees all of it.
    assert!(stdout(&output).contains("(zq-fetch zq-brass)"), "{}", stdout(&output));
    let traced = fs::read_to_string(&traced).expect("what was written");
    let on_sockets: Vec<&str> =
        traced.lines().filter(|line| line.contains("<UNIX") || line.contains("<TCP")).collect();
    assert!(on_sockets.iter().any(|line| line.contains("-swing gate)")), "public words are sent");
    let told: Vec<_> = on_sockets.iter().filter(|line| line.contains(MARK)).collect();
    assert!(told.is_empty(), "{told:?}");
}

#[test]
fn no_plan_is_proved_of_named_members() {
    let no_key = changed("problem-doorkeeper.pddl", "(fits brass gate)", "(fits brass gate)");
    let path = no_key.path().join("problem-doorkeeper.pddl");
    let text = fs::read_to_string(&path).expect("a text").replace("(hangs brass)", "");
    fs::write(&path, text).expect("written");
    let (output, value) = joint(no_key.path(), &[]);
    assert_eq!(output.status.code(), Some(11), "{value} {}", stderr(&output));
    let reason = value["reason"].as_str().expect("a reason");
    assert_eq!(reason, "proven: there is no joint plan of `doorkeeper`, `robot`");
}

#[test]
fn files_that_contradict_each_other_are_refused() {
    let folder = changed("domain-doorkeeper.pddl", "(open ?d - door)", "(open ?d ?e - door)");
    let (output, value) = joint(folder.path(), &[]);
    assert_eq!(output.status.code(), Some(33), "{value} {}", stderr(&output));
    let text = value.to_string();
    assert!(text.contains("`open` takes"), "{text}");
    let (output, value) = joint(&example().join("missing"), &[]);
    assert_eq!(output.status.code(), Some(33), "{value}");
}

#[test]
fn a_task_of_an_agent_that_cannot_be_named_is_refused() {
    let folder = changed("domain-robot.pddl", "drive", "drive");
    for kind in ["domain", "problem"] {
        let path = |agent: &str| folder.path().join(format!("{kind}-{agent}.pddl"));
        fs::rename(path("robot"), path("Robot 1")).expect("renamed");
    }
    let (output, _) = joint(folder.path(), &[]);
    assert_eq!(output.status.code(), Some(33), "{}", stderr(&output));
    let printed = stdout(&output);
    assert!(printed.contains("`Robot 1` cannot be the name of an agent"), "{printed}");
}
