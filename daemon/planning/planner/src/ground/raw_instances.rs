//! Ground operators and axioms with raw fact numbers, created from reachable tuples. Further
//! operators and axioms can be added later.
//!
//! A *raw* fact is a row of a relation, a comparison, or an auxiliary fact. `finish` keeps the raw
//! facts that are relevant to the goal, and renumbers them.

use pddl::Diagnostic;

use super::action_relation;
use super::draft::OperatorDraft;
use super::formula_template::{COMPARISONS_MAX, Comparisons, FormulaGrounder, FormulaTemplate};
use super::ground_fluents::GroundFluents;
use super::ground_formula::{Auxiliaries, RawAxiom};
use super::grounding_meter::GroundingMeter;
use super::instantiate::{Instantiation, SchemaTemplate, ready_axioms};
use super::join::Catalog;
use super::object_sets::ObjectSets;
use super::reach::ReachableTuples;
use super::relation::Relation;
use crate::normalize::lifted::{Closed, Lifted, LiftedSchema};
use crate::outcome::StopReason;
use crate::task::{FactId, GroundComparison, Literal, OperatorTable};

/// The ground task, with raw fact numbers.
pub(super) struct RawTask {
    /// Ground operators. Their costs are stored as the bits of `f64` values, in units of the
    /// metric.
    pub(super) operators: OperatorTable,
    pub(super) axioms: Vec<RawAxiom>,
    pub(super) comparisons: Vec<GroundComparison>,
    /// Literals of the goal; `None` if the goal can never hold.
    pub(super) goal: Option<Vec<Literal>>,
    pub(super) layout: FactLayout,
    /// Whether an operator with a negative cost was omitted from `operators` because it is
    /// irrelevant to the goal.
    pub(super) has_negative_cost: bool,
    pub(super) warnings: Vec<Diagnostic>,
}

/// Layout of the raw fact numbers: the ranges of each predicate's rows, of the comparisons and of
/// the auxiliary facts.
pub(super) struct FactLayout {
    /// Per predicate: the raw fact number of its first row. The last entry is the end of all rows.
    pub(super) offsets: Vec<usize>,
    pub(super) comparison_offset: usize,
    pub(super) auxiliary_offset: usize,
    /// The raw fact number after the last auxiliary fact.
    pub(super) end: usize,
    /// Number of comparisons so far.
    pub(super) comparisons: usize,
}

/// Operators and axioms that have been grounded so far. The numbers of raw facts never change here.
#[derive(Debug)]
pub(super) struct RawInstances {
    pub(super) operators: OperatorTable,
    pub(super) auxiliaries: Auxiliaries,
    pub(super) comparisons: Comparisons,
    pub(super) warnings: Vec<Diagnostic>,
    /// Axioms of the domain. The axioms that derive auxiliary facts are in `auxiliaries`.
    axioms: Vec<RawAxiom>,
    /// Per predicate: the raw fact number of its first row. The last entry is the end of all rows.
    offsets: Vec<usize>,
    comparison_offset: usize,
}

/// Grounds every schema, every axiom and the goal over the reachable tuples.
pub(super) fn instantiate_all(
    lifted: &Lifted,
    reached: &mut ReachableTuples,
    values: &mut GroundFluents,
    work: &mut GroundingMeter<'_>,
) -> Result<RawTask, StopReason> {
    let sizes = reached.relations[..lifted.predicates.len()].iter().map(Relation::len);
    let mut drawn = RawInstances::new(sizes, 0);
    drawn.add_instances(lifted, reached, values, &vec![0; lifted.schemas.len()], work)?;
    let goal = drawn.ground_goal(lifted, &lifted.goal, reached, values, work)?;
    Ok(drawn.into_raw(goal))
}

// === impl FactLayout ===

impl FactLayout {
    /// Returns the dense index after the last comparison.
    pub(super) fn comparison_end(&self) -> usize {
        self.comparison_offset + self.comparisons
    }

    /// Returns the dense index after the last raw fact.
    pub(super) fn dense_end(&self) -> usize {
        self.comparison_end() + (self.end - self.auxiliary_offset)
    }

    /// Returns the dense index of a raw fact: its number without the reserved gap for further
    /// comparisons.
    #[inline]
    pub(super) fn dense(&self, fact: FactId) -> usize {
        let index = fact.index();
        if index < self.auxiliary_offset {
            index
        } else {
            index - self.auxiliary_offset + self.comparison_end()
        }
    }
}

// === impl RawInstances ===

impl RawInstances {
    /// Creates an empty set of instances. `room` gives the maximum number of facts of each
    /// predicate; `spare` is the maximum number of facts of all later predicates together.
    pub(super) fn new(room: impl Iterator<Item = usize>, spare: usize) -> RawInstances {
        let mut offsets = vec![0];
        offsets.extend(room.scan(0, |end, room| {
            *end += room;
            Some(*end)
        }));
        let comparison_offset = offsets[offsets.len() - 1] + spare;
        RawInstances {
            operators: OperatorTable::default(),
            auxiliaries: Auxiliaries::new(comparison_offset + COMPARISONS_MAX),
            comparisons: Comparisons::default(),
            warnings: Vec::new(),
            axioms: Vec::new(),
            offsets,
            comparison_offset,
        }
    }

