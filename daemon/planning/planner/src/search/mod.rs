//! Search: finds a sequence of operators that solves a ground task.
//!
//! A search implements [`Search::step`]. The loop [`run`] runs one search and enforces the limits;
//! [`restarts`] and [`portfolio`] do the same for several searches.
//!
//! - [`climbing`] and [`goal_by_goal`] are quick and incomplete; [`lazy`] is complete.
//! - [`restarts`] adds new searches to one without progress; [`portfolio`] runs two in lockstep.
//! - [`optimal`] finds a cheapest plan of a small task, with a proof.
//! - [`improve`] removes superfluous steps of a plan; [`neighborhood`] finds shortcuts.

pub(crate) mod climbing;
pub(crate) mod goal_by_goal;
pub(crate) mod improve;
pub(crate) mod lazy;
pub(crate) mod neighborhood;
mod open;
pub(crate) mod optimal;
mod outlook;
pub(crate) mod portfolio;
mod preferred;
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

    /// Does one step of the search. Returns the result if the search has ended.
    fn advance(&mut self) -> Option<SearchResult> {
        match self.step() {
            SearchStep::InProgress => None,
            SearchStep::Solved(plan) => Some(Ok(plan)),
            SearchStep::Exhausted => Some(Err(self.exhausted())),
        }
    }

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
    let mut meter = ProgressMeter::default();
    loop {
        let limit = limit_reached(budget, search.expansions(), search.bytes(), cancel);
        if let Some(reason) = limit {
            return Err(reason);
        }
        if let Some(result) = search.advance() {
            return result;
        }
        meter.report(search.expansions(), tell);
    }
}

/// Returns the limit that a search has reached, if any.
fn limit_reached(
    budget: Budget,
    expansions: u64,
    bytes: usize,
    cancel: &Cancel,
) -> Option<StopReason> {
    if expansions >= budget.expansions_max {
        Some(StopReason::ExpansionLimit { limit: budget.expansions_max })
    } else if bytes > budget.memory_max_bytes {
        Some(StopReason::MemoryLimit { limit: budget.memory_max_bytes })
    } else {
        cancel.is_set().then_some(StopReason::Cancelled)
    }
}

/// Decides when the next progress event is due: at the first report, and then every
/// [`TELL_EVERY`] expansions.
#[derive(Debug, Default)]
struct ProgressMeter {
    tell_at: u64,
}

// === impl ProgressMeter ===

impl ProgressMeter {
    /// Calls `tell` with the number of expansions if an event is due.
    fn report(&mut self, expansions: u64, tell: &mut dyn FnMut(SearchProgress<'_>)) {
        if expansions >= self.tell_at {
            self.tell_at = (expansions / TELL_EVERY + 1) * TELL_EVERY;
            tell(SearchProgress::Searching(expansions));
        }
    }
}
