//! Counts the work of evaluating conditions in a state, and ends the evaluation at a limit.
//!
//! A condition from a user or another agent may quantify over so many variables that its evaluation
//! would take hours. The count depends on the texts only, so that the limit has the same effect on
//! every machine.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::limits::Cancel;

/// Counter of the evaluation steps that are still allowed in a state. Each clone continues with its
/// own count.
#[derive(Debug)]
pub(super) struct WorkMeter {
    /// Maximum number of steps: for all conditions together, and again for each component of the
    /// axioms. At the limit, the evaluation ends.
    limit: u64,
    left: AtomicU64,
    /// Whether the limit has ended the evaluation of axioms. Derived facts are then missing for
    /// good.
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

    /// Counts `steps`. Returns `false` if the limit is reached or the evaluation was cancelled;
    /// then every later call does so, too.
    pub(super) fn spend(&self, steps: u64) -> bool {
        let left = self.left.load(Ordering::Relaxed);
        let is_stopped = self.cancel.as_ref().is_some_and(Cancel::is_set);
        let rest = if is_stopped { 0 } else { left.saturating_sub(steps) };
        // Two threads that share a state may overwrite each other's count. The limit need not be
        // that exact.
        self.left.store(rest, Ordering::Relaxed);
        rest > 0
    }

    /// Restarts the count, unless the limit has ended the evaluation of axioms.
    pub(super) fn renew(&self) {
        if !self.is_cut.load(Ordering::Relaxed) {
            self.left.store(self.limit, Ordering::Relaxed);
        }
    }

    /// Returns a meter with the limit `limit`. If the limit of this meter has ended the evaluation
    /// of axioms before, the new meter allows no steps.
    pub(super) fn with_limit(&self, limit: u64, cancel: Option<Cancel>) -> WorkMeter {
        let meter = WorkMeter::new(limit, cancel);
        if self.is_cut.load(Ordering::Relaxed) {
            meter.left.store(0, Ordering::Relaxed);
            meter.is_cut.store(true, Ordering::Relaxed);
        }
        meter
    }

    /// Calls `evaluate`, which computes the facts of a component of the axioms. Its steps are
    /// counted separately, up to the same limit. The facts are kept for later conditions, so they
    /// must not depend on the steps that the current condition has already taken.
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
