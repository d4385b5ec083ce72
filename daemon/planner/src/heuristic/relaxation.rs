//! The delete relaxation of a task, in flat arrays, and its exploration from a state.
//!
//! A *proposition* is a literal that somebody asks for. Every operator becomes one relaxed operator
//! for its unconditional effects and one per conditional effect; every axiom becomes one that costs
//! nothing. What has no place in the relaxation is taken to hold: the negation of a derived fact,
//! and any comparison once a number in it may change.

use super::queue::CostQueue;
use crate::state::{State, is_true, true_facts};
use crate::task::{Changes, FactId, Literal, Operator, OperatorId, Task};

/// A cost that is not reached.
pub(super) const UNREACHED: u64 = u64::MAX;

/// Marks relaxed operators that come from axioms.
const AXIOM: u32 = u32::MAX;

/// What an operator counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Weights {
    /// Every operator counts one.
    Unit,
    /// Its cost first; steps decide between equal costs.
    CostThenSteps,
}

/// Steps between two costs: a plan shorter than this never seems dearer for its length.
pub(crate) const STEPS_PER_COST: u64 = 1 << 16;

/// Lists of numbers in one array.
#[derive(Debug, Default)]
pub(super) struct Rows {
    starts: Vec<u32>,
    items: Vec<u32>,
}

/// The relaxed task.
#[derive(Debug)]
pub(crate) struct Relaxation {
    fact_count: usize,
    /// Facts whose falsehood is asked for; their propositions follow those of the facts.
    negated: Vec<FactId>,
    proposition_count: usize,
    /// Relaxed operators that ask for a proposition.
    asking: Rows,
    preconditions: Rows,
    adds: Rows,
    base_costs: Vec<u64>,
    /// The operator each relaxed operator comes from.
    origins: Vec<u32>,
    missing: Vec<u32>,
    goal: Vec<u32>,
    /// Relaxed operators without preconditions.
    free: Vec<u32>,
}

/// How the costs of several preconditions become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Combine {
    Add,
    Max,
}

/// Costs of propositions, as seen from one state.
#[derive(Debug, Default)]
pub(super) struct Exploration {
    pub(super) costs: Vec<u64>,
    /// The relaxed operator that reaches each proposition best.
    pub(super) supporters: Vec<u32>,
    operator_costs: Vec<u64>,
    missing: Vec<u32>,
    initial: Vec<u32>,
    queue: CostQueue,
}

/// Marks propositions that no operator had to reach.
pub(super) const NO_SUPPORTER: u32 = u32::MAX;

impl Weights {
    /// What an operator counts.
    pub(crate) fn weight(self, task: &Task, operator: Operator<'_>) -> u64 {
        match self {
            Weights::Unit => 1,
            // Then the cheapest plan is the shortest.
            Weights::CostThenSteps if task.costs_equal => 1,
            Weights::CostThenSteps => {
                operator.cost.saturating_mul(STEPS_PER_COST).saturating_add(1)
            }
        }
    }
}

// === impl Rows ===

impl Rows {
    fn new(lists: &[Vec<u32>]) -> Rows {
        let mut rows = Rows { starts: vec![0], items: Vec::new() };
        for list in lists {
            rows.items.extend(list);
            rows.starts.push(rows.items.len() as u32);
        }
        rows
    }

    pub(super) fn row(&self, index: u32) -> &[u32] {
        let index = index as usize;
        &self.items[self.starts[index] as usize..self.starts[index + 1] as usize]
    }
}

// === impl Relaxation ===

impl Relaxation {
    pub(crate) fn new(task: &Task, weights: Weights) -> Relaxation {
        let mut builder = Builder::new(task);
        for (index, operator) in task.operators.iter().enumerate() {
            builder.operator(index as u32, operator, weights.weight(task, operator));
        }
        for axiom in &task.axioms {
            let preconditions = builder.propositions(&axiom.body);
            builder.push(AXIOM, preconditions, vec![axiom.head.0], 0);
        }
        builder.finish()
    }

    /// How much there is to explore.
    pub(crate) fn size(&self) -> usize {
        self.preconditions.items.len() + self.adds.items.len() + self.proposition_count
    }

