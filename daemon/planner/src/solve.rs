//! From a ground task to plans: first any plan, then better ones, as much as is asked for.
//!
//! 1. The quick ladder (`search::climbing`), which solves most of what a building asks.
//! 2. What no plan can use is left out (`prune`).
//! 3. Search with all that is known (`search::lazy`), on one thread or in two lanes.
//! 4. Steps that the plan does not need are left out (`search::improve`).
//! 5. On small tasks, the cheapest plan (`search::optimal`), with a proof.
//! 6. Anytime: searches with less and less haste, each for a cheaper plan than the last, and between
//!    them for shortcuts (`search::neighborhood`).

use crate::configuration::Method;
use crate::heuristic::{Evaluator, FastForward, LandmarkCut, Weights, heuristic};
use crate::limits::{Budget, Cancel, Effort, Options};
use crate::outcome::{Statistics, StopReason};
use crate::prune::{Pruned, prune};
use crate::search::climbing::{Climb, Climbed};
use crate::search::lazy::{Lazy, List, Manner};
use crate::search::neighborhood::Extent;
use crate::search::optimal::{AStar, weight};
use crate::search::{Search, Told, improve, lanes, neighborhood, run};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, Task};

/// Work of the optimal search that follows a first plan without being asked for: explorations times
/// the size of what each looks at. That is about a tenth of a second, and covers a building's
/// problems.
const OPTIMAL_WORK_MAX: u64 = 5_000_000;

/// How much estimates count, in the searches for better plans: LAMA's sequence (Richter and
/// Westphal, 2010).
const WEIGHTS: [Option<u32>; 5] = [None, Some(5), Some(3), Some(2), Some(1)];

/// Words of pairs that are looked at for what is superfluous, once the quick ladder has failed:
/// half a second.
const PRUNING_MAX: u64 = 300_000_000;

/// Expansions after which a search for a better plan makes room for another one, if not more were
/// made before it.
const STAGE_MIN: u64 = 10_000;

/// Steps looked at for shortcuts, for each expansion of the searches between: a step is taken in a
/// hundredth of the time of an expansion with its estimate.
const SHORTCUTS_PER_EXPANSION: u64 = 8;

/// The lists of the searches for better plans.
const LAMA: &[List] = &[List::Ff, List::FfPreferred, List::Landmarks, List::LandmarksPreferred];

/// Solves one task.
pub(crate) struct Solver<'t> {
    task: &'t Task,
    generator: SuccessorGenerator,
    options: &'t Options,
    cancel: &'t Cancel,
    statistics: &'t mut Statistics,
}

// === impl Solver ===

