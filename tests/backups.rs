//! Backup and restore of a machine, and a state folder of another version.

use std::fs;
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Stdio;

use serde_json::Value;

use crate::support::{Office, lab, lines, stderr, stdout};

const GOAL: &str = "(known-temperature office2)";

/// Returns the text of an ecosystem `lab` with a Journal and a thermometer in office2.
fn lab_with_journal() -> String {
    lab("decentralized")
        + "[[agent]]\nname = \"journal\"\nplugin = \"journal\"\n\n\
           [[agent]]\nname = \"keyboard\"\nplugin = \"keyboard\"\n\n\
           [[agent]]\nname = \"thermometer\"\nplugin = \"temperature-sensor\"\n\
           driver = \"simulated\"\nconfig = { location = \"office2\" }\n"
}

/// Returns an office whose daemon runs, with a goal that is kept.
fn with_a_kept_goal() -> Office {
    let office = Office::new();
    let file = office.write("lab.toml", &lab_with_journal());
    let mut office = office.with_file(file);
    office.write("people.toml", "");
    fs::set_permissions(office.folder().join("people.toml"), fs::Permissions::from_mode(0o600))
        .expect("it is ours");
    office.up_alone(&[]);
    let file = office.file.display().to_string();
    let mut goal = office.command(&["goal", GOAL, "--maintain", "--ecosystem", &file]);
    let mut asking = goal.stdout(Stdio::piped()).spawn().expect("the binary is built");
    let said = lines(&mut asking);
    loop {
        let line = said.recv_timeout(crate::support::PATIENCE).expect("the goal comes to hold");
        if line.contains("holds") {
            break;
        }
    }
    // A killed command cancels nothing.
    asking.kill().expect("our child");
    asking.wait().expect("our child");
    office
}

/// Returns the path of a file in the folder of an office, as an argument.
fn path(office: &Office, name: &str) -> String {
    office.folder().join(name).display().to_string()
}

fn kept_goals(office: &Office) -> Vec<String> {
    let goals = office.ask_json(&["goals"])["goals"].clone();
    let goals = goals.as_array().cloned().unwrap_or_default();
    let kept = goals.iter().filter(|goal| goal["keep"] == "maintain");
    kept.map(|goal| goal["goal"].as_str().unwrap_or_default().to_owned()).collect()
}

#[test]
fn a_kept_goal_moves_to_another_machine() {
    let one = with_a_kept_goal();
    let archive = path(&one, "office.tar.gz");
    let (code, said) = one.ask(&["backup", &archive]);
    assert_eq!(code, Some(0), "{said}");
    let mode = fs::metadata(&archive).expect("it is there").permissions().mode() & 0o777;
    assert_eq!(mode, 0o600, "keys may be in it");

    // Where the daemon runs, nothing is put in place.
    let refused = one.run(&["restore", &archive, "--replace"]);
    assert!(stderr(&refused).contains("is running on this machine"), "{}", stderr(&refused));

    let mut other = Office::new();
    let configuration = path(&other, "moved");
    let restored = other.run(&["restore", &archive, "--configuration", &configuration, "--json"]);
    assert!(restored.status.success(), "{}", stderr(&restored));
    let value: Value = serde_json::from_str(&stdout(&restored)).expect("one object");
    let file = value["file"].as_str().expect("the ecosystem file").to_owned();
    assert!(Path::new(&file).starts_with(&configuration), "{file}");
    other.file = file.into();
    other.up_alone(&[]);
    let deadline = std::time::Instant::now() + crate::support::PATIENCE;
    while kept_goals(&other) != [GOAL] {
        assert!(std::time::Instant::now() < deadline, "{:?}", kept_goals(&other));
    }
}

