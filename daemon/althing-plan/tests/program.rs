//! `althing-plan`, run as a user runs it.

use std::process::{Command, Output};

use expect_test::expect;

const DOMAIN: &str = "\
(define (domain lamp)
  (:predicates (on))
  (:action switch :parameters () :effect (on)))
";
const PROBLEM: &str = "(define (problem evening) (:domain lamp) (:init) (:goal (on)))\n";

/// Runs it in a folder with a domain and a problem.
fn run(arguments: &[&str]) -> Output {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [("domain.pddl", DOMAIN), ("evening.pddl", PROBLEM)] {
        std::fs::write(folder.path().join(name), text).expect("it can be written");
    }
    let program = env!("CARGO_BIN_EXE_althing-plan");
    Command::new(program).args(arguments).current_dir(&folder).output().expect("it runs")
}

#[test]
fn it_plans() {
    let output = run(&["domain.pddl", "evening.pddl"]);
    assert_eq!(output.status.code(), Some(0));
    expect![[r#"
        (switch)
        ; cost = 1 (unit cost)
    "#]]
    .assert_eq(&String::from_utf8_lossy(&output.stdout));
}

#[test]
fn it_says_what_is_wrong_with_a_file() {
    let output = run(&["domain.pddl", "morning.pddl"]);
    assert_eq!(output.status.code(), Some(33));
    expect![[r#"
        error: failed to read `morning.pddl`: there is no such file

        1 error
    "#]]
    .assert_eq(&String::from_utf8_lossy(&output.stderr));
}

#[test]
fn it_calls_itself_by_its_name() {
    let help = run(&["--help"]);
    assert_eq!(help.status.code(), Some(0));
    let text = String::from_utf8_lossy(&help.stdout);
    assert!(text.contains("Usage: althing-plan [OPTIONS]"), "{text}");
    assert!(text.contains("Examples: althing-plan domain.pddl"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    assert_eq!(run(&["--no-such-option"]).status.code(), Some(64));
}
