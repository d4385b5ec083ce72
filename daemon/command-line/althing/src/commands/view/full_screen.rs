//! The terminal as one screen: raw mode, the alternate screen, the mouse. Whatever ends the
//! program, a panic included, the terminal is as it was before ([`leave`]).
//!
//! The terminal is opened a second time, so that writing to it never waits for longer than the
//! screen is wanted: a terminal may stop reading, or go away.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::{Hide, Show};
use ratatui::crossterm::event::{DisableBracketedPaste, EnableBracketedPaste};
use ratatui::crossterm::style::{Print, ResetColor};
use ratatui::crossterm::terminal::{Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen};
use ratatui::crossterm::{execute, queue};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::termios::{OptionalActions, QueueSelector, Termios, tcflush, tcgetattr, tcsetattr};

/// How often a write to a terminal that does not read checks whether the screen is still wanted.
const RETRY_AFTER: Duration = Duration::from_millis(100);

/// How long the end of the screen waits for a terminal that does not read.
const LEFT_WITHIN: Duration = Duration::from_millis(500);

/// Reports of clicks and of the wheel. Reports of each movement would be much over a slow link.
const MOUSE_ON: &str = "\x1b[?1000h\x1b[?1006h";
const MOUSE_OFF: &str = "\x1b[?1006l\x1b[?1000l";

/// The screen that is shown now.
static SHOWN: Mutex<Option<ShownScreen>> = Mutex::new(None);

/// Number of bytes that were sent to the terminal.
static SENT: AtomicU64 = AtomicU64::new(0);

struct ShownScreen {
    terminal: Arc<File>,
    /// The modes of the terminal before the screen was shown.
    before: Termios,
}

/// A screen, which is left when this value is dropped.
pub(super) struct FullScreen {
    pub(super) terminal: Terminal<CrosstermBackend<ScreenWriter>>,
    _guard: ScreenGuard,
}

/// Leaves the screen when it is dropped.
struct ScreenGuard;

/// Writes to the terminal as long as the screen is shown. Whole frames are sent at once.
#[derive(Debug, Default)]
pub(super) struct ScreenWriter {
    frame: Vec<u8>,
}

impl FullScreen {
    /// Shows the screen.
    ///
    /// # Errors
    ///
    /// Returns an error if standard output is no terminal.
    pub(super) fn show() -> io::Result<FullScreen> {
        let guard = show_on(open_terminal()?)?;
        let terminal = Terminal::new(CrosstermBackend::new(ScreenWriter::default()))?;
        Ok(FullScreen { terminal, _guard: guard })
    }
}

impl Drop for ScreenGuard {
    fn drop(&mut self) {
        leave();
    }
}

/// Opens the terminal of standard output a second time, so that it can be written to without
/// waiting, which the shell's own use of the terminal does not notice.
fn open_terminal() -> io::Result<File> {
    const STREAM: &str = "/proc/self/fd/1";
    let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOCTTY;
    let flags = i32::try_from(flags.bits()).unwrap_or_default();
    let terminal = OpenOptions::new().read(true).write(true).custom_flags(flags).open(STREAM)?;
    match rustix::termios::isatty(&terminal) {
        true => Ok(terminal),
        false => Err(io::Error::from(Errno::NOTTY)),
    }
}

/// Shows the screen on a terminal.
fn show_on(terminal: File) -> io::Result<ScreenGuard> {
    let before = tcgetattr(&terminal)?;
    let mut raw = before.clone();
    raw.make_raw();
    tcsetattr(&terminal, OptionalActions::Now, &raw)?;
    *lock() = Some(ShownScreen { terminal: Arc::new(terminal), before });
    let guard = ScreenGuard;
    let mut writer = ScreenWriter::default();
    execute!(
        writer,
        EnterAlternateScreen,
        Hide,
        Print(MOUSE_ON),
        EnableBracketedPaste,
        Clear(ClearType::All)
    )?;
    Ok(guard)
}

/// Leaves the screen, if one is shown: the terminal is as it was before. May be called at any time,
/// by any thread.
pub(crate) fn leave() {
    let Some(ShownScreen { terminal, before }) = lock().take() else { return };
    // The modes come first: setting them never waits. A failure cannot be told anywhere.
    let _ = tcsetattr(&terminal, OptionalActions::Now, &before);
    let mut end = Vec::new();
    let _ = queue!(
        end,
        Print(MOUSE_OFF),
        DisableBracketedPaste,
        ResetColor,
        Show,
        LeaveAlternateScreen
    );
    let deadline = Instant::now() + LEFT_WITHIN;
    let _ = send(&terminal, &end, || Instant::now() < deadline);
    // What was typed for the screen is not for the shell.
    let _ = tcflush(&terminal, QueueSelector::IFlush);
    terminal::output::set_prompt(None);
}

/// Sends a sequence of this program to the terminal, beside the frames.
pub(super) fn send_sequence(sequence: &str) -> io::Result<()> {
    let mut writer = ScreenWriter::default();
    writer.write_all(sequence.as_bytes())?;
    writer.flush()
}

/// Returns the number of bytes that were sent to the terminal so far.
pub(super) fn bytes_sent() -> u64 {
    SENT.load(Ordering::Relaxed)
}

