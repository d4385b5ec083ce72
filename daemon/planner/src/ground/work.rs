//! The work of grounding: counted, and ended where it is too much.

use crate::limits::{Budget, Cancel};
use crate::outcome::StopReason;

/// Counts work, and knows when it is too much.
pub(super) struct Work<'c> {
    /// Candidate tuples looked at.
    pub(super) steps: u64,
    budget: Budget,
    cancel: &'c Cancel,
    /// The step that looks at the limits next.
    next_look: u64,
    breaths: u32,
    /// Bytes of what is done.
    held: usize,
}

/// How often the caller's flag is looked at, in join steps; a step takes some ten nanoseconds.
const STEPS_BETWEEN_CANCEL_CHECKS: u64 = 1 << 14;

/// The same for the units of other work, some hundred nanoseconds each.
const BREATHS_BETWEEN_CANCEL_CHECKS: u32 = 1 << 12;

// === impl Work ===

impl<'c> Work<'c> {
    pub(super) fn new(budget: Budget, cancel: &'c Cancel) -> Work<'c> {
        Work { steps: 0, budget, cancel, next_look: 1, breaths: 0, held: 0 }
    }

    #[inline]
    pub(super) fn step(&mut self) -> Result<(), StopReason> {
        self.steps += 1;
        if self.steps < self.next_look { Ok(()) } else { self.look() }
    }

    /// Looks at the limits now, for whoever does not work in steps.
    #[cold]
    pub(super) fn look(&mut self) -> Result<(), StopReason> {
        let limit = self.budget.join_steps_max;
        let regular = self.steps.saturating_add(STEPS_BETWEEN_CANCEL_CHECKS);
        self.next_look = regular.min(limit.saturating_add(1));
        if self.steps > limit {
            return Err(StopReason::JoinStepLimit { limit });
        }
        if self.cancel.is_set() { Err(StopReason::Cancelled) } else { Ok(()) }
    }

    /// For work that is no join: one operator or axiom, say. It does not count.
    #[inline]
    pub(super) fn breathe(&mut self) -> Result<(), StopReason> {
        self.breaths = self.breaths.wrapping_add(1);
        if self.breaths.is_multiple_of(BREATHS_BETWEEN_CANCEL_CHECKS) && self.cancel.is_set() {
            return Err(StopReason::Cancelled);
        }
        Ok(())
    }

    /// Counts what is done and stays: from now on, `check_memory` adds it.
    pub(super) fn hold(&mut self, bytes: usize) {
        self.held += bytes;
    }

    /// Fails if that many bytes are more than grounding may take.
    #[inline]
    pub(super) fn check_memory(&self, bytes: usize) -> Result<(), StopReason> {
        let limit = self.budget.memory_max_bytes;
        if bytes + self.held > limit { Err(StopReason::MemoryLimit { limit }) } else { Ok(()) }
    }
}
