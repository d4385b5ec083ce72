//! Joins, which find all bindings of variables that satisfy a set of atoms, without enumerating all
//! combinations of objects.
//!
//! - [`JoinPlan::compile`] fixes the order of the atoms: first those with all arguments bound, then
//!   those with few matches. The objects of a type are enumerated only for variables that no atom
//!   binds.
//! - [`Join::run`] executes the plan, and counts every candidate tuple in the [`GroundingMeter`].

use super::ground_fluents::GroundFluents;
use super::grounding_meter::GroundingMeter;
use super::object_sets::ObjectSets;
use super::relation::{IndexId, Relation};
use crate::normalize::lifted::{
    Lifted, LiftedAtom, LiftedExpression, LiftedTerm, SlotIndex, TypeIndex,
};
use crate::outcome::StopReason;
use crate::task::ObjectId;

/// A test within a join, which is evaluated as soon as its variables are bound.
#[derive(Clone, Debug)]
pub(super) enum JoinFilter {
    Equal {
        positive: bool,
        left: LiftedTerm,
        right: LiftedTerm,
    },
    /// Tests that an atom is false in the initial state. This test is sufficient, because no action
    /// deletes facts of the atom's predicate.
    NotInitially(LiftedAtom),
    /// Tests a comparison of static functions.
    Compare {
        comparison: pddl::Comparison,
        sides: Box<(LiftedExpression, LiftedExpression)>,
    },
}

/// A join plan: the order in which variables are bound and tests are evaluated.
#[derive(Clone, Debug, Default)]
pub(super) struct JoinPlan {
    steps: Vec<JoinStep>,
}

#[derive(Clone, Debug)]
enum JoinStep {
    /// Binds variables from the rows of a relation that match the bound arguments.
    Probe(IndexProbe),
    /// Tests whether a fully bound tuple is in the relation.
    Contains {
        atom: LiftedAtom,
        is_new_to: bool,
    },
    /// Binds a variable to each object of its object set.
    Enumerate(SlotIndex),
    Check(JoinFilter),
}

#[derive(Clone, Debug)]
struct IndexProbe {
    relation: usize,
    index: IndexId,
    key: Vec<LiftedTerm>,
    binds: Vec<(usize, SlotIndex)>,
    same: Vec<(usize, usize)>,
    is_new_to: bool,
}

/// An atom that a join matches with the rows of a relation.
#[derive(Clone, Copy, Debug)]
pub(super) struct JoinAtom<'r> {
    pub(super) atom: &'r LiftedAtom,
    /// Whether the tuple that triggered the join is excluded for this atom. Bindings with this
    /// tuple are found by another join, which the same tuple triggers at this atom.
    pub(super) is_new_to: bool,
}

/// Inputs of a join.
#[derive(Clone, Copy)]
pub(super) struct Join<'g> {
    pub(super) relations: &'g [Relation],
    pub(super) sets: &'g ObjectSets,
    pub(super) values: &'g GroundFluents,
    /// Per slot (variable): the set of objects that it may be bound to.
    pub(super) frame: &'g [TypeIndex],
    /// Relation of the tuple that triggered the join, and the row of the tuple in it; `None` for a
    /// join without a trigger.
    pub(super) cause: Option<(usize, usize)>,
}

/// Inputs of planning a join.
pub(super) struct Catalog<'g> {
    pub(super) lifted: &'g Lifted,
    pub(super) relations: &'g mut [Relation],
    pub(super) sets: &'g ObjectSets,
    /// Whether the relations are complete, so that their sizes are valid estimates.
    pub(super) is_complete: bool,
}

// === impl JoinPlan ===

impl JoinPlan {
    /// Plans a join over the atoms in `parts` that binds all slots in `wanted`. `bound` marks the
    /// slots that are bound before the join, and is updated.
    pub(super) fn compile<'r>(
        catalog: &mut Catalog<'_>,
        frame: &[TypeIndex],
        parts: impl IntoIterator<Item = JoinAtom<'r>>,
        filters: &[JoinFilter],
        wanted: &[SlotIndex],
        bound: &mut [bool],
    ) -> JoinPlan {
        let mut plan = JoinPlan::default();
        let mut parts: Vec<JoinAtom<'_>> = parts.into_iter().collect();
        let mut filters: Vec<&JoinFilter> = filters.iter().collect();
        plan.check_ready(&mut filters, bound);
        while !parts.is_empty() {
            let costs = parts.iter().map(|part| estimate(catalog, frame, part.atom, bound));
            let best = costs.enumerate().min_by(|(_, left), (_, right)| left.total_cmp(right));
            let Some((position, _)) = best else { break };
            let part = parts.remove(position);
            plan.steps.push(probe(catalog.relations, part, bound));
            plan.check_ready(&mut filters, bound);
        }
        for &slot in wanted {
            if !std::mem::replace(&mut bound[slot as usize], true) {
                plan.steps.push(JoinStep::Enumerate(slot));
                plan.check_ready(&mut filters, bound);
            }
        }
        plan
    }

    /// Appends the filters with all variables bound to the plan, and removes them from `filters`.
    fn check_ready(&mut self, filters: &mut Vec<&JoinFilter>, bound: &[bool]) {
        filters.retain(|filter| {
            let mut is_ready = true;
            filter.slots(&mut |slot| is_ready &= bound[slot as usize]);
            if is_ready {
                self.steps.push(JoinStep::Check((*filter).clone()));
            }
            !is_ready
        });
    }
}

