//! LM-cut: a sum of landmarks, each a set of operators one of which every plan needs (Helmert and
//! Domshlak, 2009). Admissible; sees goals that must be paid for one by one, which h_max does not.
//!
//! Relaxed operators of one operator share its cost, so that an action with several conditional
//! effects is never charged twice for one application.

use super::Evaluator;
use super::queue::CostQueue;
use super::relaxation::{Relaxation, UNREACHED, Weights};
use crate::rows::Rows;
use crate::state::State;
use crate::task::Task;

/// LM-cut, counting costs first and steps second.
#[derive(Debug)]
pub(crate) struct LandmarkCut {
    relaxation: Relaxation,
    /// Relaxed operators that add a proposition.
    adding: Rows,
    /// What is left of each operator's weight.
    remaining: Vec<u64>,
    costs: Vec<u64>,
    missing: Vec<u32>,
    /// The dearest precondition of each relaxed operator; the last one to be reached.
    supporters: Vec<u32>,
    queue: CostQueue,
    initial: Vec<u32>,
    zones: Vec<Zone>,
    waiting: Vec<u32>,
    cut: Vec<u32>,
    explorations: u64,
    explorations_max: u64,
}

/// Where a proposition lies, as seen from a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Zone {
    Unseen,
    /// The goal follows from it without further cost.
    Goal,
    /// Reached from the state without crossing the cut.
    Before,
}

/// Cuts in one evaluation: many more than the goals of a task that is small enough for this.
const CUTS_MAX: u64 = 500;

/// The supporter of relaxed operators without preconditions.
const NOTHING: u32 = u32::MAX;

// === impl LandmarkCut ===

impl LandmarkCut {
    pub(crate) fn new(task: &Task) -> LandmarkCut {
        let relaxation = Relaxation::new(task, Weights::CostThenSteps);
        LandmarkCut {
            adding: relaxation.adding(),
            remaining: vec![0; task.operator_count()],
            costs: Vec::new(),
            missing: Vec::new(),
            supporters: vec![NOTHING; relaxation.relaxed_count()],
            queue: CostQueue::default(),
            initial: Vec::new(),
            zones: vec![Zone::Unseen; relaxation.proposition_count()],
            waiting: Vec::new(),
            cut: Vec::new(),
            explorations: 0,
            explorations_max: CUTS_MAX,
            relaxation,
        }
    }

    fn cost(&self, relaxed: u32) -> u64 {
        self.relaxation.origin(relaxed).map_or(0, |operator| self.remaining[operator.index()])
    }

    /// Computes h_max over what is left of the weights.
    fn explore(&mut self) {
        self.costs.clear();
        self.costs.resize(self.relaxation.proposition_count(), UNREACHED);
        self.missing.clear();
        self.missing.extend_from_slice(self.relaxation.missing());
        self.queue.clear();
        for index in 0..self.initial.len() {
            self.reach(self.initial[index], 0);
        }
        for index in 0..self.relaxation.free().len() {
            self.fire(self.relaxation.free()[index], 0);
        }
        while let Some((cost, proposition)) = self.queue.pop() {
            if self.costs[proposition as usize] < cost {
                continue;
            }
            for index in 0..self.relaxation.asking(proposition).len() {
                let relaxed = self.relaxation.asking(proposition)[index];
                let missing = &mut self.missing[relaxed as usize];
                *missing -= 1;
                if *missing == 0 {
                    self.supporters[relaxed as usize] = proposition;
                    self.fire(relaxed, cost);
                }
            }
        }
    }

    fn fire(&mut self, relaxed: u32, cost: u64) {
        let total = cost.saturating_add(self.cost(relaxed)).min(UNREACHED - 1);
        for index in 0..self.relaxation.adds(relaxed).len() {
            self.reach(self.relaxation.adds(relaxed)[index], total);
        }
    }

    fn reach(&mut self, proposition: u32, cost: u64) {
        if cost < self.costs[proposition as usize] {
            self.costs[proposition as usize] = cost;
            self.queue.push(cost, proposition);
        }
    }

