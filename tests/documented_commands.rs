//! The commands of README.md and of docs/*.md are run as they stand, or are listed here with the
//! reason why they are not.
//!
//! Every block that is marked as `sh` is read. Each document gets a folder of its own, with the
//! files that its commands name, and a running ecosystem, unless its first command starts one.

mod left_out;

use std::collections::BTreeSet;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::support::{Office, PATIENCE, finish, lines, stderr, stdout};
use left_out::{ENDINGS, LEFT_OUT, PREPARATIONS};

/// A command of a document.
#[derive(Clone, Debug)]
struct DocumentedCommand {
    line: usize,
    text: String,
}

/// How a command ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    /// By itself, with one of these exit codes.
    Code(&'static [i32]),
    /// Never: it is ended after it has printed a line with this text.
    Said(&'static str),
    /// Never, and the commands after it need it: it is ended with the document.
    Daemon,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..").canonicalize().expect("the repository")
}

/// Returns the documents: README.md, and those in `docs`.
fn documents() -> Vec<String> {
    let folder = std::fs::read_dir(root().join("docs")).expect("the folder of documents");
    let names = folder.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = names.filter(|name| name.ends_with(".md")).collect();
    names.sort();
    let docs = names.into_iter().map(|name| format!("docs/{name}"));
    std::iter::once("README.md".to_owned()).chain(docs).collect()
}

/// Returns the commands in the blocks `sh` of a document. A line that ends with a backslash goes on
/// in the next one.
fn commands(text: &str) -> Vec<DocumentedCommand> {
    let mut commands: Vec<DocumentedCommand> = Vec::new();
    let (mut is_inside, mut goes_on) = (false, false);
    for (index, line) in text.lines().enumerate() {
        if line.starts_with("```") {
            is_inside = line == "```sh" && !is_inside;
            goes_on = false;
            continue;
        }
        let code = line.trim();
        if !is_inside || code.is_empty() || code.starts_with('#') {
            continue;
        }
        match commands.last_mut().filter(|_| goes_on) {
            Some(before) => before.text += &format!("\n{line}"),
            None => commands.push(DocumentedCommand { line: index + 1, text: line.to_owned() }),
        }
        goes_on = line.ends_with('\\');
    }
    commands
}

/// Returns the reason why a command is not run; `None` if it is run.
fn reason(document: &str, command: &str) -> Option<&'static str> {
    let is_it = |(place, part, _): &&(&str, &str, &str)| {
        (*place == "*" || *place == document) && command.contains(part)
    };
    LEFT_OUT.iter().find(is_it).map(|(.., reason)| *reason)
}

fn ending(command: &str) -> Ending {
    let listed = ENDINGS.iter().find(|(part, _)| command.contains(part));
    listed.map_or(Ending::Code(&[0]), |(_, ending)| *ending)
}

// === running ===

/// The folder of a document's commands, and the processes that go on.
struct Stage {
    office: Office,
    daemons: Vec<Child>,
}

