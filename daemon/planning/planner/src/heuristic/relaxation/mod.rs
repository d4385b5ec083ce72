//! The delete relaxation of a task in flat arrays, and its exploration from a state.
//!
//! A *proposition* is a literal that some condition requires. Every operator becomes one relaxed
//! operator for its unconditional effect and one per conditional effect. Every axiom becomes a
//! relaxed operator without cost. A derived fact is false if all axioms that derive it fail; making
//! it false also costs nothing.
//!
//! Two kinds of conditions cannot be expressed here and are assumed to hold: the falsity of facts
//! that derive each other, and any comparison with a number that may have changed.

mod builder;
mod dominance;
mod margins;
mod numbers;

use rustc_hash::FxHashMap;

use self::builder::RelaxationBuilder;
pub(super) use self::margins::{Margins, NumericCondition};
use self::numbers::NumericSteps;
pub(super) use self::numbers::{Repetitions, repeatable_change};
use super::cost_queue::CostQueue;
use crate::rows::Rows;
use crate::state::{State, is_true, true_facts};
use crate::task::{FactId, GroundOperator, Literal, OperatorId, Task};

/// Cost of an unreached proposition.
pub(super) const UNREACHED: u64 = u64::MAX;

/// Origin of a relaxed operator that comes from an axiom.
const AXIOM: u32 = u32::MAX;

/// Entry in place of a step, for an addition that one application of its operator achieves.
const NO_STEP: u32 = u32::MAX;

/// One application of an operator, which uses up nothing that must be got.
pub(super) const ONCE: Repetitions = Repetitions { times: 1, is_detour: false, supply_cost: 0 };

/// Weight of an operator in a search or heuristic. If all operators of a task have the same cost,
/// each of them has the weight one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Weights {
    /// Every operator has the weight one.
    Unit,
    /// The weight of an operator is its cost plus one, so that plans of operators without cost
    /// still have a length.
    PlusOne,
    /// The weight of an operator is [`STEPS_PER_COST`] per unit of cost, plus one. Of plans with
    /// equal costs, the one with fewer steps is preferred.
    CostThenSteps,
}

/// Weight of one unit of cost, in steps. A plan with fewer steps than this never weighs more than a
/// plan that costs one unit more.
pub(crate) const STEPS_PER_COST: u64 = 1 << 16;

/// The delete relaxation of a task.
#[derive(Debug)]
pub(crate) struct Relaxation {
    fact_count: usize,
    /// Facts that some condition requires to be false. The propositions of their negations follow
    /// those of the facts.
    negated: Vec<FactId>,
    /// Per fact of `negated`: the proposition of its negation.
    negations: FxHashMap<FactId, u32>,
    proposition_count: usize,
    /// Per proposition: the relaxed operators with this precondition.
    asking: Rows,
    preconditions: Rows,
    adds: Rows,
    /// Per addition: the step in `numbers` that determines the number of repetitions of the
    /// operator; empty if no addition is numeric.
    steps: Vec<u32>,
    numbers: NumericSteps,
    base_costs: Vec<u64>,
    /// Per relaxed operator: the operator that it comes from, or [`AXIOM`].
    origins: Vec<u32>,
    missing: Vec<u32>,
    goal: Vec<u32>,
    /// Relaxed operators without preconditions.
    free: Vec<u32>,
}

/// The h_max costs of propositions in one state.
#[derive(Debug, Default)]
pub(super) struct Exploration {
    pub(super) costs: Vec<u64>,
    operator_costs: Vec<u64>,
    missing: Vec<u32>,
    initial: Vec<u32>,
    queue: CostQueue,
}

impl Weights {
    /// Returns the weight of an operator.
    pub(crate) fn weight(self, task: &Task, operator: GroundOperator<'_>) -> u64 {
        match self {
            Weights::Unit => 1,
            // If all costs are equal, a cheapest plan is a shortest plan.
            _ if task.costs_equal => 1,
            Weights::PlusOne => operator.cost.saturating_add(1),
            Weights::CostThenSteps => {
                operator.cost.saturating_mul(STEPS_PER_COST).saturating_add(1)
            }
        }
    }
}

// === impl Relaxation ===

impl Relaxation {
    pub(crate) fn new(task: &Task, weights: Weights) -> Relaxation {
        Relaxation::build(task, weights, false)
    }

    /// Builds the relaxation as [`Relaxation::new`] does, but without dominated additions. It must
    /// not be used for admissible estimates.
    pub(crate) fn simplified(task: &Task, weights: Weights) -> Relaxation {
        Relaxation::build(task, weights, true)
    }

