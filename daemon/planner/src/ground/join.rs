//! Joins: finding every binding under which some atoms hold, without looking at all bindings.
//!
//! - [`JoinPlan::compile`] fixes the order once: atoms whose arguments are known already come first,
//!   then static ones that leave few choices, and objects of a type only where no atom helps.
//! - [`Join::run`] walks it, counting every candidate in [`Work`].

use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::{
    Lifted, LiftedAtom, LiftedExpression, LiftedTerm, Slot, TypeIndex, objects,
};
use crate::outcome::StopReason;
use crate::task::ObjectId;

use super::relation::{IndexId, Relation};
use super::values::Values;

/// A test that waits until its variables are bound.
#[derive(Clone, Debug)]
pub(super) enum Filter {
    Equal {
        positive: bool,
        left: LiftedTerm,
        right: LiftedTerm,
    },
    /// The atom does not hold in the initial state, and no action adds or removes it.
    NotInitially(LiftedAtom),
    /// A comparison of static functions.
    Compare {
        positive: bool,
        comparison: pddl::Comparison,
        sides: Box<(LiftedExpression, LiftedExpression)>,
    },
}

/// An order in which to bind variables.
#[derive(Clone, Debug, Default)]
pub(super) struct JoinPlan {
    steps: Vec<Step>,
}

#[derive(Clone, Debug)]
enum Step {
    /// Binds variables from the rows that agree with what is bound.
    Probe {
        relation: usize,
        index: IndexId,
        key: Vec<LiftedTerm>,
        binds: Vec<(usize, Slot)>,
        same: Vec<(usize, usize)>,
    },
    /// Asks whether the tuple is there.
    Contains(LiftedAtom),
    /// Binds a variable to every object of its type.
    Enumerate(Slot),
    Check(Filter),
}

/// Counts work, and knows when it is too much.
pub(super) struct Work<'c> {
    pub(super) steps: u64,
    budget: Budget,
    cancel: &'c Cancel,
}

/// What a join reads.
#[derive(Clone, Copy)]
pub(super) struct Join<'g> {
    pub(super) lifted: &'g Lifted,
    pub(super) relations: &'g [Relation],
    pub(super) values: &'g Values,
    pub(super) frame: &'g [TypeIndex],
}

/// How often the caller's flag is looked at, in join steps; a step takes some ten nanoseconds.
const STEPS_BETWEEN_CANCEL_CHECKS: u64 = 1 << 12;

// === impl Work ===

impl<'c> Work<'c> {
    pub(super) fn new(budget: Budget, cancel: &'c Cancel) -> Work<'c> {
        Work { steps: 0, budget, cancel }
    }

    pub(super) fn step(&mut self) -> Result<(), StopReason> {
        self.steps += 1;
        if self.steps > self.budget.join_steps_max {
            return Err(StopReason::JoinStepLimit { limit: self.budget.join_steps_max });
        }
        if self.steps.is_multiple_of(STEPS_BETWEEN_CANCEL_CHECKS) && self.cancel.is_set() {
            return Err(StopReason::Cancelled);
        }
        Ok(())
    }

    /// Fails if that many bytes are more than grounding may take.
    pub(super) fn check_memory(&self, bytes: usize) -> Result<(), StopReason> {
        let limit = self.budget.memory_max_bytes;
        if bytes > limit { Err(StopReason::MemoryLimit { limit }) } else { Ok(()) }
    }
}

// === impl JoinPlan ===

impl JoinPlan {
    /// Plans a join over `atoms` that binds all of `wanted`; `bound` says which slots are bound
    /// before, and afterwards which are.
    pub(super) fn compile(
        lifted: &Lifted,
        relations: &mut [Relation],
        atoms: &[LiftedAtom],
        filters: &[Filter],
        wanted: &[Slot],
        bound: &mut [bool],
    ) -> JoinPlan {
        let mut plan = JoinPlan::default();
        let mut atoms: Vec<&LiftedAtom> = atoms.iter().collect();
        let mut filters: Vec<&Filter> = filters.iter().collect();
        loop {
            filters.retain(|filter| {
                let ready = filter.slots().iter().all(|slot| bound[*slot as usize]);
                if ready {
                    plan.steps.push(Step::Check((*filter).clone()));
                }
                !ready
            });
            let costs = atoms.iter().map(|atom| estimate(lifted, relations, atom, bound));
            let best = costs.enumerate().min_by(|(_, left), (_, right)| left.total_cmp(right));
            let Some((position, _)) = best else { break };
            let atom = atoms.remove(position);
            plan.steps.push(probe(relations, atom, bound));
        }
        for &slot in wanted {
            if !std::mem::replace(&mut bound[slot as usize], true) {
                plan.steps.push(Step::Enumerate(slot));
                let ready =
                    |filter: &&Filter| filter.slots().iter().all(|one| bound[*one as usize]);
                plan.steps.extend(
                    filters.iter().filter(|one| ready(one)).map(|one| Step::Check((*one).clone())),
                );
                filters.retain(|filter| !ready(filter));
            }
        }
        plan
    }
}

/// How many rows an atom is likely to match, given what is bound.
fn estimate(lifted: &Lifted, relations: &[Relation], atom: &LiftedAtom, bound: &[bool]) -> f64 {
    let relation = &relations[atom.predicate];
    let is_static =
        lifted.predicates.get(atom.predicate).is_some_and(|predicate| predicate.is_static());
    let is_bound = |term: &LiftedTerm| match term {
        LiftedTerm::Variable(slot) => bound[*slot as usize],
        LiftedTerm::Object(_) => true,
    };
    if atom.arguments.iter().all(is_bound) {
        return 0.0;
    }
    // Of facts that come and go little is known yet: each open argument is taken to have ten values.
    let open = atom.arguments.iter().filter(|term| !is_bound(term)).count();
    if !is_static {
        return 10f64.powi(open as i32);
    }
    let columns = atom.arguments.iter().enumerate().filter(|(_, term)| is_bound(term));
    columns.fold(relation.len() as f64, |rows, (column, _)| {
        rows / relation.distinct(column).max(1) as f64
    })
}

/// The step that joins an atom; binds its variables.
fn probe(relations: &mut [Relation], atom: &LiftedAtom, bound: &mut [bool]) -> Step {
    let (mut columns, mut key) = (Vec::new(), Vec::new());
    let (mut binds, mut same) = (Vec::<(usize, Slot)>::new(), Vec::new());
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
    if binds.is_empty() {
        return Step::Contains(atom.clone());
    }
    binds.iter().for_each(|(_, slot)| bound[*slot as usize] = true);
    let index = relations[atom.predicate].index(&columns);
    Step::Probe { relation: atom.predicate, index, key, binds, same }
}

// === impl Filter ===

impl Filter {
    fn slots(&self) -> Vec<Slot> {
        let mut slots = Vec::new();
        let mut term = |term: &LiftedTerm| {
            if let LiftedTerm::Variable(slot) = term {
                slots.push(*slot);
            }
        };
        match self {
            Filter::Equal { left, right, .. } => [left, right].into_iter().for_each(term),
            Filter::NotInitially(atom) => atom.arguments.iter().for_each(term),
            Filter::Compare { sides, .. } => {
                sides.0.terms(&mut term);
                sides.1.terms(&mut term);
            }
        }
        slots
    }
}

// === impl Join ===

/// Called for every binding found.
pub(super) type Found<'f, 'c> =
    &'f mut dyn FnMut(&mut [ObjectId], &mut Work<'c>) -> Result<(), StopReason>;

