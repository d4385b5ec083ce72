//! Limits on the work of one planning call, and the flag by which the caller stops a call.
//!
//! - [`Budget`] limits work, never time: the same task and budget give the same answer on every
//!   machine.
//! - [`Cancel`] is a flag that stops a call. A caller with a deadline sets the flag when its own
//!   clock reaches the deadline.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Limits on the work and the memory of one planning call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Maximum number of states that the search may expand. At the limit, the search ends.
    pub expansions_max: u64,
    /// Maximum number of candidate tuples of grounding, after which grounding ends without a
    /// result. Also the maximum number of steps of evaluating the conditions of one plan, after
    /// which the plan is not returned.
    pub join_steps_max: u64,
    /// Maximum number of bytes of the tables of grounding and of the states of the search; at the
    /// limit, the call ends. The planner's estimate of these bytes is a lower bound of the memory
    /// that they occupy.
    pub memory_max_bytes: usize,
}

/// A flag that stops a running planning call. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

// === impl Budget ===

impl Default for Budget {
    /// Returns the default limits: no practical limit on expansions; two billion candidate tuples
    /// for grounding (a few minutes); and 2 GiB of memory, the usual limit in comparisons of
    /// planners.
    fn default() -> Budget {
        Budget {
            expansions_max: u64::MAX,
            join_steps_max: 2_000_000_000,
            memory_max_bytes: 2 << 30,
        }
    }
}

// === impl Cancel ===

impl Cancel {
    /// Creates a flag that is not set.
    pub fn new() -> Cancel {
        Cancel::default()
    }

    /// Stops the calls that share this flag. The flag cannot be reset.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`Cancel::set`] was called on this flag or on a clone of it.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
