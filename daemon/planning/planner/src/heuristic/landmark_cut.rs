//! LM-cut: the sum of the costs of disjunctive action landmarks (Helmert and Domshlak, 2009). Such
//! a landmark is a set of operators of which every plan contains at least one. The heuristic is
//! admissible. Unlike h_max, it adds the costs of several goals.
//!
//! A landmark of a state is also a landmark of a successor state, unless it contains the operator
//! that leads to the successor. Most landmarks of an evaluation are therefore copied from the
//! parent state (Pommerening and Helmert, 2013).
//!
//! Relaxed operators that come from one operator share its cost, so that an action with several
//! conditional effects is charged only once for one application.

use super::cost_queue::CostQueue;
use super::relaxation::{Relaxation, UNREACHED, Weights};
use std::ops::Range;

use super::Evaluator;
use crate::rows::Rows;
use crate::state::{State, StateId, Transition};
use crate::task::Task;

/// The LM-cut heuristic of a task, with scratch space. Plans are compared by cost, and plans of
/// equal cost by the number of steps.
#[derive(Debug)]
pub(crate) struct LandmarkCut {
    relaxation: Relaxation,
    /// Per proposition: the relaxed operators that add it.
    adding: Rows,
    /// Per operator: its cost minus the costs that earlier cuts have charged.
    remaining: Vec<u64>,
    costs: Vec<u64>,
    missing: Vec<u32>,
    /// Per relaxed operator: its supporter, the precondition with the greatest h_max cost.
    supporters: Vec<u32>,
    /// Per relaxed operator: the h_max cost of its supporter.
    supported: Vec<u64>,
    /// Per relaxed operator: the operator that it comes from, with which it shares the cost. Axioms
    /// share an additional entry with the cost zero.
    origins: Vec<u32>,
    /// Per operator: its relaxed operators.
    parts: Rows,
    charged: Vec<u32>,
    queue: CostQueue,
    initial: Vec<u32>,
    zones: Vec<Zone>,
    waiting: Vec<u32>,
    cut: Vec<u32>,
    explorations: u64,
    explorations_max: u64,
    enough: u64,
    known: LandmarkStore,
}

/// Stored landmarks of evaluated states, up to a limit on memory.
#[derive(Debug, Default)]
struct LandmarkStore {
    /// Per state: the start and the end of its landmarks in `prices`.
    ranges: Vec<(u32, u32)>,
    /// Per landmark: its cost, and the end of its operators in `operators`. The operators begin at
    /// the end of the previous landmark's operators.
    prices: Vec<(u64, u32)>,
    operators: Vec<u32>,
}

/// Limit on the number of operators in all stored landmarks: about 64 MiB. When it is exceeded, the
/// landmarks of further states are not stored.
const KEPT_MAX: usize = 1 << 24;

/// Zone of a proposition in the justification graph, relative to a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Zone {
    Unseen,
    /// Goal zone: the goal is reachable from the proposition at no further cost.
    Goal,
    /// Before zone: the proposition is reachable from the state without crossing the cut.
    Before,
}

/// Limit on the number of cuts in one evaluation, far above the number of goals in a task that is
/// small enough for LM-cut. At the limit, the costs of the cuts found so far are the estimate.
const CUTS_MAX: u64 = 500;

/// Supporter of a relaxed operator without preconditions.
const NOTHING: u32 = u32::MAX;

// === impl LandmarkCut ===

impl LandmarkCut {
    pub(crate) fn new(task: &Task) -> LandmarkCut {
        let relaxation = Relaxation::new(task, Weights::CostThenSteps);
        let operators = task.operator_count();
        let origin = |relaxed| relaxation.origin(relaxed).map_or(operators, |one| one.index());
        let all = 0..relaxation.relaxed_count() as u32;
        let origins: Vec<u32> = all.map(|relaxed| origin(relaxed) as u32).collect();
        let pairs = origins.iter().copied().zip(0..);
        LandmarkCut {
            parts: Rows::collect(operators + 1, pairs),
            supported: vec![0; origins.len()],
            origins,
            charged: Vec::new(),
            adding: relaxation.adding(),
            // The last entry is that of the axioms.
            remaining: vec![0; operators + 1],
            costs: Vec::new(),
            missing: Vec::new(),
            supporters: vec![NOTHING; relaxation.relaxed_count()],
            // With these weights, a single cost is already greater than the length of most plans.
            queue: CostQueue::of_great_costs(),
            initial: Vec::new(),
            zones: vec![Zone::Unseen; relaxation.proposition_count()],
            waiting: Vec::new(),
            cut: Vec::new(),
            explorations: 0,
            explorations_max: CUTS_MAX,
            enough: u64::MAX,
            known: LandmarkStore::default(),
            relaxation,
        }
    }

