//! Limits of the work that one planning call may do, and the flag by which its caller stops it.
//!
//! - [`Budget`] counts work, never time: the same task and budget give the same answer on every
//!   machine.
//! - [`Cancel`] is a flag that stops a call. A caller with a deadline sets it by its own clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::configuration::{CONFIGURATIONS, Configuration};

/// Caps on work and memory of one call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// States that the search may expand.
    pub expansions_max: u64,
    /// Candidate tuples that grounding may look at.
    pub join_steps_max: u64,
    /// Bytes that the tables of grounding and the states of the search may take. The estimate is a
    /// lower bound of what they really take.
    pub memory_max_bytes: usize,
}

/// Budget and effort of a planning call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Caps on work and memory.
    pub budget: Budget,
    /// Expansions of the cost-optimal search that follows the first plan on small tasks; 0 disables it.
    pub optimal_expansions_max: u64,
    /// Search configuration for the first plan.
    pub configuration: &'static Configuration,
    /// Whether to go on for better plans after the first one.
    pub effort: Effort,
    /// Number of searches that run in parallel, 1 or 2. The result depends on this number, but is the
    /// same in every run with it.
    pub threads: u32,
}

/// Required quality of the plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// Return the first plan; the cheapest one where finding it takes little work.
    #[default]
    First,
    /// Search for cheaper and cheaper plans until a limit is reached.
    Anytime,
    /// Search for the cheapest plan with a proof, however long it takes.
    Optimal,
}

/// Asks a running call to stop. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

// === impl Budget ===

impl Default for Budget {
    /// No practical cap on expansions; grounding stops at two billion candidates (a few minutes);
    /// memory is capped at 2 GiB, the limit that planner comparisons commonly use.
    fn default() -> Budget {
        Budget {
            expansions_max: u64::MAX,
            join_steps_max: 2_000_000_000,
            memory_max_bytes: 2 << 30,
        }
    }
}

impl Default for Options {
    /// 20,000 expansions of optimal search: enough for the tasks of a building, which take
    /// milliseconds.
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
    /// Returns a flag that is not set.
    pub fn new() -> Cancel {
        Cancel::default()
    }

    /// Asks the calls that share this flag to stop. The flag cannot be unset.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`Cancel::set`] was called on this flag or a clone of it.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