impl<'t> Solver<'t> {
    pub(crate) fn new(
        task: &'t Task,
        options: &'t Options,
        cancel: &'t Cancel,
        statistics: &'t mut Statistics,
    ) -> Solver<'t> {
        let generator = SuccessorGenerator::new(task);
        Solver { task, generator, options, cancel, statistics }
    }

    /// Tells how far it is, and every plan that is worth it; why there is none, or no further one.
    pub(crate) fn run(&mut self, tell: &mut dyn FnMut(Told<'_>)) -> StopReason {
        let first = match self.climb() {
            Climbed::Plan(plan) if self.options.effort == Effort::First => {
                return self.finish(plan, tell);
            }
            Climbed::Plan(plan) => Some(plan),
            Climbed::DeadEnd => return StopReason::Unsolvable { before_search: true },
            Climbed::GaveUp => None,
        };
        let bytes_max = self.options.budget.memory_max_bytes / 8;
        match prune(self.task, PRUNING_MAX, bytes_max, self.cancel) {
            Pruned::Nothing => StopReason::Unsolvable { before_search: true },
            Pruned::Everything => self.go_on(first, tell),
            Pruned::Smaller(smaller) => {
                let first = first.and_then(|plan| smaller.translate(&plan));
                Solver::new(&smaller.task, self.options, self.cancel, self.statistics).go_on(
                    first,
                    &mut |told| match told {
                        Told::Found(plan) => tell(Told::Found(&smaller.original(plan))),
                        told => tell(told),
                    },
                )
            }
        }
    }

    /// Whether the cheapest plan of the task is the cheapest plan of the texts.
    fn is_provable(&self) -> bool {
        self.task.unprovable.is_none()
    }

    /// The quick ladder, if the configuration has it.
    fn climb(&mut self) -> Climbed {
        if !matches!(self.options.configuration.method, Method::Lists { climb: true, .. }) {
            return Climbed::GaveUp;
        }
        let mut ff = FastForward::new(self.task, Weights::Unit);
        let mut climb = Climb::new(self.task, &mut ff);
        let climbed = climb.run(self.cancel);
        self.statistics.evaluations += climb.evaluations;
        self.statistics.expansions += climb.expansions;
        climbed
    }

    /// What is done once nothing superfluous is left: searches, unless a plan is known.
    fn go_on(
        &mut self,
        first: Option<Vec<OperatorId>>,
        tell: &mut dyn FnMut(Told<'_>),
    ) -> StopReason {
        match first.map_or_else(|| self.first(tell), Ok) {
            Ok(plan) => self.finish(plan, tell),
            Err(reason) => reason,
        }
    }

    /// The first plan, as the configuration has it.
    fn first(&mut self, tell: &mut dyn FnMut(Told<'_>)) -> Result<Vec<OperatorId>, StopReason> {
        match self.options.configuration.method {
            Method::Lists { lists, .. } => self.search(lists, tell),
            Method::AStar { heuristic } => self.a_star(heuristic, tell),
        }
    }

    /// Tells a first plan, and better ones.
    fn finish(&mut self, first: Vec<OperatorId>, tell: &mut dyn FnMut(Told<'_>)) -> StopReason {
        if self.statistics.proven_optimal {
            tell(Told::Found(&first));
            return StopReason::GoalReached;
        }
        let first = improve::eliminate(self.task, first, self.cancel);
        // Where costs are not exact, what seems to be cheaper may be dearer: the validator, which
        // knows the true costs, hears of both.
        let is_told = self.options.effort == Effort::Anytime || !self.is_provable();
        if is_told {
            tell(Told::Found(&first));
        }
        let (best, reason) = self.cheapest(first.clone(), tell);
        if !is_told || best != first {
            tell(Told::Found(&best));
        }
        match self.options.effort {
            Effort::Anytime if !self.statistics.proven_optimal => self.improve(best, tell),
            Effort::Optimal if !self.statistics.proven_optimal => reason,
            _ => StopReason::GoalReached,
        }
    }

    /// Searches with several lists in turn.
    fn search(
        &mut self,
        lists: &'static [List],
        tell: &mut dyn FnMut(Told<'_>),
    ) -> Result<Vec<OperatorId>, StopReason> {
        let ff = FastForward::new(self.task, Weights::Unit);
        let (task, generator, budget) = (self.task, &self.generator, self.options.budget);
        let (result, found) = if self.options.threads > 1 {
            lanes::run(task, generator, ff, lists, budget, self.cancel, tell)
        } else {
            let mut search = Lazy::new(task, generator, ff, Manner::greedy(lists), self.cancel);
            (run(&mut search, budget, self.cancel, tell), search.statistics())
        };
        self.statistics.expansions += found.expansions;
        self.statistics.evaluations += found.evaluations;
        result
    }

    fn a_star(
        &mut self,
        name: &str,
        tell: &mut dyn FnMut(Told<'_>),
    ) -> Result<Vec<OperatorId>, StopReason> {
        let build = heuristic(name).and_then(|one| one.build);
        let evaluator = build.map_or_else(
            || Box::new(LandmarkCut::new(self.task)) as Box<dyn Evaluator>,
            |build| build(self.task),
        );
        let mut search = AStar::new(self.task, &self.generator, evaluator, u64::MAX, u64::MAX);
        let result = run(&mut search, self.options.budget, self.cancel, tell);
        self.statistics.expansions = search.expansions();
        match result {
            Ok(plan) => {
                self.statistics.proven_optimal = self.is_provable();
                Ok(plan)
            }
            // What weighs too much to be counted was left out.
            Err(StopReason::Exhausted) if search.has_overflowed() => Err(StopReason::Exhausted),
            // Without a bound, nothing else was left out but dead ends of an admissible heuristic.
            Err(StopReason::Exhausted) => Err(StopReason::Unsolvable { before_search: false }),
            Err(reason) => Err(reason),
        }
    }

    /// The cheapest plan, where it can be found with little work or has been asked for; otherwise
    /// the given one; and why the search for it ended.
    fn cheapest(
        &mut self,
        first: Vec<OperatorId>,
        tell: &mut dyn FnMut(Told<'_>),
    ) -> (Vec<OperatorId>, StopReason) {
        let evaluator = LandmarkCut::new(self.task);
        let size = evaluator.size().max(1) as u64;
        let is_asked = self.options.effort == Effort::Optimal;
        let (explorations_max, expansions_max) = match is_asked {
            true => (u64::MAX, self.options.budget.expansions_max),
            false => (OPTIMAL_WORK_MAX / size, self.options.optimal_expansions_max),
        };
        // A* expands at least the states of a plan, and each takes about as many cuts as there are
        // steps left.
        let needed = (first.len() as u64).saturating_mul(first.len() as u64);
        if expansions_max == 0 || explorations_max < needed.max(1) {
            return (first, StopReason::Exhausted);
        }
        let bound = weight(self.task, &first);
        let mut search =
            AStar::new(self.task, &self.generator, Box::new(evaluator), bound, explorations_max);
        let budget = Budget { expansions_max, ..self.options.budget };
        let result = run(&mut search, budget, self.cancel, tell);
        self.statistics.optimal_expansions = search.expansions();
        // Rounded costs prove nothing about the true ones.
        let is_exact = self.is_provable() && bound < u64::MAX;
        match result {
            Ok(better) => {
                self.statistics.proven_optimal = is_exact;
                (better, StopReason::GoalReached)
            }
            Err(reason) => {
                self.statistics.proven_optimal = is_exact && reason == StopReason::Exhausted;
                (first, reason)
            }
        }
    }

    /// Looks for shortcuts near the plan, and near each that is found, until there are none.
    fn take_shortcuts(
        &mut self,
        best: &mut Vec<OperatorId>,
        expansions: u64,
        tell: &mut dyn FnMut(Told<'_>),
    ) {
        let extent = Extent {
            steps_max: expansions.saturating_mul(SHORTCUTS_PER_EXPANSION),
            bytes_max: self.options.budget.memory_max_bytes,
        };
        while let Some(cheaper) =
            neighborhood::cheaper(self.task, &self.generator, best, extent, self.cancel)
        {
            let costs_less = self.task.cost(&cheaper) < self.task.cost(best);
            *best = improve::eliminate(self.task, cheaper, self.cancel);
            if costs_less {
                tell(Told::Found(best));
            }
        }
    }

    /// Searches for cheaper plans until there is none or a limit is reached.
    fn improve(&mut self, mut best: Vec<OperatorId>, tell: &mut dyn FnMut(Told<'_>)) -> StopReason {
        // Where all steps cost the same, the first search was the first of these.
        let stages = WEIGHTS.into_iter().cycle().skip(usize::from(self.task.costs_equal));
        for weight in stages {
            let left = STAGE_MIN.max(self.statistics.expansions);
            let makes_room = left < self.options.budget.expansions_max;
            let expansions_max = left.min(self.options.budget.expansions_max);
            self.take_shortcuts(&mut best, expansions_max, tell);
            let budget = Budget { expansions_max, ..self.options.budget };
            let manner = Manner {
                weights: Weights::PlusOne,
                weight,
                bound: self.task.cost(&best),
                lists: LAMA,
            };
            let ff = FastForward::new(self.task, manner.weights);
            let mut search = Lazy::new(self.task, &self.generator, ff, manner, self.cancel);
            let result = run(&mut search, budget, self.cancel, tell);
            let found_here = search.statistics();
            self.statistics.expansions += found_here.expansions;
            self.statistics.evaluations += found_here.evaluations;
            match result {
                Ok(plan) => {
                    best = improve::eliminate(self.task, plan, self.cancel);
                    tell(Told::Found(&best));
                }
                Err(StopReason::ExpansionLimit { .. }) if makes_room => (),
                Err(StopReason::Exhausted) => {
                    // Where all steps cost the same, the cheapest plan is the shortest.
                    self.statistics.proven_optimal = self.task.costs_equal && self.is_provable();
                    return StopReason::GoalReached;
                }
                Err(reason) => return reason,
            }
        }
        StopReason::GoalReached
    }
}
