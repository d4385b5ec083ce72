//! Incremental grounding: a ground problem that is kept while its texts change. Removed objects and
//! actions are masked, and only additions are grounded.
//!
//! - No fact is static here, because the world may change any fact, and nothing is dropped as
//!   irrelevant. [`IncrementalGrounding::task`] simplifies the problem for one state and goal, in
//!   one pass.
//! - Objects, predicates and schemas keep their numbers; new ones get the next higher numbers.
//! - If a change cannot be represented by masks and additions, the result is [`NeedsRegrounding`],
//!   and the caller grounds the texts again.

use pddl::{Atom, InitElement, Term};

use super::action_relation;
use super::finish::{RawInitialState, finish};
use super::ground_fluents::GroundFluents;
use super::ground_formula::RawAxiom;
use super::grounding_meter::GroundingMeter;
use super::object_sets::ObjectSets;
use super::raw_instances::{FactLayout, RawInstances, RawTask};
use super::reach::{PreviousCounts, ReachableTuples, initial_relations, reach_on};
use super::relation::Relation;
use super::relaxed_reachability::{RelaxationIndex, RelaxedReachable};
use super::relevant_operators::RelevanceIndex;
use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::{
    Closed, Formula, Lifted, LiftedAtom, LiftedSchema, PredicateIndex, TypeSet,
};
use crate::normalize::{SymbolTable, closed, initial_values};
use crate::operators::OperatorTable;
use crate::outcome::StopReason;
use crate::task::{Literal, ObjectId, Task};

/// A ground problem that is updated when its texts change.
#[derive(Debug)]
pub(crate) struct IncrementalGrounding {
    lifted: Lifted,
    symbols: SymbolTable,
    values: GroundFluents,
    reached: ReachableTuples,
    instances: RawInstances,
    relaxation_index: Option<RelaxationIndex>,
    relevance_index: Option<RelevanceIndex>,
    /// Whether a condition quantifies over objects. If so, objects cannot be masked.
    is_quantified: bool,
    /// Number of comparisons and auxiliary facts of the texts. Those of goals have higher numbers.
    invented_facts: usize,
}

/// Mask of the objects, schemas and predicates that exist now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PresenceMask {
    /// Per object: whether the object exists.
    pub(crate) objects: Vec<bool>,
    /// Per schema: whether the schema exists.
    pub(crate) schemas: Vec<bool>,
    /// Per declared predicate: whether the predicate exists.
    pub(crate) predicates: Vec<bool>,
}

/// Initial state of a problem (`:init`), with numbers instead of names.
#[derive(Debug, Default)]
pub(crate) struct InitialState {
    /// Facts that are true. Each entry is the predicate of the fact, and the row of the fact in the
    /// predicate's relation.
    facts: Vec<(PredicateIndex, usize)>,
    values: Vec<(usize, Vec<ObjectId>, f64)>,
}

/// Error for a change that cannot be represented by masks and additions, so that the problem must
/// be grounded again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NeedsRegrounding;

/// Number of facts that are reserved for each predicate beyond twice the number of its facts now.
const ROOM: usize = 8;

/// Limit on comparisons, disjunctions and types that earlier goals have added. If it is exceeded,
/// the problem is grounded again, so that a caller with ever new goals cannot exhaust the memory.
const LEFTOVERS_MAX: usize = 1_000;

/// Number of spare facts for all later declared predicates together.
const ROOM_FOR_PREDICATES: usize = 512;

// === impl IncrementalGrounding ===

impl IncrementalGrounding {
    /// Grounds a lifted task. Sets `join_steps` to the work that was done, even if grounding fails.
    pub(crate) fn new(
        mut lifted: Lifted,
        symbols: SymbolTable,
        budget: Budget,
        cancel: &Cancel,
        join_steps: &mut u64,
    ) -> Result<IncrementalGrounding, StopReason> {
        let mut work = GroundingMeter::new(budget, cancel);
        make_changeable(&mut lifted);
        let mut values = GroundFluents::new(&lifted);
        let relations = initial_relations(&lifted);
        let reached = reach_on(&lifted, &values, relations, PreviousCounts::default(), &mut work);
        *join_steps = work.steps;
        let mut reached = reached?;
        let sizes = reached.relations[..lifted.predicates.len()].iter();
        let mut drawn = RawInstances::new(sizes.map(|one| room(one.len())), ROOM_FOR_PREDICATES);
        let rows = vec![0; lifted.schemas.len()];
        drawn.add_instances(&lifted, &mut reached, &mut values, &rows, &mut work)?;
        let is_quantified = is_quantified(&lifted);
        let made_up = drawn.invented_fact_count();
        let (flow, sources) = (None, None);
        Ok(IncrementalGrounding {
            lifted,
            symbols,
            values,
            reached,
            instances: drawn,
            relaxation_index: flow,
            relevance_index: sources,
            is_quantified,
            invented_facts: made_up,
        })
    }

