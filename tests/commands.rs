//! Tests of the commands for a running ecosystem, and of the answers to invalid requests.

use std::process::{Child, Stdio};
use std::time::Instant;

use crate::support::{Office, PATIENCE, ask, lines, office, stderr, stdout};

fn file() -> String {
    Office::file().display().to_string()
}

#[test]
fn an_office_of_four_machines() {
    let office = office();

    let (code, goal) = ask(&office, &["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{goal}");
    assert!(goal.contains("20.5 °C at office1"), "{goal}");
    assert!(goal.contains("done     the goal holds"), "{goal}");

    let (_, again) = ask(&office, &["goal", "temperatures"]);
    assert!(again.contains("it holds already"), "{again}");

    let (_, agents) = ask(&office, &["agents"]);
    for line in ["turtlebot-1", "turtlebot-laptop", "move", "report-temperature"] {
        assert!(agents.contains(line), "{agents}");
    }
    let (_, state) = ask(&office, &["state"]);
    assert!(state.contains("(known-temperature office1)"), "{state}");
    assert!(state.contains("ir-1"), "whose word it is: {state}");

    let (_, domain) = ask(&office, &["domain"]);
    let parsed = pddl::parse_domain(&domain);
    assert!(parsed.is_ok(), "{:?}", parsed.diagnostics);

    let snapshot = office.ask_json(&["domain"]);
    assert!(snapshot["offers"]["turtlebot-1"]["move"].is_object(), "{snapshot}");

    // Invalid requests: each gets a clear answer, and the office goes on.
    let (code, unknown) = ask(&office, &["goal", "(known-temprature office1)"]);
    assert_eq!(code, Some(1), "{unknown}");
    assert!(unknown.contains("known-temperature"), "the likely name: {unknown}");

    let (code, broken) = ask(&office, &["goal", "(and (known-temperature office1)"]);
    assert_eq!(code, Some(33), "{broken}");

    let (code, misnamed) = ask(&office, &["goal", "temperature"]);
    assert_eq!(code, Some(33), "{misnamed}");
    assert!(misnamed.contains("did you mean `temperatures`?"), "{misnamed}");

    let (code, never) = ask(&office, &["goal", "(mounted-on thermometer-office2 turtlebot-1)"]);
    assert_eq!(code, Some(1), "{never}");
    assert!(never.contains("(mounted-on thermometer-office2 turtlebot-1)"), "{never}");

    let (code, nothing) = ask(&office, &["goal", "--cancel", "no-such-goal"]);
    assert_eq!(code, Some(1), "{nothing}");
    assert!(nothing.contains("there is no goal `no-such-goal`"), "{nothing}");

    let (code, still) = ask(&office, &["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{still}");
}

#[test]
fn one_action_at_a_time() {
    let office = office();
    let (code, moved) = ask(&office, &["act", "(move turtlebot-1 corridor office1)"]);
    assert_eq!(code, Some(0), "{moved}");
    assert!(moved.contains("arrived at office1"), "{moved}");
    let (_, state) = ask(&office, &["state"]);
    assert!(state.contains("(at turtlebot-1 office1)"), "{state}");

    let (code, again) = ask(&office, &["act", "(move turtlebot-1 corridor office1)", "--json"]);
    assert_eq!(code, Some(1), "it is not in the corridor any more: {again}");
    assert!(again.contains("(at turtlebot-1 corridor)"), "what does not hold: {again}");

    let (code, nobody) = ask(&office, &["act", "(move turtlebot-2 corridor office1)"]);
    assert_eq!(code, Some(1), "{nobody}");
    assert!(nobody.contains("did you mean `turtlebot-1`?"), "{nobody}");

    let (code, broken) = ask(&office, &["act", "(move turtlebot-1"]);
    assert_eq!(code, Some(33), "{broken}");
}

#[test]
fn the_state_is_changed_by_a_request() {
    let office = office();
    let fact = "(known-temperature office1)";
    let (code, set) = ask(&office, &["set", fact]);
    assert_eq!(code, Some(0), "{set}");
    let (_, goal) = ask(&office, &["goal", fact]);
    assert!(goal.contains("it holds already"), "{goal}");

    let (code, retracted) = ask(&office, &["set", "--retract", fact, "--json"]);
    assert_eq!(code, Some(0), "{retracted}");
    let (_, state) = ask(&office, &["state"]);
    assert!(!state.contains(fact), "{state}");

    let (code, unknown) = ask(&office, &["set", "(known-temprature office1)"]);
    assert_eq!(code, Some(1), "{unknown}");
    assert!(unknown.contains("did you mean `known-temperature`?"), "{unknown}");
    let (code, broken) = ask(&office, &["set", "(known-temperature"]);
    assert_eq!(code, Some(33), "{broken}");
}

#[test]
fn the_planning_mode_changes_at_run_time() {
    let office = office();
    let planned = || {
        let mailboxes = office.ask_json(&["mailbox", "planning-agent"]);
        mailboxes["daemons"][0]["mailboxes"][0]["received"].as_u64().expect("a count")
    };
    let before = planned();
    let (code, goal) = ask(&office, &["goal", "(known-temperature office2)"]);
    assert_eq!(code, Some(0), "{goal}");
    assert_eq!(planned(), before, "the central planner is idle");

    let (code, mode) = ask(&office, &["mode", "centralized"]);
    assert_eq!(code, Some(0), "{mode}");
    assert!(mode.contains("centralized from now on"), "{mode}");
    let (code, goal) = ask(&office, &["goal", "(known-temperature conf-room)"]);
    assert_eq!(code, Some(0), "{goal}");
    assert!(planned() > before, "the central planner was asked");
}

#[test]
fn a_question_is_answered_or_ends_at_its_deadline() {
    let office = office();
    let question = |patience: u32| {
        let text = format!(
            r#"{{"receiver": "keyboard", "performative": "query-ref",
                "content": {{"text": "May I enter?"}}, "reply_within": {patience}}}"#
        );
        office.write(&format!("{patience}.json"), &text).display().to_string()
    };
    let (code, none) = ask(&office, &["answer"]);
    assert_eq!((code, none.as_str()), (Some(0), "no questions are open\n"));
    // Not shorter: on a busy machine the question may have to be sent twice.
    let (code, refused) = ask(&office, &["send", &question(2_000)]);
    assert_eq!(code, Some(1), "{refused}");
    assert!(refused.contains("`keyboard` has no terminal open"), "{refused}");

    let asked = question(60_000);
    let (mut asking, answers) = begin(&office, &["send", &asked]);
    let deadline = Instant::now() + PATIENCE;
    let open = loop {
        let (_, open) = ask(&office, &["answer"]);
        if open.contains("May I enter?") {
            break open;
        }
        assert!(Instant::now() < deadline, "the question never came");
    };
    assert!(open.contains("keyboard/2"), "{open}");
    let (code, unknown) = ask(&office, &["answer", "9", "yes"]);
    assert_eq!(code, Some(33), "{unknown}");
    assert!(unknown.contains("open: keyboard/2"), "{unknown}");
    let (code, told) = ask(&office, &["answer", "2", "yes,", "do"]);
    assert_eq!(code, Some(0), "{told}");
    await_line(&answers, "inform   keyboard: yes, do");
    assert!(asking.wait().is_ok_and(|status| status.success()));
}