fn is_bound(term: &LiftedTerm, bound: &[bool]) -> bool {
    match term {
        LiftedTerm::Variable(slot) => bound[*slot as usize],
        LiftedTerm::Object(_) => true,
    }
}

/// Estimates the number of rows that match an atom, for the slots that are `bound`.
fn estimate(catalog: &Catalog<'_>, frame: &[TypeIndex], atom: &LiftedAtom, bound: &[bool]) -> f64 {
    let open = atom.arguments.iter().enumerate().filter_map(|(column, term)| match term {
        LiftedTerm::Variable(slot) if !bound[*slot as usize] => Some((column, *slot)),
        _ => None,
    });
    let size = |slot: SlotIndex| catalog.sets.get(frame[slot as usize]).members.len() as f64;
    let relation = &catalog.relations[atom.predicate];
    if !catalog.is_complete && !is_static(catalog.lifted, atom.predicate) {
        // The relation of a fluent predicate still grows, and may contain most combinations in the
        // end.
        let mut combinations = 1.0;
        let mut seen = Vec::new();
        for (_, slot) in open {
            if !seen.contains(&slot) {
                seen.push(slot);
                combinations *= size(slot);
            }
        }
        return if seen.is_empty() { 0.0 } else { combinations };
    }
    let mut is_open = false;
    let mut rows = relation.len() as f64;
    for (column, slot) in open {
        is_open = true;
        rows *= (size(slot) / relation.distinct(column).max(1) as f64).min(1.0);
    }
    for (column, term) in atom.arguments.iter().enumerate() {
        if is_bound(term, bound) {
            rows /= relation.distinct(column).max(1) as f64;
        }
    }
    if is_open { rows } else { 0.0 }
}

/// Whether the relation is that of a static predicate, which no action changes.
pub(super) fn is_static(lifted: &Lifted, relation: usize) -> bool {
    lifted.predicates.get(relation).is_some_and(|predicate| predicate.is_static())
}

/// Returns the step that joins an atom, and marks the atom's variables as bound.
fn probe(relations: &mut [Relation], part: JoinAtom<'_>, bound: &mut [bool]) -> JoinStep {
    let JoinAtom { atom, is_new_to } = part;
    let (mut columns, mut key) = (Vec::new(), Vec::new());
    let (mut binds, mut same) = (Vec::<(usize, SlotIndex)>::new(), Vec::new());
    for (column, term) in atom.arguments.iter().enumerate() {
        match *term {
            LiftedTerm::Variable(slot) if !bound[slot as usize] => {
                match binds.iter().find(|(_, other)| *other == slot) {
                    Some(&(first, _)) => same.push((first, column)),
                    None => binds.push((column, slot)),
                }
            }
            _ => {
                columns.push(column);
                key.push(*term);
            }
        }
    }
    if binds.is_empty() && relations[atom.predicate].has_set() {
        return JoinStep::Contains { atom: atom.clone(), is_new_to };
    }
    binds.iter().for_each(|(_, slot)| bound[*slot as usize] = true);
    let index = relations[atom.predicate].index(&columns);
    JoinStep::Probe(IndexProbe { relation: atom.predicate, index, key, binds, same, is_new_to })
}

// === impl JoinFilter ===

impl JoinFilter {
    /// Calls `visit` for every variable in the filter.
    pub(super) fn slots(&self, visit: &mut dyn FnMut(SlotIndex)) {
        let mut term = |term: &LiftedTerm| {
            if let LiftedTerm::Variable(slot) = term {
                visit(*slot);
            }
        };
        match self {
            JoinFilter::Equal { left, right, .. } => [left, right].into_iter().for_each(term),
            JoinFilter::NotInitially(atom) => atom.arguments.iter().for_each(term),
            JoinFilter::Compare { sides, .. } => {
                sides.0.terms(&mut term);
                sides.1.terms(&mut term);
            }
        }
    }