    /// The dearest proposition of the goal, and its cost.
    fn dearest_goal(&self) -> Option<(u64, u32)> {
        let goal = self.relaxation.goal().iter();
        goal.map(|goal| (self.costs[*goal as usize], *goal)).max()
    }

    /// Marks what leads to `goal` without cost.
    fn mark_goal_zone(&mut self, goal: u32) {
        self.zones.fill(Zone::Unseen);
        self.zones[goal as usize] = Zone::Goal;
        self.waiting.push(goal);
        while let Some(proposition) = self.waiting.pop() {
            for &relaxed in self.adding.row(proposition) {
                let is_reached = self.missing[relaxed as usize] == 0;
                if !is_reached || self.cost(relaxed) > 0 {
                    continue;
                }
                let supporter = self.supporters[relaxed as usize];
                if supporter != NOTHING && self.zones[supporter as usize] == Zone::Unseen {
                    self.zones[supporter as usize] = Zone::Goal;
                    self.waiting.push(supporter);
                }
            }
        }
    }

    /// Collects the relaxed operators that lead from before the cut into the goal zone.
    fn find_cut(&mut self) {
        self.cut.clear();
        for index in 0..self.initial.len() {
            self.enter(self.initial[index]);
        }
        for index in 0..self.relaxation.free().len() {
            self.cross(self.relaxation.free()[index]);
        }
        while let Some(proposition) = self.waiting.pop() {
            for index in 0..self.relaxation.asking(proposition).len() {
                let relaxed = self.relaxation.asking(proposition)[index];
                let is_reached = self.missing[relaxed as usize] == 0;
                if is_reached && self.supporters[relaxed as usize] == proposition {
                    self.cross(relaxed);
                }
            }
        }
    }

    fn enter(&mut self, proposition: u32) {
        let zone = &mut self.zones[proposition as usize];
        if *zone == Zone::Unseen {
            *zone = Zone::Before;
            self.waiting.push(proposition);
        }
    }

    fn cross(&mut self, relaxed: u32) {
        let adds = self.relaxation.adds(relaxed);
        let is_goal = |proposition: &u32| self.zones[*proposition as usize] == Zone::Goal;
        if adds.iter().any(is_goal) {
            self.cut.push(relaxed);
        }
        for index in 0..self.relaxation.adds(relaxed).len() {
            self.enter(self.relaxation.adds(relaxed)[index]);
        }
    }

    /// Charges the cut; returns what it costs.
    fn charge(&mut self) -> u64 {
        let price = self.cut.iter().map(|relaxed| self.cost(*relaxed)).min().unwrap_or(0);
        let mut operators: Vec<_> =
            self.cut.iter().filter_map(|relaxed| self.relaxation.origin(*relaxed)).collect();
        operators.sort_unstable();
        operators.dedup();
        for operator in operators {
            self.remaining[operator.index()] -= price;
        }
        price
    }
}

impl Evaluator for LandmarkCut {
    fn evaluate(&mut self, state: &State) -> Option<u64> {
        self.initial.clear();
        self.relaxation.initial(state, &mut self.initial);
        self.relaxation.weights(&mut self.remaining);
        self.explorations = 0;
        let mut total: u64 = 0;
        loop {
            if self.explorations >= self.explorations_max {
                // What is left out makes the estimate lower, and so keeps it admissible.
                return Some(total);
            }
            self.explorations += 1;
            self.explore();
            match self.dearest_goal() {
                Some((UNREACHED, _)) => return None,
                None | Some((0, _)) => return Some(total),
                Some((_, goal)) => self.mark_goal_zone(goal),
            }
            self.find_cut();
            let price = self.charge();
            if price == 0 {
                // Cannot happen while weights are finite; stopping here stays admissible.
                return Some(total);
            }
            total = total.saturating_add(price);
        }
    }

    fn limit(&mut self, explorations_max: u64) {
        self.explorations_max = explorations_max.min(CUTS_MAX);
    }

    fn explorations(&self) -> u64 {
        self.explorations
    }
}
