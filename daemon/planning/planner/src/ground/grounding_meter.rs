//! Counts the work of grounding, and stops grounding at its limits.

use crate::limits::{Budget, Cancel};
use crate::outcome::StopReason;

/// Counter of the work and the memory of grounding, with the limits.
pub(super) struct GroundingMeter<'c> {
    /// Number of join steps so far. A join step visits one candidate tuple.
    pub(super) steps: u64,
    budget: Budget,
    cancel: &'c Cancel,
    /// Number of the join step at which the limits are checked again.
    next_look: u64,
    breaths: u32,
    /// Number of bytes of finished data structures.
    held: usize,
}

/// Number of join steps between two checks of the caller's [`Cancel`] flag. A step takes about ten
/// nanoseconds.
const STEPS_BETWEEN_CANCEL_CHECKS: u64 = 1 << 14;

/// Number of units of work other than join steps between two checks of the caller's [`Cancel`]
/// flag. A unit takes about a hundred nanoseconds.
const UNITS_BETWEEN_CANCEL_CHECKS: u32 = 1 << 12;

// === impl GroundingMeter ===

impl<'c> GroundingMeter<'c> {
    pub(super) fn new(budget: Budget, cancel: &'c Cancel) -> GroundingMeter<'c> {
        GroundingMeter { steps: 0, budget, cancel, next_look: 1, breaths: 0, held: 0 }
    }

    #[inline]
    pub(super) fn step(&mut self) -> Result<(), StopReason> {
        self.steps += 1;
        if self.steps < self.next_look { Ok(()) } else { self.check_limits() }
    }

    /// Checks the limits now. `step` calls this function regularly, and so does work that is not
    /// counted in join steps.
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

    /// Counts one unit of work other than a join step, such as one operator or axiom. Checks the
    /// caller's [`Cancel`] flag regularly. These units do not count towards the limits.
    #[inline]
    pub(super) fn count_unit(&mut self) -> Result<(), StopReason> {
        self.breaths = self.breaths.wrapping_add(1);
        if self.breaths.is_multiple_of(UNITS_BETWEEN_CANCEL_CHECKS) && self.cancel.is_set() {
            return Err(StopReason::Cancelled);
        }
        Ok(())
    }

    /// Adds the bytes of a finished data structure, which `check_memory` includes from now on.
    pub(super) fn add_finished_bytes(&mut self, bytes: usize) {
        self.held += bytes;
    }

    /// Returns an error if `bytes`, together with the bytes of finished data, exceed the memory
    /// limit.
    #[inline]
    pub(super) fn check_memory(&self, bytes: usize) -> Result<(), StopReason> {
        let limit = self.budget.memory_max_bytes;
        if bytes + self.held > limit { Err(StopReason::MemoryLimit { limit }) } else { Ok(()) }
    }
}
