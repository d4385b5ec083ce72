//! Builds the delete relaxation of a task.

use rustc_hash::FxHashMap;

use super::dominance::RelaxedOperators;
use super::numbers::{NumericSteps, Supply};
use super::{AXIOM, NO_STEP, Relaxation};
use crate::rows::Rows;
use crate::task::{Changes, FactId, GroundOperator, Literal, NumericChange, Task};

/// Builder of a delete relaxation: collects relaxed operators.
pub(super) struct RelaxationBuilder<'t> {
    task: &'t Task,
    negated: Vec<FactId>,
    /// Per fact: the proposition of its negation; `None` if no condition requires the fact to be
    /// false.
    negations: Vec<Option<u32>>,
    /// Number of propositions that mean “the body of this axiom fails”. They follow the
    /// propositions of the negated facts.
    failing: usize,
    /// Per numeric fluent: the indices of the comparisons that use it.
    comparisons: Vec<Vec<usize>>,
    numbers: NumericSteps,
    /// The numeric step that determines the number of repetitions of a relaxed operator for an
    /// added proposition. The key is the relaxed operator and the proposition.
    steps: FxHashMap<(u32, u32), u32>,
    preconditions: Rows,
    adds: Rows,
    base_costs: Vec<u64>,
    origins: Vec<u32>,
    /// Per relaxed operator that uses up a number that it requires: what it uses up.
    used_up: Vec<(u32, Vec<Supply>)>,
}

// === impl RelaxationBuilder ===

