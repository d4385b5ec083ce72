//! Restarts: a search that makes no progress for a while shares its time with searches that begin
//! anew, each with the operators in another order.
//!
//! The time of a greedy search depends on how it breaks ties, by orders of magnitude (Gomes, Selman,
//! Crato and Kautz, 2000, on heavy tails). The order of the operators determines the order of the
//! successors, and which of several relaxed plans the FF heuristic finds. The lengths of the new
//! searches are those of Luby, Sinclair and Zuckerman (1993).
//!
//! The original search always continues, so a proof that no plan exists stays possible, and makes at
//! least three of four evaluations. A new search uses the landmarks of the original one. Preparing the rest
//! of it (operators in another order, their index, the relaxation) counts as
//! [`PREPARATION_EVALUATIONS`].

use fastrand::Rng;

use super::lazy::{LazySearch, List, SearchParameters};
use super::{ProgressMeter, Search, SearchProgress, SearchResult, limit_reached};
use crate::heuristic::{FastForward, Weights};
use crate::limits::{Budget, Cancel};
use crate::outcome::{Statistics, StopReason};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, OperatorTable, Task};

/// Number of evaluations of the original search for each evaluation of the new searches, while it
/// makes no progress.
const SHARE: u64 = 3;

/// Number of evaluations that take as long as the preparation of a new search.
const PREPARATION_EVALUATIONS: u64 = 100;

/// When new searches begin, and their lengths.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RestartLimits {
    /// Number of evaluations of the original search without progress before a new search begins.
    pub(crate) stalled_max: u64,
    /// Number of evaluations of the shortest new search.
    pub(crate) unit: u64,
}

impl Default for RestartLimits {
    fn default() -> RestartLimits {
        RestartLimits { stalled_max: 5_000, unit: 1_000 }
    }
}

/// A task with the operators in another order.
struct ShuffledTask {
    task: Task,
    generator: SuccessorGenerator,
    /// Per operator of this task: its number in the original task.
    origins: Vec<OperatorId>,
}

/// The searches for a first plan of a task.
pub(crate) struct Restarts<'r, 't> {
    task: &'t Task,
    original: LazySearch<'t>,
    /// Estimated number of bytes for preparing a new search.
    preparation_bytes: usize,
    lists: &'static [List],
    budget: Budget,
    cancel: &'r Cancel,
    /// Expansions and evaluations of the new searches so far.
    anew: Statistics,
    meter: ProgressMeter,
}

// === impl ShuffledTask ===

impl ShuffledTask {
    fn new(task: &Task, seed: u64) -> ShuffledTask {
        let all = 0..task.operator_count() as u32;
        let mut origins: Vec<OperatorId> = all.map(OperatorId).collect();
        Rng::with_seed(seed).shuffle(&mut origins);
        let mut operators = OperatorTable::default();
        for id in &origins {
            let operator = task.operator(*id);
            operators.push_with(operator, operator.preconditions.iter().copied());
        }
        let task = task.with_operators(operators);
        ShuffledTask { generator: SuccessorGenerator::new(&task), task, origins }
    }

    /// Translates a plan of this task to operators of the original task.
    fn original(&self, plan: &[OperatorId]) -> Vec<OperatorId> {
        plan.iter().map(|id| self.origins[id.index()]).collect()
    }
}

// === impl Restarts ===

impl<'r, 't> Restarts<'r, 't> {
    pub(crate) fn new(
        task: &'t Task,
        generator: &'t SuccessorGenerator,
        ff: FastForward<'t>,
        lists: &'static [List],
        budget: Budget,
        cancel: &'r Cancel,
    ) -> Restarts<'r, 't> {
        let parameters = SearchParameters::greedy(lists);
        let original = LazySearch::new(task, generator, ff, parameters, cancel);
        // A table that grows has up to twice the size that it needs.
        let preparation_bytes = original.bytes() + 2 * task.bytes() + generator.bytes();
        let anew = Statistics::default();
        let meter = ProgressMeter::default();
        Restarts { task, original, preparation_bytes, lists, budget, cancel, anew, meter }
    }

