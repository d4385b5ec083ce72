//! The additive heuristic h_add: in the delete relaxation, the cost of a conjunction is the sum of
//! the costs of its parts (Bonet and Geffner, 2001). The heuristic is not admissible. Its use here
//! is to select the best supporters for the FF heuristic.
//!
//! A search spends almost all its time in this module, so data that is used together is stored
//! together.

use rustc_hash::FxHashMap;

use super::cost_queue::CostQueue;
use super::relaxation::{ONCE, Relaxation, Repetitions};
use crate::rows::Rows;
use crate::state::State;

/// Cost of an unreached proposition.
const UNREACHED: u32 = u32::MAX;

/// Greatest cost of a proposition. Greater costs are reduced to this value, so that the sum of two
/// costs does not overflow.
const COST_MAX: u32 = 1 << 30;

/// Bound on the costs of nine in ten operators. Where they cost more, as with six decimals, all costs
/// are scaled down, so that a sum reaches [`COST_MAX`] only in very long relaxed plans. Few operators
/// that cost more than all others do not change the scale. Costs choose among supporters here; the FF
/// heuristic adds up the unscaled ones.
const BASE_COST_MAX: u64 = 1 << 16;

/// Supporter of a proposition that holds in the state and needs no relaxed operator.
pub(super) const NO_SUPPORTER: u32 = u32::MAX;

const NOT_YET: ReachedCost = ReachedCost { cost: UNREACHED, supporter: NO_SUPPORTER };

/// Costs and best supporters of propositions in the last explored state, with scratch space.
#[derive(Debug)]
pub(super) struct AdditiveHeuristic {
    reached: Vec<ReachedCost>,
    /// Per proposition: the relaxed operators with this proposition as their only precondition.
    alone: Rows,
    /// Clique of each proposition that is in one.
    cliques: Cliques,
    /// Per proposition: the counters of the relaxed operators with this proposition as one of
    /// several preconditions.
    among: Rows,
    /// Per counter: its relaxed operator.
    counted: Vec<u32>,
    counters: Vec<Counter>,
    /// Initial values of the counters, before any proposition is reached.
    fresh: Vec<Counter>,
    /// Per relaxed operator: its cost, scaled down by `scale`.
    base_costs: Vec<u32>,
    /// Number of bits by which costs are scaled down.
    scale: u32,
    is_goal: Vec<bool>,
    /// Per numeric step: the required repetitions of its operator. Empty if the relaxation has no
    /// numeric steps.
    repetitions: Vec<Repetitions>,
    initial: Vec<u32>,
    queue: CostQueue,
}

/// Lowest cost of reaching a proposition, and the relaxed operator that reaches it at this cost.
#[derive(Clone, Copy, Debug)]
struct ReachedCost {
    cost: u32,
    supporter: u32,
}

/// Counter of a relaxed operator: the number of its unreached preconditions, and the sum of the
/// operator's cost and the costs of its reached preconditions.
#[derive(Clone, Copy, Debug)]
struct Counter {
    missing: u32,
    cost: u32,
}

/// Returns the number of bits by which costs are scaled down so that nine in ten are at most
/// [`BASE_COST_MAX`].
fn scale(mut costs: Vec<u64>) -> u32 {
    let place = costs.len() * 9 / 10;
    if place >= costs.len() {
        return 0;
    }
    let (_, high, _) = costs.select_nth_unstable(place);
    let bits = |cost: u64| u64::BITS - cost.leading_zeros();
    if *high > BASE_COST_MAX { bits(*high) - bits(BASE_COST_MAX - 1) } else { 0 }
}

/// Returns a cost scaled down by a number of bits. Only a cost of zero becomes zero.
fn scaled(cost: u64, scale: u32) -> u32 {
    let scaled = (cost >> scale).min(u64::from(COST_MAX)) as u32;
    scaled.max(u32::from(cost > 0))
}

// === impl AdditiveHeuristic ===