    /// Returns the number of the object with this name; `None` if no known text declares it.
    pub(crate) fn object(&self, name: &pddl::Name) -> Option<ObjectId> {
        self.symbols.known_object(name)
    }

    /// Returns warnings about constructs that the author of the domain probably did not intend.
    pub(crate) fn warnings(&self) -> &[pddl::Diagnostic] {
        &self.instances.warnings
    }

    /// Whether objects can be masked, which requires that no condition quantifies over them.
    pub(crate) fn can_mask_objects(&self) -> bool {
        !self.is_quantified
    }

    /// Whether all function values in `:init` are of functions and objects that also had a value
    /// when the problem was grounded.
    pub(crate) fn has_known_values(&self, now: &InitialState) -> bool {
        self.values.has_tuples(&now.values)
    }

    /// Converts the names in `:init` to numbers. Returns `None` if `:init` contains facts or values
    /// that the ground problem has no numbers for.
    pub(crate) fn convert_initial_state(
        &mut self,
        problem: &pddl::Problem,
    ) -> Option<InitialState> {
        let (symbols, relations) = (&mut self.symbols, &self.reached.relations);
        let mut facts = Vec::with_capacity(problem.init.len());
        let mut objects = Vec::new();
        // Facts of the same predicate are usually next to each other.
        let mut last: Option<(&Atom, PredicateIndex)> = None;
        for element in &problem.init {
            let InitElement::Atom(atom) = element else { continue };
            let arity = atom.arguments.len();
            let is_same = |(other, _): &(&Atom, usize)| {
                other.predicate == atom.predicate && other.arguments.len() == arity
            };
            let predicate = match last.filter(is_same) {
                Some((_, predicate)) => predicate,
                None => symbols.known_predicate(&atom.predicate, arity)?,
            };
            last = Some((atom, predicate));
            objects.clear();
            for term in &atom.arguments {
                let Term::Object(name) = term else { return None };
                objects.push(symbols.known_object(name)?);
            }
            facts.push((predicate, relations[predicate].find(&objects)?));
        }
        let values = initial_values(symbols, problem);
        symbols.take_problems().is_empty().then_some(InitialState { facts, values })
    }

    /// Whether the operators are still valid with the function values of `now`. Numeric fluents may
    /// have new values, but must be defined for the same objects; all other functions must have the
    /// same values as before.
    pub(crate) fn keeps_operators_valid(&self, now: &InitialState, present: &PresenceMask) -> bool {
        !self.lifted.costs.varies
            && self.values.keeps_expressions_valid(&self.lifted, &now.values, &present.objects)
    }

