//! Solves a ground task: finds a first plan, and then better plans if the options request them.
//!
//! 1. Enforced hill climbing (`search::climbing`), which solves most tasks of buildings.
//! 2. Pruning of facts and operators that no plan can use (`prune`).
//! 3. A search for one part of the goal after the other (`search::goal_by_goal`), and for shortcuts
//!    near its plan (`search::neighborhood`).
//! 4. Search with several open lists (`search::lazy`), on one thread with restarts
//!    (`search::restarts`), or on two in parallel (`search::portfolio`).
//! 5. Removal of superfluous steps of the plan (`search::improve`).
//! 6. On small tasks, a search for a cheapest plan (`search::optimal`), with a proof.
//! 7. If better plans are requested: searches with decreasing weights, each for a cheaper plan than
//!    before, and between them searches for shortcuts (`search::neighborhood`).

use crate::configuration::SearchMethod;
use crate::heuristic::{Admissible, FastForward, LandmarkCut, Weights};
use crate::limits::{Budget, Cancel};
use crate::options::{Effort, Options};
use crate::outcome::{Statistics, StopReason};
use crate::prune::{Pruned, prune};
use crate::search::climbing::{ClimbingOutcome, HillClimbing};
use crate::search::goal_by_goal::GoalByGoal;
use crate::search::lazy::{LazySearch, List, SearchParameters};
use crate::search::neighborhood::NeighborhoodLimits;
use crate::search::optimal::{AStar, weight};
use crate::search::restarts::{RestartLimits, Restarts};
use crate::search::{Search, SearchProgress, improve, neighborhood, portfolio, run};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, Task};

/// Limit on the work of an optimal search without a requested proof, which follows a first plan.
/// When it is exceeded, the first plan is kept. The work is the number of explorations of the
/// delete relaxation times its size. The limit allows about a tenth of a second, and is sufficient
/// for problems of buildings.
const OPTIMAL_WORK_MAX: u64 = 5_000_000;

/// Weights of the heuristic in the consecutive searches for better plans: LAMA's sequence (Richter
/// and Westphal, 2010). `None` is greedy search.
const WEIGHTS: [Option<u32>; 5] = [None, Some(5), Some(3), Some(2), Some(1)];

/// Limit on the work of pruning after hill climbing, in words of 64 pairs of literals. If it is
/// exceeded, the task is searched unpruned. Pruning within this limit takes about half a second.
const PRUNING_MAX: u64 = 300_000_000;

/// Minimum limit on the expansions of one search for a better plan. When it reaches its limit, the
/// next search begins. The limit is higher if the searches so far made more expansions.
const STAGE_MIN: u64 = 10_000;

/// The search for one part of the goal after the other may make one of so many expansions of the
/// limit.
const QUICK_SHARE: u64 = 4;

/// Limits on the search for shortcuts after it: the steps of each round, the words of states that
/// these copy, and the rounds. They allow some hundredths of a second.
const QUICK_SHORTCUTS_MAX: u64 = 40_000;
const QUICK_SHORTCUT_WORDS_MAX: u64 = 4_000_000;
const QUICK_ROUNDS_MAX: u32 = 4;

/// Number of steps of the search for shortcuts per expansion of the previous searches. Such a step
/// takes a hundredth of the time of an expansion with its evaluation.
const SHORTCUTS_PER_EXPANSION: u64 = 8;

/// Open lists of the searches for better plans, as in the planner LAMA.
const LAMA: &[List] = &[List::Ff, List::FfPreferred, List::Landmarks, List::LandmarksPreferred];

