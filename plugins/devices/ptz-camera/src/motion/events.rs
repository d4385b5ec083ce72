//! The events of Motion: single words that its hooks write into a named pipe.
//!
//! A named pipe belongs to one machine and needs no port, and the shell of a hook can write into it
//! without any further program. Each line is one word, so that nothing of a picture or a file name
//! reaches a shell or this process.

use std::os::unix::fs::FileTypeExt as _;
use std::path::Path;

use rustix::fs::{CWD, Mode, mkfifoat};
use tokio::io::AsyncReadExt as _;
use tokio::net::unix::pipe::{OpenOptions, Receiver};

use crate::lines::Lines;

/// Maximum length of a line, in bytes; longer lines are ignored.
const LINE_BYTES_MAX: usize = 32;

/// An event of Motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MotionEvent {
    Started,
    Ended,
    CameraLost,
    CameraFound,
}

/// The hooks of Motion with the words that they write, and the resulting events.
pub(super) const HOOKS: [(&str, &str, MotionEvent); 4] = [
    ("on_event_start", "start", MotionEvent::Started),
    ("on_event_end", "end", MotionEvent::Ended),
    ("on_camera_lost", "lost", MotionEvent::CameraLost),
    ("on_camera_found", "found", MotionEvent::CameraFound),
];

/// The reading end of the pipe.
#[derive(Debug)]
pub(super) struct EventPipe {
    receiver: Receiver,
    lines: Lines,
}

impl EventPipe {
    /// Opens the pipe, and makes it if it does not exist; then only the user of this process can
    /// write into it.
    ///
    /// # Errors
    ///
    /// Returns an error if the pipe cannot be made or opened, or is another kind of file.
    pub(super) fn open(path: &Path) -> Result<EventPipe, String> {
        let shown = path.display();
        match std::fs::symlink_metadata(path) {
            Ok(found) if found.file_type().is_fifo() => (),
            Ok(_) => {
                return Err(format!(
                    "read events from {shown}: it is no named pipe; remove it, and mkfifo {shown}"
                ));
            }
            Err(_) => mkfifoat(CWD, path, Mode::RUSR | Mode::WUSR)
                .map_err(|error| format!("make the named pipe {shown}: {error}"))?,
        }
        // As this end can write, too, the pipe never ends when a hook closes it.
        let receiver = OpenOptions::new().read_write(true).open_receiver(path);
        let receiver = receiver.map_err(|error| format!("read events from {shown}: {error}"))?;
        Ok(EventPipe { receiver, lines: Lines::new(LINE_BYTES_MAX) })
    }

    /// Returns the next events, one at least; other words are left out. No event is lost if the
    /// future is dropped.
    ///
    /// # Errors
    ///
    /// Returns an error if the pipe cannot be read.
    pub(super) async fn next(&mut self) -> Result<Vec<MotionEvent>, String> {
        loop {
            let mut piece = [0; 1_024];
            let count = self.receiver.read(&mut piece).await;
            let count = count.map_err(|error| format!("read the events of Motion: {error}"))?;
            let lines = self.lines.take(piece.get(..count).unwrap_or_default());
            let events: Vec<_> = lines.iter().filter_map(|line| event(line)).collect();
            if !events.is_empty() {
                return Ok(events);
            }
        }
    }
}

fn event(line: &str) -> Option<MotionEvent> {
    HOOKS.iter().find(|(_, word, _)| *word == line).map(|(_, _, event)| *event)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[tokio::test]
    async fn words_are_events_and_anything_else_is_ignored() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("events");
        let mut pipe = EventPipe::open(&path).expect("it is made");
        let mode = std::fs::metadata(&path).expect("there").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        let mut again = std::fs::OpenOptions::new().write(true).open(&path).expect("it is open");
        let text = format!("end\n; rm -rf /\n{}\nstart 5\nstart\nlo", "x".repeat(5_000));
        std::io::Write::write_all(&mut again, text.as_bytes()).expect("written");
        assert_eq!(pipe.next().await, Ok(vec![MotionEvent::Ended]));
        assert_eq!(pipe.next().await, Ok(vec![MotionEvent::Started]));
        std::io::Write::write_all(&mut again, b"st\nfound\n").expect("written");
        drop(again);
        let last = pipe.next().await;
        assert_eq!(last, Ok(vec![MotionEvent::CameraLost, MotionEvent::CameraFound]));
    }

    #[tokio::test]
    async fn another_kind_of_file_is_refused() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let problem = EventPipe::open(file.path()).expect_err("it is no pipe");
        assert!(problem.contains("it is no named pipe"), "{problem}");
        let problem = EventPipe::open(Path::new("/no/such/folder/events")).expect_err("no folder");
        assert!(problem.contains("make the named pipe"), "{problem}");
    }
}