    /// Grounds the additions to the texts. `lifted` repeats the known parts in the same order,
    /// followed by the new ones.
    pub(crate) fn extend(
        &mut self,
        mut lifted: Lifted,
        symbols: SymbolTable,
        budget: Budget,
        cancel: &Cancel,
        join_steps: &mut u64,
    ) -> Result<Result<(), NeedsRegrounding>, StopReason> {
        let before = PreviousCounts {
            objects: self.lifted.objects.len(),
            schemas: self.lifted.schemas.len(),
        };
        let known = self.lifted.predicates.len();
        let mut work = GroundingMeter::new(budget, cancel);
        make_changeable(&mut lifted);
        if !self.values.add_values(&lifted, before.objects) {
            return Ok(Err(NeedsRegrounding));
        }
        let mut relations = std::mem::take(&mut self.reached.relations);
        let schemas = relations.split_off(known);
        relations.extend(lifted.predicates[known..].iter().map(|one| Relation::new(one.arity)));
        relations.extend(schemas);
        let new = lifted.schemas[before.schemas..].iter();
        relations.extend(new.map(|schema| Relation::new(schema.parameter_count)));
        relations.iter_mut().for_each(Relation::forget_statistics);
        let sizes: Vec<usize> = relations.iter().map(Relation::len).collect();
        for (predicate, arguments) in &lifted.init {
            relations[*predicate].insert(arguments);
        }
        let reached = reach_on(&lifted, &self.values, relations, before, &mut work);
        *join_steps = work.steps;
        self.reached = reached?;
        let lengths = || self.reached.relations.iter().map(Relation::len);
        if !self.instances.has_room(lengths().take(lifted.predicates.len()), room) {
            return Ok(Err(NeedsRegrounding));
        }
        let grew: Vec<bool> = lengths().zip(sizes.iter()).map(|(now, then)| now > *then).collect();
        let objects_grew = lifted.objects.len() > before.objects;
        let mut rows = vec![0; lifted.schemas.len()];
        let mut settled = vec![false; lifted.schemas.len()];
        for (index, schema) in lifted.schemas[..before.schemas].iter().enumerate() {
            settled[index] = is_settled(schema, &grew, objects_grew);
            if settled[index] {
                rows[index] = sizes[action_relation(&lifted, index)];
            }
        }
        let operators = &self.instances.operators;
        let stays = |index: &usize| settled[operators.get(*index).schema as usize];
        self.instances.operators = chosen(operators, (0..operators.len()).filter(stays));
        self.instances.add_instances(
            &lifted,
            &mut self.reached,
            &mut self.values,
            &rows,
            &mut work,
        )?;
        self.is_quantified = is_quantified(&lifted);
        (self.lifted, self.symbols) = (lifted, symbols);
        (self.relaxation_index, self.relevance_index) = (None, None);
        Ok(Ok(()))
    }

    /// Builds the task for one state and goal. Returns `None` if the goal can never hold. Returns
    /// [`NeedsRegrounding`] if the goal uses functions that are not part of the state, or if
    /// earlier goals have added too much.
    pub(crate) fn task(
        &mut self,
        now: &InitialState,
        present: &PresenceMask,
        goal: &pddl::Condition,
        budget: Budget,
        cancel: &Cancel,
    ) -> Result<Result<Option<Task>, NeedsRegrounding>, StopReason> {
        let mut work = GroundingMeter::new(budget, cancel);
        let types = self.symbols.types.len() - self.lifted.types.len();
        if self.instances.invented_fact_count() - self.invented_facts + types > LEFTOVERS_MAX {
            return Ok(Err(NeedsRegrounding));
        }
        let goal = closed(&mut self.symbols, goal);
        let mut is_followed = self.symbols.take_problems().is_empty();
        goal.formula.functions(&mut |index| is_followed &= self.lifted.functions[index].read);
        if !is_followed {
            return Ok(Err(NeedsRegrounding));
        }
        let Some(goal) = self.goal(&goal, present, &mut work)? else { return Ok(Ok(None)) };
        let (layout, holds, possible) = self.possible(now, present);
        let operators = self.wanted(&layout, &goal, &possible);
        let can = |axiom: &&_| is_possible(&layout, &possible.facts, axiom);
        let raw = RawTask {
            operators,
            axioms: self.instances.axioms().filter(can).cloned().collect(),
            comparisons: self.instances.comparisons.all.clone(),
            goal: Some(goal),
            layout,
            has_negative_cost: self.pays(&possible),
            warnings: Vec::new(),
        };
        let never = possible.facts.iter().map(|can| !can).collect();
        let start = RawInitialState {
            initial: holds,
            never,
            values: self.values.fluent_values(&self.lifted, &now.values),
        };
        let relations = &self.reached.relations;
        finish(&self.lifted, relations, start, raw, &mut work).map(Ok)
    }

    /// Returns, for each of `facts`, whether it is reachable in the delete relaxation. The result
    /// is `false` for a fact that the ground problem does not contain.
    pub(crate) fn reaches(
        &mut self,
        now: &InitialState,
        present: &PresenceMask,
        facts: &[(PredicateIndex, Vec<ObjectId>)],
    ) -> Vec<bool> {
        let (layout, _, possible) = self.possible(now, present);
        let can = |(predicate, objects): &(PredicateIndex, Vec<ObjectId>)| {
            let row = self.reached.relations[*predicate].find(objects);
            row.is_some_and(|row| possible.facts[layout.offsets[*predicate] + row])
        };
        facts.iter().map(can).collect()
    }