impl AdditiveHeuristic {
    pub(super) fn new(relaxation: &Relaxation) -> AdditiveHeuristic {
        let all = 0..relaxation.relaxed_count() as u32;
        let scale = scale(all.clone().map(|relaxed| relaxation.base_cost(relaxed)).collect());
        let base_costs: Vec<u32> =
            all.clone().map(|relaxed| scaled(relaxation.base_cost(relaxed), scale)).collect();
        let counted: Vec<u32> =
            all.filter(|relaxed| relaxation.preconditions(*relaxed).len() > 1).collect();
        let fresh: Vec<Counter> = { counted.iter() }
            .map(|relaxed| Counter {
                missing: relaxation.missing()[*relaxed as usize],
                cost: base_costs[*relaxed as usize],
            })
            .collect();
        let mut is_goal = vec![false; relaxation.proposition_count()];
        relaxation.goal().iter().for_each(|goal| is_goal[*goal as usize] = true);
        let alone = alone(relaxation);
        AdditiveHeuristic {
            reached: vec![NOT_YET; relaxation.proposition_count()],
            cliques: Cliques::new(relaxation, &alone, &base_costs),
            alone,
            among: among(relaxation, &counted),
            counted,
            base_costs,
            scale,
            counters: fresh.clone(),
            fresh,
            is_goal,
            repetitions: Vec::new(),
            initial: Vec::new(),
            queue: CostQueue::default(),
        }
    }

    /// Returns the number of bytes of the tables.
    pub(super) fn bytes(&self) -> usize {
        let rows = self.alone.bytes() + self.among.bytes() + self.base_costs.len() * 4;
        self.reached.len() * 9 + self.counters.len() * 20 + rows
    }

    /// Adopts the goal of the relaxation after it has changed.
    pub(super) fn set_goal(&mut self, relaxation: &Relaxation) {
        self.is_goal.fill(false);
        relaxation.goal().iter().for_each(|goal| self.is_goal[*goal as usize] = true);
    }

    /// Returns the scaled cost of a proposition; [`UNREACHED`] if it is unreachable.
    #[inline]
    pub(super) fn cost(&self, proposition: u32) -> u32 {
        self.reached[proposition as usize].cost
    }

    /// Returns the cost of a proposition, in the unit of the relaxation; `None` if the exploration
    /// ended before it was reached.
    pub(super) fn reached_cost(&self, proposition: u32) -> Option<u64> {
        let cost = Some(self.cost(proposition)).filter(|cost| *cost != UNREACHED)?;
        Some(u64::from(cost).saturating_mul(1 << self.scale))
    }

    /// Returns the best supporter of a proposition: the relaxed operator that reaches it at the
    /// lowest cost.
    #[inline]
    pub(super) fn supporter(&self, proposition: u32) -> u32 {
        self.reached[proposition as usize].supporter
    }

    /// Returns the repetitions of the best supporter that make the proposition true.
    pub(super) fn repetitions(&self, relaxation: &Relaxation, proposition: u32) -> Repetitions {
        if self.repetitions.is_empty() {
            return ONCE;
        }
        self.repetitions_of(relaxation, self.supporter(proposition), proposition)
    }

    /// Returns the repetitions of a relaxed operator that make a proposition true.
    pub(super) fn repetitions_of(
        &self,
        relaxation: &Relaxation,
        relaxed: u32,
        proposition: u32,
    ) -> Repetitions {
        let mut adds = relaxation.adds_with(relaxed, &self.repetitions);
        adds.find(|(added, _)| *added == proposition).map_or(ONCE, |(_, found)| found)
    }

    /// Computes the costs of propositions until all goal propositions are reached. Returns `false`
    /// if a goal proposition is unreachable.
    pub(super) fn explore(&mut self, relaxation: &Relaxation, state: &State) -> bool {
        if relaxation.has_numbers() {
            relaxation.repetitions(state, &mut self.repetitions);
            self.explore_from::<true>(relaxation, state)
        } else {
            self.explore_from::<false>(relaxation, state)
        }
    }