/// Whether a screen is shown.
pub(super) fn is_shown() -> bool {
    lock().is_some()
}

/// Whether the terminal of the screen has gone away.
pub(super) fn is_gone() -> bool {
    let Some(terminal) = shown() else { return true };
    let mut watched = [PollFd::new(&*terminal, PollFlags::empty())];
    let now = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut watched, Some(&now)).is_ok()
        && watched[0].revents().intersects(PollFlags::HUP | PollFlags::ERR)
}

fn shown() -> Option<Arc<File>> {
    lock().as_ref().map(|shown| Arc::clone(&shown.terminal))
}

fn lock() -> MutexGuard<'static, Option<ShownScreen>> {
    SHOWN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes to the terminal; gives up if the terminal does not read and `is_wanted` returns `false`.
fn send(terminal: &File, mut bytes: &[u8], is_wanted: impl Fn() -> bool) -> io::Result<()> {
    while !bytes.is_empty() {
        match rustix::io::write(terminal, bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(written) => {
                SENT.fetch_add(u64::try_from(written).unwrap_or(u64::MAX), Ordering::Relaxed);
                bytes = &bytes[written..];
            }
            Err(Errno::INTR) => (),
            Err(Errno::AGAIN) if is_wanted() => {
                let mut watched = [PollFd::new(terminal, PollFlags::OUT)];
                let timeout = Timespec::try_from(RETRY_AFTER).ok();
                // After a signal or an error, the write is tried again, and tells the error.
                let _ = poll(&mut watched, timeout.as_ref());
            }
            Err(Errno::AGAIN) => return Err(io::ErrorKind::TimedOut.into()),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

impl Write for ScreenWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.frame.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let frame = std::mem::take(&mut self.frame);
        match shown() {
            Some(terminal) => send(&terminal, &frame, is_shown),
            None => Err(io::ErrorKind::NotConnected.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;
    use std::os::fd::OwnedFd;

    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::LocalModes;

    use super::*;

    /// Opens a pseudo-terminal: the side of a terminal emulator, and that of a program.
    fn pseudo_terminal() -> (File, File) {
        let emulator: OwnedFd = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pty");
        grantpt(&emulator).expect("granted");
        unlockpt(&emulator).expect("unlocked");
        let name = ptsname(&emulator, Vec::new()).expect("a name");
        let path = name.to_str().expect("a path");
        let nonblock = i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).expect("a flag");
        let program = OpenOptions::new().read(true).write(true).custom_flags(nonblock).open(path);
        (File::from(emulator), program.expect("the other side"))
    }

    /// Reads what a program has written, until `end` comes.
    fn read_to(emulator: &mut File, end: &str) -> String {
        let (mut text, mut bytes) = (String::new(), [0; 4_096]);
        let timeout = Timespec { tv_sec: 60, tv_nsec: 0 };
        while !text.contains(end) {
            let ready = poll(&mut [PollFd::new(emulator, PollFlags::IN)], Some(&timeout));
            assert_eq!(ready.ok(), Some(1), "it never came: {text:?}");
            let count = emulator.read(&mut bytes).expect("written");
            text.push_str(&String::from_utf8_lossy(&bytes[..count]));
        }
        text
    }

    fn is_raw(terminal: &File) -> bool {
        !tcgetattr(terminal).expect("modes").local_modes.contains(LocalModes::ICANON)
    }

    /// One test, because a process shows one screen at a time.
    #[test]
    fn the_terminal_is_restored_after_a_panic_and_if_it_never_reads() {
        let (mut emulator, program) = pseudo_terminal();
        let watched = program.try_clone().expect("a copy");
        let ended = std::panic::catch_unwind(move || {
            let _guard = show_on(program).expect("shown");
            assert!(is_raw(&watched) && is_shown() && !is_gone());
            panic!("an injected panic");
        });
        assert!(ended.is_err() && !is_shown());
        let text = read_to(&mut emulator, "\x1b[?1049l");
        for (done, undone) in [
            ("\x1b[?1049h", "\x1b[?1049l"),
            ("\x1b[?25l", "\x1b[?25h"),
            (MOUSE_ON, MOUSE_OFF),
            ("\x1b[?2004h", "\x1b[?2004l"),
        ] {
            let (done, undone) = (text.find(done), text.find(undone));
            assert!(done.is_some() && done < undone, "{text:?}");
        }

        let (emulator, program) = pseudo_terminal();
        let watched = program.try_clone().expect("a copy");
        let _guard = show_on(program).expect("shown");
        let writer = std::thread::spawn(|| {
            let mut writer = ScreenWriter::default();
            writer.write_all(&vec![b'x'; 1 << 20]).expect("buffered");
            writer.flush()
        });
        // The emulator never reads, and the screen is left all the same.
        leave();
        assert!(writer.join().expect("it ends").is_err());
        assert!(!is_raw(&watched));
        drop(emulator);

        let (emulator, program) = pseudo_terminal();
        let _guard = show_on(program).expect("shown");
        drop(emulator);
        assert!(is_gone(), "a terminal that goes away is noticed");
        leave();
    }
}
