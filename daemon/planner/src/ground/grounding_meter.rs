//! Counts the work of grounding, and stops it at the limits.

use crate::limits::{Budget, Cancel};
use crate::outcome::StopReason;

/// Counter of work and memory, with the limits.
pub(super) struct GroundingMeter<'c> {
    /// Join steps: candidate tuples looked at.
    pub(super) steps: u64,
    budget: Budget,
    cancel: &'c Cancel,
    /// Number of the step at which the limits are checked next.
    next_look: u64,
    breaths: u32,
    /// Bytes of finished data structures that are kept.
    held: usize,
}

/// Interval of the checks of the caller's flag, in join steps. A step takes about ten nanoseconds.
const STEPS_BETWEEN_CANCEL_CHECKS: u64 = 1 << 14;

/// The same for units of other work, which take about a hundred nanoseconds each.
const UNITS_BETWEEN_CANCEL_CHECKS: u32 = 1 << 12;

// === impl Work ===

impl<'c> GroundingMeter<'c> {
    pub(super) fn new(budget: Budget, cancel: &'c Cancel) -> GroundingMeter<'c> {
        GroundingMeter { steps: 0, budget, cancel, next_look: 1, breaths: 0, held: 0 }
    }

    #[inline]
    pub(super) fn step(&mut self) -> Result<(), StopReason> {
        self.steps += 1;
        if self.steps < self.next_look { Ok(()) } else { self.check_limits() }
    }

    /// Checks the limits now, for work that is not counted in steps.
    #[cold]
    pub(super) fn check_limits(&mut self) -> Result<(), StopReason> {
        let limit = self.budget.join_steps_max;
        let regular = self.steps.saturating_add(STEPS_BETWEEN_CANCEL_CHECKS);
        self.next_look = regular.min(limit.saturating_add(1));
        if self.steps > limit {
            return Err(StopReason::JoinStepLimit { limit });
        }
        if self.cancel.is_set() { Err(StopReason::Cancelled) } else { Ok(()) }
    }

    /// Checks the caller's flag once in a while, for work that is no join, such as one operator or
    /// axiom. It is not counted.
    #[inline]
    pub(super) fn count_unit(&mut self) -> Result<(), StopReason> {
        self.breaths = self.breaths.wrapping_add(1);
        if self.breaths.is_multiple_of(UNITS_BETWEEN_CANCEL_CHECKS) && self.cancel.is_set() {
            return Err(StopReason::Cancelled);
        }
        Ok(())
    }

    /// Adds bytes of data that is finished and stays; `check_memory` includes them from now on.
    pub(super) fn add_finished_bytes(&mut self, bytes: usize) {
        self.held += bytes;
    }

    /// Returns an error if `bytes`, together with the bytes held, exceed the limit.
    #[inline]
    pub(super) fn check_memory(&self, bytes: usize) -> Result<(), StopReason> {
        let limit = self.budget.memory_max_bytes;
        if bytes + self.held > limit { Err(StopReason::MemoryLimit { limit }) } else { Ok(()) }
    }
}