    fn build(task: &Task, weights: Weights, simplify: bool) -> Relaxation {
        let mut builder = RelaxationBuilder::new(task);
        for (index, operator) in task.operators.iter().enumerate() {
            builder.operator(index as u32, operator, weights.weight(task, operator));
        }
        builder.axioms();
        builder.finish(simplify)
    }

    /// Returns the size of the relaxation, which is a measure of the work of one exploration.
    pub(crate) fn size(&self) -> usize {
        self.preconditions.item_count() + self.adds.item_count() + self.proposition_count
    }

    /// Returns the number of bytes of the relaxation.
    pub(super) fn bytes(&self) -> usize {
        let rows = self.asking.bytes() + self.preconditions.bytes() + self.adds.bytes();
        rows + self.base_costs.len() * 16
    }

    pub(super) fn goal(&self) -> &[u32] {
        &self.goal
    }

    /// Replaces the goal by other literals that the goal of the task contains.
    pub(super) fn set_goal(&mut self, goal: &[Literal]) {
        self.goal = goal.iter().filter_map(|part| self.proposition(*part)).collect();
        self.goal.sort_unstable();
        self.goal.dedup();
    }

    pub(super) fn proposition_count(&self) -> usize {
        self.proposition_count
    }

    pub(super) fn relaxed_count(&self) -> usize {
        self.missing.len()
    }

    pub(super) fn missing(&self) -> &[u32] {
        &self.missing
    }

    pub(super) fn free(&self) -> &[u32] {
        &self.free
    }

    #[inline]
    pub(super) fn asking(&self, proposition: u32) -> &[u32] {
        self.asking.row(proposition)
    }

    #[inline]
    pub(super) fn adds(&self, relaxed: u32) -> &[u32] {
        self.adds.row(relaxed)
    }

    /// Whether the operators of some additions must be repeated, because these additions are
    /// numeric.
    pub(super) fn has_numbers(&self) -> bool {
        !self.numbers.is_empty()
    }

    /// Computes the number of repetitions of each numeric step's operator in a state, and the cost of
    /// what these use up.
    pub(super) fn repetitions(&self, state: &State, found: &mut Vec<Repetitions>) {
        self.numbers.repetitions(&state[self.fact_count.div_ceil(64)..], found);
    }