impl Join<'_> {
    /// Whether an object may stand in a slot.
    pub(super) fn fits(&self, slot: Slot, object: ObjectId) -> bool {
        self.lifted.types[self.frame[slot as usize]].contains(object)
    }

    /// Calls `found` for every binding that the plan reaches.
    pub(super) fn run<'c>(
        &self,
        plan: &JoinPlan,
        binding: &mut [ObjectId],
        work: &mut Work<'c>,
        found: Found<'_, 'c>,
    ) -> Result<(), StopReason> {
        self.walk(&plan.steps, binding, work, found)
    }

    fn walk<'c>(
        &self,
        steps: &[Step],
        binding: &mut [ObjectId],
        work: &mut Work<'c>,
        found: Found<'_, 'c>,
    ) -> Result<(), StopReason> {
        let Some((step, rest)) = steps.split_first() else { return found(binding, work) };
        work.step()?;
        match step {
            Step::Check(filter) => {
                if self.passes(filter, binding) {
                    self.walk(rest, binding, work, found)?;
                }
            }
            Step::Contains(atom) => {
                let tuple: Tuple = objects(&atom.arguments, binding).collect();
                if self.relations[atom.predicate].contains_indexed(&tuple.0) {
                    self.walk(rest, binding, work, found)?;
                }
            }
            Step::Enumerate(slot) => {
                for &object in &self.lifted.types[self.frame[*slot as usize]].members {
                    work.step()?;
                    binding[*slot as usize] = object;
                    self.walk(rest, binding, work, found)?;
                }
            }
            Step::Probe { relation, index, key, binds, same } => {
                let relation = &self.relations[*relation];
                let key: Tuple = objects(key, binding).collect();
                for row in relation.matching(*index, &key.0) {
                    work.step()?;
                    let row = relation.row(row);
                    if same.iter().any(|(left, right)| row[*left] != row[*right])
                        || binds.iter().any(|(column, slot)| !self.fits(*slot, row[*column]))
                    {
                        continue;
                    }
                    binds.iter().for_each(|(column, slot)| binding[*slot as usize] = row[*column]);
                    self.walk(rest, binding, work, found)?;
                }
            }
        }
        Ok(())
    }

    fn passes(&self, filter: &Filter, binding: &[ObjectId]) -> bool {
        match filter {
            Filter::Equal { positive, left, right } => {
                (left.object(binding) == right.object(binding)) == *positive
            }
            Filter::NotInitially(atom) => {
                let tuple: Tuple = objects(&atom.arguments, binding).collect();
                let relation = &self.relations[atom.predicate];
                relation.find(&tuple.0).is_none_or(|row| row >= relation.initial)
            }
            Filter::Compare { positive, comparison, sides } => {
                let left = self.values.fixed(&sides.0, binding);
                let right = self.values.fixed(&sides.1, binding);
                let holds = left
                    .zip(right)
                    .is_some_and(|(l, r)| super::values::compares(*comparison, l, r));
                holds == *positive
            }
        }
    }
}

/// A short tuple.
struct Tuple(Vec<ObjectId>);

impl FromIterator<ObjectId> for Tuple {
    fn from_iter<I: IntoIterator<Item = ObjectId>>(objects: I) -> Tuple {
        Tuple(objects.into_iter().collect())
    }
}