    /// Converts a condition that is a single fact to the number of its predicate and the numbers of
    /// its objects. Returns `None` for other conditions, and for names that the ground problem has
    /// no numbers for.
    pub(crate) fn fact(&mut self, condition: &pddl::Condition) -> Option<(usize, Vec<ObjectId>)> {
        let pddl::Condition::Atom(atom) = condition else { return None };
        let objects = atom.arguments.iter().map(|term| match term {
            pddl::Term::Object(name) => self.symbols.known_object(name),
            pddl::Term::Variable(_) => None,
        });
        let objects = objects.collect::<Option<Vec<_>>>()?;
        let predicate = self.symbols.predicate(&atom.predicate, objects.len());
        self.symbols.take_problems();
        Some((predicate?, objects))
    }

    /// Returns three things: the layout of the fact numbers; for each raw fact number, whether the
    /// fact is true; and the facts and operators that are reachable from the true facts in the
    /// delete relaxation.
    fn possible(
        &mut self,
        now: &InitialState,
        present: &PresenceMask,
    ) -> (FactLayout, Vec<bool>, RelaxedReachable) {
        let layout = self.instances.layout();
        let mut holds = vec![false; layout.comparison_offset];
        for (predicate, row) in &now.facts {
            holds[layout.offsets[*predicate] + row] = true;
        }
        let masked = self.masked(present);
        let RawInstances { operators, .. } = &self.instances;
        let flow = self.relaxation_index.take().filter(|flow| flow.covers(&layout, operators));
        let flow = flow
            .unwrap_or_else(|| RelaxationIndex::new(&layout, operators, self.instances.axioms()));
        let possible = flow.relaxed_reachable(&layout, &holds, &masked);
        self.relaxation_index = Some(flow);
        (layout, holds, possible)
    }

    /// Returns the operators that are relevant to the goal and applicable in the delete relaxation.
    fn wanted(
        &mut self,
        layout: &FactLayout,
        goal: &[Literal],
        possible: &RelaxedReachable,
    ) -> OperatorTable {
        let RawInstances { operators, .. } = &self.instances;
        let sources =
            self.relevance_index.take().filter(|sources| sources.covers(layout, operators));
        let new = || RelevanceIndex::new(layout, operators, self.instances.axioms());
        let sources = sources.unwrap_or_else(new);
        let wanted = sources.wanted(layout, goal, &possible.operators);
        self.relevance_index = Some(sources);
        chosen(operators, wanted.into_iter())
    }

    /// Whether an operator that is applicable in the delete relaxation has a negative cost, even if
    /// it is irrelevant to the goal.
    fn pays(&self, possible: &RelaxedReachable) -> bool {
        let mut all = self.instances.operators.iter().zip(&possible.operators);
        all.any(|(operator, can)| *can && f64::from_bits(operator.cost) < 0.0)
    }

    /// Grounds a goal over the objects that exist now.
    fn goal(
        &mut self,
        goal: &Closed,
        present: &PresenceMask,
        work: &mut GroundingMeter<'_>,
    ) -> Result<Option<Vec<Literal>>, StopReason> {
        let count = self.lifted.objects.len();
        let here = |set: &TypeSet| {
            let members = set.members.iter().copied();
            TypeSet::new(members.filter(|one| present.objects[one.index()]).collect(), count)
        };
        let mut reached = ReachableTuples {
            sets: ObjectSets::of(self.symbols.types.iter().map(here).collect()),
            relations: std::mem::take(&mut self.reached.relations),
        };
        let drawn =
            self.instances.ground_goal(&self.lifted, goal, &mut reached, &mut self.values, work);
        self.reached.relations = reached.relations;
        drawn
    }

    /// Returns, per operator, whether it is masked: its schema or one of its objects no longer
    /// exists.
    fn masked(&self, present: &PresenceMask) -> Vec<bool> {
        let is_here = |object: &ObjectId| present.objects[object.index()];
        let all = self.instances.operators.iter();
        all.map(|operator| {
            !present.schemas[operator.schema as usize] || !operator.arguments.iter().all(is_here)
        })
        .collect()
    }
}

