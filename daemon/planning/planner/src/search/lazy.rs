//! Best-first search with deferred evaluation and several open lists that alternate.
//!
//! The open lists are those of NOLAN (Corrêa and Seipp, 2025):
//!
//! - one sorted by the FF heuristic, for all operators;
//! - two for preferred operators only, sorted by the FF heuristic and by landmark count (LAMA:
//!   Richter and Westphal, 2010);
//! - one sorted by novelty, partitioned by landmark count.
//!
//! More lists are possible: LAMA's landmark count for all operators, for tasks with an uninformative
//! FF heuristic; type-based buckets, for tasks where all heuristics mislead; and, for tasks with
//! numbers, one sorted by the cost of a relaxed plan that covers its deficits.
//!
//! Whenever the search makes progress, the lists of preferred operators get a thousand additional
//! turns.
//!
//! Without a weight the search is greedy and ends with its first plan. With a weight, the search
//! respects path costs, evaluates states again that it reaches at a lower cost, and returns only
//! plans below a cost bound. Such a search is one stage of LAMA's anytime search.

use std::sync::Arc;

use super::open::{OpenEntry, OpenList};
use super::preferred::Preferred;
use super::types::TypeList;
use super::{Search, SearchStep};
use crate::arena;
use crate::heuristic::{Evaluator, FastForward, LandmarkCount, NOT_NOVEL, Novelty, Weights};
use crate::limits::Cancel;
use crate::mutex::MutexGroups;
use crate::outcome::{Statistics, StopReason};
use crate::progression::Progression;
use crate::state::{StateId, StateSpace, all_hold};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, Task};

/// Number of additional turns of the lists of preferred operators after each progress of the
/// search.
const BOOST: i64 = 1_000;

/// Kind of an open list: the order of its states, and the operators that are applied in them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum List {
    /// Sorted by the FF heuristic, before deficits are covered; all operators are applied.
    Ff,
    /// Sorted as [`List::Ff`]; only operators that are preferred before deficits are covered are
    /// applied.
    FfPreferred,
    /// Sorted by landmark count; all preferred operators are applied, but no others.
    LandmarksPreferred,
    /// Sorted by novelty among the states with the same landmark count. States without novelty are
    /// not added.
    Novel,
    /// Sorted by landmark count; all operators are applied.
    Landmarks,
    /// Type-based: each turn returns a random state of a random type.
    Types,
    /// Sorted by the FF heuristic with the cost of covering deficits; all preferred operators are
    /// applied, but no others. Empty if no deficit can be covered.
    Covered,
}

/// Open lists of the second search, which runs in parallel to the configured search if two threads
/// are requested.
pub(crate) const EXPLORATION_LISTS: &[List] =
    &[List::Ff, List::Novel, List::Landmarks, List::Types];

/// Number of kinds of open lists; the entry of [`List::Types`] stays empty.
const LISTS: usize = 7;

/// Limit on the work of finding mutex groups, in visited parts of effects. After it, the groups
/// found so far are used. The work takes some hundredths of a second.
const MUTEX_WORK_MAX: u64 = 5_000_000;

/// Parameters of a search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SearchParameters {
    /// Weights of operators in path costs and in the FF heuristic.
    pub(crate) weights: Weights,
    /// Factor of the heuristic estimate relative to the path cost; `None` for greedy search, which
    /// ignores path costs.
    pub(crate) weight: Option<u32>,
    /// Cost bound, in units of the task. Only plans with a lower cost are returned.
    pub(crate) bound: u64,
    /// Open lists of the search. Of lists with the same number of turns, the first one is next.
    pub(crate) lists: &'static [List],
}