impl<'t> RelaxationBuilder<'t> {
    pub(super) fn new(task: &'t Task) -> RelaxationBuilder<'t> {
        let mut builder = RelaxationBuilder {
            task,
            negated: Vec::new(),
            negations: vec![None; task.fact_count],
            failing: 0,
            comparisons: vec![Vec::new(); task.values.len()],
            numbers: NumericSteps::new(&task.comparisons),
            steps: FxHashMap::default(),
            preconditions: Rows::default(),
            adds: Rows::default(),
            base_costs: Vec::new(),
            origins: Vec::new(),
            used_up: Vec::new(),
        };
        for literal in task.goal.iter() {
            builder.note_negation(*literal);
        }
        for operator in task.operators.iter() {
            operator.preconditions.iter().for_each(|literal| builder.note_negation(*literal));
            for one in operator.conditional.iter() {
                one.conditions.iter().for_each(|literal| builder.note_negation(*literal));
            }
        }
        builder.note_negations_of_axioms();
        for (index, comparison) in task.comparisons.iter().enumerate() {
            let mut note = |fluent: u32| builder.comparisons[fluent as usize].push(index);
            comparison.left.fluents(&mut note);
            comparison.right.fluents(&mut note);
        }
        builder
    }

    fn is_derived(&self, fact: FactId) -> bool {
        fact.index() >= self.task.basic_count + self.task.comparisons.len()
    }

    fn note_negation(&mut self, literal: Literal) {
        let fact = literal.fact();
        if !literal.is_positive() && self.negations[fact.index()].is_none() {
            self.negations[fact.index()] = Some((self.task.fact_count + self.negated.len()) as u32);
            self.negated.push(fact);
        }
    }

    /// Registers the facts that axiom bodies require to be false. A derived fact is false if the
    /// bodies of all its axioms fail, so its negation also requires the negations of their
    /// literals.
    fn note_negations_of_axioms(&mut self) {
        for literal in self.task.axioms.iter().flat_map(|axiom| &axiom.body) {
            self.note_negation(*literal);
        }
        loop {
            let known = self.negated.len();
            for axiom in &self.task.axioms {
                if self.negations[axiom.head.index()].is_some() {
                    for literal in axiom.body.iter() {
                        self.note_negation(literal.negated());
                    }
                }
            }
            if self.negated.len() == known {
                return;
            }
        }
    }

    fn proposition(&self, literal: Literal) -> Option<u32> {
        if literal.is_positive() {
            Some(literal.fact().0)
        } else {
            self.negations[literal.fact().index()]
        }
    }

    fn propositions<'l>(&self, literals: impl Iterator<Item = &'l Literal>) -> Vec<u32> {
        let mut all: Vec<u32> = literals.filter_map(|one| self.proposition(*one)).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    pub(super) fn operator(&mut self, origin: u32, operator: GroundOperator<'_>, weight: u64) {
        let preconditions = self.propositions(operator.preconditions.iter());
        let adds = self.added(operator.effect);
        if !adds.is_empty() {
            self.note_used_up(operator);
        }
        self.push(origin, &preconditions, &adds, weight);
        for one in operator.conditional.iter() {
            let all = operator.preconditions.iter().chain(one.conditions.iter());
            let (preconditions, adds) = (self.propositions(all), self.added(one.effect));
            self.push(origin, &preconditions, &adds, weight);
        }
    }

    /// Notes what the next relaxed operator, that of `operator` without conditional effects, uses up.
    fn note_used_up(&mut self, operator: GroundOperator<'_>) {
        let changes = operator.effect.numeric;
        if changes.is_empty() {
            return;
        }
        let comparison = |one: &Literal| one.fact().index().checked_sub(self.task.basic_count);
        let relaxed = self.preconditions.len() as u32;
        let required = operator.preconditions.iter().filter_map(|one| {
            let index = comparison(one).filter(|index| *index < self.task.comparisons.len())?;
            self.numbers.use_up(index, one.is_positive(), changes)
        });
        let used_up: Vec<Supply> = required.collect();
        if !used_up.is_empty() {
            self.used_up.push((relaxed, used_up));
        }
    }

    /// Passes on what operators use up to their numeric steps.
    fn note_supplies(&mut self) {
        if self.used_up.is_empty() {
            return;
        }
        let mut cheapest: FxHashMap<(u32, bool), f64> = FxHashMap::default();
        let mut of_relaxed: FxHashMap<u32, Vec<u32>> = FxHashMap::default();
        for (&(relaxed, _), &step) in &self.steps {
            of_relaxed.entry(relaxed).or_default().push(step);
            let unit_cost = self.numbers.unit_cost(step, self.base_costs[relaxed as usize]);
            let Some((distance, cost)) = unit_cost else { continue };
            let known = cheapest.entry(distance).or_insert(cost);
            *known = known.min(cost);
        }
        for (relaxed, supplies) in std::mem::take(&mut self.used_up) {
            let Some(steps) = of_relaxed.remove(&relaxed) else { continue };
            self.numbers.note_supplies(supplies, steps.into_iter(), &cheapest);
        }
    }

    /// Adds the relaxed operators that make derived facts true and those that make them false.
    pub(super) fn axioms(&mut self) {
        for axiom in &self.task.axioms {
            let body = self.propositions(axiom.body.iter());
            self.push(AXIOM, &body, &[axiom.head.0], 0);
        }
        let components = Components::of(self.task);
        let mut bodies: FxHashMap<u32, Vec<u32>> = FxHashMap::default();
        for axiom in &self.task.axioms {
            let Some(negation) = self.negations[axiom.head.index()] else { continue };
            let fails = (self.task.fact_count + self.negated.len() + self.failing) as u32;
            self.failing += 1;
            bodies.entry(negation).or_default().push(fails);
            for literal in axiom.body.iter() {
                // Facts that derive each other become false together. The failure of one of them is
                // therefore assumed, so that no reachable proposition is missed.
                let is_circular =
                    literal.is_positive() && components.share(literal.fact(), axiom.head);
                match self.proposition(literal.negated()) {
                    Some(proposition) if !is_circular => {
                        self.push(AXIOM, &[proposition], &[fails], 0);
                    }
                    _ => self.push(AXIOM, &[], &[fails], 0),
                }
            }
        }
        let mut bodies: Vec<(u32, Vec<u32>)> = bodies.into_iter().collect();
        bodies.sort_unstable();
        for (negation, fails) in bodies {
            self.push(AXIOM, &fails, &[negation], 0);
        }
        let mut has_axiom = vec![false; self.task.fact_count];
        self.task.axioms.iter().for_each(|axiom| has_axiom[axiom.head.index()] = true);
        for index in 0..self.negated.len() {
            let fact = self.negated[index];
            if self.is_derived(fact) && !has_axiom[fact.index()] {
                let negation = (self.task.fact_count + index) as u32;
                self.push(AXIOM, &[], &[negation], 0);
            }
        }
    }

    /// Returns the propositions that the changes of an effect may make true.
    fn added(&mut self, changes: Changes<'_>) -> Vec<u32> {
        let mut all: Vec<u32> = changes.adds.iter().map(|fact| fact.0).collect();
        all.extend(changes.deletes.iter().filter_map(|fact| self.negations[fact.index()]));
        self.add_comparisons(changes.numeric, &mut all);
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Adds the propositions of comparisons that numeric changes may make true or false to `all`.
    /// The changes are those of the next relaxed operator.
    fn add_comparisons(&mut self, changes: &[NumericChange], all: &mut Vec<u32>) {
        let read = changes.iter().flat_map(|change| &self.comparisons[change.fluent as usize]);
        let mut read: Vec<usize> = read.copied().collect();
        read.sort_unstable();
        read.dedup();
        if read.is_empty() {
            return;
        }
        let (relaxed, first) = (self.preconditions.len() as u32, self.numbers.register(changes));
        for index in read {
            let fact = FactId::from_index(self.task.basic_count + index);
            let propositions = [(Some(fact.0), true), (self.negations[fact.index()], false)];
            for (proposition, truth) in propositions {
                let Some(proposition) = proposition else { continue };
                if let Some(step) = self.numbers.step(index, truth, changes, first) {
                    self.steps.insert((relaxed, proposition), step);
                    all.push(proposition);
                }
            }
        }
    }

    fn push(&mut self, origin: u32, preconditions: &[u32], adds: &[u32], weight: u64) {
        if adds.is_empty() {
            return;
        }
        self.preconditions.push(preconditions);
        self.adds.push(adds);
        self.base_costs.push(weight);
        self.origins.push(origin);
    }

    /// Returns the numeric step of each addition in `adds`, in their order; [`NO_STEP`] for an
    /// addition that one application of its operator achieves. The result is empty if the
    /// relaxation has no numeric steps.
    fn steps_of(&self, adds: &Rows) -> Vec<u32> {
        if self.numbers.is_empty() {
            return Vec::new();
        }
        let rows = (0..adds.len() as u32).map(|relaxed| (relaxed, adds.row(relaxed)));
        let each = rows.flat_map(|(relaxed, row)| row.iter().map(move |one| (relaxed, *one)));
        each.map(|key| self.steps.get(&key).copied().unwrap_or(NO_STEP)).collect()
    }

    /// Builds the relaxation. If `simplify` is set, dominated additions are omitted.
    pub(super) fn finish(mut self, simplify: bool) -> Relaxation {
        self.note_supplies();
        let goal = self.propositions(self.task.goal.iter());
        let proposition_count = self.task.fact_count + self.negated.len() + self.failing;
        let adds = if simplify {
            let (preconditions, adds) = (&self.preconditions, &self.adds);
            let base_costs = &self.base_costs;
            let is_exempt = |relaxed, proposition| self.steps.contains_key(&(relaxed, proposition));
            RelaxedOperators { preconditions, adds, base_costs }
                .useful_adds(proposition_count, &is_exempt)
        } else {
            std::mem::take(&mut self.adds)
        };
        let steps = self.steps_of(&adds);
        let count = self.preconditions.len() as u32;
        let missing: Vec<u32> =
            (0..count).map(|index| self.preconditions.row(index).len() as u32).collect();
        let free = (0..count).filter(|index| missing[*index as usize] == 0).collect();
        let negations = self.negated.iter().copied().zip(self.task.fact_count as u32..);
        Relaxation {
            negations: negations.collect(),
            fact_count: self.task.fact_count,
            negated: self.negated,
            proposition_count,
            asking: self.preconditions.inverted(proposition_count),
            preconditions: self.preconditions,
            adds,
            steps,
            numbers: self.numbers,
            base_costs: self.base_costs,
            origins: self.origins,
            missing,
            goal,
            free,
        }
    }
}

/// Strongly connected components of derived facts. The facts of a component derive each other.
struct Components {
    /// Index of the first derived fact.
    first: usize,
    /// Per derived fact: the number of its component.
    components: Vec<usize>,
}

// === impl Components ===

impl Components {
    fn of(task: &Task) -> Components {
        let first = task.basic_count + task.comparisons.len();
        let mut uses = vec![Vec::new(); task.fact_count - first];
        for axiom in &task.axioms {
            let derived = axiom.body.iter().filter(|literal| literal.is_positive());
            let derived = derived.filter_map(|literal| literal.fact().index().checked_sub(first));
            uses[axiom.head.index() - first].extend(derived);
        }
        Components { first, components: pddl::graph::components(&uses) }
    }

    fn share(&self, left: FactId, right: FactId) -> bool {
        let component = |fact: FactId| {
            let index = fact.index().checked_sub(self.first)?;
            Some(self.components[index])
        };
        component(left).is_some_and(|left| component(right) == Some(left))
    }
}
