//! Evaluates the effects of a step. All their conditions and values are evaluated in the state
//! before the step.

use pddl::{Assignment, FluentTerm, Name, Span, Term};

use super::FaultReason;
use super::compiled::{CompiledAssign, CompiledEffect, Fact};
use super::numeric_values::combine;
use super::query::WorldView;
use super::symbols::{Object, RelationId};

/// Collected effects of one step.
#[derive(Debug, Default)]
pub(super) struct StepChanges {
    pub(super) deletes: Tuples,
    pub(super) adds: Tuples,
    updates: Vec<Update>,
}

/// Facts of several predicates, stored in one array.
#[derive(Debug, Default)]
pub(super) struct Tuples {
    relations: Vec<(RelationId, usize)>,
    objects: Vec<Object>,
}

/// Change of a fluent by one numeric effect.
#[derive(Clone, Debug)]
struct Update {
    function: RelationId,
    objects: Box<[Object]>,
    assignment: Assignment,
    value: f64,
}

/// A new value of a fluent: the function, its arguments, and the value.
pub(super) type NewValue = (RelationId, Box<[Object]>, f64);

// === impl Tuples ===

impl Tuples {
    fn push(&mut self, fact: &Fact, frame: &[Object]) {
        self.relations.push((fact.relation, fact.arguments.len()));
        self.objects.extend(fact.arguments.iter().map(|argument| argument.value(frame)));
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (RelationId, &[Object])> {
        let mut rest = self.objects.as_slice();
        self.relations.iter().map(move |(relation, arity)| {
            let (tuple, others) = rest.split_at(*arity);
            rest = others;
            (*relation, tuple)
        })
    }
}

// === impl Update ===

impl Update {
    fn key(&self) -> (RelationId, &[Object]) {
        (self.function, &self.objects)
    }
}

// === impl WorldView ===

impl WorldView<'_> {
    pub(super) fn collect(
        self,
        change: &CompiledEffect,
        frame: &mut [Object],
        changes: &mut StepChanges,
    ) -> Result<(), FaultReason> {
        match change {
            CompiledEffect::All(parts) => {
                parts.iter().try_for_each(|part| self.collect(part, frame, changes))
            }
            CompiledEffect::Set(fact, true) => {
                changes.adds.push(fact, frame);
                Ok(())
            }
            CompiledEffect::Set(fact, false) => {
                changes.deletes.push(fact, frame);
                Ok(())
            }
            CompiledEffect::Assign(assign) => self.collect_assign(assign, frame, changes),
            CompiledEffect::When(inner) => {
                let (condition, then) = &**inner;
                if self.holds(condition, frame) {
                    self.collect(then, frame, changes)
                } else {
                    Ok(())
                }
            }
            CompiledEffect::Each(inner) => {
                let (query, then) = &**inner;
                // The reported fault is that of the first binding in the order of the texts.
                let mut earliest: Option<(Vec<Object>, FaultReason)> = None;
                self.each(query, frame, &mut |frame| {
                    if let Err(reason) = self.collect(then, frame, changes) {
                        let objects = query.variables.iter().map(|one| frame[one.slot.index()]);
                        let objects = objects.collect();
                        if earliest.as_ref().is_none_or(|(first, _)| objects < *first) {
                            earliest = Some((objects, reason));
                        }
                    }
                    true
                });
                earliest.map_or(Ok(()), |(_, reason)| Err(reason))
            }
        }
    }

    fn collect_assign(
        self,
        assign: &CompiledAssign,
        frame: &[Object],
        changes: &mut StepChanges,
    ) -> Result<(), FaultReason> {
        let value = self.evaluate(&assign.value, frame).map_err(FaultReason::Undefined)?;
        let (assignment, fluent) = (assign.assignment, &assign.fluent);
        let undefined = || FaultReason::Undefined(self.ground_fluent(fluent, frame));
        if assignment != Assignment::Assign && self.fluent(fluent, frame).is_none() {
            return Err(undefined());
        }
        let function = fluent.function.ok_or_else(undefined)?;
        let objects = fluent.arguments.iter().map(|argument| argument.value(frame)).collect();
        changes.updates.push(Update { function, objects, assignment, value });
        Ok(())
    }

    /// Returns the new values of the fluents that a step changes. Returns an error if the updates
    /// of one fluent contradict each other, or if a new value is not finite.
    pub(super) fn new_values(
        self,
        changes: &mut StepChanges,
    ) -> Result<Vec<NewValue>, FaultReason> {
        // The sort is stable: updates of one fluent stay in the order of the text.
        changes.updates.sort_by(|left, right| left.key().cmp(&right.key()));
        let (mut values, mut endless, mut conflicts) = (Vec::new(), Vec::new(), Vec::new());
        for same in changes.updates.chunk_by(|left, right| left.key() == right.key()) {
            let Update { function, objects, .. } = &same[0];
            let old = self.world.values[function.index()].get(|column| objects[column]);
            let updates = same.iter().map(|update| (update.assignment, update.value));
            match combine(old, updates) {
                Some(value) if value.is_finite() => {
                    values.push((*function, objects.clone(), value));
                }
                Some(_) => endless.push((*function, &**objects)),
                None => conflicts.push((*function, &**objects)),
            }
        }
        match (self.first(conflicts), self.first(endless)) {
            (Some(fluent), _) => Err(FaultReason::Conflict(fluent)),
            (None, Some(fluent)) => Err(FaultReason::NotFinite(fluent)),
            (None, None) => Ok(values),
        }
    }

    /// Returns the alphabetically first of the given fluents; `None` if there are none.
    fn first(self, fluents: Vec<(RelationId, &[Object])>) -> Option<FluentTerm> {
        let names = |(function, objects)| self.names(function, objects);
        let (function, objects) = fluents.into_iter().map(names).min()?;
        let arguments = objects.into_iter().map(Term::Object).collect();
        Some(FluentTerm { function, arguments, span: Span::default() })
    }

    fn names(self, function: RelationId, objects: &[Object]) -> (Name, Vec<Name>) {
        let model = &self.world.model;
        let objects = objects.iter().filter_map(|object| model.objects.name(*object)).cloned();
        (model.functions.name(function).clone(), objects.collect())
    }
}