/// Starts a command and returns its lines as they come.
fn begin(office: &Office, arguments: &[&str]) -> (Child, std::sync::mpsc::Receiver<String>) {
    let file = file();
    let mut command = office.command(&[arguments, &["--ecosystem", &file]].concat());
    let mut child = command.stdout(Stdio::piped()).spawn().expect("the binary is built");
    let lines = lines(&mut child);
    (child, lines)
}

fn await_line(lines: &std::sync::mpsc::Receiver<String>, text: &str) -> String {
    loop {
        let line = lines.recv_timeout(PATIENCE);
        let line = line.unwrap_or_else(|_| panic!("`{text}` never came"));
        if line.contains(text) {
            return line;
        }
    }
}

#[test]
fn a_goal_is_listed_and_its_conversation_watched() {
    let office = office();
    let (_, own) = ask(&office, &["goals"]);
    assert!(own.starts_with("1 goal of `smart-office` at "), "{own}");
    assert!(own.contains("`plan-requester` leads at reasoning"), "{own}");
    assert!(own.contains("(patrolled corridor)\n"), "what the robot wants by itself: {own}");
    assert_eq!(own.matches("to be kept").count(), 1, "{own}");
    let goal = ["goal", "(known-temperature office2)", "--maintain", "--priority", "3"];
    let (mut keeping, said) = begin(&office, &goal);
    let asked = await_line(&said, "asked");
    let id = asked.split_whitespace().last().expect("a conversation").to_owned();
    await_line(&said, "holds");

    let (code, goals) = ask(&office, &["goals"]);
    assert_eq!(code, Some(0), "{goals}");
    for part in ["(known-temperature office2)", " holds ", "to be kept, priority 3; asked for by"] {
        assert!(goals.contains(part), "{part}: {goals}");
    }
    let listed = office.ask_json(&["goals"]);
    let listed = listed["goals"].as_array().expect("a list");
    let goal =
        listed.iter().find(|goal| goal["conversation"] == id.as_str()).expect("it is listed");
    let number = goal["number"].to_string();
    assert!(goals.lines().any(|line| line.trim_start().starts_with(&format!("{number}  holds"))));
    let (code, whole) = ask(&office, &["goals", &number]);
    assert_eq!(code, Some(0), "{whole}");
    for part in [&format!("goal {number}  (known-temperature office2)"), &id, "asked for"] {
        assert!(whole.contains(part), "{part}: {whole}");
    }

    let (mut watching, diagram) = begin(&office, &["watch", "--conversation", &number]);
    await_line(&diagram, &format!("listening to {id}"));
    let (code, unknown) = ask(&office, &["goal", "--cancel", "999"]);
    assert_eq!(code, Some(33), "{unknown}");
    assert!(unknown.contains("there is no goal 999 now; there are 1 and 2"), "{unknown}");
    let (code, given_up) = ask(&office, &["goal", "--cancel", &number]);
    assert_eq!(code, Some(0), "{given_up}");
    assert!(keeping.wait().is_ok());
    let cancel = await_line(&diagram, "─ cancel ─");
    let confirm = await_line(&diagram, "─ confirm ─");
    let what = await_line(&diagram, "cancelled: ");
    assert!(cancel.contains("▶ plan-requester"), "{cancel}");
    for line in [cancel, confirm, what] {
        assert!(line.chars().count() <= 80, "{line}");
    }
    let _ = watching.kill();
    let _ = watching.wait();
}

