//! The prompt as a person uses it: in a terminal of 80 × 24, driven by a terminal multiplexer.

use std::io::Read as _;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::sync::mpsc;
use std::time::Instant;

use crate::support::left_out::left_out;
use crate::support::{Office, PATIENCE, office, stdout};

/// A terminal with one program in it.
struct Terminal<'o> {
    office: &'o Office,
    socket: PathBuf,
    /// Signals that the screen has changed.
    changed: mpsc::Receiver<()>,
}

/// Whether there is a multiplexer. Without one these tests are skipped with a report.
fn has_tmux() -> bool {
    let found = Command::new("tmux").arg("-V").output().is_ok();
    if !found {
        left_out("tmux is not installed: apt-get install tmux");
    }
    found
}

impl<'o> Terminal<'o> {
    /// Runs `althing` in a terminal. When it ends, the terminal shows its exit code, and whether
    /// typed text is echoed as before.
    fn open(office: &'o Office, arguments: &str) -> Terminal<'o> {
        let socket = office.write("tmux.conf", "set -g default-terminal screen-256color\n");
        let (config, socket) = (socket.clone(), socket.with_extension("sock"));
        let (fifo, program) = (socket.with_extension("fifo"), env!("CARGO_BIN_EXE_althing"));
        let script = format!(
            "'{program}' {arguments}; echo \"ended with $?, $(stty -a | grep -o ' -\\?echo ')\"; cat"
        );
        let made = Command::new("mkfifo").arg(&fifo).status();
        assert!(made.expect("mkfifo is there").success());
        let mut terminal = Terminal { office, socket, changed: mpsc::channel().1 };
        let config = config.display().to_string();
        let size = ["-x", "80", "-y", "24"];
        terminal.tmux(&[&["-f", &config, "new-session", "-d"][..], &size, &[&script]].concat());
        terminal.tmux(&["pipe-pane", "-O", &format!("exec cat > '{}'", fifo.display())]);
        let (tell, changed) = mpsc::channel();
        std::thread::spawn(move || {
            let mut output = std::fs::File::open(fifo).expect("a fifo");
            let mut bytes = [0; 4_096];
            while output.read(&mut bytes).is_ok_and(|count| count > 0) && tell.send(()).is_ok() {}
        });
        terminal.changed = changed;
        terminal
    }

    fn tmux(&self, arguments: &[&str]) -> Output {
        let mut command = self.office.program("tmux");
        command.arg("-S").arg(&self.socket).args(arguments).env_remove("TMUX");
        let output = command.output().expect("tmux is there");
        assert!(output.status.success(), "{arguments:?}: {output:?}");
        output
    }

    fn type_text(&self, text: &str) {
        self.tmux(&["send-keys", "-l", text]);
    }

    fn press(&self, key: &str) {
        self.tmux(&["send-keys", key]);
    }

    /// Types a line and ends it.
    fn enter(&self, line: &str) {
        self.type_text(line);
        self.press("Enter");
    }

    /// Returns the text on the screen.
    fn screen(&self) -> String {
        stdout(&self.tmux(&["capture-pane", "-p"]))
    }

    /// Waits until the screen satisfies `fits`; checks it after every change.
    fn await_screen(&self, what: &str, fits: impl Fn(&str) -> bool) -> String {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let screen = self.screen();
            if fits(&screen) {
                return screen;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            let changed = self.changed.recv_timeout(left);
            assert!(changed.is_ok(), "{what} never came:\n{}", self.screen());
        }
    }

    fn await_text(&self, text: &str) -> String {
        self.await_screen(text, |screen| screen.contains(text))
    }

    /// Waits until the edited line equals `line`.
    fn await_line(&self, line: &str) -> String {
        let line = format!("althing> {line}");
        let is_last = |screen: &str| screen.trim_end().lines().last() == Some(line.trim_end());
        self.await_screen(&line, is_last)
    }
}

impl Drop for Terminal<'_> {
    fn drop(&mut self) {
        let mut command = Command::new("tmux");
        let _ = command.arg("-S").arg(&self.socket).arg("kill-server").output();
    }
}

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
    terminal.await_text("holds; to be kept");
    terminal.enter("cancel 1");
    terminal.await_text("[1] cancelled");
    terminal.await_line("");
    terminal.press("C-d");
    let end = terminal.await_text("ended with");
    assert!(end.contains("ended with 0,  echo"), "{end}");
}
