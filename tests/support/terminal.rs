//! A terminal of a given size with one program in it, driven by a terminal multiplexer.

use std::io::Read as _;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use super::left_out::left_out;
use super::{Office, PATIENCE, stdout};

/// A terminal with one program in it.
pub(crate) struct Terminal<'o> {
    office: &'o Office,
    socket: PathBuf,
    /// Signals that the screen has changed.
    changed: mpsc::Receiver<()>,
}

/// Whether there is a multiplexer. Without one these tests are skipped with a report.
pub(crate) fn has_tmux() -> bool {
    let found = Command::new("tmux").arg("-V").output().is_ok();
    if !found {
        left_out("tmux is not installed: apt-get install tmux");
    }
    found
}

impl<'o> Terminal<'o> {
    /// Runs `althing` in a terminal. When it ends, the terminal shows its exit code, and whether
    /// typed text is echoed as before.
    pub(crate) fn open(office: &'o Office, arguments: &str) -> Terminal<'o> {
        Terminal::of_size(office, arguments, (80, 24))
    }

    /// Does the same in a terminal of so many columns and lines.
    pub(crate) fn of_size(
        office: &'o Office,
        arguments: &str,
        (columns, lines): (u16, u16),
    ) -> Terminal<'o> {
        static OPENED: AtomicUsize = AtomicUsize::new(0);
        let name = format!("terminal-{}.conf", OPENED.fetch_add(1, Ordering::Relaxed));
        let socket = office.write(&name, "set -g default-terminal screen-256color\n");
        let (config, socket) = (socket.clone(), socket.with_extension("sock"));
        let (fifo, program) = (socket.with_extension("fifo"), env!("CARGO_BIN_EXE_althing"));
        let script = format!(
            "'{program}' {arguments}; echo \"ended with $?, $(stty -a | grep -o ' -\\?echo ')\"; cat"
        );
        let made = Command::new("mkfifo").arg(&fifo).status();
        assert!(made.expect("mkfifo is there").success());
        let mut terminal = Terminal { office, socket, changed: mpsc::channel().1 };
        let config = config.display().to_string();
        let (columns, lines) = (columns.to_string(), lines.to_string());
        let size = ["-x", &columns, "-y", &lines];
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

    pub(crate) fn tmux(&self, arguments: &[&str]) -> Output {
        let mut command = self.office.program("tmux");
        command.arg("-S").arg(&self.socket).args(arguments).env_remove("TMUX");
        let output = command.output().expect("tmux is there");
        assert!(output.status.success(), "{arguments:?}: {output:?}");
        output
    }

    pub(crate) fn type_text(&self, text: &str) {
        self.tmux(&["send-keys", "-l", text]);
    }

    pub(crate) fn press(&self, key: &str) {
        self.tmux(&["send-keys", key]);
    }

    /// Types a line and ends it.
    pub(crate) fn enter(&self, line: &str) {
        self.type_text(line);
        self.press("Enter");
    }

    /// Returns the text on the screen.
    pub(crate) fn screen(&self) -> String {
        stdout(&self.tmux(&["capture-pane", "-p"]))
    }

    /// Waits until the screen satisfies `fits`; checks it after every change.
    pub(crate) fn await_screen(&self, what: &str, fits: impl Fn(&str) -> bool) -> String {
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

    pub(crate) fn await_text(&self, text: &str) -> String {
        self.await_screen(text, |screen| screen.contains(text))
    }

    /// Waits until the edited line equals `line`.
    pub(crate) fn await_line(&self, line: &str) -> String {
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