    /// Returns the propositions that a relaxed operator adds. Each entry is the proposition, and
    /// the number of times that the operator must be applied to add it, with the cost of what these
    /// applications use up. `repetitions` contains these numbers for each numeric step.
    #[inline]
    pub(super) fn adds_with<'r>(
        &'r self,
        relaxed: u32,
        repetitions: &'r [Repetitions],
    ) -> impl Iterator<Item = (u32, Repetitions)> {
        let steps = &self.steps[self.adds.range(relaxed)];
        let times =
            steps.iter().map(|step| repetitions.get(*step as usize).copied().unwrap_or(ONCE));
        self.adds.row(relaxed).iter().copied().zip(times)
    }

    /// Returns, per proposition, the relaxed operators that add it.
    pub(super) fn adding(&self) -> Rows {
        self.adds.inverted(self.proposition_count)
    }

    /// Returns, per proposition that is a comparison, the relaxed operators that may reach its bound
    /// from some state.
    pub(super) fn approaching(&self) -> Rows {
        let all = 0..self.adds.len() as u32;
        let numeric = all.flat_map(|relaxed| {
            let additions = self.adds.range(relaxed).zip(self.adds.row(relaxed));
            let numeric = additions.filter(|(index, _)| self.steps[*index] != NO_STEP);
            numeric.map(move |(_, proposition)| (*proposition, relaxed))
        });
        Rows::collect(self.proposition_count, numeric)
    }

    /// Writes the weight of each operator to `weights`.
    pub(super) fn weights(&self, weights: &mut [u64]) {
        for (origin, cost) in self.origins.iter().zip(&self.base_costs) {
            if *origin != AXIOM {
                weights[*origin as usize] = *cost;
            }
        }
    }

    /// Appends the propositions that hold in a state to `found`.
    pub(super) fn initial(&self, state: &State, found: &mut Vec<u32>) {
        found.extend(true_facts(state, self.fact_count).map(|fact| fact.0));
        for (index, fact) in self.negated.iter().enumerate() {
            if !is_true(state, *fact) {
                found.push((self.fact_count + index) as u32);
            }
        }
    }

    /// Whether a proposition holds in a state. The propositions of failing axioms never hold.
    pub(super) fn holds(&self, state: &State, proposition: u32) -> bool {
        match (proposition as usize).checked_sub(self.fact_count) {
            None => is_true(state, FactId(proposition)),
            Some(index) => self.negated.get(index).is_some_and(|fact| !is_true(state, *fact)),
        }
    }

    /// Returns the proposition of a literal; `None` if no condition requires the fact to be false.
    pub(super) fn proposition(&self, literal: Literal) -> Option<u32> {
        let fact = literal.fact();
        if literal.is_positive() {
            return Some(fact.0);
        }
        self.negations.get(&fact).copied()
    }

    /// Returns the fact of a proposition that is a positive literal; `None` for other propositions.
    pub(super) fn positive(&self, proposition: u32) -> Option<FactId> {
        ((proposition as usize) < self.fact_count).then_some(FactId(proposition))
    }

    /// Returns the literal of a proposition; `None` for the proposition of a failing axiom.
    pub(super) fn literal(&self, proposition: u32) -> Option<Literal> {
        match (proposition as usize).checked_sub(self.fact_count) {
            None => Some(Literal::new(FactId(proposition), true)),
            Some(index) => self.negated.get(index).map(|fact| Literal::new(*fact, false)),
        }
    }

    /// Whether a proposition is a positive or negative literal of a fact, and not that of a failing
    /// axiom.
    pub(super) fn is_literal(&self, proposition: u32) -> bool {
        self.literal(proposition).is_some()
    }

    #[inline]
    pub(super) fn preconditions(&self, relaxed: u32) -> &[u32] {
        self.preconditions.row(relaxed)
    }

    pub(super) fn base_cost(&self, relaxed: u32) -> u64 {
        self.base_costs[relaxed as usize]
    }

    /// Returns the operator that a relaxed operator comes from; `None` if it comes from an axiom.
    #[inline]
    pub(super) fn origin(&self, relaxed: u32) -> Option<OperatorId> {
        let origin = self.origins[relaxed as usize];
        (origin != AXIOM).then_some(OperatorId(origin))
    }

    /// Computes h_max costs of propositions until all goal propositions are reached. Returns
    /// `false` if a goal proposition is unreachable.
    pub(super) fn explore(&self, state: &State, exploration: &mut Exploration) -> bool {
        exploration.reset(self);
        let mut initial = std::mem::take(&mut exploration.initial);
        self.initial(state, &mut initial);
        for proposition in initial.drain(..) {
            exploration.reach(proposition, 0);
        }
        exploration.initial = initial;
        for &relaxed in &self.free {
            exploration.fire(self, relaxed);
        }
        let mut goals_missing = self.goal.len();
        while let Some((cost, proposition)) = exploration.queue.pop() {
            if exploration.costs[proposition as usize] < cost {
                continue;
            }
            if self.goal.binary_search(&proposition).is_ok() {
                goals_missing -= 1;
                if goals_missing == 0 {
                    return true;
                }
            }
            for &relaxed in self.asking.row(proposition) {
                exploration.satisfy(self, relaxed, cost);
            }
        }
        self.goal.iter().all(|goal| exploration.costs[*goal as usize] != UNREACHED)
    }
}

// === impl Exploration ===

impl Exploration {
    fn reset(&mut self, relaxation: &Relaxation) {
        self.costs.clear();
        self.costs.resize(relaxation.proposition_count, UNREACHED);
        self.operator_costs.clear();
        self.operator_costs.extend_from_slice(&relaxation.base_costs);
        self.missing.clear();
        self.missing.extend_from_slice(&relaxation.missing);
        self.queue.clear();
    }

    fn reach(&mut self, proposition: u32, cost: u64) {
        let known = &mut self.costs[proposition as usize];
        if cost < *known {
            *known = cost;
            self.queue.push(cost, proposition);
        }
    }

    fn satisfy(&mut self, relaxation: &Relaxation, relaxed: u32, cost: u64) {
        let index = relaxed as usize;
        let total = &mut self.operator_costs[index];
        // The sum saturates just below the value for unreached propositions.
        let through = cost.saturating_add(relaxation.base_costs[index]).min(UNREACHED - 1);
        *total = (*total).max(through);
        self.missing[index] -= 1;
        if self.missing[index] == 0 {
            self.fire(relaxation, relaxed);
        }
    }

    fn fire(&mut self, relaxation: &Relaxation, relaxed: u32) {
        let cost = self.operator_costs[relaxed as usize];
        for &proposition in relaxation.adds.row(relaxed) {
            self.reach(proposition, cost);
        }
    }
}