    /// Returns the size of the relaxation, which is a measure of the work of one exploration.
    pub(crate) fn size(&self) -> usize {
        self.relaxation.size()
    }

    fn cost(&self, relaxed: u32) -> u64 {
        self.remaining[self.origins[relaxed as usize] as usize]
    }

    /// Computes the h_max costs of all propositions from the remaining costs of the operators.
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
                    self.supported[relaxed as usize] = cost;
                    self.fire(relaxed, cost);
                }
            }
        }
    }

    /// Updates the h_max costs after the remaining costs of some operators have decreased. Only
    /// propositions with decreasing costs are visited.
    fn explore_again(&mut self) {
        self.queue.clear();
        for index in 0..self.charged.len() {
            let operator = self.charged[index];
            for part in self.parts.range(operator) {
                let relaxed = self.parts.item(part);
                if self.missing[relaxed as usize] == 0 {
                    self.fire(relaxed, self.supported[relaxed as usize]);
                }
            }
        }
        while let Some((cost, proposition)) = self.queue.pop() {
            if self.costs[proposition as usize] < cost {
                continue;
            }
            for index in 0..self.relaxation.asking(proposition).len() {
                let relaxed = self.relaxation.asking(proposition)[index];
                let is_support = self.supporters[relaxed as usize] == proposition;
                if is_support && self.missing[relaxed as usize] == 0 {
                    self.support_again(relaxed);
                }
            }
        }
    }

    /// Chooses the supporter of a relaxed operator again, after the cost of the old supporter has
    /// decreased.
    fn support_again(&mut self, relaxed: u32) {
        let preconditions = self.relaxation.preconditions(relaxed).iter();
        let dearest = preconditions.map(|one| (self.costs[*one as usize], *one)).max();
        let Some((cost, supporter)) = dearest else { return };
        self.supporters[relaxed as usize] = supporter;
        if cost < self.supported[relaxed as usize] {
            self.supported[relaxed as usize] = cost;
            self.fire(relaxed, cost);
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

    /// Returns the goal proposition with the greatest h_max cost, as a pair of cost and
    /// proposition; `None` without a goal.
    fn most_expensive_goal(&self) -> Option<(u64, u32)> {
        let goal = self.relaxation.goal().iter();
        goal.map(|goal| (self.costs[*goal as usize], *goal)).max()
    }

    /// Marks the goal zone: the propositions from which `goal` is reachable at no cost.
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

    /// Finds the cut: the relaxed operators that lead from the before zone into the goal zone.
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

    /// Subtracts the cost of the cut from the remaining cost of each operator in the cut. Returns
    /// the cost of the cut, which is that of its cheapest operator.
    fn charge(&mut self) -> u64 {
        let price = self.cut.iter().map(|relaxed| self.cost(*relaxed)).min().unwrap_or(0);
        self.charged.clear();
        self.charged.extend(self.cut.iter().map(|relaxed| self.origins[*relaxed as usize]));
        self.charged.sort_unstable();
        self.charged.dedup();
        for operator in &self.charged {
            self.remaining[*operator as usize] -= price;
        }
        price
    }

    /// Finds cuts with the remaining costs until the goal costs nothing, and adds their costs to
    /// `total`. Returns the sum, or `None` for a dead end.
    fn cuts(&mut self, mut total: u64) -> Option<u64> {
        self.explorations = 0;
        loop {
            if self.explorations >= self.explorations_max {
                // Without the remaining cuts the estimate is lower, so it stays admissible.
                return Some(total);
            }
            self.explorations += 1;
            if self.explorations == 1 {
                self.explore()
            } else {
                self.explore_again()
            }
            match self.most_expensive_goal() {
                Some((UNREACHED, _)) => return None,
                None | Some((0, _)) => return Some(total),
                // The remaining h_max cost is a lower bound of the costs of later cuts.
                Some((rest, _)) if total.saturating_add(rest) >= self.enough => {
                    return Some(total.saturating_add(rest));
                }
                Some((_, goal)) => self.mark_goal_zone(goal),
            }
            self.find_cut();
            let price = self.charge();
            if price == 0 {
                // A cut with finite costs never costs zero. Stopping here keeps the estimate
                // admissible.
                return Some(total);
            }
            total = total.saturating_add(price);
            self.known.push(price, &self.charged);
        }
    }

    /// Prepares the evaluation of a state: resets the costs of all operators.
    fn start(&mut self, state: &State) {
        self.initial.clear();
        self.relaxation.initial(state, &mut self.initial);
        self.relaxation.weights(&mut self.remaining);
    }

    /// Copies the landmarks of the parent state that do not contain the operator of `way`, the
    /// transition from the parent state. Returns the sum of their costs.
    fn inherit(&mut self, way: Transition) -> u64 {
        let mut total: u64 = 0;
        for landmark in self.known.of(way.parent) {
            let (price, operators) = self.known.get(landmark);
            if operators.contains(&way.operator.0) {
                continue;
            }
            for operator in operators {
                self.remaining[*operator as usize] -= price;
            }
            total = total.saturating_add(price);
            self.known.push_again(landmark);
        }
        total
    }
}

impl Evaluator for LandmarkCut {
    fn evaluate(&mut self, state: &State) -> Option<u64> {
        self.known = LandmarkStore::default();
        self.start(state);
        self.cuts(0)
    }

    fn evaluate_after(
        &mut self,
        state: &State,
        id: StateId,
        way: Option<Transition>,
    ) -> Option<u64> {
        self.start(state);
        let first = self.known.prices.len() as u32;
        let inherited = way.map_or(0, |way| self.inherit(way));
        let estimate = self.cuts(inherited);
        self.known.keep(id, first);
        estimate
    }

    fn limit(&mut self, explorations_max: u64, enough: u64) {
        self.explorations_max = explorations_max.min(CUTS_MAX);
        self.enough = enough;
    }

    fn explorations(&self) -> u64 {
        self.explorations
    }

    fn bytes(&self) -> usize {
        self.relaxation.bytes() + self.known.bytes()
    }
}

// === impl LandmarkStore ===

impl LandmarkStore {
    /// Returns the range of a state's landmarks; empty if they are not stored.
    fn of(&self, state: StateId) -> Range<usize> {
        let (start, end) = self.ranges.get(state.0 as usize).copied().unwrap_or((0, 0));
        start as usize..end as usize
    }

    /// Returns the cost of a landmark, and its operators.
    fn get(&self, landmark: usize) -> (u64, &[u32]) {
        (self.prices[landmark].0, &self.operators[self.place(landmark)])
    }

    /// Returns the range of a landmark's operators in `operators`.
    fn place(&self, landmark: usize) -> Range<usize> {
        let start = landmark.checked_sub(1).map_or(0, |before| self.prices[before].1);
        start as usize..self.prices[landmark].1 as usize
    }

    fn push(&mut self, price: u64, operators: &[u32]) {
        self.operators.extend_from_slice(operators);
        self.prices.push((price, self.operators.len() as u32));
    }

    /// Adds a copy of a stored landmark.
    fn push_again(&mut self, landmark: usize) {
        self.operators.extend_from_within(self.place(landmark));
        self.prices.push((self.prices[landmark].0, self.operators.len() as u32));
    }

    /// Assigns all landmarks from the index `first` on to a state. If the limit is exceeded, drops
    /// them instead.
    fn keep(&mut self, state: StateId, first: u32) {
        if self.operators.len() > KEPT_MAX {
            self.prices.truncate(first as usize);
            let end = self.prices.last().map_or(0, |(_, end)| *end);
            self.operators.truncate(end as usize);
            return;
        }
        let index = state.0 as usize;
        if index >= self.ranges.len() {
            self.ranges.resize(index + 1, (0, 0));
        }
        self.ranges[index] = (first, self.prices.len() as u32);
    }

    fn bytes(&self) -> usize {
        self.ranges.capacity() * 8 + self.prices.capacity() * 16 + self.operators.capacity() * 4
    }
}