#[test]
fn mailboxes_are_listed_and_messages_are_sent_by_commands() {
    let office = office();
    let (code, all) = ask(&office, &["mailbox"]);
    assert_eq!(code, Some(0), "{all}");
    for part in ["turtlebot-1 ", "OVERFLOWED", "MISADDRESSED", "reasoning"] {
        assert!(all.contains(part), "{part}: {all}");
    }
    assert!(all.lines().all(|line| line.chars().count() <= 80), "{all}");
    let (code, unknown) = ask(&office, &["mailbox", "turtlebot-11"]);
    assert_eq!(code, Some(69), "{unknown}");
    assert!(unknown.contains("did you mean `turtlebot-1`?"), "{unknown}");

    let message = r#"{"receiver": "turtlebot-1", "performative": "request",
        "content": {"act": "achieve", "goal": "(known-temperature office1)"}}"#;
    let file = office.write("message.json", message).display().to_string();
    let (code, answer) = ask(&office, &["send", &file]);
    assert_eq!(code, Some(1), "{answer}");
    assert!(answer.contains("refuse   turtlebot-1: an actuator takes `act`"), "{answer}");
    let file = office.write("wrong.json", r#"{"performative": "shout"}"#).display().to_string();
    let (code, wrong) = ask(&office, &["send", &file]);
    assert_eq!(code, Some(33), "{wrong}");
}

#[test]
fn a_script_runs_line_by_line() {
    let office = office();
    let file = file();
    let script = "# to and fro\n\
        act (move turtlebot-1 corridor office1)\n\
        act (move turtlebot-1 office1 corridor)\n\
        agents\n";
    let path = office.write("script", script);
    let run = |path| {
        let mut command = office.command(&["keyboard", "--ecosystem", &file]);
        command.stdin(std::fs::File::open(path).expect("just written"));
        command.output().expect("the binary is built")
    };
    let output = run(path);
    let text = stdout(&output);
    assert_eq!(output.status.code(), Some(0), "{text}{}", stderr(&output));
    let first = text.find("[1] done").expect("the first action ends");
    let second = text.find("[2] asked").expect("the second action begins");
    assert!(first < second && text.contains("[2] done"), "{text}");
    assert!(text.contains("thermometer-office2"), "{text}");
    assert!(!text.contains("althing>") && !text.contains('\u{1b}'), "{text}");

    let output = run(office.write("wrong", "act (fly turtlebot-1)\nquit\nagents\n"));
    assert_eq!(output.status.code(), Some(1), "{}", stdout(&output));
    assert!(!stdout(&output).contains("AGENT"), "nothing is done after `quit`");
}

#[test]
fn shells_can_complete() {
    let office = Office::new();
    for shell in ["bash", "zsh", "fish"] {
        let output = office.run(&["completions", shell]);
        assert_eq!(output.status.code(), Some(0));
        assert!(stdout(&output).contains("mailbox"), "{shell}");
    }
}

#[test]
fn a_stopped_daemon_is_replaced_in_a_plan() {
    let office = office();
    office.signal("office2-pi", "STOP");
    let (code, goal) = ask(&office, &["goal", "temperatures"]);
    office.signal("office2-pi", "CONT");
    assert_eq!(code, Some(0), "the robot measures office2 instead: {goal}");
    assert!(goal.contains("21.5 °C at office2"), "{goal}");
}

#[test]
fn an_absent_ecosystem_is_reported() {
    let office = Office::new();
    let commands = [
        &["agents"][..],
        &["goal", "temperatures"],
        &["act", "(move turtlebot-1 corridor office1)"],
        &["set", "(known-temperature office1)"],
        &["mode", "centralized"],
        &["answer"],
        &["state"],
        &["domain"],
        &["goals"],
        &["mailbox"],
        &["keyboard"],
    ];
    for command in commands {
        let (code, text) = ask(&office, command);
        assert_eq!(code, Some(69), "{text}");
        assert!(text.contains("no daemon of it runs on this machine"), "{text}");
    }
}

#[test]
fn an_unknown_daemon_name_yields_the_known_ones() {
    let office = Office::new();
    let output = office.run(&["up", &file(), "--daemon", "office2-pie"]);
    assert_eq!(output.status.code(), Some(78));
    let text = stderr(&output);
    assert!(text.contains("did you mean `office2-pi`?"), "{text}");
}