    /// Runs the searches until one of them ends with a plan or a proof, or a limit is reached.
    pub(crate) fn run(
        &mut self,
        limits: RestartLimits,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> SearchResult {
        let (mut number, mut until) = (1, 0);
        loop {
            if let Some(result) = self.continue_original(until, limits.stalled_max, tell) {
                return result;
            }
            // The tables of the original search never become smaller.
            let bytes = self.original.bytes() + self.preparation_bytes;
            if bytes > self.budget.memory_max_bytes {
                until = u64::MAX;
                continue;
            }
            let length = luby(number).saturating_mul(limits.unit);
            if let Some(result) = self.restart(number, length, tell) {
                return result;
            }
            number += 1;
            let taken = length.saturating_add(PREPARATION_EVALUATIONS);
            until = self.original.evaluations().saturating_add(SHARE.saturating_mul(taken));
        }
    }

    /// Returns the statistics of all searches so far.
    pub(crate) fn statistics(&self) -> Statistics {
        let original = self.original.statistics();
        Statistics {
            expansions: original.expansions + self.anew.expansions,
            evaluations: original.evaluations + self.anew.evaluations,
            ..original
        }
    }

    /// Continues the original search while it has made less than `until` evaluations, or progress
    /// within the last `stalled_max` of them. Returns `None` if the search has not ended then.
    fn continue_original(
        &mut self,
        until: u64,
        stalled_max: u64,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> Option<SearchResult> {
        while self.original.evaluations() < until || self.original.stalled() < stalled_max {
            if let Some(reason) = self.reached(self.original.expansions(), self.original.bytes()) {
                return Some(Err(reason));
            }
            if let Some(result) = self.original.advance() {
                return Some(result);
            }
            self.report(self.original.expansions(), tell);
        }
        None
    }

    /// Runs a new search with `length` evaluations at most. Returns `None` if it has not ended then.
    fn restart(
        &mut self,
        number: u64,
        length: u64,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> Option<SearchResult> {
        if let Some(reason) = self.reached(self.original.expansions(), self.original.bytes()) {
            return Some(Err(reason));
        }
        let shuffled = ShuffledTask::new(self.task, number);
        let (task, generator) = (&shuffled.task, &shuffled.generator);
        let ff = FastForward::new(task, Weights::Unit);
        let parameters = SearchParameters::greedy(self.lists);
        let mut search = LazySearch::new(task, generator, ff, parameters, self.cancel)
            .with_landmarks_of(&self.original);
        let kept = self.original.bytes() + task.bytes() + generator.bytes();
        let result = loop {
            let expansions = self.original.expansions() + search.expansions();
            match self.reached(expansions, kept + search.bytes()) {
                // The memory of this search is free again when it ends.
                Some(StopReason::MemoryLimit { .. }) => break None,
                Some(reason) => break Some(Err(reason)),
                None if search.evaluations() >= length => break None,
                None => (),
            }
            if let Some(result) = search.advance() {
                break Some(result.map(|plan| shuffled.original(&plan)));
            }
            self.report(expansions, tell);
        };
        let made = search.statistics();
        self.anew.expansions += made.expansions;
        self.anew.evaluations += made.evaluations;
        result
    }

    /// Returns the limit that is reached, if any. `expansions` are those of the searches that are
    /// still in progress.
    fn reached(&self, expansions: u64, bytes: usize) -> Option<StopReason> {
        limit_reached(self.budget, self.anew.expansions + expansions, bytes, self.cancel)
    }

    fn report(&mut self, expansions: u64, tell: &mut dyn FnMut(SearchProgress<'_>)) {
        self.meter.report(self.anew.expansions + expansions, tell);
    }
}

/// Returns the entry of Luby's sequence with this number: 1, 1, 2, 1, 1, 2, 4, and so on. The first
/// entry has the number one.
fn luby(mut number: u64) -> u64 {
    loop {
        let power = (number + 1).next_power_of_two();
        if power == number + 1 {
            return power / 2;
        }
        number -= power / 2 - 1;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::test_tasks::{assert_reaches_the_goal, conjunction, task, texts, with_goal};

    const LISTS: &[List] = &[List::Ff, List::FfPreferred, List::Landmarks];

    #[test]
    fn lengths_are_those_of_luby() {
        let first: Vec<u64> = (1..=15).map(luby).collect();
        assert_eq!(first, [1, 1, 2, 1, 1, 2, 4, 1, 1, 2, 1, 1, 2, 4, 8]);
    }

    /// A new search has 1,000 evaluations before the original one begins, so its plan is the answer.
    #[test]
    fn a_plan_of_a_new_search_is_one_of_the_original_task() {
        let domain = "(define (domain d) (:predicates (at ?x) (next ?x ?y) (seen ?x))
            (:action go :parameters (?x ?y) :precondition (and (at ?x) (next ?x ?y))
              :effect (and (not (at ?x)) (at ?y)))
            (:action see :parameters (?x) :precondition (at ?x) :effect (seen ?x)))";
        let problem = "(define (problem p) (:domain d) (:objects a b c e)
            (:init (at a) (next a b) (next b c) (next c e) (next e a) (next a e))
            (:goal (and (seen c) (seen e) (at a))))";
        let (task, cancel) = (task(domain, problem), Cancel::new());
        let generator = SuccessorGenerator::new(&task);
        let ff = FastForward::new(&task, Weights::Unit);
        let mut search = Restarts::new(&task, &generator, ff, LISTS, Budget::default(), &cancel);
        let limits = RestartLimits { stalled_max: 0, unit: 1_000 };
        let plan = search.run(limits, &mut |_| ()).expect("a plan");
        assert_eq!(search.original.evaluations(), 0, "the original search has not begun");
        assert!(plan.len() >= 6, "{plan:?}");
        assert_reaches_the_goal(&task, &plan);
    }

    proptest! {
        #[test]
        fn restarts_change_neither_what_is_possible_nor_what_is_proved(
            (actions, initial) in texts(),
            goal in conjunction(),
        ) {
            let Some(task) = with_goal(&actions, &initial, goal) else { return Ok(()) };
            let (cancel, budget) = (Cancel::new(), Budget::default());
            let generator = SuccessorGenerator::new(&task);
            let solve = |limits| {
                let ff = FastForward::new(&task, Weights::Unit);
                let mut search = Restarts::new(&task, &generator, ff, LISTS, budget, &cancel);
                search.run(limits, &mut |_| ())
            };
            let never = solve(RestartLimits { stalled_max: u64::MAX, unit: 1 });
            match solve(RestartLimits { stalled_max: 0, unit: 1_000 }) {
                Ok(plan) => {
                    assert_reaches_the_goal(&task, &plan);
                    prop_assert!(never.is_ok());
                }
                Err(reason) => prop_assert_eq!(never, Err(reason)),
            }
        }
    }
}
