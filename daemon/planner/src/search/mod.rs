//! Search: from a ground task to a sequence of operators.
//!
//! A search is a `step`; the loop around it, with its limits, is the same for all and lives here.
//!
//! - [`climbing`] tries what is quick, [`lazy`] finds a plan wherever there is one.
//! - [`lanes`] runs two searches in step.
//! - [`optimal`] finds the cheapest where the task is small; it proves that there is none cheaper.
//! - [`improve`] drops steps that a plan does not need, [`neighborhood`] finds shortcuts.

pub(crate) mod climbing;
pub(crate) mod improve;
pub(crate) mod lanes;
pub(crate) mod lazy;
pub(crate) mod neighborhood;
mod open;
pub(crate) mod optimal;
mod types;

use crate::limits::{Budget, Cancel};
use crate::outcome::StopReason;
use crate::task::OperatorId;

/// What one step of a search led to.
#[derive(Debug)]
pub(crate) enum Step {
    /// Nothing yet.
    InProgress,
    /// A plan.
    Solved(Vec<OperatorId>),
    /// No state is left to look at.
    Exhausted,
}

/// What is told while it is searched.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Told<'p> {
    /// This search goes on; it has expanded so many states.
    Searching(u64),
    /// A plan.
    Found(&'p [OperatorId]),
}

/// Expansions between two tellings.
const TELL_EVERY: u64 = 1_000;

/// A search that goes on by steps.
pub(crate) trait Search {
    /// Expands at most one state.
    fn step(&mut self) -> Step;

    /// States expanded so far.
    fn expansions(&self) -> u64;

    /// Bytes taken so far.
    fn bytes(&self) -> usize;

    /// What it means when no state is left.
    fn exhausted(&self) -> StopReason;
}

/// Steps a search until it ends or a limit is reached; tells now and then how far it is, the first
/// time once it is set up.
pub(crate) fn run(
    search: &mut dyn Search,
    budget: Budget,
    cancel: &Cancel,
    tell: &mut dyn FnMut(Told<'_>),
) -> Result<Vec<OperatorId>, StopReason> {
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
            Step::InProgress => (),
            Step::Solved(plan) => return Ok(plan),
            Step::Exhausted => return Err(search.exhausted()),
        }
        if search.expansions() >= tell_at {
            tell_at = (search.expansions() / TELL_EVERY + 1) * TELL_EVERY;
            tell(Told::Searching(search.expansions()));
        }
    }
}
