//! A* with an admissible heuristic: finds a cheapest plan with the fewest steps.
//!
//! With a bound, only plans with a smaller weight than the bound are searched for. If there is
//! none, the plan with the weight of the bound is optimal.
//!
//! A search with a bound and with limited work also gives up when its lower bound rises so slowly that
//! the rest of the work will not suffice (`outlook`).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::outlook::SearchOutlook;
use super::{Search, SearchStep};
use crate::heuristic::{Evaluator, Weights};
use crate::outcome::StopReason;
use crate::progression::Progression;
use crate::state::{StateId, StateSpace, all_hold};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, Task};

/// Entry of the open list: the state's `f`, its `h`, its id, and its `g` at the time of queueing.
/// Entries are sorted by the smallest `f`, then by the smallest `h`, then by the newest state.
type AStarEntry = Reverse<(u64, u64, Reverse<StateId>, u64)>;

/// Value of `estimates` for a state without an evaluation.
const UNKNOWN: u64 = u64::MAX;

/// Value of `estimates` for a dead end.
const DEAD_END: u64 = u64::MAX - 1;

/// An A* search for a plan with a smaller weight than a bound. The number of explorations of the
/// relaxation is limited.
pub(crate) struct AStar<'t> {
    task: &'t Task,
    evaluator: Box<dyn Evaluator + 't>,
    progression: Progression<'t>,
    generator: &'t SuccessorGenerator,
    space: StateSpace,
    /// Per state: the least weight of the known paths to it.
    distances: Vec<u64>,
    /// Per state: its heuristic estimate, or [`UNKNOWN`] before the evaluation.
    estimates: Vec<u64>,
    open: BinaryHeap<AStarEntry>,
    bound: u64,
    explorations_max: u64,
    explorations: u64,
    expansions: u64,
    /// Whether the rest of the work will suffice; `None` if the search goes on in any case.
    outlook: Option<SearchOutlook>,
    is_given_up: bool,
    /// Whether a state was dropped because its weight exceeds the range of `u64`.
    has_overflowed: bool,
    successor: Vec<u64>,
    applicable: Vec<OperatorId>,
}

/// Returns the weight of a sequence of operators in A*.
pub(crate) fn weight(task: &Task, operators: &[OperatorId]) -> u64 {
    let weights =
        operators.iter().map(|id| Weights::CostThenSteps.weight(task, task.operator(*id)));
    weights.fold(0, u64::saturating_add)
}

// === impl AStar ===

impl<'t> AStar<'t> {
    pub(crate) fn new(
        task: &'t Task,
        generator: &'t SuccessorGenerator,
        evaluator: Box<dyn Evaluator + 't>,
        bound: u64,
        explorations_max: u64,
    ) -> AStar<'t> {
        let mut progression = Progression::new(task);
        let space = StateSpace::new(&progression.initial());
        let mut search = AStar {
            task,
            evaluator,
            progression,
            generator,
            space,
            distances: vec![0],
            estimates: vec![UNKNOWN],
            open: BinaryHeap::new(),
            bound,
            explorations_max,
            explorations: 0,
            expansions: 0,
            outlook: None,
            is_given_up: false,
            has_overflowed: false,
            successor: Vec::new(),
            applicable: Vec::new(),
        };
        search.queue(StateId(0), 0, 0, 0);
        search
    }

    /// Lets the search give up when its lower bound rises too slowly. `steps` is the number of steps of
    /// the plan that has the weight of the bound.
    pub(crate) fn give_up_if_slow(&mut self, steps: usize) {
        self.outlook = Some(SearchOutlook::new(self.bound, steps, self.explorations_max));
    }

    fn queue(&mut self, id: StateId, g: u64, h: u64, f: u64) {
        if f < self.bound {
            self.open.push(Reverse((f, h, Reverse(id), g)));
        } else if self.bound == u64::MAX {
            self.has_overflowed = true;
        }
    }

    /// Whether a search without a bound dropped a state because its weight exceeds the range of
    /// `u64`.
    pub(crate) fn has_overflowed(&self) -> bool {
        self.has_overflowed
    }

    /// Returns the heuristic estimate of a state after a path with the weight `g`. The evaluator
    /// may stop when the estimate is large enough to exclude plans below the bound.
    fn estimate(&mut self, id: StateId, g: u64) -> u64 {
        let known = self.estimates[id.0 as usize];
        if known != UNKNOWN {
            return known;
        }
        let explorations_max = self.explorations_max.saturating_sub(self.explorations).max(1);
        self.evaluator.limit(explorations_max, self.bound.saturating_sub(g));
        let way = self.space.transition(id);
        let estimate = self.evaluator.evaluate_after(self.space.state(id), id, way);
        self.explorations += self.evaluator.explorations();
        let estimate = estimate.map_or(DEAD_END, |estimate| estimate.min(DEAD_END - 1));
        self.estimates[id.0 as usize] = estimate;
        estimate
    }

    /// Queues a successor with the estimate of its parent minus the weight of the step. This
    /// estimate is still a lower bound (pathmax), so that most states need no evaluation.
    fn generate(&mut self, parent: StateId, operator: OperatorId, (f, h, g): (u64, u64, u64)) {
        let from = self.space.state(parent);
        let ground = self.task.operator(operator);
        if !self.progression.apply(ground, from, &mut self.successor) {
            return;
        }
        let weight = Weights::CostThenSteps.weight(self.task, ground);
        let g = g.saturating_add(weight);
        let (id, is_new) = self.space.insert(&self.successor, parent, operator);
        if is_new {
            self.distances.push(g);
            self.estimates.push(UNKNOWN);
        } else if g < self.distances[id.0 as usize] {
            self.distances[id.0 as usize] = g;
            self.space.reparent(id, parent, operator);
        } else {
            return;
        }
        let h = h.saturating_sub(weight);
        self.queue(id, g, h, f.max(g.saturating_add(h)));
    }
}

