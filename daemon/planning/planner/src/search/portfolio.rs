//! Two searches in parallel, in lockstep. After every round of steps, the searches wait for each
//! other, so that the result does not depend on the speed of the machine.

use super::lazy::{EXPLORATION_LISTS, LazySearch, List, SearchParameters};
use super::{Search, SearchProgress, SearchResult, limit_reached};
use crate::heuristic::{FastForward, Weights};
use crate::limits::{Budget, Cancel};
use crate::outcome::{Statistics, StopReason};
use crate::successors::SuccessorGenerator;
use crate::task::Task;

/// Number of steps of each search per round, which take some milliseconds.
const ROUND: usize = 500;

/// Runs two searches in parallel: one with the given open lists, and one with
/// [`EXPLORATION_LISTS`]. The first search with a plan or a proof ends both. If both end in the
/// same round, the search with the given lists takes precedence.
pub(crate) fn run<'t>(
    task: &'t Task,
    generator: &'t SuccessorGenerator,
    ff: FastForward<'t>,
    lists: &'static [List],
    budget: Budget,
    cancel: &Cancel,
    tell: &mut dyn FnMut(SearchProgress<'_>),
) -> (SearchResult, Statistics) {
    let other = FastForward::new(task, Weights::Unit);
    let mut lanes = [
        LazySearch::new(task, generator, ff, SearchParameters::greedy(lists), cancel),
        LazySearch::new(
            task,
            generator,
            other,
            SearchParameters::greedy(EXPLORATION_LISTS),
            cancel,
        ),
    ];
    let found = loop {
        if let Some(reason) = limit(&lanes, budget, cancel) {
            break Err(reason);
        }
        tell(SearchProgress::Searching(lanes.iter().map(Search::expansions).sum()));
        let [greedy, curious] = &mut lanes;
        let (first, second) = std::thread::scope(|scope| {
            let beside = scope.spawn(|| (round(curious), pddl::rounding_losses()));
            let first = round(greedy);
            // A panic of the second thread is resumed on this thread.
            let (second, losses) =
                beside.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            pddl::add_rounding_losses(losses);
            (first, second)
        });
        if let Some(found) = first.or(second) {
            break found;
        }
    };
    let statistics = Statistics {
        expansions: lanes.iter().map(Search::expansions).sum(),
        evaluations: lanes.iter().map(|lane| lane.statistics().evaluations).sum(),
        ..Statistics::default()
    };
    (found, statistics)
}

fn round(lane: &mut LazySearch<'_>) -> Option<SearchResult> {
    (0..ROUND).find_map(|_| lane.advance())
}

fn limit(lanes: &[LazySearch<'_>; 2], budget: Budget, cancel: &Cancel) -> Option<StopReason> {
    let expansions = lanes.iter().map(Search::expansions).sum();
    let bytes = lanes.iter().map(Search::bytes).sum();
    limit_reached(budget, expansions, bytes, cancel)
}
