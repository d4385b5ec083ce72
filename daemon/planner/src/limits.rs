//! How much work one planning call may do, and how its caller stops it.
//!
//! - [`Budget`] counts work, never time: the same task and budget give the same answer everywhere.
//! - [`Cancel`] is the caller's hand on the brake. Whoever wants a deadline sets it from a clock of
//!   their own.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::configuration::{CONFIGURATIONS, Configuration};

/// Caps on work and memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// States that search may expand.
    pub expansions_max: u64,
    /// Candidate tuples that grounding may look at.
    pub join_steps_max: u64,
    /// Bytes that the tables of grounding and the states of search may take, estimated from below.
    pub memory_max_bytes: usize,
}

/// What a call may spend and how hard it tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Caps on work and memory.
    pub budget: Budget,
    /// Expansions of the cost-optimal search that follows the first plan on small tasks; 0 leaves
    /// it out.
    pub optimal_expansions_max: u64,
    /// How the first plan is searched for.
    pub configuration: &'static Configuration,
    /// What to do after the first plan.
    pub effort: Effort,
    /// How many searches run side by side, 1 or 2. The same number finds the same plan.
    pub threads: u32,
}

/// How good a plan is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// The first plan, and the cheapest where that is little work.
    #[default]
    First,
    /// Cheaper and cheaper plans until a limit is reached.
    Anytime,
    /// The cheapest plan with a proof, or none, however long it takes.
    Optimal,
}

/// Asks a running call to stop. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

// === impl Budget ===

impl Default for Budget {
    /// No practical cap on expansions; grounding stops at two billion candidates (a few minutes);
    /// memory at 2 GiB, the limit that planner comparisons commonly use.
    fn default() -> Budget {
        Budget {
            expansions_max: u64::MAX,
            join_steps_max: 2_000_000_000,
            memory_max_bytes: 2 << 30,
        }
    }
}

impl Default for Options {
    /// 20,000 expansions of optimal search: enough for a building, milliseconds on a building.
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
    /// A flag that is not set.
    pub fn new() -> Cancel {
        Cancel::default()
    }

    /// Asks for the end. It cannot be taken back.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the end was asked for.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