impl Drop for Stage {
    fn drop(&mut self) {
        for daemon in &mut self.daemons {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}

impl Stage {
    /// Makes the folder, with the folders of the repository and the files that commands name.
    fn open() -> Stage {
        let office = Office::new();
        let programs = office.folder().join("bin");
        std::fs::create_dir(&programs).expect("a folder");
        symlink(env!("CARGO_BIN_EXE_althing"), programs.join("althing")).expect("a link");
        let office = office.with_programs(&programs);
        let root = root();
        // A daemon writes into its folder of plugins, which may be the one below.
        std::fs::create_dir_all(office.folder().join("plugins")).expect("a folder");
        for folder in ["domains", "ecosystems", "plugins/python", "docs", "deploy"] {
            symlink(root.join(folder), office.folder().join(folder)).expect("a link");
        }
        let file = std::fs::read_to_string(Office::file()).expect("the office's file");
        let file = file.replace("\"../domains/", "\"domains/");
        for name in ["althing.toml", "office.toml", "ecosystem.toml"] {
            office.write(name, &file);
        }
        office.write("domain.pddl", DOMAIN);
        office.write("problem.pddl", PROBLEM);
        Stage { office, daemons: Vec::new() }
    }

    fn shell(&self, text: &str) -> Command {
        let mut command = self.office.program("sh");
        let home = self.office.folder().join("home");
        command.args(["-c", text]).stdin(Stdio::null()).env("HOME", &home);
        command.env_remove("XDG_CONFIG_HOME").env_remove("XDG_STATE_HOME");
        command
    }

    /// Starts a command that does not end, and waits until it has printed a line with `said`.
    fn start(&self, text: &str, said: &str) -> Result<Child, String> {
        let mut command = self.shell(&format!("exec {text}"));
        let started = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut child = started.map_err(|error| error.to_string())?;
        let printed = lines(&mut child);
        let mut all = String::new();
        while let Ok(line) = printed.recv_timeout(PATIENCE) {
            if line.contains(said) {
                // The rest of the output is read, so that the command never blocks.
                std::thread::spawn(move || printed.iter().for_each(drop));
                return Ok(child);
            }
            all += &format!("{line}\n");
        }
        let _ = child.kill();
        let _ = child.wait();
        Err(format!("never printed `{said}`: {all}"))
    }

    /// Runs a command as it stands. Returns what went wrong.
    fn run(&mut self, text: &str) -> Result<(), String> {
        match ending(text) {
            Ending::Daemon => {
                let daemon = self.start(text, "is ready")?;
                self.daemons.push(daemon);
            }
            Ending::Said(said) => {
                let mut child = self.start(text, said)?;
                let _ = child.kill();
                let _ = child.wait();
            }
            Ending::Code(codes) => {
                let output = finish(&mut self.shell(text));
                let code = output.status.code().unwrap_or(-1);
                if !codes.contains(&code) {
                    let said = format!("{}{}", stdout(&output), stderr(&output));
                    return Err(format!("exit code {code}: {said}"));
                }
            }
        }
        Ok(())
    }
}

/// Runs the commands of one document.
#[track_caller]
fn check(document: &str) {
    let text = std::fs::read_to_string(root().join(document)).expect("the document");
    let all = commands(&text);
    let run: Vec<_> = all.iter().filter(|it| reason(document, &it.text).is_none()).collect();
    let Some(first) = run.first() else { return };
    let mut stage = Stage::open();
    if ending(&first.text) != Ending::Daemon {
        let daemon = stage.start("althing up althing.toml", "is ready").expect("the office");
        stage.daemons.push(daemon);
    }
    let preparations = PREPARATIONS.iter().filter(|(of, _)| *of == document);
    for (_, preparation) in preparations {
        stage.run(preparation).unwrap_or_else(|problem| panic!("{preparation}: {problem}"));
    }
    let mut failed = Vec::new();
    for DocumentedCommand { line, text } in run {
        if let Err(problem) = stage.run(text) {
            failed.push(format!("{document}:{line}: {text}\n{problem}"));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// The test of each document whose commands are run.
macro_rules! documents {
    ($($name:ident: $document:literal),* $(,)?) => {
        const TESTED: &[&str] = &[$($document),*];
        $(
            #[test]
            fn $name() {
                check($document);
            }
        )*
    };
}

documents! {
    the_readme: "README.md",
    history: "docs/history.md",
    interfacing: "docs/interfacing.md",
    metrics: "docs/metrics.md",
    people: "docs/people.md",
    plugins: "docs/plugins.md",
    security: "docs/security.md",
    stops: "docs/stops.md",
    view: "docs/view.md",
    devices: "docs/devices.md",
    joint_planning: "docs/joint-planning.md",
}

/// Checks that the commands of every document are run, or listed with a reason.
#[test]
fn every_command_is_run_or_has_a_reason() {
    let mut missing = Vec::new();
    for document in documents() {
        let text = std::fs::read_to_string(root().join(&document)).expect("the document");
        for DocumentedCommand { line, text } in commands(&text) {
            let is_run = TESTED.contains(&document.as_str()) && text.starts_with("althing ");
            if !is_run && reason(&document, &text).is_none() {
                missing.push(format!("{document}:{line}: {text}"));
            }
        }
    }
    assert!(
        missing.is_empty(),
        "add the document to `documents!`, or the commands to LEFT_OUT with a reason:\n{}",
        missing.join("\n")
    );
}

/// Checks that each reason belongs to a command that a document has.
#[test]
fn no_reason_is_left_over() {
    let texts: Vec<(String, String)> = documents()
        .into_iter()
        .map(|name| {
            let text = std::fs::read_to_string(root().join(&name)).expect("the document");
            (name, text)
        })
        .collect();
    let mut unused = BTreeSet::new();
    for (place, part, _) in LEFT_OUT {
        let is_used = texts.iter().any(|(name, text)| {
            (*place == "*" || place == name)
                && commands(text).iter().any(|command| command.text.contains(part))
        });
        if !is_used {
            unused.insert((place, part));
        }
    }
    assert!(unused.is_empty(), "{unused:?}");
}

#[test]
fn blocks_are_read_line_by_line() {
    let text =
        "a\n```sh\n# comment\nalthing up   # here\nsudo a \\\n    b\n```\n```text\nno\n```\n";
    let read: Vec<_> = commands(text).into_iter().map(|it| (it.line, it.text)).collect();
    let expected = [(4, "althing up   # here".to_owned()), (5, "sudo a \\\n    b".to_owned())];
    assert_eq!(read, expected);
}

const DOMAIN: &str = "\
(define (domain lamp) (:requirements :strips :typing) (:types room lamp)
  (:predicates (on ?l - lamp) (in ?l - lamp ?r - room) (at ?r - room) (door ?a ?b - room))
  (:action go :parameters (?a ?b - room) :precondition (and (at ?a) (door ?a ?b))
    :effect (and (not (at ?a)) (at ?b)))
  (:action switch :parameters (?l - lamp ?r - room) :precondition (and (at ?r) (in ?l ?r))
    :effect (on ?l)))
";

const PROBLEM: &str = "\
(define (problem evening) (:domain lamp)
  (:objects hall study - room desk-lamp - lamp)
  (:init (at hall) (door hall study) (in desk-lamp study))
  (:goal (on desk-lamp)))
";
