//! The screens of a first contact: the first screen, the help, the messages about wrong command
//! lines.

use crate::sandbox::Sandbox;

#[test]
fn without_arguments_the_first_screen_is_shown() {
    let run = Sandbox::new(&[]).check("", 0);
    assert!(run.stdout.starts_with("Althing"), "{}", run.stdout);
    assert_eq!(run.stdout, Sandbox::new(&[]).check("--help", 0).stdout);
    assert_eq!(run.stdout, Sandbox::new(&[]).check("help", 0).stdout);
}

#[test]
fn help_fits_80_columns() {
    let commands = [
        "up",
        "keyboard",
        "scenario",
        "goal",
        "act",
        "set",
        "mode",
        "answer",
        "agents",
        "domain",
        "state",
        "goals",
        "watch",
        "replay",
        "mailbox",
        "send",
        "plan",
        "validate",
        "check",
        "completions",
    ];
    for command in commands {
        let help = Sandbox::new(&[]).check(&format!("{command} --help"), 0).stdout;
        assert!(help.contains(&format!("althing {command}")), "{help}");
        for line in help.lines() {
            assert!(line.chars().count() <= 80, "{command}: {line}");
        }
    }
}

#[test]
fn a_wrong_command_line_is_no_planner_s_exit_code() {
    let run = Sandbox::new(&[]).check("pln", 64);
    assert!(run.stderr.contains("plan"), "{}", run.stderr);
    Sandbox::new(&[]).check("plan only-one", 64);
    Sandbox::new(&[]).check("plan a b --time-limit 0", 64);
    Sandbox::new(&[]).check("plan a b --threads 0", 64);
    Sandbox::new(&[]).check("goal", 64);
}

#[test]
fn colors_are_for_terminals() {
    let run = Sandbox::new(&[]).check("plan a b", 33);
    assert!(!run.stderr.contains('\u{1b}'), "{}", run.stderr);
}