/// A best-first search in progress.
pub(crate) struct LazySearch<'t> {
    task: &'t Task,
    manner: SearchParameters,
    progression: Progression<'t>,
    generator: &'t SuccessorGenerator,
    ff: FastForward<'t>,
    landmarks: Arc<LandmarkCount>,
    /// Whether the landmarks are found. They are found at the start, unless another search has.
    has_landmarks: bool,
    novelty: Novelty,
    space: StateSpace,
    /// Per state: its landmark status, the set of achieved landmarks.
    statuses: Vec<u64>,
    /// Per state: its landmark count, which is also its partition for novelty.
    counts: Vec<u32>,
    /// Per state: the cost of its path, in units of the task, and the weight of its path.
    spent: Vec<PathCost>,
    preferred: Preferred,
    sorted: [OpenList; LISTS],
    types: TypeList,
    turns: [i64; LISTS],
    lowest: Lowest,
    /// Number of evaluations at the last progress of the search.
    progress_at: u64,
    started: bool,
    dead_end_at_start: bool,
    expansions: u64,
    evaluations: u64,
    successor: Vec<u64>,
    cancel: Cancel,
}

/// Lowest values so far.
#[derive(Clone, Copy, Debug)]
struct Lowest {
    estimate: u64,
    /// Estimate without the cost of covering deficits.
    plain: u64,
    /// Landmark count.
    count: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct PathCost {
    cost: u64,
    weight: u64,
}

// === impl SearchParameters ===

impl SearchParameters {
    /// Returns the parameters of a greedy search for a first plan, with the weight one for every
    /// step.
    pub(crate) fn greedy(lists: &'static [List]) -> SearchParameters {
        SearchParameters { weights: Weights::Unit, weight: None, bound: u64::MAX, lists }
    }

    fn key(&self, spent: u64, estimate: u64) -> u64 {
        match self.weight {
            None => estimate,
            Some(weight) => spent.saturating_add(estimate.saturating_mul(u64::from(weight))),
        }
    }
}

// === impl LazySearch ===

impl<'t> LazySearch<'t> {
    pub(crate) fn new(
        task: &'t Task,
        generator: &'t SuccessorGenerator,
        ff: FastForward<'t>,
        manner: SearchParameters,
        cancel: &Cancel,
    ) -> LazySearch<'t> {
        let mut progression = Progression::new(task);
        let initial = progression.initial();
        LazySearch {
            task,
            manner,
            progression,
            generator,
            ff,
            landmarks: Arc::default(),
            has_landmarks: false,
            novelty: Novelty::new(task),
            space: StateSpace::new(&initial),
            statuses: Vec::new(),
            counts: Vec::new(),
            spent: vec![PathCost::default()],
            preferred: Preferred::default(),
            sorted: Default::default(),
            types: TypeList::default(),
            turns: [0; LISTS],
            lowest: Lowest { estimate: u64::MAX, plain: u64::MAX, count: u32::MAX },
            progress_at: 0,
            started: false,
            dead_end_at_start: false,
            expansions: 0,
            evaluations: 0,
            successor: Vec::new(),
            cancel: cancel.clone(),
        }
    }