    fn explore_from<const NUMBERS: bool>(
        &mut self,
        relaxation: &Relaxation,
        state: &State,
    ) -> bool {
        self.reached.fill(NOT_YET);
        self.counters.copy_from_slice(&self.fresh);
        self.queue.clear();
        self.cliques.entered.fill(false);
        let mut initial = std::mem::take(&mut self.initial);
        initial.clear();
        relaxation.initial(state, &mut initial);
        for &proposition in initial.iter().rev() {
            self.reached[proposition as usize] = ReachedCost { cost: 0, supporter: NO_SUPPORTER };
        }
        let mut goals_missing = relaxation.goal().len();
        for &proposition in initial.iter().rev() {
            goals_missing -= usize::from(self.is_goal[proposition as usize]);
            self.open::<NUMBERS>(relaxation, proposition, 0);
        }
        self.initial = initial;
        if goals_missing == 0 {
            return true;
        }
        for &relaxed in relaxation.free() {
            self.fire::<NUMBERS>(relaxation, relaxed, self.base_costs[relaxed as usize]);
        }
        while let Some((cost, proposition)) = self.queue.pop() {
            if self.cost(proposition) != cost as u32 {
                continue;
            }
            if self.is_goal[proposition as usize] {
                goals_missing -= 1;
                if goals_missing == 0 {
                    return true;
                }
            }
            self.open::<NUMBERS>(relaxation, proposition, cost as u32);
        }
        false
    }

    /// Counts a reached proposition for the relaxed operators with this precondition, and fires the
    /// operators with all preconditions reached.
    #[inline]
    fn open<const NUMBERS: bool>(&mut self, relaxation: &Relaxation, proposition: u32, cost: u32) {
        if self.cliques.enter(proposition) {
            for index in self.alone.range(proposition) {
                let relaxed = self.alone.item(index);
                let total = (self.base_costs[relaxed as usize] + cost).min(COST_MAX);
                self.fire::<NUMBERS>(relaxation, relaxed, total);
            }
        }
        for index in self.among.range(proposition) {
            let index = self.among.item(index) as usize;
            let counter = &mut self.counters[index];
            counter.missing -= 1;
            counter.cost = (counter.cost + cost).min(COST_MAX);
            if counter.missing == 0 {
                let (cost, relaxed) = (counter.cost, self.counted[index]);
                self.fire::<NUMBERS>(relaxation, relaxed, cost);
            }
        }
    }

    /// Updates the costs of the propositions that a relaxed operator adds. `cost` includes one
    /// application of the operator; the cost of further applications is added here.
    #[inline]
    fn fire<const NUMBERS: bool>(&mut self, relaxation: &Relaxation, relaxed: u32, cost: u32) {
        if NUMBERS {
            let base = self.base_costs[relaxed as usize];
            for (proposition, needed) in relaxation.adds_with(relaxed, &self.repetitions) {
                let further = base.saturating_mul(needed.times - 1);
                let further = further.saturating_add(scaled(needed.supply_cost, self.scale));
                let cost = cost.saturating_add(further).min(COST_MAX);
                reach(proposition, cost, relaxed, &mut self.reached, &mut self.queue);
            }
        } else {
            for &proposition in relaxation.adds(relaxed) {
                reach(proposition, cost, relaxed, &mut self.reached, &mut self.queue);
            }
        }
    }
}

#[inline]
fn reach(
    proposition: u32,
    cost: u32,
    supporter: u32,
    reached: &mut [ReachedCost],
    queue: &mut CostQueue,
) {
    let known = &mut reached[proposition as usize];
    if cost < known.cost {
        *known = ReachedCost { cost, supporter };
        queue.push(u64::from(cost), proposition);
    }
}

/// Returns, per proposition, the relaxed operators with this proposition as their only
/// precondition.
fn alone(relaxation: &Relaxation) -> Rows {
    let all = 0..relaxation.relaxed_count() as u32;
    let pairs = all.filter_map(|relaxed| match relaxation.preconditions(relaxed) {
        [one] => Some((*one, relaxed)),
        _ => None,
    });
    Rows::collect(relaxation.proposition_count(), pairs)
}

