//! Search: finds a sequence of operators that solves a ground task.
//!
//! A search implements [`Search::step`]. The loop [`run`] runs one search and enforces the limits;
//! [`restarts`] and [`portfolio`] do the same for several searches.
//!
//! - [`climbing`] is quick and incomplete; [`lazy`] is complete.
//! - [`restarts`] adds new searches to one without progress; [`portfolio`] runs two in lockstep.
//! - [`optimal`] finds a cheapest plan of a small task, with a proof.
//! - [`improve`] removes superfluous steps of a plan; [`neighborhood`] finds shortcuts.

pub(crate) mod climbing;
pub(crate) mod improve;
pub(crate) mod lazy;
pub(crate) mod neighborhood;
mod open;
pub(crate) mod optimal;
pub(crate) mod portfolio;
pub(crate) mod restarts;
mod types;

use crate::limits::{Budget, Cancel};
use crate::outcome::StopReason;
use crate::task::OperatorId;

/// Result of a search that has ended.
type SearchResult = Result<Vec<OperatorId>, StopReason>;

/// Result of one step of a search.
#[derive(Debug)]
pub(crate) enum SearchStep {
    /// The search has found neither a plan nor a proof yet.
    InProgress,
    /// The search has found a plan.
    Solved(Vec<OperatorId>),
    /// No state is left to expand.
    Exhausted,
}

/// Progress event of a search.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SearchProgress<'p> {
    /// The search has expanded this number of states and continues.
    Searching(u64),
    /// The search has found this plan.
    Found(&'p [OperatorId]),
}

/// Number of expansions between two progress events.
const TELL_EVERY: u64 = 1_000;

/// A search that runs step by step.
pub(crate) trait Search {
    /// Does one step of the search, which expands at most one state.
    fn step(&mut self) -> SearchStep;

    /// Returns the number of states expanded so far.
    fn expansions(&self) -> u64;

    /// Returns the present number of bytes of the search.
    fn bytes(&self) -> usize;

    /// Returns the stop reason of a search that has no state left to expand. It is
    /// [`StopReason::Unsolvable`] if the empty search proves that no plan exists.
    fn exhausted(&self) -> StopReason;
}

/// Runs a search until it ends or reaches a limit. Calls `tell` with the progress after the first
/// step, and then every [`TELL_EVERY`] expansions.
pub(crate) fn run(
    search: &mut dyn Search,
    budget: Budget,
    cancel: &Cancel,
    tell: &mut dyn FnMut(SearchProgress<'_>),
) -> SearchResult {
    let mut tell_at = search.expansions();
    loop {
        if search.expansions() >= budget.expansions_max {
            return Err(StopReason::ExpansionLimit { limit: budget.expansions_max });
        }
        if search.bytes() > budget.memory_max_bytes {
            return Err(StopReason::MemoryLimit { limit: budget.memory_max_bytes });
        }
        if cancel.is_set() {
            return Err(StopReason::Cancelled);
        }
        match search.step() {
            SearchStep::InProgress => (),
            SearchStep::Solved(plan) => return Ok(plan),
            SearchStep::Exhausted => return Err(search.exhausted()),
        }
        if search.expansions() >= tell_at {
            tell_at = (search.expansions() / TELL_EVERY + 1) * TELL_EVERY;
            tell(SearchProgress::Searching(search.expansions()));
        }
    }
}