#[test]
fn what_is_there_is_kept_aside_and_a_broken_archive_changes_nothing() {
    let mut office = with_a_kept_goal();
    let archive = path(&office, "office.tar.gz");
    let (code, said) = office.ask(&["backup", &archive, "--without", "history,plugins"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("left out: history, plugins"), "{said}");
    office.kill("alone");

    let occupied = office.run(&["restore", &archive]);
    assert_eq!(occupied.status.code(), Some(33));
    assert!(stderr(&occupied).contains("is there already"), "{}", stderr(&occupied));
    let whole = fs::read(&archive).expect("it is there");
    let torn = path(&office, "torn.tar.gz");
    fs::write(&torn, &whole[..whole.len() / 2]).expect("written");
    let broken = office.run(&["restore", &torn, "--replace"]);
    assert!(stderr(&broken).contains("torn.tar.gz"), "{}", stderr(&broken));
    let state = office.folder().join("state");
    let names = || {
        let entries = fs::read_dir(&state).expect("a folder").flatten();
        let mut names: Vec<_> =
            entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    };
    assert_eq!(names(), ["lab"], "nothing has changed");

    let restored = office.run(&["restore", &archive, "--replace"]);
    assert!(restored.status.success(), "{}", stderr(&restored));
    let names = names();
    assert!(names.len() == 2 && names[1].starts_with("lab.before-"), "{names:?}");
    office.up_alone(&[]);
    let deadline = std::time::Instant::now() + crate::support::PATIENCE;
    while kept_goals(&office) != [GOAL] {
        assert!(std::time::Instant::now() < deadline, "{:?}", kept_goals(&office));
    }
}

#[test]
fn a_daemon_that_starts_while_an_archive_is_unpacked_keeps_its_state() {
    let mut office = with_a_kept_goal();
    let archive = path(&office, "office.tar.gz");
    let (code, said) = office.ask(&["backup", &archive]);
    assert_eq!(code, Some(0), "{said}");
    office.kill("alone");
    let whole = fs::read(&archive).expect("it is there");
    // The command reads the archive twice: to check it, and to unpack it. Each time it reads from a
    // pipe of its own, so that the test knows how far the command is.
    let pipes = [path(&office, "first"), path(&office, "second")];
    let made = std::process::Command::new("mkfifo").args(&pipes).status().expect("coreutils");
    assert!(made.success());
    let link = path(&office, "slow.tar.gz");
    std::os::unix::fs::symlink(&pipes[0], &link).expect("linked");
    let mut restore = office.command(&["restore", &link, "--replace"]);
    let restore = restore.stdout(Stdio::piped()).stderr(Stdio::piped());
    let restore = restore.spawn().expect("the binary is built");
    let mut first = open_pipe(&pipes[0]);
    let next = path(&office, "next");
    std::os::unix::fs::symlink(&pipes[1], &next).expect("linked");
    fs::rename(&next, &link).expect("renamed");
    first.write_all(&whole).expect("it reads");
    drop(first);
    let mut second = open_pipe(&pipes[1]);
    // It has found no daemon, and now unpacks.
    office.up_alone(&[]);
    second.write_all(&whole).expect("it reads");
    drop(second);
    let output = restore.wait_with_output().expect("our child");
    let said = stderr(&output);
    assert!(said.contains("is running on this machine"), "{:?} {said}", output.status);
    let entries = fs::read_dir(office.folder().join("state")).expect("a folder").flatten();
    let names: Vec<_> = entries.map(|entry| entry.file_name()).collect();
    assert_eq!(names, ["lab"], "nothing has changed");
}

/// Opens a pipe for writing, as soon as a command reads from it.
fn open_pipe(path: &str) -> fs::File {
    fs::OpenOptions::new().write(true).open(path).expect("a pipe")
}

#[test]
fn the_state_of_a_newer_version_is_refused_by_name() {
    let office = Office::new();
    let file = office.write("lab.toml", &lab_with_journal());
    let folder = office.folder().join("state/lab/hub");
    fs::create_dir_all(&folder).expect("made");
    let newer = "{\"format\":99,\"written_by\":\"9.0.0\"}";
    fs::write(folder.join("format.json"), newer).expect("written");
    fs::write(folder.join("stops.json"), "in another format").expect("written");
    let up = office.run(&["up", &file.display().to_string(), "--daemon", "hub"]);
    assert_eq!(up.status.code(), Some(78), "no restart helps: {}", stderr(&up));
    assert!(stderr(&up).contains("althing 9.0.0 wrote it (format 99"), "{}", stderr(&up));
    let entries = fs::read_dir(&folder).expect("a folder").count();
    assert_eq!(entries, 2, "nothing is added");
    let kept = fs::read_to_string(folder.join("stops.json")).expect("it is there");
    assert_eq!(kept, "in another format");
}
