//! Progress lines for a person waiting for a plan at a terminal.

use std::fmt;
use std::io::IsTerminal as _;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use terminal::output;
use terminal::render::plural;

use crate::arguments::PlanArgs;

/// Interval between two progress lines.
const PROGRESS_INTERVAL: Duration = Duration::from_secs(5);

/// Thread that prints progress lines from time to time. It ends when this value is dropped.
pub(crate) struct ProgressPrinter {
    stop: Option<mpsc::Sender<()>>,
    thread: Option<thread::JoinHandle<()>>,
}

/// The stage that the embedded planner has reached.
#[derive(Clone, Copy, Default)]
pub(crate) enum PlanningStage {
    #[default]
    Grounding,
    Preparing {
        facts: usize,
        operators: usize,
    },
    Searching {
        expansions: u64,
    },
}

/// The current stage of planning, shared by all clones of this value.
#[derive(Clone, Default)]
pub(crate) struct Progress(Arc<Mutex<PlanningStage>>);

// === impl Progress ===

impl Progress {
    pub(crate) fn set(&self, stage: PlanningStage) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = stage;
    }

    /// Returns a function that formats the progress line of the current stage. The argument of the
    /// function is the number of seconds since the start.
    pub(crate) fn line(&self) -> impl Fn(u64) -> String + Send + 'static {
        let Progress(stage) = self.clone();
        move |seconds| {
            let stage = *stage.lock().unwrap_or_else(PoisonError::into_inner);
            format!("{stage}, {seconds} s so far")
        }
    }
}

impl fmt::Display for PlanningStage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            PlanningStage::Grounding => f.write_str("grounding"),
            PlanningStage::Preparing { facts, operators } => {
                let (facts, operators) = (plural(facts, "fact"), plural(operators, "operator"));
                write!(f, "preparing a search over {facts} and {operators}")
            }
            PlanningStage::Searching { expansions } => {
                let expansions = usize::try_from(expansions).unwrap_or(usize::MAX);
                write!(f, "searching, {} expanded", plural(expansions, "state"))
            }
        }
    }
}

// === impl ProgressPrinter ===

impl ProgressPrinter {
    /// Starts to print progress lines. `line` formats a line from the number of seconds since the
    /// start. Returns `None` if stderr is not a terminal or the output is JSON.
    pub(crate) fn start(
        args: &PlanArgs,
        started: Instant,
        line: impl Fn(u64) -> String + Send + 'static,
    ) -> Option<ProgressPrinter> {
        if args.print.json || !std::io::stderr().is_terminal() {
            return None;
        }
        let (stop, stopped) = mpsc::channel::<()>();
        let thread = thread::spawn(move || {
            while stopped.recv_timeout(PROGRESS_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                output::print_note(&line(started.elapsed().as_secs()));
            }
        });
        Some(ProgressPrinter { stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for ProgressPrinter {
    fn drop(&mut self) {
        drop(self.stop.take());
        let _ = self.thread.take().map(thread::JoinHandle::join);
    }
}
