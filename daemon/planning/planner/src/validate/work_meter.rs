//! Counts the work of evaluating conditions in a state, and ends it at a limit.
//!
//! A condition from outside may quantify over so many variables that evaluating it takes hours. The
//! count depends on the texts only, so that the same texts end at the same limit on every machine.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::limits::Cancel;

/// Count of the evaluation steps that a state may still take. A clone counts for itself.
#[derive(Debug)]
pub(super) struct WorkMeter {
    /// Maximal number of steps, for conditions together and for each component of the axioms.
    limit: u64,
    left: AtomicU64,
    /// Whether the limit has ended the evaluation of axioms, so that facts are missing from then on.
    is_cut: AtomicBool,
    /// Flag by which the caller stops the evaluation.
    cancel: Option<Cancel>,
}

// === impl WorkMeter ===

impl Default for WorkMeter {
    /// Returns a meter without a practical limit.
    fn default() -> WorkMeter {
        WorkMeter::new(u64::MAX, None)
    }
}

impl Clone for WorkMeter {
    fn clone(&self) -> WorkMeter {
        let left = AtomicU64::new(self.left.load(Ordering::Relaxed));
        let is_cut = AtomicBool::new(self.is_cut.load(Ordering::Relaxed));
        WorkMeter { limit: self.limit, left, is_cut, cancel: self.cancel.clone() }
    }
}

impl WorkMeter {
    pub(super) fn new(limit: u64, cancel: Option<Cancel>) -> WorkMeter {
        let (left, is_cut) = (AtomicU64::new(limit), AtomicBool::new(false));
        WorkMeter { limit, left, is_cut, cancel }
    }

    pub(super) fn limit(&self) -> u64 {
        self.limit
    }

    /// Counts `steps`, and returns whether they are within the limit. Once the limit is reached, no
    /// further step is.
    pub(super) fn spend(&self, steps: u64) -> bool {
        let left = self.left.load(Ordering::Relaxed);
        let is_stopped = self.cancel.as_ref().is_some_and(Cancel::is_set);
        let rest = if is_stopped { 0 } else { left.saturating_sub(steps) };
        // Two threads that share a state may lose a count of each other, which the limit can bear.
        self.left.store(rest, Ordering::Relaxed);
        rest > 0
    }

    /// Begins to count anew, unless facts are missing.
    pub(super) fn renew(&self) {
        if !self.is_cut.load(Ordering::Relaxed) {
            self.left.store(self.limit, Ordering::Relaxed);
        }
    }

    /// Returns the meter with another limit. If facts are missing, no step is within it.
    pub(super) fn with_limit(&self, limit: u64, cancel: Option<Cancel>) -> WorkMeter {
        let meter = WorkMeter::new(limit, cancel);
        if self.is_cut.load(Ordering::Relaxed) {
            meter.left.store(0, Ordering::Relaxed);
            meter.is_cut.store(true, Ordering::Relaxed);
        }
        meter
    }

    /// Calls `evaluate`, which computes the facts of a component of the axioms, with a count of its
    /// own: its facts are kept, however many steps the condition that asks for them has taken.
    pub(super) fn apart<T>(&self, evaluate: impl FnOnce() -> T) -> T {
        let before = self.left.load(Ordering::Relaxed);
        self.renew();
        let evaluated = evaluate();
        match self.is_exhausted() {
            true => self.is_cut.store(true, Ordering::Relaxed),
            false => self.left.store(before, Ordering::Relaxed),
        }
        evaluated
    }

    /// Whether the limit is reached, or the evaluation was stopped.
    pub(super) fn is_exhausted(&self) -> bool {
        self.left.load(Ordering::Relaxed) == 0
    }
}
