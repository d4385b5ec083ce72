//! Limits of time and memory that hold from the first byte read, during every part of the work.
//!
//! - The planner counts its own work and memory, and ends by itself where it can. Reading, checking
//!   and normalising a text are not counted by the planner; therefore a thread of this module
//!   checks the clock and the memory of the whole process.
//! - When the time is over, the thread asks the planner to stop. If the planner gives no answer
//!   within a grace period, the thread prints the answer itself (what has been found out so far: a
//!   final answer, the best plan, or that there is none) and ends the process.

use std::process::ExitCode;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use planner::{Cancel, StopReason};

/// How often the memory of the process is checked.
const MEMORY_CHECK_INTERVAL: Duration = Duration::from_millis(20);

/// Minimum time after the end of the time limit in which the planner may still give its answer.
const GRACE_MIN: Duration = Duration::from_millis(300);

/// Minimum allowance, in bytes, for memory that the planner does not count: code and texts.
const BESIDE_BYTES: u64 = 64 << 20;

/// Handle of the thread that watches the limits of the process until the process gives its answer.
pub struct LimitWatch {
    answer: Arc<AnswerLock>,
    /// Sender that is never used. Dropping it ends the watching thread.
    _stop: mpsc::Sender<()>,
}

/// Lock that lets the process give only one answer: its own, or that of the watching thread.
#[derive(Default)]
struct AnswerLock(Mutex<AnswerState>);

#[derive(Default)]
struct AnswerState {
    /// Whether the main thread, and not the watching thread, has begun to give the answer.
    is_given: bool,
    /// The best plan reported so far.
    best: Option<String>,
    /// Prints the answer that is certain already; `None` if nothing is certain.
    certain: Option<CertainAnswer>,
}

/// Prints the answer of a process that a limit ends: the reason, and the best plan found so far.
/// Returns the exit code.
pub type LimitReporter = Box<dyn FnOnce(StopReason, Option<String>) -> u8 + Send>;

/// Prints an answer that is certain already, even if the rest of the work is not complete. Returns
/// the exit code.
pub type CertainAnswer = Box<dyn FnOnce() -> u8 + Send>;

/// Limits on the time and the memory of a process.
pub struct RunLimits {
    /// Maximum run time of the process; `None` for no limit.
    pub time: Option<Duration>,
    /// Maximum memory of the planner's tables, in bytes.
    pub memory_bytes: usize,
}

impl RunLimits {
    /// Returns limits with the given time, and with half of the available memory.
    pub fn of_time(time: Option<Duration>) -> RunLimits {
        let available = machine::memory_available().map_or(u64::MAX, |available| available / 2);
        RunLimits { time, memory_bytes: usize::try_from(available).unwrap_or(usize::MAX) }
    }
}

/// Returns a function that prints which limit has ended a command: as one line, or as a JSON object
/// with a status.
pub fn refusal(json: bool) -> LimitReporter {
    Box::new(move |reason, _| {
        let (status, words) = match reason {
            StopReason::MemoryLimit { limit } => {
                ("out-of-memory", format!("out of memory at {} MiB", limit >> 20))
            }
            _ => ("out-of-time", "out of time (--time-limit)".to_owned()),
        };
        let code = reason.exit_code();
        match json {
            true => drop(crate::output::print_json(&serde_json::json!({ "status": status }), code)),
            false => crate::output::print_note(&words),
        }
        code
    })
}

// === impl LimitWatch ===

impl LimitWatch {
    /// Starts the watching thread. The thread sets `cancel` when the time is over, and calls `give`
    /// if it has to print the answer itself.
    pub fn start(
        limits: RunLimits,
        started: Instant,
        cancel: Cancel,
        give: LimitReporter,
    ) -> LimitWatch {
        let answer = Arc::new(AnswerLock::default());
        let (stop, stopped) = mpsc::channel();
        let shared = Arc::clone(&answer);
        thread::spawn(move || {
            if let Some(reason) = watch(&limits, started, &cancel, &stopped) {
                shared.give(reason, give);
            }
        });
        LimitWatch { answer, _stop: stop }
    }

    /// Stores the best plan found so far, in place of the one before.
    pub fn record_plan(&self, plan: String) {
        self.answer.lock_state().best = Some(plan);
    }

    /// Stores an answer that is certain before the work is complete. If a limit ends the process
    /// after this call, the process prints this answer instead of the reason.
    pub fn record_certain(&self, answer: CertainAnswer) {
        self.answer.lock_state().certain = Some(answer);
    }

    /// Gives the answer of the process by calling `answer`. If the watching thread is already
    /// giving an answer, this call blocks until that thread ends the process.
    pub fn answer(&self, answer: impl FnOnce() -> ExitCode) -> ExitCode {
        self.answer.lock_state().is_given = true;
        answer()
    }
}

/// Waits until a limit is exceeded, and returns that limit as the reason. Returns `None` if the
/// process gives its answer first.
fn watch(
    limits: &RunLimits,
    started: Instant,
    cancel: &Cancel,
    stopped: &mpsc::Receiver<()>,
) -> Option<StopReason> {
    let bytes_max = limits.memory_bytes as u64;
    let bytes_max = bytes_max.saturating_add((bytes_max / 4).max(BESIDE_BYTES));
    let grace = limits.time.map(|time| GRACE_MIN.max(time / 10));
    loop {
        if stopped.recv_timeout(MEMORY_CHECK_INTERVAL) != Err(RecvTimeoutError::Timeout) {
            return None;
        }
        if machine::memory_resident().is_some_and(|bytes| bytes > bytes_max) {
            return Some(StopReason::MemoryLimit { limit: limits.memory_bytes });
        }
        let (Some(time), Some(grace)) = (limits.time, grace) else { continue };
        if started.elapsed() >= time {
            cancel.set();
        }
        if started.elapsed() >= time.saturating_add(grace) {
            return Some(StopReason::Cancelled);
        }
    }
}

// === impl AnswerLock ===

impl AnswerLock {
    fn lock_state(&self) -> MutexGuard<'_, AnswerState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn give(&self, reason: StopReason, give: LimitReporter) {
        // The lock is held until the process ends, so that there is no second answer.
        let mut given = self.lock_state();
        if !given.is_given {
            std::process::exit(i32::from(given.end(reason, give)));
        }
    }
}

// === impl AnswerState ===

impl AnswerState {
    /// Prints the answer of a process that a limit ends. Returns the exit code.
    fn end(&mut self, reason: StopReason, give: LimitReporter) -> u8 {
        match self.certain.take() {
            Some(answer) => answer(),
            None => give(reason, self.best.take()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_that_is_certain_is_given_in_place_of_the_limit() {
        let watch = LimitWatch::start(
            RunLimits { time: None, memory_bytes: usize::MAX },
            Instant::now(),
            Cancel::new(),
            Box::new(|_, _| 1),
        );
        let reporter = || -> LimitReporter { Box::new(|reason, _| reason.exit_code()) };
        let end = || watch.answer.lock_state().end(StopReason::Cancelled, reporter());
        assert_eq!(end(), 23, "nothing is certain");
        watch.record_plan("(a)".to_owned());
        let best: LimitReporter = Box::new(|_, best| u8::from(best.as_deref() == Some("(a)")));
        assert_eq!(watch.answer.lock_state().end(StopReason::Cancelled, best), 1);
        watch.record_certain(Box::new(|| 10));
        assert_eq!(end(), 10);
    }
}
