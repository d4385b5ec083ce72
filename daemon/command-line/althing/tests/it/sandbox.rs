//! A folder of files in which the binary runs, with no environment variables except those of a
//! test.

use std::path::Path;
use std::process::{Command, Output};

use expect_test::Expect;
use serde_json::Value;
use tempfile::TempDir;

/// A domain without mistakes, for tests to use or to change.
pub(crate) const LAMP: &str = "\
(define (domain lamp)
  (:requirements :strips :typing)
  (:types room lamp)
  (:predicates
    (on ?l - lamp)
    (in ?l - lamp ?r - room)
    (at ?r - room)
    (door ?a ?b - room))
  (:action go
    :parameters (?a ?b - room)
    :precondition (and (at ?a) (door ?a ?b))
    :effect (and (not (at ?a)) (at ?b)))
  (:action switch
    :parameters (?l - lamp ?r - room)
    :precondition (and (at ?r) (in ?l ?r))
    :effect (on ?l)))
";

/// A problem of that domain, with a plan of two steps.
pub(crate) const EVENING: &str = "\
(define (problem evening)
  (:domain lamp)
  (:objects hall study - room desk-lamp - lamp)
  (:init (at hall) (door hall study) (door study hall) (in desk-lamp study))
  (:goal (on desk-lamp)))
";

/// The plan of that problem.
pub(crate) const PLAN: &str = "(go hall study)\n(switch desk-lamp study)\n";

/// A folder that is removed after the test.
pub(crate) struct Sandbox {
    folder: TempDir,
    variables: Vec<(String, String)>,
}

/// The result of a run.
pub(crate) struct Run {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Sandbox {
    pub(crate) fn new(files: &[(&str, &str)]) -> Sandbox {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let sandbox = Sandbox { folder, variables: Vec::new() };
        for (name, text) in files {
            sandbox.write(name, text.as_bytes());
        }
        sandbox
    }

    /// A sandbox with the domain, its problem and its plan.
    pub(crate) fn lamp() -> Sandbox {
        Sandbox::new(&[("domain.pddl", LAMP), ("evening.pddl", EVENING), ("plan.txt", PLAN)])
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) {
        let path = self.path().join(name);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).expect("a folder in the sandbox");
        }
        std::fs::write(path, bytes).expect("a file in the sandbox");
    }

    pub(crate) fn with_variable(mut self, name: &str, value: &str) -> Sandbox {
        self.variables.push((name.to_owned(), value.to_owned()));
        self
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Runs `althing` with arguments separated by spaces.
    #[track_caller]
    pub(crate) fn run(&self, arguments: &str) -> Run {
        let mut command = Command::new(env!("CARGO_BIN_EXE_althing"));
        command.args(arguments.split_whitespace()).current_dir(self.path());
        command.env_clear().envs(self.variables.iter().cloned());
        let Output { status, stdout, stderr } = command.output().expect("the binary runs");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        Run { code: status.code().expect("no signal"), stdout: text(stdout), stderr: text(stderr) }
    }

    /// Runs `althing` and compares the exit code.
    #[track_caller]
    pub(crate) fn check(&self, arguments: &str, code: i32) -> Run {
        let run = self.run(arguments);
        assert_eq!(run.code, code, "{}{}", run.stdout, run.stderr);
        run
    }
}

impl Run {
    /// Compares both streams; text that depends on the clock is hidden.
    #[track_caller]
    pub(crate) fn shows(self, stdout: Expect, stderr: Expect) -> Run {
        stdout.assert_eq(&self.stdout);
        stderr.assert_eq(&without_seconds(&self.stderr));
        self
    }

    /// Parses stdout, which is one JSON object.
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        assert_eq!(self.stdout.lines().count(), 1, "{}", self.stdout);
        serde_json::from_str(&self.stdout).expect("JSON")
    }
}

fn without_seconds(text: &str) -> String {
    let lines = text.lines().map(|line| match line.split_once(" expanded in ") {
        Some((before, _)) => format!("{before} expanded in … s\n"),
        None => format!("{line}\n"),
    });
    lines.collect()
}