impl Search for AStar<'_> {
    fn step(&mut self) -> SearchStep {
        if self.explorations > self.explorations_max {
            return SearchStep::Exhausted;
        }
        let Some(Reverse((f, h, Reverse(id), g))) = self.open.pop() else {
            return SearchStep::Exhausted;
        };
        if g > self.distances[id.0 as usize] {
            return SearchStep::InProgress;
        }
        if self.outlook.as_ref().is_some_and(|it| it.is_hopeless(f, self.explorations)) {
            self.is_given_up = true;
            return SearchStep::Exhausted;
        }
        let estimate = self.estimate(id, g);
        let raised = f.max(g.saturating_add(estimate));
        if estimate == DEAD_END || raised > f {
            if estimate != DEAD_END {
                self.queue(id, g, estimate, raised);
            }
            return SearchStep::InProgress;
        }
        let h = h.max(estimate);
        let state = self.space.state(id);
        if all_hold(state, &self.task.goal) {
            return SearchStep::Solved(self.space.path(id));
        }
        if let Some(outlook) = &mut self.outlook {
            outlook.note_expansion(f, h, self.explorations);
        }
        self.expansions += 1;
        let mut applicable = std::mem::take(&mut self.applicable);
        self.generator.applicable(self.task, state, &mut applicable);
        for &operator in &applicable {
            self.generate(id, operator, (f, h, g));
        }
        self.applicable = applicable;
        SearchStep::InProgress
    }

    fn expansions(&self) -> u64 {
        self.expansions
    }

    fn bytes(&self) -> usize {
        let per_state = self.distances.capacity() * 16;
        let open = self.open.capacity() * size_of::<AStarEntry>();
        self.space.bytes() + open + per_state + self.evaluator.bytes()
    }

    /// Returns the stop reason for an empty open list. It is never [`StopReason::Unsolvable`]: the
    /// search considers only plans below the bound, so plans above the bound may exist.
    fn exhausted(&self) -> StopReason {
        if self.is_given_up || self.explorations > self.explorations_max {
            StopReason::ExpansionLimit { limit: self.expansions }
        } else {
            StopReason::Exhausted
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heuristic::LandmarkCut;
    use crate::limits::{Budget, Cancel};
    use crate::search::run;
    use crate::test_tasks::task;

    /// Carries balls from one room to another, two at a time. The heuristic counts a step for each ball
    /// to be picked up and dropped, and does not see how often the robot has to go.
    fn balls(count: usize) -> Task {
        let domain = "(define (domain d) (:requirements :typing) (:types room ball hand)
            (:predicates (here ?r - room) (at ?b - ball ?r - room) (free ?h - hand)
              (held ?b - ball ?h - hand))
            (:action go :parameters (?x ?y - room) :precondition (here ?x)
              :effect (and (not (here ?x)) (here ?y)))
            (:action pick :parameters (?b - ball ?r - room ?h - hand)
              :precondition (and (here ?r) (at ?b ?r) (free ?h))
              :effect (and (held ?b ?h) (not (at ?b ?r)) (not (free ?h))))
            (:action drop :parameters (?b - ball ?r - room ?h - hand)
              :precondition (and (here ?r) (held ?b ?h))
              :effect (and (not (held ?b ?h)) (at ?b ?r) (free ?h))))";
        let all = |text: &str| {
            let each = (0..count).map(|ball| text.replace('#', &format!("b{ball}")));
            each.collect::<Vec<_>>().join(" ")
        };
        let problem = format!(
            "(define (problem p) (:domain d) (:objects x y - room {} - ball left right - hand)
                (:init (here x) (free left) (free right) {}) (:goal (and {})))",
            all("#"),
            all("(at # x)"),
            all("(at # y)")
        );
        task(domain, &problem)
    }

    /// Searches for a plan of fewer steps than `bound`. Returns the reason of the end, and the share of
    /// the work that was spent.
    fn search(task: &Task, bound: u64, work_max: u64, may_give_up: bool) -> (StopReason, f64) {
        let generator = SuccessorGenerator::new(task);
        let evaluator = Box::new(LandmarkCut::new(task));
        let unit = weight(task, &[OperatorId(0)]);
        let mut search = AStar::new(task, &generator, evaluator, bound * unit, work_max);
        if may_give_up {
            search.give_up_if_slow(bound as usize);
        }
        let ended = run(&mut search, Budget::default(), &Cancel::new(), &mut |_| ());
        let reason = ended.err().unwrap_or(StopReason::GoalReached);
        (reason, search.explorations as f64 / work_max as f64)
    }

    #[test]
    fn a_search_without_prospects_is_given_up_early() {
        let task = balls(12);
        let is_limited = |reason| matches!(reason, StopReason::ExpansionLimit { .. });
        let (reason, spent) = search(&task, 50, 20_000, true);
        assert!(is_limited(reason) && spent < 0.3, "{reason:?} {spent}");
        let (reason, spent) = search(&task, 50, 20_000, false);
        assert!(is_limited(reason) && spent > 0.9, "{reason:?} {spent}");
    }

    #[test]
    fn a_search_that_ends_long_before_its_limit_is_not_given_up() {
        // Six balls need seventeen steps, and the estimate of the initial state is thirteen.
        let (task, plenty) = (balls(6), 1 << 40);
        for (bound, expected) in [(17, StopReason::Exhausted), (20, StopReason::GoalReached)] {
            let (_, spent) = search(&task, bound, plenty, false);
            let work = (spent * plenty as f64) as u64;
            let (reason, _) = search(&task, bound, work * 5, true);
            assert_eq!(reason, expected);
        }
    }
}