/// Returns, per proposition, the counters of the relaxed operators with this proposition as one of
/// several preconditions.
fn among(relaxation: &Relaxation, counted: &[u32]) -> Rows {
    let pairs = counted.iter().zip(0..).flat_map(|(relaxed, index)| {
        relaxation.preconditions(*relaxed).iter().map(move |one| (*one, index))
    });
    Rows::collect(relaxation.proposition_count(), pairs)
}

/// Cliques: sets of propositions in which each proposition leads to all others at the same cost,
/// such as places that are all adjacent. After one proposition of a clique is reached, the others
/// need not fire their operators, because the first one has reached the same propositions at no
/// greater cost.
#[derive(Debug)]
struct Cliques {
    /// Per proposition: its clique, or [`NO_CLIQUE`].
    of: Vec<u32>,
    entered: Vec<bool>,
}

const NO_CLIQUE: u32 = u32::MAX;

// === impl Cliques ===

impl Cliques {
    fn new(relaxation: &Relaxation, alone: &Rows, base_costs: &[u32]) -> Cliques {
        let mut of = vec![NO_CLIQUE; relaxation.proposition_count()];
        if relaxation.has_numbers() {
            // With numbers, the costs of the propositions that one operator adds differ.
            return Cliques { of, entered: Vec::new() };
        }
        let mut known: FxHashMap<(u32, Vec<u32>), u32> = FxHashMap::default();
        for proposition in 0..of.len() as u32 {
            let Some(members) = members(relaxation, alone, base_costs, proposition) else {
                continue;
            };
            let next = known.len() as u32;
            of[proposition as usize] = *known.entry(members).or_insert(next);
        }
        Cliques { of, entered: vec![false; known.len()] }
    }

    /// Whether the operators of a reached proposition must fire: the proposition is in no clique,
    /// or the first reached one of its clique. Records that the clique is reached.
    #[inline]
    fn enter(&mut self, proposition: u32) -> bool {
        match self.of[proposition as usize] {
            NO_CLIQUE => true,
            clique => !std::mem::replace(&mut self.entered[clique as usize], true),
        }
    }
}

/// Returns the common cost of the relaxed operators with `proposition` as their only precondition.
/// Also returns the set of `proposition` and all propositions that these operators add. Returns
/// `None` if there is no operator of this kind, or if the costs differ.
fn members(
    relaxation: &Relaxation,
    alone: &Rows,
    base_costs: &[u32],
    proposition: u32,
) -> Option<(u32, Vec<u32>)> {
    let (first, rest) = alone.row(proposition).split_first()?;
    let cost = base_costs[*first as usize];
    if rest.iter().any(|relaxed| base_costs[*relaxed as usize] != cost) {
        return None;
    }
    let mut members = vec![proposition];
    alone.row(proposition).iter().for_each(|one| members.extend(relaxation.adds(*one)));
    members.sort_unstable();
    members.dedup();
    Some((cost, members))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_great_costs_are_scaled_down_and_none_becomes_zero() {
        assert_eq!((scale(vec![]), scale(vec![0]), scale(vec![BASE_COST_MAX])), (0, 0, 0));
        for largest in [BASE_COST_MAX + 1, 3_000_000, 4_294_967_296, u64::MAX] {
            let scale = scale(vec![1, largest]);
            let scaled_largest = u64::from(scaled(largest, scale));
            assert!(scaled_largest <= BASE_COST_MAX, "{largest} becomes {scaled_largest}");
            assert!(scaled_largest * 4 > BASE_COST_MAX, "{largest} becomes {scaled_largest}");
            assert_eq!((scaled(1, scale), scaled(0, scale)), (1, 0));
        }
    }

    #[test]
    fn one_penalty_leaves_the_other_costs_apart() {
        let mut costs = vec![1, 2, 3, 4, 5, 6, 7, 8, 9, 10];
        costs.push(1 << 40);
        let scale = scale(costs);
        assert_eq!((scaled(1, scale), scaled(10, scale)), (1, 10));
        assert_eq!(scaled(1 << 40, scale), COST_MAX);
    }
}
