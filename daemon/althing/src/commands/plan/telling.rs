//! A line now and then, for whoever waits for a plan at a terminal.

use std::io::IsTerminal as _;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use crate::cli::PlanArgs;
use crate::output;

/// How often a person is told that it still goes on.
const PATIENCE: Duration = Duration::from_secs(5);

/// Says now and then how far it is, until it is dropped.
pub(super) struct Telling {
    stop: Option<mpsc::Sender<()>>,
    thread: Option<thread::JoinHandle<()>>,
}

// === impl Telling ===

impl Telling {
    /// Starts, where a person is there to read it; `line` makes the line of the seconds gone.
    pub(super) fn start(
        args: &PlanArgs,
        started: Instant,
        line: impl Fn(u64) -> String + Send + 'static,
    ) -> Option<Telling> {
        if args.print.json || !std::io::stderr().is_terminal() {
            return None;
        }
        let (stop, stopped) = mpsc::channel::<()>();
        let thread = thread::spawn(move || {
            while stopped.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                output::note(&line(started.elapsed().as_secs()));
            }
        });
        Some(Telling { stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for Telling {
    fn drop(&mut self) {
        drop(self.stop.take());
        let _ = self.thread.take().map(thread::JoinHandle::join);
    }
}