    /// Whether each predicate has room for its number of facts in `facts`. The room of a new
    /// predicate is the result of `room` for its number of facts.
    pub(super) fn has_room(
        &mut self,
        facts: impl Iterator<Item = usize>,
        room: impl Fn(usize) -> usize,
    ) -> bool {
        for (predicate, facts) in facts.enumerate() {
            let start = self.offsets[predicate];
            if predicate + 1 == self.offsets.len() {
                self.offsets.push(start + room(facts));
            }
            if start + facts > self.offsets[predicate + 1] {
                return false;
            }
        }
        self.offsets.last().is_some_and(|end| *end <= self.comparison_offset)
    }

    /// Grounds the new tuples of each schema, beginning at its row in `rows`, and grounds all
    /// axioms again.
    pub(super) fn add_instances(
        &mut self,
        lifted: &Lifted,
        reached: &mut ReachableTuples,
        values: &mut GroundFluents,
        rows: &[usize],
        work: &mut GroundingMeter<'_>,
    ) -> Result<(), StopReason> {
        let ReachableTuples { relations, sets } = reached;
        let mut catalog = Catalog { lifted, relations, sets, is_complete: true };
        let has_rows = |(index, _): &(usize, &LiftedSchema)| {
            rows[*index] < catalog.relations[action_relation(lifted, *index)].len()
        };
        let schemas: Vec<_> = lifted.schemas.iter().enumerate().filter(has_rows).collect();
        let schemas = schemas.into_iter();
        let ready: Vec<SchemaTemplate<'_>> = schemas
            .map(|(index, schema)| SchemaTemplate::new(&mut catalog, index, schema))
            .collect();
        let axioms = ready_axioms(&mut catalog);
        self.axioms.clear();
        let mut instantiation = self.instantiation(lifted, relations, sets, values, work);
        for schema in &ready {
            instantiation.schema(schema, rows[schema.index])?;
        }
        for axiom in &axioms {
            instantiation.axiom(axiom)?;
        }
        Ok(())
    }

    /// Grounds a goal. Returns `None` if the goal can never hold.
    pub(super) fn ground_goal(
        &mut self,
        lifted: &Lifted,
        goal: &Closed,
        reached: &mut ReachableTuples,
        values: &mut GroundFluents,
        work: &mut GroundingMeter<'_>,
    ) -> Result<Option<Vec<Literal>>, StopReason> {
        let ReachableTuples { relations, sets } = reached;
        let mut catalog = Catalog { lifted, relations, sets, is_complete: true };
        let Closed { frame, formula } = goal;
        let node =
            FormulaTemplate::compile(&mut catalog, frame, formula, &mut vec![false; frame.len()]);
        self.instantiation(lifted, relations, sets, values, work).goal(&node, frame)
    }

    fn instantiation<'g, 'w, 'c>(
        &'g mut self,
        lifted: &'g Lifted,
        relations: &'g [Relation],
        sets: &'g ObjectSets,
        values: &'g mut GroundFluents,
        work: &'w mut GroundingMeter<'c>,
    ) -> Instantiation<'g, 'w, 'c> {
        let RawInstances { operators, auxiliaries, comparisons, warnings, axioms, .. } = self;
        let (offsets, comparison_offset) = (&*self.offsets, self.comparison_offset);
        let grounder = FormulaGrounder {
            lifted,
            relations,
            sets,
            offsets,
            values,
            comparisons,
            comparison_offset,
        };
        Instantiation {
            grounder,
            auxiliaries,
            operators,
            axioms,
            warnings,
            work,
            top: lifted.axioms.iter().map(|axiom| axiom.stratum + 1).max().unwrap_or(0),
            bytes: 0,
            draft: OperatorDraft::default(),
            literals: Vec::new(),
            bindings: Vec::new(),
        }
    }

    /// Returns the number of comparisons and auxiliary facts, which are not rows of relations.
    pub(super) fn invented_fact_count(&self) -> usize {
        self.comparisons.all.len() + self.auxiliaries.len()
    }

    /// Returns the layout of the raw fact numbers.
    pub(super) fn layout(&self) -> FactLayout {
        let comparison_offset = self.comparison_offset;
        FactLayout {
            offsets: self.offsets.clone(),
            comparison_offset,
            auxiliary_offset: comparison_offset + COMPARISONS_MAX,
            end: self.auxiliaries.end(),
            comparisons: self.comparisons.all.len(),
        }
    }

    /// Iterates over all ground axioms: those of auxiliary facts, then those of the domain.
    pub(super) fn axioms(&self) -> impl Iterator<Item = &RawAxiom> {
        self.auxiliaries.axioms.iter().chain(&self.axioms)
    }

    fn into_raw(self, goal: Option<Vec<Literal>>) -> RawTask {
        let layout = self.layout();
        let RawInstances { operators, mut auxiliaries, comparisons, warnings, axioms, .. } = self;
        auxiliaries.axioms.extend(axioms);
        auxiliaries.tidy();
        let (axioms, comparisons) = (auxiliaries.axioms, comparisons.all);
        RawTask { operators, axioms, comparisons, goal, layout, has_negative_cost: false, warnings }
    }
}
