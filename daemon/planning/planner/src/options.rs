//! Options of a planning call: its limits, its search configuration, and the effort to find a
//! better plan.

use crate::configuration::{CONFIGURATIONS, Configuration};
use crate::limits::Budget;

/// Budget and effort of a planning call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Limits on the work and the memory of the call.
    pub budget: Budget,
    /// Maximum number of states that the optimal search may expand. On small tasks, this search
    /// follows the first plan; 0 disables it. At the limit, the first plan is kept.
    pub optimal_expansions_max: u64,
    /// Search configuration for the first plan.
    pub configuration: &'static Configuration,
    /// Required quality of the plan, which determines whether the search continues after the first
    /// plan.
    pub effort: Effort,
    /// Number of parallel searches: 1 or 2. The resulting plan depends on this number, but is the
    /// same in every run with the same number.
    pub threads: u32,
}

/// Required quality of the plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// The first plan, or a cheapest plan if finding one takes little work.
    #[default]
    First,
    /// The cheapest plan that is found before a limit is reached.
    Anytime,
    /// A cheapest plan with the proof that no plan is cheaper, at any cost of time.
    Optimal,
}

impl Default for Options {
    /// Returns the default options. The optimal search may expand 20,000 states, which is enough
    /// for tasks of buildings and takes milliseconds.
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
