//! Limits of the work that one planning call may do, and the flag by which the caller stops the call.
//!
//! - [`Budget`] limits work, never time: the same task and budget give the same answer on every
//!   machine.
//! - [`Cancel`] is a flag that stops a call. A caller with a deadline sets the flag when the deadline
//!   has passed by the caller's own clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Caps on the work and the memory of one planning call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Maximum number of states that the search may expand.
    pub expansions_max: u64,
    /// Maximum number of candidate tuples that grounding may look at, and of steps that evaluating the
    /// conditions of one plan may take.
    pub join_steps_max: u64,
    /// Maximum number of bytes that the tables of grounding and the states of the search may take. The
    /// planner's estimate of these bytes is a lower bound of the memory that they really take.
    pub memory_max_bytes: usize,
}

/// A flag that asks a running planning call to stop. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

// === impl Budget ===

impl Default for Budget {
    /// Returns the default caps: no practical cap on expansions; two billion candidate tuples for
    /// grounding (a few minutes); and 2 GiB of memory, the limit that planner comparisons commonly use.
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

    /// Asks the calls that share this flag to stop. Once set, the flag stays set.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`Cancel::set`] was called on this flag or on a clone of this flag.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