    pub(super) fn goal(&self) -> &[u32] {
        &self.goal
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

    pub(super) fn asking(&self, proposition: u32) -> &[u32] {
        self.asking.row(proposition)
    }

    pub(super) fn adds(&self, relaxed: u32) -> &[u32] {
        self.adds.row(relaxed)
    }

    /// Relaxed operators by what they add.
    pub(super) fn adding(&self) -> Rows {
        let mut adding = vec![Vec::new(); self.proposition_count];
        for relaxed in 0..self.relaxed_count() as u32 {
            for proposition in self.adds(relaxed) {
                adding[*proposition as usize].push(relaxed);
            }
        }
        Rows::new(&adding)
    }

    /// Sets each operator's weight.
    pub(super) fn weights(&self, weights: &mut [u64]) {
        for (origin, cost) in self.origins.iter().zip(&self.base_costs) {
            if *origin != AXIOM {
                weights[*origin as usize] = *cost;
            }
        }
    }

    /// Collects the propositions that hold in a state.
    pub(super) fn initial(&self, state: &State, found: &mut Vec<u32>) {
        found.extend(true_facts(state, self.fact_count).map(|fact| fact.0));
        for (index, fact) in self.negated.iter().enumerate() {
            if !is_true(state, *fact) {
                found.push((self.fact_count + index) as u32);
            }
        }
    }

    pub(super) fn preconditions(&self, relaxed: u32) -> &[u32] {
        self.preconditions.row(relaxed)
    }

    pub(super) fn base_cost(&self, relaxed: u32) -> u64 {
        self.base_costs[relaxed as usize]
    }

    /// The operator behind a relaxed operator; axioms have none.
    pub(super) fn origin(&self, relaxed: u32) -> Option<OperatorId> {
        let origin = self.origins[relaxed as usize];
        (origin != AXIOM).then_some(OperatorId(origin))
    }

    /// Computes the costs of propositions until the goal's are known; whether all of it is reached.
    /// Without a stop at the goal, everything reachable gets its cost.
    pub(super) fn explore(
        &self,
        state: &State,
        combine: Combine,
        stop_at_goal: bool,
        exploration: &mut Exploration,
    ) -> bool {
        exploration.reset(self);
        let mut initial = std::mem::take(&mut exploration.initial);
        self.initial(state, &mut initial);
        for proposition in initial.drain(..) {
            exploration.reach(proposition, 0, NO_SUPPORTER);
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
            if stop_at_goal && self.goal.binary_search(&proposition).is_ok() {
                goals_missing -= 1;
                if goals_missing == 0 {
                    return true;
                }
            }
            for &relaxed in self.asking.row(proposition) {
                exploration.satisfy(self, relaxed, cost, combine);
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
        self.supporters.resize(relaxation.proposition_count, NO_SUPPORTER);
        self.operator_costs.clear();
        self.operator_costs.extend_from_slice(&relaxation.base_costs);
        self.missing.clear();
        self.missing.extend_from_slice(&relaxation.missing);
        self.queue.clear();
    }

    fn reach(&mut self, proposition: u32, cost: u64, supporter: u32) {
        let known = &mut self.costs[proposition as usize];
        if cost < *known {
            *known = cost;
            self.supporters[proposition as usize] = supporter;
            self.queue.push(cost, proposition);
        }
    }

    fn satisfy(&mut self, relaxation: &Relaxation, relaxed: u32, cost: u64, combine: Combine) {
        let index = relaxed as usize;
        let total = &mut self.operator_costs[index];
        *total = match combine {
            // Saturates just below what means unreached.
            Combine::Add => total.saturating_add(cost).min(UNREACHED - 1),
            Combine::Max => (*total).max(cost.saturating_add(relaxation.base_costs[index])),
        };
        self.missing[index] -= 1;
        if self.missing[index] == 0 {
            self.fire(relaxation, relaxed);
        }
    }

    fn fire(&mut self, relaxation: &Relaxation, relaxed: u32) {
        let cost = self.operator_costs[relaxed as usize];
        for &proposition in relaxation.adds.row(relaxed) {
            self.reach(proposition, cost, relaxed);
        }
    }
}

/// Collects relaxed operators.
struct Builder<'t> {
    task: &'t Task,
    negated: Vec<FactId>,
    /// By fact: its negation's proposition.
    negations: Vec<Option<u32>>,
    /// By numeric fluent: the comparisons that read it.
    comparisons: Vec<Vec<FactId>>,
    preconditions: Vec<Vec<u32>>,
    adds: Vec<Vec<u32>>,
    base_costs: Vec<u64>,
    origins: Vec<u32>,
}

// === impl Builder ===

impl<'t> Builder<'t> {
    fn new(task: &'t Task) -> Builder<'t> {
        let mut builder = Builder {
            task,
            negated: Vec::new(),
            negations: vec![None; task.fact_count],
            comparisons: vec![Vec::new(); task.values.len()],
            preconditions: Vec::new(),
            adds: Vec::new(),
            base_costs: Vec::new(),
            origins: Vec::new(),
        };
        let axioms = task.axioms.iter().flat_map(|axiom| &axiom.body);
        let operators = task.operators.iter().flat_map(|operator| {
            let conditions = operator.conditional.iter().flat_map(|one| one.conditions);
            operator.preconditions.iter().chain(conditions)
        });
        for literal in task.goal.iter().chain(axioms).chain(operators) {
            builder.note_negation(*literal);
        }
        for (index, comparison) in task.comparisons.iter().enumerate() {
            let fact = FactId::from_index(task.basic_count + index);
            let mut note = |fluent: u32| builder.comparisons[fluent as usize].push(fact);
            comparison.left.fluents(&mut note);
            comparison.right.fluents(&mut note);
        }
        builder
    }

    fn note_negation(&mut self, literal: Literal) {
        let fact = literal.fact();
        let is_derived = fact.index() >= self.task.basic_count + self.task.comparisons.len();
        if !literal.is_positive() && !is_derived && self.negations[fact.index()].is_none() {
            self.negations[fact.index()] = Some((self.task.fact_count + self.negated.len()) as u32);
            self.negated.push(fact);
        }
    }

    fn proposition(&self, literal: Literal) -> Option<u32> {
        if literal.is_positive() {
            Some(literal.fact().0)
        } else {
            self.negations[literal.fact().index()]
        }
    }

    fn propositions(&self, literals: &[Literal]) -> Vec<u32> {
        let mut all: Vec<u32> =
            literals.iter().filter_map(|literal| self.proposition(*literal)).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    fn operator(&mut self, origin: u32, operator: Operator<'_>, weight: u64) {
        let preconditions = self.propositions(operator.preconditions);
        let adds = self.added(operator.effect);
        self.push(origin, preconditions, adds, weight);
        for one in operator.conditional.iter() {
            let all = [operator.preconditions, one.conditions].concat();
            let (preconditions, adds) = (self.propositions(&all), self.added(one.effect));
            self.push(origin, preconditions, adds, weight);
        }
    }

    /// The propositions that changes may make true.
    fn added(&self, changes: Changes<'_>) -> Vec<u32> {
        let mut all: Vec<u32> = changes.adds.iter().map(|fact| fact.0).collect();
        all.extend(changes.deletes.iter().filter_map(|fact| self.negations[fact.index()]));
        for change in changes.numeric {
            for fact in &self.comparisons[change.fluent as usize] {
                all.push(fact.0);
                all.extend(self.negations[fact.index()]);
            }
        }
        all.sort_unstable();
        all.dedup();
        all
    }

    fn push(&mut self, origin: u32, preconditions: Vec<u32>, adds: Vec<u32>, weight: u64) {
        if adds.is_empty() {
            return;
        }
        self.preconditions.push(preconditions);
        self.adds.push(adds);
        self.base_costs.push(weight);
        self.origins.push(origin);
    }

    fn finish(self) -> Relaxation {
        let goal = self.propositions(&self.task.goal);
        let proposition_count = self.task.fact_count + self.negated.len();
        let mut asking = vec![Vec::new(); proposition_count];
        for (index, preconditions) in self.preconditions.iter().enumerate() {
            for proposition in preconditions {
                asking[*proposition as usize].push(index as u32);
            }
        }
        let missing: Vec<u32> = self.preconditions.iter().map(|all| all.len() as u32).collect();
        let free =
            (0..missing.len() as u32).filter(|index| missing[*index as usize] == 0).collect();
        Relaxation {
            fact_count: self.task.fact_count,
            negated: self.negated,
            proposition_count,
            asking: Rows::new(&asking),
            preconditions: Rows::new(&self.preconditions),
            adds: Rows::new(&self.adds),
            base_costs: self.base_costs,
            origins: self.origins,
            missing,
            goal,
            free,
        }
    }
}