/// Returns the number of facts that are reserved for a predicate with `facts` facts now.
fn room(facts: usize) -> usize {
    2 * facts + ROOM
}

/// Marks all basic predicates as changeable, because the world may change any fact.
fn make_changeable(lifted: &mut Lifted) {
    for predicate in lifted.predicates.iter_mut().filter(|predicate| !predicate.derived) {
        (predicate.added, predicate.deleted) = (true, true);
    }
}

/// Returns a table with the operators that have these numbers.
fn chosen(operators: &OperatorTable, numbers: impl Iterator<Item = usize>) -> OperatorTable {
    let mut chosen = OperatorTable::default();
    for operator in numbers.map(|number| operators.get(number)) {
        chosen.push_with(operator, operator.preconditions.iter().copied());
    }
    chosen
}

/// Whether an axiom may fire: all facts in its positive literals are marked as reachable in
/// `facts`.
fn is_possible(layout: &FactLayout, facts: &[bool], axiom: &RawAxiom) -> bool {
    let mut asked = axiom.body.iter().filter(|literal| literal.is_positive());
    asked.all(|literal| facts[layout.dense(literal.fact())])
}

/// Whether the ground operators of a schema are still correct after some predicates, and possibly
/// the set of objects, have grown.
///
/// When a tuple of the schema was found, the facts that its precondition requires and the facts
/// that it adds already existed. Facts in negative or conditional parts, and facts that the tuple
/// deletes, may be new.
fn is_settled(schema: &LiftedSchema, grew: &[bool], objects_grew: bool) -> bool {
    let mut required = Vec::new();
    let mut is_settled = settled_conjunct(&schema.precondition, grew, objects_grew, &mut required);
    let mut condition = |formula: &Formula| {
        formula.literals(&mut |_, atom| is_settled &= !grew[atom.predicate]);
        is_settled &= !(objects_grew && ranges(formula));
    };
    schema.effects.iter().for_each(|effect| condition(&effect.condition));
    schema.numeric.iter().for_each(|change| condition(&change.condition));
    let deletes = schema.effects.iter().filter(|effect| !effect.adds);
    for effect in deletes {
        is_settled &= !grew[effect.atom.predicate] || required.contains(&&effect.atom);
    }
    let mut variables = schema.effects.iter().map(|effect| &effect.variables);
    let mut numeric = schema.numeric.iter().map(|change| &change.variables);
    let is_universal = variables.any(|one| !one.is_empty()) || numeric.any(|one| !one.is_empty());
    is_settled && !(objects_grew && is_universal)
}

/// Does the same as [`is_settled`] for a part of a precondition. Collects the atoms that this part
/// always requires.
fn settled_conjunct<'s>(
    formula: &'s Formula,
    grew: &[bool],
    objects_grew: bool,
    required: &mut Vec<&'s LiftedAtom>,
) -> bool {
    match formula {
        Formula::And(parts) => {
            let mut is_settled = true;
            for part in parts {
                is_settled &= settled_conjunct(part, grew, objects_grew, required);
            }
            is_settled
        }
        Formula::Literal { positive: true, atom } => {
            required.push(atom);
            true
        }
        other => {
            let mut is_settled = !(objects_grew && ranges(other));
            other.literals(&mut |_, atom| is_settled &= !grew[atom.predicate]);
            is_settled
        }
    }
}

/// Whether a formula quantifies over objects.
fn ranges(formula: &Formula) -> bool {
    match formula {
        Formula::Exists(..) | Formula::Forall(..) => true,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(ranges),
        _ => false,
    }
}

/// Whether a quantifier of the task could refer to a removed object.
fn is_quantified(lifted: &Lifted) -> bool {
    let in_schema = |schema: &LiftedSchema| {
        let mut effects = schema.effects.iter();
        let mut numeric = schema.numeric.iter();
        ranges(&schema.precondition)
            || effects.any(|effect| {
                ranges(&effect.condition)
                    || !effect.variables.is_empty() && (effect.adds || !effect.condition.is_true())
            })
            || numeric.any(|change| ranges(&change.condition) || !change.variables.is_empty())
    };
    lifted.schemas.iter().any(in_schema)
        || lifted.axioms.iter().any(|axiom| axiom.frame.len() > axiom.parameter_count)
}