    /// Calls `visit` for every term in the filter.
    pub(super) fn terms_mut(&mut self, visit: &mut dyn FnMut(&mut LiftedTerm)) {
        match self {
            JoinFilter::Equal { left, right, .. } => [left, right].into_iter().for_each(visit),
            JoinFilter::NotInitially(atom) => atom.arguments.iter_mut().for_each(visit),
            JoinFilter::Compare { sides, .. } => {
                sides.0.terms_mut(visit);
                sides.1.terms_mut(visit);
            }
        }
    }

    /// Whether a binding satisfies the filter. The binding must include all variables of the
    /// filter.
    pub(super) fn passes(
        &self,
        relations: &[Relation],
        values: &GroundFluents,
        binding: &[ObjectId],
    ) -> bool {
        match self {
            JoinFilter::Equal { positive, left, right } => {
                (left.object(binding) == right.object(binding)) == *positive
            }
            JoinFilter::NotInitially(atom) => {
                let relation = &relations[atom.predicate];
                let row = relation.find_terms(&atom.arguments, binding);
                row.is_none_or(|row| row >= relation.initial)
            }
            JoinFilter::Compare { comparison, sides } => {
                let left = values.fixed(&sides.0, binding);
                let right = values.fixed(&sides.1, binding);
                left.zip(right).is_some_and(|(left, right)| comparison.holds(left, right))
            }
        }
    }
}

// === impl Join ===

impl Join<'_> {
    /// Whether a slot may be bound to an object.
    #[inline]
    pub(super) fn fits(&self, slot: SlotIndex, object: ObjectId) -> bool {
        self.sets.get(self.frame[slot as usize]).contains(object)
    }

    /// Calls `found` for every binding that satisfies the join plan.
    pub(super) fn run<'c, F>(
        &self,
        plan: &JoinPlan,
        binding: &mut [ObjectId],
        work: &mut GroundingMeter<'c>,
        found: &mut F,
    ) -> Result<(), StopReason>
    where
        F: FnMut(&mut [ObjectId], &mut GroundingMeter<'c>) -> Result<(), StopReason>,
    {
        self.walk(&plan.steps, binding, work, found)
    }

    fn walk<'c, F>(
        &self,
        steps: &[JoinStep],
        binding: &mut [ObjectId],
        work: &mut GroundingMeter<'c>,
        found: &mut F,
    ) -> Result<(), StopReason>
    where
        F: FnMut(&mut [ObjectId], &mut GroundingMeter<'c>) -> Result<(), StopReason>,
    {
        let Some((step, rest)) = steps.split_first() else { return found(binding, work) };
        work.step()?;
        match step {
            JoinStep::Check(filter) => {
                if filter.passes(self.relations, self.values, binding) {
                    self.walk(rest, binding, work, found)?;
                }
            }
            JoinStep::Contains { atom, is_new_to } => {
                let relation = &self.relations[atom.predicate];
                let row = relation.find_terms(&atom.arguments, binding);
                let holds = row.is_some_and(|row| {
                    relation.is_indexed(row)
                        && !(*is_new_to && self.cause == Some((atom.predicate, row)))
                });
                if holds {
                    self.walk(rest, binding, work, found)?;
                }
            }
            JoinStep::Enumerate(slot) => {
                for &object in &self.sets.get(self.frame[*slot as usize]).members {
                    work.step()?;
                    binding[*slot as usize] = object;
                    self.walk(rest, binding, work, found)?;
                }
            }
            JoinStep::Probe(probe) => {
                let relation = &self.relations[probe.relation];
                for row in relation.matching(probe.index, &probe.key, binding) {
                    work.step()?;
                    if self.take(probe, row, relation.row(row), binding) {
                        self.walk(rest, binding, work, found)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Binds the variables of an atom to the objects of a row. Returns `false` if the row does not
    /// match.
    #[inline]
    fn take(
        &self,
        probe: &IndexProbe,
        index: usize,
        row: &[ObjectId],
        binding: &mut [ObjectId],
    ) -> bool {
        if probe.is_new_to && self.cause == Some((probe.relation, index))
            || probe.same.iter().any(|(left, right)| row[*left] != row[*right])
        {
            return false;
        }
        for (column, slot) in &probe.binds {
            if !self.fits(*slot, row[*column]) {
                return false;
            }
            binding[*slot as usize] = row[*column];
        }
        true
    }
}
