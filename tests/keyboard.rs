//! The prompt as a person uses it: in a terminal of 80 × 24, driven by a terminal multiplexer.

use std::process::Stdio;

use crate::support::terminal::{Terminal, has_tmux};
use crate::support::{Office, office, stdout};

fn file() -> String {
    Office::file().display().to_string()
}

#[test]
fn a_person_at_a_prompt() {
    if !has_tmux() {
        return;
    }
    let office = office();
    let arguments = format!("keyboard --name alice --ecosystem '{}'", file());
    let terminal = Terminal::open(&office, &arguments);
    terminal.await_text("You are `alice` in `smart-office`");
    terminal.await_line("");

    // An action; its completions come from the agents that are present.
    terminal.type_text("act (mo");
    terminal.press("Tab");
    terminal.await_line("act (move");
    terminal.type_text(" t");
    terminal.press("Tab");
    terminal.await_line("act (move turtlebot-1");
    terminal.enter(" corridor office1)");
    terminal.await_text("[1] done");

    // A question arrives while a line is being typed, and does not change the line.
    terminal.type_text("(known-temperature of");
    terminal.await_line("(known-temperature of");
    let question = r#"{"receiver": "alice", "performative": "query-ref",
        "content": {"text": "May I enter?"}, "reply_within": 60000}"#;
    let question = office.write("question.json", question).display().to_string();
    let mut asking = office.command(&["send", &question, "--ecosystem", &file()]);
    let asking = asking.stdout(Stdio::piped()).spawn().expect("the binary is built");
    terminal.await_text("May I enter?");
    terminal.await_text("answer 1 TEXT");
    terminal.await_line("(known-temperature of");
    terminal.press("C-u");
    terminal.enter("answer 1 yes, do");
    terminal.await_text("was told");
    let answer = asking.wait_with_output().expect("our child");
    assert!(answer.status.success(), "{answer:?}");
    assert!(stdout(&answer).contains("inform   alice: yes, do"), "{answer:?}");

    // A line that begins with a parenthesis is a goal. Typed lines are kept in the history.
    terminal.enter("(known-temperature office1)");
    terminal.await_text("20.5 °C at office1");
    terminal.await_text("[3] done");
    terminal.press("Up");
    terminal.await_line("(known-temperature office1)");
    terminal.press("C-u");

    // A mistake is answered, and Ctrl-C only discards the line.
    terminal.enter("agnets");
    terminal.await_text("agents");
    terminal.type_text("half a li");
    terminal.press("C-c");
    terminal.await_text("Ctrl-D ends");
    terminal.await_line("");

    terminal.press("C-d");
    let end = terminal.await_text("ended with");
    // A mistake at the prompt was answered there, and does not change the exit code.
    assert!(end.contains("ended with 0,  echo"), "{end}");
}

#[test]
fn a_daemon_with_a_prompt() {
    if !has_tmux() {
        return;
    }
    let office = Office::new();
    let terminal = Terminal::open(&office, &format!("up '{}' --keyboard", file()));
    terminal.await_text("You are `keyboard-");
    terminal.await_line("");
    terminal.enter("goal temperatures --maintain");
    terminal.await_text("[1] holds");
    terminal.enter("goals");
    terminal.await_text("[1]  holds");
    terminal.enter("cancel 1");
    terminal.await_text("[1] cancelled");
    terminal.await_line("");
    terminal.press("C-d");
    let end = terminal.await_text("ended with");
    assert!(end.contains("ended with 0,  echo"), "{end}");
}