/// Solver of one task.
pub(crate) struct Solver<'t> {
    task: &'t Task,
    generator: SuccessorGenerator,
    options: &'t Options,
    /// What the searches may use: the limits of the options, less the memory of the task.
    budget: Budget,
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
        Solver::within(options.budget, task, options, cancel, statistics)
    }

    /// Creates a solver of a task within a budget, from which the memory of the task is taken.
    fn within(
        budget: Budget,
        task: &'t Task,
        options: &'t Options,
        cancel: &'t Cancel,
        statistics: &'t mut Statistics,
    ) -> Solver<'t> {
        let generator = SuccessorGenerator::new(task);
        let held_bytes = task.bytes() + generator.bytes();
        let memory_max_bytes = budget.memory_max_bytes.saturating_sub(held_bytes);
        let budget = Budget { memory_max_bytes, ..budget };
        Solver { task, generator, options, budget, cancel, statistics }
    }

    /// Runs all stages. Calls `tell` with the progress and with every improved plan. Returns the
    /// reason why there is no plan, or no better plan than the last one.
    pub(crate) fn run(&mut self, tell: &mut dyn FnMut(SearchProgress<'_>)) -> StopReason {
        match self.run_stages(tell) {
            // The caller knows the limit of the whole call, not what the task leaves of it.
            StopReason::MemoryLimit { .. } => {
                StopReason::MemoryLimit { limit: self.options.budget.memory_max_bytes }
            }
            StopReason::ExpansionLimit { .. } => {
                StopReason::ExpansionLimit { limit: self.options.budget.expansions_max }
            }
            reason => reason,
        }
    }

    fn run_stages(&mut self, tell: &mut dyn FnMut(SearchProgress<'_>)) -> StopReason {
        let first = match self.climb() {
            ClimbingOutcome::Plan(plan) if self.options.effort == Effort::First => {
                return self.finish(plan, tell);
            }
            ClimbingOutcome::Plan(plan) => Some(plan),
            ClimbingOutcome::DeadEnd => return StopReason::Unsolvable { before_search: true },
            ClimbingOutcome::GaveUp => None,
        };
        let bytes_max = self.budget.memory_max_bytes / 8;
        match prune(self.task, PRUNING_MAX, bytes_max, self.cancel) {
            Pruned::Nothing => StopReason::Unsolvable { before_search: true },
            Pruned::Everything => self.solve_pruned(first, tell),
            Pruned::Smaller(smaller) => {
                let first = first.and_then(|plan| smaller.translate(&plan));
                let (task, options, cancel) = (&smaller.task, self.options, self.cancel);
                let mut solver =
                    Solver::within(self.budget, task, options, cancel, self.statistics);
                solver.solve_pruned(first, &mut |told| match told {
                    SearchProgress::Found(plan) => {
                        tell(SearchProgress::Found(&smaller.original(plan)))
                    }
                    told => tell(told),
                })
            }
        }
    }

    /// Whether a cheapest plan of the ground task is also a cheapest plan of the PDDL texts.
    fn is_provable(&self) -> bool {
        self.task.unprovable.is_none()
    }

    /// Runs hill climbing. If it gives up in a task with numbers, runs it again with relaxed plans
    /// that cover their deficits. Returns [`ClimbingOutcome::GaveUp`] also if the configuration does
    /// not include hill climbing.
    fn climb(&mut self) -> ClimbingOutcome {
        if !matches!(self.options.configuration.method, SearchMethod::Lists { is_quick: true, .. })
        {
            return ClimbingOutcome::GaveUp;
        }
        let mut ff = FastForward::new(self.task, Weights::Unit);
        let covering: &[bool] = if ff.may_have_deficits() { &[false, true] } else { &[false] };
        let mut climbed = ClimbingOutcome::GaveUp;
        for &covers in covering {
            ff.set_covering(covers);
            let mut climb = HillClimbing::new(self.task, &mut ff);
            climbed = climb.run(self.cancel);
            self.statistics.evaluations += climb.evaluations;
            self.statistics.expansions += climb.expansions;
            if !matches!(climbed, ClimbingOutcome::GaveUp) {
                break;
            }
        }
        climbed
    }

    /// Continues with the pruned task: searches for a first plan unless `first` is one, then for
    /// better plans.
    fn solve_pruned(
        &mut self,
        first: Option<Vec<OperatorId>>,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> StopReason {
        match first.map_or_else(|| self.first(tell), Ok) {
            Ok(plan) => self.finish(plan, tell),
            Err(reason) => reason,
        }
    }

    /// Searches for a first plan with the search method of the configuration.
    fn first(
        &mut self,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> Result<Vec<OperatorId>, StopReason> {
        match self.options.configuration.method {
            SearchMethod::Lists { is_quick, lists } => self.search((is_quick, lists), tell),
            SearchMethod::AStar { heuristic } => self.a_star(heuristic, tell),
        }
    }

    /// Removes superfluous steps from a first plan and reports the plan, then searches for better
    /// plans.
    fn finish(
        &mut self,
        first: Vec<OperatorId>,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> StopReason {
        if self.statistics.proven_optimal {
            tell(SearchProgress::Found(&first));
            return StopReason::GoalReached;
        }
        let first = improve::eliminate(self.task, first, self.cancel);
        // If costs are not exact, a plan that seems cheaper may be more expensive. The validator
        // computes the true costs and therefore receives both plans.
        // The search for a cheapest plan may end at a limit of time or memory.
        let is_told = self.options.effort != Effort::First || !self.is_provable();
        if is_told {
            tell(SearchProgress::Found(&first));
        }
        let (best, reason) = self.cheapest(first.clone(), tell);
        if !is_told || best != first {
            tell(SearchProgress::Found(&best));
        }
        match self.options.effort {
            Effort::Anytime if !self.statistics.proven_optimal => self.improve(best, tell),
            Effort::Optimal if !self.statistics.proven_optimal => reason,
            _ => StopReason::GoalReached,
        }
    }

    /// Searches for a first plan with several open lists, on one or two threads. If the configuration
    /// includes quick searches, reaches one part of the goal after the other first.
    fn search(
        &mut self,
        (is_quick, lists): (bool, &'static [List]),
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> Result<Vec<OperatorId>, StopReason> {
        let (task, generator, mut budget) = (self.task, &self.generator, self.budget);
        let mut ff = FastForward::new(task, Weights::Unit);
        if is_quick && task.goal.len() > 1 {
            let expansions_max = budget.expansions_max / QUICK_SHARE;
            let share = Budget { expansions_max, ..budget };
            let mut search = GoalByGoal::new(task, generator, &mut ff, (share, self.cancel));
            let plan = search.run();
            self.statistics.expansions += search.expansions;
            self.statistics.evaluations += search.evaluations;
            budget.expansions_max = budget.expansions_max.saturating_sub(search.expansions);
            if let Some(plan) = plan {
                return Ok(self.shortened(plan));
            }
        }
        let (result, found) = if self.options.threads > 1 {
            portfolio::run(task, generator, ff, lists, budget, self.cancel, tell)
        } else {
            let mut search = Restarts::new(task, generator, ff, lists, budget, self.cancel);
            (search.run(RestartLimits::default(), tell), search.statistics())
        };
        self.statistics.expansions += found.expansions;
        self.statistics.evaluations += found.evaluations;
        result
    }

    fn a_star(
        &mut self,
        heuristic: Admissible,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> Result<Vec<OperatorId>, StopReason> {
        let evaluator = heuristic.evaluator(self.task);
        let mut search = AStar::new(self.task, &self.generator, evaluator, u64::MAX, u64::MAX);
        let result = run(&mut search, self.budget, self.cancel, tell);
        self.statistics.expansions = search.expansions();
        match result {
            Ok(plan) => {
                self.statistics.proven_optimal = self.is_provable();
                Ok(plan)
            }
            // The search has dropped states with costs that exceed the range of numbers, so this is
            // no proof.
            Err(StopReason::Exhausted) if search.has_overflowed() => Err(StopReason::Exhausted),
            // Without a bound, the search drops only states that the admissible heuristic proves to
            // be dead ends.
            Err(StopReason::Exhausted) => Err(StopReason::Unsolvable { before_search: false }),
            Err(reason) => Err(reason),
        }
    }

    /// Returns the cheapest plan if it is requested or can be found with little work, and otherwise
    /// `first`. Also returns the reason why the search for the cheapest plan ended.
    fn cheapest(
        &mut self,
        first: Vec<OperatorId>,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> (Vec<OperatorId>, StopReason) {
        let is_asked = self.options.effort == Effort::Optimal;
        // A* expands at least the states of a plan, and each evaluation needs about as many cuts as
        // there are steps left.
        let needed = (first.len() as u64).saturating_mul(first.len() as u64).max(1);
        // The evaluator, which is as large as the task, has at least one part per operator.
        let operators = self.task.operators.len().max(1) as u64;
        if !is_asked && OPTIMAL_WORK_MAX / operators < needed {
            return (first, StopReason::Exhausted);
        }
        let evaluator = LandmarkCut::new(self.task);
        let size = evaluator.size().max(1) as u64;
        let (explorations_max, expansions_max) = match is_asked {
            true => (u64::MAX, self.budget.expansions_max),
            false => (OPTIMAL_WORK_MAX / size, self.options.optimal_expansions_max),
        };
        if expansions_max == 0 || explorations_max < needed {
            return (first, StopReason::Exhausted);
        }
        let bound = weight(self.task, &first);
        let mut search =
            AStar::new(self.task, &self.generator, Box::new(evaluator), bound, explorations_max);
        if !is_asked {
            search.give_up_if_slow(first.len());
        }
        let budget = Budget { expansions_max, ..self.budget };
        let result = run(&mut search, budget, self.cancel, tell);
        self.statistics.optimal_expansions = search.expansions();
        // Rounded costs are no basis for a proof.
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

    /// Removes superfluous steps and the nearest detours from a plan that reaches one part of the goal
    /// after the other: the way between two parts is often not the shortest one.
    fn shortened(&self, mut plan: Vec<OperatorId>) -> Vec<OperatorId> {
        let words = self.task.fact_count.div_ceil(64) + self.task.values.len();
        let steps_max = (QUICK_SHORTCUT_WORDS_MAX / words.max(1) as u64).min(QUICK_SHORTCUTS_MAX);
        let extent = NeighborhoodLimits { steps_max, bytes_max: self.budget.memory_max_bytes };
        for _ in 0..QUICK_ROUNDS_MAX {
            plan = improve::eliminate(self.task, plan, self.cancel);
            let cheaper =
                neighborhood::cheaper(self.task, &self.generator, &plan, extent, self.cancel);
            let Some(cheaper) = cheaper else { break };
            plan = cheaper;
        }
        plan
    }

    /// Searches for shortcuts near the plan, and then near each new plan, until there are no more.
    /// Calls `tell` with each plan that costs less than the previous one.
    fn take_shortcuts(
        &mut self,
        best: &mut Vec<OperatorId>,
        expansions: u64,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) {
        let extent = NeighborhoodLimits {
            steps_max: expansions.saturating_mul(SHORTCUTS_PER_EXPANSION),
            bytes_max: self.budget.memory_max_bytes,
        };
        while let Some(cheaper) =
            neighborhood::cheaper(self.task, &self.generator, best, extent, self.cancel)
        {
            let costs_less = self.task.cost(&cheaper) < self.task.cost(best);
            *best = improve::eliminate(self.task, cheaper, self.cancel);
            if costs_less {
                tell(SearchProgress::Found(best));
            }
        }
    }

    /// Searches for plans of decreasing cost until there is none or a limit is reached.
    fn improve(
        &mut self,
        mut best: Vec<OperatorId>,
        tell: &mut dyn FnMut(SearchProgress<'_>),
    ) -> StopReason {
        // If all steps have the same cost, the first search was already the greedy stage.
        let stages = WEIGHTS.into_iter().cycle().skip(usize::from(self.task.costs_equal));
        for weight in stages {
            let left = STAGE_MIN.max(self.statistics.expansions);
            let makes_room = left < self.budget.expansions_max;
            let expansions_max = left.min(self.budget.expansions_max);
            self.take_shortcuts(&mut best, expansions_max, tell);
            let budget = Budget { expansions_max, ..self.budget };
            let manner = SearchParameters {
                weights: Weights::PlusOne,
                weight,
                bound: self.task.cost(&best),
                lists: LAMA,
            };
            let ff = FastForward::new(self.task, manner.weights);
            let mut search = LazySearch::new(self.task, &self.generator, ff, manner, self.cancel);
            let result = run(&mut search, budget, self.cancel, tell);
            let found_here = search.statistics();
            self.statistics.expansions += found_here.expansions;
            self.statistics.evaluations += found_here.evaluations;
            match result {
                Ok(plan) => {
                    best = improve::eliminate(self.task, plan, self.cancel);
                    tell(SearchProgress::Found(&best));
                }
                Err(StopReason::ExpansionLimit { .. }) if makes_room => (),
                // The greedy stage keeps the first path to a state, so a cheaper one was perhaps dropped.
                Err(StopReason::Exhausted) if weight.is_none() => (),
                Err(StopReason::Exhausted) => {
                    // If all steps have the same cost, a cheapest plan is a shortest plan.
                    self.statistics.proven_optimal = self.task.costs_equal && self.is_provable();
                    return StopReason::GoalReached;
                }
                Err(reason) => return reason,
            }
        }
        StopReason::GoalReached
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::configuration;
    use crate::test_tasks::task;

    #[test]
    fn the_task_counts_towards_the_limit_of_memory() {
        let domain = "(define (domain d) (:predicates (at ?x) (next ?x ?y))
            (:action go :parameters (?x ?y) :precondition (and (at ?x) (next ?x ?y))
              :effect (and (not (at ?x)) (at ?y))))";
        let problem = "(define (problem p) (:domain d) (:objects a b c)
            (:init (at a) (next a b) (next b c) (next c a)) (:goal (at c)))";
        let (task, cancel) = (task(domain, problem), Cancel::new());
        let configuration = configuration("lama-first").expect("a configuration");
        let with_limit = |limit| {
            let budget = Budget { memory_max_bytes: limit, ..Budget::default() };
            let options = Options { budget, configuration, ..Options::default() };
            Solver::new(&task, &options, &cancel, &mut Statistics::default()).run(&mut |_| ())
        };
        let held = task.bytes() + SuccessorGenerator::new(&task).bytes();
        assert_eq!(with_limit(held), StopReason::MemoryLimit { limit: held });
        assert_eq!(with_limit(held + (1 << 20)), StopReason::GoalReached);
    }
}
