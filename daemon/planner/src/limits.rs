//! Limits of the work that one planning call may do, and the flag by which the caller stops the call.
//!
//! - [`Budget`] limits work, never time: the same task and budget give the same answer on every
//!   machine.
//! - [`Cancel`] is a flag that stops a call. A caller with a deadline sets the flag when the deadline
//!   has passed by the caller's own clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::configuration::{CONFIGURATIONS, Configuration};

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

/// Budget and effort of a planning call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Caps on the work and the memory of the call.
    pub budget: Budget,
    /// Maximum number of states that the cost-optimal search may expand. This search follows the first
    /// plan on small tasks; 0 disables it.
    pub optimal_expansions_max: u64,
    /// Search configuration by which the first plan is searched for.
    pub configuration: &'static Configuration,
    /// Required quality of the plan, which decides whether better plans are searched for after the
    /// first one.
    pub effort: Effort,
    /// Number of searches that run in parallel: 1 or 2. The plan that is found depends on this number,
    /// but is the same in every run with the same number.
    pub threads: u32,
}

/// Required quality of the plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// Returns the first plan that is found, or a cheapest plan if finding one takes little work.
    #[default]
    First,
    /// Searches for cheaper and cheaper plans until a limit is reached.
    Anytime,
    /// Searches for a cheapest plan and the proof that none is cheaper, however long it takes.
    Optimal,
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

impl Default for Options {
    /// Returns the default options, with 20,000 expansions for the optimal search: enough for the tasks
    /// of a building, which take milliseconds.
    fn default() -> Options {
        Options {
            budget: Budget::default(),
            optimal_expansions_max: 20_000,
            configuration: &CONFIGURATIONS[0],
            effort: Effort::First,
            threads: 1,
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