    /// Uses the landmarks that another search of the same task has found, if it has. The search must
    /// not have started.
    pub(crate) fn with_landmarks_of(mut self, other: &LazySearch<'_>) -> LazySearch<'t> {
        self.landmarks = Arc::clone(&other.landmarks);
        self.has_landmarks = other.has_landmarks;
        self
    }

    /// Returns the statistics of the search, with its expansions and evaluations so far.
    pub(crate) fn statistics(&self) -> Statistics {
        let (expansions, evaluations) = (self.expansions, self.evaluations);
        Statistics { expansions, evaluations, ..Statistics::default() }
    }

    /// Returns the number of states evaluated so far.
    pub(crate) fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Returns the number of evaluations since the last progress, which is a lower estimate, with or
    /// without covered deficits, or a lower landmark count than any before.
    pub(crate) fn stalled(&self) -> u64 {
        self.evaluations - self.progress_at
    }

    fn start(&mut self) -> SearchStep {
        self.started = true;
        let initial = StateId(0);
        if self.manner.bound == 0 {
            return SearchStep::Exhausted;
        }
        if all_hold(self.space.state(initial), &self.task.goal) {
            return SearchStep::Solved(Vec::new());
        }
        self.evaluations += 1;
        let state = self.space.state(initial);
        // All landmarks are in the plain relaxed plan.
        self.ff.set_covering(false);
        let Some(mut estimate) = self.ff.evaluate(state) else {
            self.dead_end_at_start = true;
            return SearchStep::Exhausted;
        };
        if !self.has_landmarks {
            let candidates = self.ff.relaxed_propositions();
            let mutex = MutexGroups::find(self.task, MUTEX_WORK_MAX, &self.cancel);
            let (task, relaxation) = (self.task, self.ff.relaxation());
            let found =
                LandmarkCount::new(task, relaxation, state, &candidates, &mutex, &self.cancel);
            (self.landmarks, self.has_landmarks) = (Arc::new(found), true);
        }
        let count = self.landmarks.start(state, &mut self.statuses);
        self.counts.push(count);
        if self.ff.may_have_deficits() && self.manner.lists.contains(&List::Covered) {
            self.ff.set_covering(true);
            estimate = self.ff.evaluate(state).unwrap_or(estimate);
        }
        self.queue(initial, None, estimate);
        SearchStep::InProgress
    }

    /// Removes and returns an entry of the open list with the fewest turns so far; `None` if all
    /// lists are empty.
    fn next(&mut self) -> Option<OpenEntry> {
        let LazySearch { sorted, types, manner, turns, space, generator, task, preferred, .. } =
            self;
        let mut all = |state, operators: &mut Vec<OperatorId>| {
            generator.applicable(task, space.state(state), operators);
        };
        loop {
            let is_open = |list: &&List| match **list {
                List::Types => !types.is_empty(),
                list => !sorted[list as usize].is_empty(),
            };
            let open = manner.lists.iter().filter(is_open);
            let list = *open.min_by_key(|list| turns[**list as usize])?;
            turns[list as usize] += 1;
            let entry = match list {
                List::Types => types.pop(&mut all),
                List::FfPreferred => sorted[list as usize].pop(|state, operators| {
                    operators.extend_from_slice(preferred.plain(state));
                }),
                List::LandmarksPreferred | List::Covered => {
                    sorted[list as usize].pop(|state, operators| {
                        operators.extend_from_slice(preferred.all(state));
                    })
                }
                _ => sorted[list as usize].pop(&mut all),
            };
            if entry.is_some() {
                return entry;
            }
        }
    }

    /// Stores the landmark status, the landmark count and the path cost of a new state.
    fn enter(&mut self, id: StateId, parent: StateId, spent: PathCost) {
        let state = self.space.state(id);
        let count = self.landmarks.progress(state, parent.0 as usize, &mut self.statuses);
        arena::make_room(&mut self.counts, 1);
        self.counts.push(count);
        arena::make_room(&mut self.spent, 1);
        self.spent.push(spent);
    }

    /// Updates the landmark status, the landmark count and the path cost of a known state that is
    /// reached at a lower cost from another parent.
    fn enter_again(&mut self, id: StateId, parent: StateId, spent: PathCost) {
        let state = self.space.state(id);
        let (known, parent) = (id.0 as usize, parent.0 as usize);
        self.counts[known] =
            self.landmarks.progress_again(state, known, parent, &mut self.statuses);
        self.spent[known] = spent;
    }

    /// Evaluates a state, and adds it to the open lists unless it is a dead end.
    fn evaluate(&mut self, id: StateId, parent: StateId) {
        self.evaluations += 1;
        match self.ff.evaluate(self.space.state(id)) {
            Some(estimate) => self.queue(id, Some(parent), estimate),
            None => self.preferred.set(id, &[], 0),
        }
    }

    fn queue(&mut self, id: StateId, parent: Option<StateId>, estimate: u64) {
        self.expansions += 1;
        let (preferred, plain_count) = (self.ff.preferred(), self.ff.plain_count());
        self.preferred.set(id, preferred, plain_count);
        let (count, spent) = (self.counts[id.0 as usize], self.spent[id.0 as usize].weight);
        let plain = self.ff.plain_estimate();
        let Lowest { estimate: lowest, plain: lowest_plain, count: fewest } = self.lowest;
        let has_progressed = estimate < lowest || plain < lowest_plain || count < fewest;
        self.lowest = Lowest {
            estimate: lowest.min(estimate),
            plain: lowest_plain.min(plain),
            count: fewest.min(count),
        };
        if has_progressed {
            self.progress_at = self.evaluations;
            self.turns[List::FfPreferred as usize] -= BOOST;
            self.turns[List::LandmarksPreferred as usize] -= BOOST;
            self.turns[List::Covered as usize] -= BOOST;
        }
        let near = self.manner.key(spent, plain);
        let near_covered = self.manner.key(spent, estimate);
        let few = self.manner.key(spent, u64::from(count));
        let (has_preferred, has_numbers) = (!preferred.is_empty(), self.ff.may_have_deficits());
        for &list in self.manner.lists {
            let key = match list {
                List::Types => {
                    self.types.push((near_covered, spent), id);
                    continue;
                }
                List::Ff => Some((near, 0, 0)),
                List::Landmarks => Some((few, 0, 0)),
                List::Covered => (has_preferred && has_numbers).then_some((near_covered, 0, 0)),
                List::FfPreferred => (plain_count > 0).then_some((near, 0, 0)),
                List::LandmarksPreferred => has_preferred.then_some((few, 0, 0)),
                List::Novel => {
                    let novelty = self.novelty(id, parent);
                    (novelty != NOT_NOVEL).then_some((u64::from(novelty), count, spent))
                }
            };
            if let Some(key) = key {
                self.sorted[list as usize].push(key, id);
            }
        }
    }

    fn novelty(&mut self, id: StateId, parent: Option<StateId>) -> u32 {
        let count = |id: StateId| self.counts[id.0 as usize];
        let before = parent.map(|parent| (self.space.state(parent), count(parent)));
        self.novelty.evaluate(self.space.state(id), count(id), before)
    }

    /// Returns the cost and the weight of the path to `parent` and one further operator.
    fn spent(&self, parent: StateId, operator: OperatorId) -> PathCost {
        let operator = self.task.operator(operator);
        let before = self.spent[parent.0 as usize];
        PathCost {
            cost: before.cost.saturating_add(operator.cost),
            weight: before.weight.saturating_add(self.manner.weights.weight(self.task, operator)),
        }
    }
}

impl Search for LazySearch<'_> {
    fn step(&mut self) -> SearchStep {
        if !self.started {
            return self.start();
        }
        let Some((parent, operator)) = self.next() else { return SearchStep::Exhausted };
        let spent = self.spent(parent, operator);
        if spent.cost >= self.manner.bound {
            return SearchStep::InProgress;
        }
        let from = self.space.state(parent);
        if !self.progression.apply(self.task.operator(operator), from, &mut self.successor) {
            return SearchStep::InProgress;
        }
        let (id, is_new) = self.space.insert(&self.successor, parent, operator);
        if is_new {
            if all_hold(&self.successor, &self.task.goal) {
                return SearchStep::Solved(self.space.path(id));
            }
            self.enter(id, parent, spent);
        } else {
            let known = self.spent[id.0 as usize];
            if self.manner.weight.is_none() || spent.weight >= known.weight {
                return SearchStep::InProgress;
            }
            self.enter_again(id, parent, spent);
            self.space.reparent(id, parent, operator);
        }
        self.evaluate(id, parent);
        SearchStep::InProgress
    }

    fn expansions(&self) -> u64 {
        self.expansions
    }

    fn bytes(&self) -> usize {
        let lists: usize = self.sorted.iter().map(OpenList::bytes).sum();
        let per_state = arena::bytes(&self.statuses, self.landmarks.words())
            + arena::bytes(&self.counts, 1)
            + arena::bytes(&self.spent, 1)
            + self.preferred.bytes();
        self.space.bytes()
            + lists
            + self.types.bytes()
            + per_state
            + self.novelty.bytes()
            + self.ff.bytes()
    }

    /// Returns the stop reason for empty open lists. Only dead ends of the relaxation and paths at
    /// or above the cost bound are pruned, so empty lists prove that no plan below the bound
    /// exists.
    fn exhausted(&self) -> StopReason {
        if self.manner.bound == u64::MAX {
            StopReason::Unsolvable { before_search: self.dead_end_at_start }
        } else {
            StopReason::Exhausted
        }
    }
}
