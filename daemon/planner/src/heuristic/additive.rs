//! h_add: a conjunction costs the sum of what its parts cost in the delete relaxation (Bonet and
//! Geffner, 2001). Not admissible; here it chooses the best supporters of the FF heuristic.
//!
//! Almost all time of a search is spent here, so what is looked at together lies together.

use rustc_hash::FxHashMap;

use super::queue::CostQueue;
use super::relaxation::Relaxation;
use crate::rows::Rows;
use crate::state::State;

/// A cost that is not reached.
const UNREACHED: u32 = u32::MAX;

/// Costs saturate here: two of them still have a sum.
const COST_MAX: u32 = 1 << 30;

/// Marks propositions that no operator had to reach.
pub(super) const NO_SUPPORTER: u32 = u32::MAX;

const NOT_YET: Reached = Reached { cost: UNREACHED, supporter: NO_SUPPORTER };

/// Costs of propositions, as seen from the state last explored.
#[derive(Debug)]
pub(super) struct Additive {
    reached: Vec<Reached>,
    /// Relaxed operators that ask for a proposition and nothing else.
    alone: Rows,
    /// By proposition: its clique, if it is in one.
    cliques: Cliques,
    /// Counters of relaxed operators that ask for a proposition among others.
    among: Rows,
    /// The relaxed operator of each counter.
    counted: Vec<u32>,
    counters: Vec<Counter>,
    /// The counters before anything is reached.
    fresh: Vec<Counter>,
    base_costs: Vec<u32>,
    is_goal: Vec<bool>,
    /// By step of a number: how often it must be repeated; empty where nothing is.
    repetitions: Vec<u32>,
    initial: Vec<u32>,
    queue: CostQueue,
}

/// How a proposition is reached best.
#[derive(Clone, Copy, Debug)]
struct Reached {
    cost: u32,
    supporter: u32,
}

/// What a relaxed operator waits for, and what it costs so far.
#[derive(Clone, Copy, Debug)]
struct Counter {
    missing: u32,
    cost: u32,
}

// === impl Additive ===

impl Additive {
    pub(super) fn new(relaxation: &Relaxation) -> Additive {
        let base_costs: Vec<u32> = (0..relaxation.relaxed_count() as u32)
            .map(|relaxed| relaxation.base_cost(relaxed).min(u64::from(COST_MAX)) as u32)
            .collect();
        let all = 0..relaxation.relaxed_count() as u32;
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
        Additive {
            reached: vec![NOT_YET; relaxation.proposition_count()],
            cliques: Cliques::new(relaxation, &alone, &base_costs),
            alone,
            among: among(relaxation, &counted),
            counted,
            base_costs,
            counters: fresh.clone(),
            fresh,
            is_goal,
            repetitions: Vec::new(),
            initial: Vec::new(),
            queue: CostQueue::default(),
        }
    }

    /// Bytes taken.
    pub(super) fn bytes(&self) -> usize {
        let rows = self.alone.bytes() + self.among.bytes() + self.base_costs.len() * 4;
        self.reached.len() * 9 + self.counters.len() * 16 + rows
    }

    /// What a proposition costs.
    #[inline]
    pub(super) fn cost(&self, proposition: u32) -> u32 {
        self.reached[proposition as usize].cost
    }

    /// The relaxed operator that reaches a proposition best.
    #[inline]
    pub(super) fn supporter(&self, proposition: u32) -> u32 {
        self.reached[proposition as usize].supporter
    }

    /// How often the operator that reaches a proposition best must be repeated for it.
    pub(super) fn repetitions(&self, relaxation: &Relaxation, proposition: u32) -> u32 {
        if self.repetitions.is_empty() {
            return 1;
        }
        let supporter = self.supporter(proposition);
        let mut adds = relaxation.adds_with(supporter, &self.repetitions);
        adds.find(|(added, _)| *added == proposition).map_or(1, |(_, times)| times)
    }

    /// Computes the costs of propositions until the goal's are known; whether all of it is reached.
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
            self.reached[proposition as usize] = Reached { cost: 0, supporter: NO_SUPPORTER };
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

    /// Tells those who ask for a proposition that it is there.
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

    /// Notes what a relaxed operator adds at a cost, which counts it once.
    #[inline]
    fn fire<const NUMBERS: bool>(&mut self, relaxation: &Relaxation, relaxed: u32, cost: u32) {
        if NUMBERS {
            let base = self.base_costs[relaxed as usize];
            for (proposition, times) in relaxation.adds_with(relaxed, &self.repetitions) {
                let further = base.saturating_mul(times - 1);
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
    reached: &mut [Reached],
    queue: &mut CostQueue,
) {
    let known = &mut reached[proposition as usize];
    if cost < known.cost {
        *known = Reached { cost, supporter };
        queue.push(u64::from(cost), proposition);
    }
}

/// By proposition: the relaxed operators that ask for nothing else.
fn alone(relaxation: &Relaxation) -> Rows {
    let all = 0..relaxation.relaxed_count() as u32;
    let pairs = all.filter_map(|relaxed| match relaxation.preconditions(relaxed) {
        [one] => Some((*one, relaxed)),
        _ => None,
    });
    Rows::collect(relaxation.proposition_count(), pairs)
}

/// By proposition: the counters of the relaxed operators that ask for it.
fn among(relaxation: &Relaxation, counted: &[u32]) -> Rows {
    let pairs = counted.iter().zip(0..).flat_map(|(relaxed, index)| {
        relaxation.preconditions(*relaxed).iter().map(move |one| (*one, index))
    });
    Rows::collect(relaxation.proposition_count(), pairs)
}

/// Propositions from each of which all others of the same clique are reached at one price: places
/// that are all next to each other, say. Once one of them is reached, the others bring nothing new:
/// what they lead to has been reached from the first, and no dearer.
#[derive(Debug)]
struct Cliques {
    /// By proposition; [`NO_CLIQUE`] where it is in none.
    of: Vec<u32>,
    entered: Vec<bool>,
}

const NO_CLIQUE: u32 = u32::MAX;

// === impl Cliques ===

impl Cliques {
    fn new(relaxation: &Relaxation, alone: &Rows, base_costs: &[u32]) -> Cliques {
        let mut of = vec![NO_CLIQUE; relaxation.proposition_count()];
        if relaxation.has_numbers() {
            // One price is not all that counts.
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

    /// Whether a proposition is the first of its clique.
    #[inline]
    fn enter(&mut self, proposition: u32) -> bool {
        match self.of[proposition as usize] {
            NO_CLIQUE => true,
            clique => !std::mem::replace(&mut self.entered[clique as usize], true),
        }
    }
}

/// A proposition and all that it leads to alone, at the one price; `None` where there are several.
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
