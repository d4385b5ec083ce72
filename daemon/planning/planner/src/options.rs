//! Options of a planning call: its limits, its search configuration, and the effort for a better plan.

use crate::configuration::{CONFIGURATIONS, Configuration};
use crate::limits::Budget;

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
