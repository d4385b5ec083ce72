//! The screens of a first contact: the first screen, the help, the messages about wrong command
//! lines.

use crate::sandbox::Sandbox;

#[test]
fn without_arguments_the_first_screen_is_shown() {
    let sandbox = Sandbox::new(&[]);
    let runtime = sandbox.path().join("run").display().to_string();
    let sandbox = sandbox.with_variable("ALTHING_RUNTIME_DIR", &runtime);
    let first = sandbox.check("", 0).stdout;
    assert!(first.starts_with("Althing") && first.contains("No daemon runs"), "{first}");
    assert!(first.contains("althing scenario 1"), "what to do next: {first}");
    assert!(first.lines().count() <= 15, "{first}");
    for line in first.lines() {
        assert!(line.chars().count() <= 80, "{line}");
    }
    // With a file, the next commands are about it.
    sandbox.write("althing.toml", b"[ecosystem]\nname = \"school\"\n[goals]\nwarm = \"(warm)\"\n");
    let first = sandbox.check("", 0).stdout;
    assert!(first.contains("althing check althing.toml"), "{first}");
}

#[test]
fn the_help_groups_the_commands_by_purpose() {
    let sandbox = Sandbox::new(&[]);
    let help = sandbox.check("--help", 0).stdout;
    for group in ["Stop", "Begin", "Ask", "Look", "Devices", "Manage", "Planner"] {
        assert!(help.lines().any(|line| line.starts_with(group)), "{group}: {help}");
    }
    for same in ["-h", "help"] {
        assert_eq!(sandbox.check(same, 0).stdout, help);
    }
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
