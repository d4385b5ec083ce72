//! A terminal with one program in it, read by this process: enough of an emulator to know which
//! characters stand where.

use std::fs::{File, OpenOptions};
use std::io::Read as _;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Action, Winsize, tcflow, tcsetwinsize};

use super::support::Outcome;

/// A program in a terminal that is read.
pub(crate) struct TerminalEmulator {
    screen: Arc<ReadScreen>,
    child: Child,
}

/// A program in a terminal that takes no output, as one that is never read once its buffer is full.
pub(crate) struct MuteTerminal {
    _terminal: File,
    child: Child,
}

/// A screen, and the signal that it has changed.
#[derive(Default)]
struct ReadScreen {
    cells: Mutex<ScreenCells>,
    changed: Condvar,
}

/// The characters of a screen.
#[derive(Default)]
struct ScreenCells {
    rows: Vec<Vec<char>>,
    row: usize,
    column: usize,
    /// The escape sequence that is being read.
    sequence: Option<String>,
}

impl TerminalEmulator {
    pub(crate) fn run(
        program: &str,
        arguments: &[&str],
        (columns, rows): (u16, u16),
    ) -> Outcome<TerminalEmulator> {
        let (mut terminal, program_side) = open((columns, rows))?;
        let child = start(program, arguments, &program_side)?;
        drop(program_side);
        let screen = Arc::<ReadScreen>::default();
        screen.lock().rows = vec![vec![' '; columns.into()]; rows.into()];
        let read = Arc::clone(&screen);
        std::thread::spawn(move || {
            let (mut bytes, mut rest) = ([0; 16 << 10], Vec::new());
            while let Ok(count @ 1..) = terminal.read(&mut bytes) {
                rest.extend_from_slice(&bytes[..count]);
                let whole = match std::str::from_utf8(&rest) {
                    Ok(text) => text.len(),
                    Err(error) => error.valid_up_to(),
                };
                let text = String::from_utf8_lossy(&rest[..whole]).into_owned();
                rest.drain(..whole);
                let mut cells = read.lock();
                text.chars().for_each(|c| cells.take(c));
                read.changed.notify_all();
            }
        });
        Ok(TerminalEmulator { screen, child })
    }

    /// Waits until a text stands on the screen. Returns the time at which it did.
    pub(crate) fn await_text(&self, text: &str, within: Duration) -> Outcome<Instant> {
        let deadline = Instant::now() + within;
        let mut cells = self.screen.lock();
        loop {
            if cells.rows.iter().any(|row| row.iter().collect::<String>().contains(text)) {
                return Ok(Instant::now());
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let rows = cells.rows.iter().map(|row| row.iter().collect::<String>());
                let rows: Vec<_> = rows.collect();
                return Err(format!("`{text}` never came:\n{}", rows.join("\n")).into());
            }
            let woken = self.screen.changed.wait_timeout(cells, left);
            cells = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl MuteTerminal {
    pub(crate) fn run(program: &str, arguments: &[&str]) -> Outcome<MuteTerminal> {
        let (terminal, program_side) = open((100, 40))?;
        tcflow(&program_side, Action::OOff)?;
        let child = start(program, arguments, &program_side)?;
        Ok(MuteTerminal { _terminal: terminal, child })
    }
}

impl Drop for TerminalEmulator {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

impl Drop for MuteTerminal {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// Opens a pseudo-terminal. Returns the side of the emulator and that of the program.
fn open((columns, rows): (u16, u16)) -> Outcome<(File, File)> {
    let terminal = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&terminal)?;
    unlockpt(&terminal)?;
    let path = ptsname(&terminal, Vec::new())?;
    let program_side = OpenOptions::new().read(true).write(true).open(path.to_str()?)?;
    let size = Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
    tcsetwinsize(&terminal, size)?;
    Ok((File::from(terminal), program_side))
}

fn start(program: &str, arguments: &[&str], program_side: &File) -> Outcome<Child> {
    let stdio = || program_side.try_clone().map(Stdio::from);
    // A session of its own, so that `/dev/tty` is not the terminal of this benchmark.
    let child = Command::new("setsid")
        .arg("--ctty")
        .arg(program)
        .args(arguments)
        .env("TERM", "xterm-256color")
        .stdin(stdio()?)
        .stdout(stdio()?)
        .stderr(stdio()?)
        .spawn()?;
    Ok(child)
}

impl ReadScreen {
    fn lock(&self) -> MutexGuard<'_, ScreenCells> {
        self.cells.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ScreenCells {
    fn take(&mut self, c: char) {
        match (&mut self.sequence, c) {
            (None, '\u{1b}') => self.sequence = Some(String::new()),
            (None, '\r') => self.column = 0,
            (None, '\n') => self.row += 1,
            (None, c) => {
                let cell = self.rows.get_mut(self.row).and_then(|row| row.get_mut(self.column));
                cell.into_iter().for_each(|cell| *cell = c);
                self.column += 1;
            }
            (Some(sequence), c) => {
                sequence.push(c);
                let is_control = sequence.starts_with('[');
                let is_end = match is_control {
                    true => sequence.len() > 1 && c.is_ascii_alphabetic(),
                    false => true,
                };
                if is_end && let Some(sequence) = self.sequence.take() {
                    self.obey(&sequence);
                }
            }
        }
    }

    /// Obeys a sequence: the cursor is put somewhere, or the screen is cleared.
    fn obey(&mut self, sequence: &str) {
        if let Some(place) = sequence.strip_prefix('[').and_then(|rest| rest.strip_suffix('H')) {
            let mut numbers = place.split(';').map(|number| number.parse().unwrap_or(1_usize));
            self.row = numbers.next().unwrap_or(1).saturating_sub(1);
            self.column = numbers.next().unwrap_or(1).saturating_sub(1);
        } else if sequence == "[2J" {
            self.rows.iter_mut().for_each(|row| row.fill(' '));
        }
    }
}
