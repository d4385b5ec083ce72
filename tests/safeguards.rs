//! Safeguards of actions, on real processes: a person allows or forbids a robot's move, and an
//! action that has begun too often is refused. The truth is where the robot says it stands, which
//! is the place in the simulated building.

use crate::support::{Office, lab, stderr};

const ROBOT: &str = "[[agent]]\nname = \"turtlebot-1\"\nplugin = \"turtlebot\"\n\
    config = { start = \"corridor\", speed = 2.0 }\n\n[building]\ntime-scale = 0.02\n\n";

fn office(safeguards: &str) -> Office {
    let office = Office::new();
    let file = office.write("lab.toml", &(lab("centralized") + ROBOT + safeguards));
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    office.await_fact("(at turtlebot-1 corridor)", true);
    office
}

#[test]
fn a_person_allows_a_move_or_forbids_it() {
    let office =
        office("[safeguards.turtlebot-1]\nmove = { confirm = true, patience = \"1min\" }\n");
    let to = |room: &str| {
        let mut asked = office.command(&["act", &format!("(move turtlebot-1 corridor {room})")]);
        asked.stdout(std::process::Stdio::piped()).spawn().expect("a command")
    };
    let question = "(move turtlebot-1 corridor office1). May it?";

    let forbidden = to("office1");
    office.answer(question, "no");
    let output = forbidden.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_ne!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("a person said no"), "{said}");
    office.await_fact("(at turtlebot-1 corridor)", true);

    let allowed = to("office1");
    office.answer(question, "Yes");
    let output = allowed.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
    office.await_fact("(at turtlebot-1 office1)", true);
}

#[test]
fn a_move_that_no_person_allows_in_time_does_not_begin() {
    let office =
        office("[safeguards.turtlebot-1]\nmove = { confirm = true, patience = \"500ms\" }\n");
    let (code, said) = office.ask(&["act", "(move turtlebot-1 corridor office1)"]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("get leave from a person: no answer came within 500ms"), "{said}");
    office.await_fact("(at turtlebot-1 corridor)", true);
}

#[test]
fn an_action_that_has_begun_too_often_is_refused_with_the_time_to_wait() {
    let office = office("[safeguards.turtlebot-1]\nmove = { at-most = 2, per = \"1h\" }\n");
    for step in ["(move turtlebot-1 corridor office1)", "(move turtlebot-1 office1 corridor)"] {
        let (code, said) = office.ask(&["act", step]);
        assert_eq!(code, Some(0), "{said}");
    }
    let (code, said) = office.ask(&["act", "(move turtlebot-1 corridor office2)"]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("`move` may begin at most 2 times in 1h; again in "), "{said}");
    // A goal tries it once, and ends with the reason.
    let (code, said) = office.ask(&["goal", "(at turtlebot-1 office2)"]);
    assert_ne!(code, Some(0), "{said}");
    let end = said.lines().last().expect("an end");
    assert!(end.contains("`move` may begin at most 2 times in 1h"), "{said}");
    office.await_fact("(at turtlebot-1 corridor)", true);
}

#[test]
fn a_restart_of_the_daemon_does_not_allow_an_action_more_often() {
    let mut office = office("[safeguards.turtlebot-1]\nmove = { at-most = 2, per = \"1h\" }\n");
    let (code, said) = office.ask(&["act", "(move turtlebot-1 corridor office1)"]);
    assert_eq!(code, Some(0), "{said}");
    office.kill("alone");
    office.up_alone(&[]);
    office.await_devices(1);
    // The simulated building began anew with its process.
    office.await_fact("(at turtlebot-1 corridor)", true);
    let (code, said) = office.ask(&["act", "(move turtlebot-1 corridor office1)"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = office.ask(&["act", "(move turtlebot-1 office1 corridor)"]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("`move` may begin at most 2 times in 1h; again in "), "{said}");
    office.await_fact("(at turtlebot-1 office1)", true);
}

#[test]
fn mistakes_in_safeguards_are_reported() {
    let office = Office::new();
    for (safeguards, complaint) in [
        ("turtlebot-1.mvoe = { confirm = true }", "| turtlebot-1.mvoe = { confirm = true } | ^"),
        ("turtlebot-1.mvoe = { confirm = true }", "did you mean `move`?"),
        ("turtlebot-1.move = { at-most = 3 }", "`at-most` needs `per`"),
        ("turtlebot-1.move = { per = \"1h\" }", "`per` needs `at-most`"),
        ("turtlebot-1.move = { patience = \"1min\" }", "`patience` needs `confirm`"),
        ("turtlebot-1.move = { at-most = 1001, per = \"1h\" }", "greater than 1000"),
        ("turtlebot-1.move = {}", "this safeguard has no effect"),
        ("turtlebot-1.move = { confirm = \"true\" }", "write confirm = true, without quotes"),
        ("turtelbot-1.move = { confirm = true }", "did you mean `turtlebot-1`?"),
    ] {
        let text = format!("{}{ROBOT}[safeguards]\n{safeguards}\n", lab("centralized"));
        let file = office.write("lab.toml", &text);
        let checked = office.run(&["check", &file.display().to_string()]);
        // The lines are wrapped.
        let said = stderr(&checked).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains(complaint), "{complaint}: {said}");
    }
}
