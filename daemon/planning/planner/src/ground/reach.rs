//! Relaxed reachability: finds all facts and applicable actions of the delete relaxation.
//!
//! Every new tuple is joined once with the tuples found before it (semi-naive evaluation of the
//! [`super::horn_rules`]). For a rule without variables, only the missing atoms are counted.

use super::action_relation;
use super::ground_fluents::GroundFluents;
use super::grounding_meter::GroundingMeter;
use super::horn_rules::{Conjunct, HornRule, NARROWING_ROWS_MAX, Narrowing, rules, variables};
use super::join::{Catalog, Join, JoinAtom, JoinPlan, is_static};
use super::object_sets::ObjectSets;
use super::relation::Relation;
use super::triggers::{Trigger, TriggerAction, Triggers};
use crate::normalize::lifted::{Lifted, LiftedAtom, LiftedTerm, SlotIndex, TypeIndex};
use crate::outcome::StopReason;
use crate::task::ObjectId;

/// All tuples that are reachable in the delete relaxation.
#[derive(Debug)]
pub(super) struct ReachableTuples {
    /// Relations of the predicates, followed by one relation per schema with its applicable
    /// bindings.
    pub(super) relations: Vec<Relation>,
    pub(super) sets: ObjectSets,
}

/// Number of new tuples between two checks of the memory limit.
const TUPLES_BETWEEN_MEMORY_CHECKS: usize = 1 << 12;

/// State of one evaluation of the Horn rules.
struct Reachability<'g, 'w, 'c> {
    lifted: &'g Lifted,
    values: &'g GroundFluents,
    work: &'w mut GroundingMeter<'c>,
    relations: Vec<Relation>,
    sets: ObjectSets,
    rules: Vec<HornRule>,
    triggers: Triggers,
    /// Per schema: the atoms in its unconditional add effects.
    adds: Vec<Vec<&'g LiftedAtom>>,
    binding: Vec<ObjectId>,
    /// Buffer for the head's tuples of one evaluation of a rule.
    found: Relation,
    /// Number of bytes of all relations at the last check.
    bytes: usize,
    /// Buffer for the triggers that match the current tuple.
    due: Vec<usize>,
}

/// Computes all tuples that are reachable in the delete relaxation.
pub(super) fn reach(
    lifted: &Lifted,
    values: &GroundFluents,
    work: &mut GroundingMeter<'_>,
) -> Result<ReachableTuples, StopReason> {
    let mut relations = initial_relations(lifted);
    let mut sets = ObjectSets::new(lifted);
    let mut narrowing = Narrowing {
        lifted,
        relations: &mut relations,
        values,
        sets: &mut sets,
        rows_left: NARROWING_ROWS_MAX,
    };
    let mut possible = Vec::new();
    for mut rule in rules(lifted) {
        work.check_limits()?;
        if rule.narrow(&mut narrowing) {
            possible.push(rule);
        }
    }
    let rules = possible;
    set_distinct(lifted, &rules, &mut relations);
    let mut reach = Reachability::new(lifted, values, work, relations, sets, rules);
    reach.start()?;
    reach.finish()
}

/// Continues an earlier evaluation after additions to the task. New facts are in `relations`
/// without an index entry, new objects and schemas follow the old ones in `lifted`, and no fact is
/// static. Rules are not narrowed, because a narrowed rule could not be widened later.
pub(super) fn reach_on(
    lifted: &Lifted,
    values: &GroundFluents,
    relations: Vec<Relation>,
    before: PreviousCounts,
    work: &mut GroundingMeter<'_>,
) -> Result<ReachableTuples, StopReason> {
    let mut reach =
        Reachability::new(lifted, values, work, relations, ObjectSets::new(lifted), rules(lifted));
    reach.resume(before)?;
    reach.finish()
}

/// Numbers of objects and schemas that the task had in the earlier evaluation, which [`reach_on`]
/// continues.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PreviousCounts {
    pub(super) objects: usize,
    pub(super) schemas: usize,
}

/// Returns the relations of predicates and schemas, filled with the facts of the initial state.
pub(super) fn initial_relations(lifted: &Lifted) -> Vec<Relation> {
    let mut relations: Vec<Relation> =
        lifted.predicates.iter().map(|predicate| Relation::new(predicate.arity)).collect();
    relations.extend(lifted.schemas.iter().map(|schema| Relation::new(schema.parameter_count)));
    for (predicate, arguments) in &lifted.init {
        relations[*predicate].insert(arguments);
    }
    for (index, relation) in relations.iter_mut().enumerate() {
        relation.initial = relation.len();
        if is_static(lifted, index) {
            relation.index_all();
        }
    }
    relations
}

/// Marks the schemas with tuples that cannot be found twice: they have one rule, in which all
/// variables are parameters. Their relations need no duplicate check.
fn set_distinct(lifted: &Lifted, rules: &[HornRule], relations: &mut [Relation]) {
    let mut counts = vec![0; relations.len()];
    let mut is_seen_twice = vec![false; relations.len()];
    for rule in rules {
        let head = &rule.head;
        counts[head.predicate] += 1;
        let in_head = variables(head);
        let mut all = rule.body.atoms.iter().flat_map(variables).chain(rule.wanted.iter().copied());
        is_seen_twice[head.predicate] |= all.any(|slot| !in_head.contains(&slot));
    }
    for (schema, action) in lifted.schemas.iter().enumerate() {
        let relation = action_relation(lifted, schema);
        if counts[relation] <= 1 && !is_seen_twice[relation] {
            relations[relation] = Relation::of_distinct(action.parameter_count);
        }
    }
}

// === impl Reachability ===

impl<'g, 'w, 'c> Reachability<'g, 'w, 'c> {
    fn new(
        lifted: &'g Lifted,
        values: &'g GroundFluents,
        work: &'w mut GroundingMeter<'c>,
        relations: Vec<Relation>,
        sets: ObjectSets,
        rules: Vec<HornRule>,
    ) -> Reachability<'g, 'w, 'c> {
        let adds = lifted.schemas.iter().map(|schema| {
            let certain = schema.effects.iter().filter(|one| one.adds && one.is_unconditional());
            certain.map(|effect| &effect.atom).collect()
        });
        Reachability {
            lifted,
            values,
            work,
            triggers: Triggers::new(relations.len()),
            relations,
            sets,
            rules,
            adds: adds.collect(),
            binding: Vec::new(),
            found: Relation::of_distinct(0),
            bytes: 0,
            due: Vec::new(),
        }
    }

    fn finish(mut self) -> Result<ReachableTuples, StopReason> {
        self.saturate()?;
        self.work.add_finished_bytes(self.bytes);
        Ok(ReachableTuples { relations: self.relations, sets: self.sets })
    }

    /// Registers the triggers of each rule, and fires the rules with static atoms only.
    fn start(&mut self) -> Result<(), StopReason> {
        for index in 0..self.rules.len() {
            let rule = &self.rules[index];
            let changing: Vec<usize> = (0..rule.body.atoms.len())
                .filter(|at| !is_static(self.lifted, rule.body.atoms[*at].predicate))
                .collect();
            if changing.is_empty() {
                self.fire_all(index)?;
                continue;
            }
            self.triggers.add(index, &self.rules[index], &changing);
        }
        Ok(())
    }

    /// Registers the triggers of each rule. Fires the rules that may have further conclusions from
    /// already indexed tuples: new rules, and old rules with variables that may be bound to new
    /// objects.
    fn resume(&mut self, before: PreviousCounts) -> Result<(), StopReason> {
        let first_new = action_relation(self.lifted, before.schemas);
        let objects_grew = self.lifted.objects.len() > before.objects;
        for index in 0..self.rules.len() {
            let HornRule { head, body, wanted, .. } = &self.rules[index];
            let asked: Vec<SlotIndex> = body.atoms.iter().flat_map(variables).collect();
            let is_new = head.predicate >= first_new
                || body.atoms.iter().any(|atom| atom.predicate >= first_new);
            let ranges_wider = objects_grew && wanted.iter().any(|slot| !asked.contains(slot));
            let has_turned = |atom: &LiftedAtom| self.relations[atom.predicate].indexed_len() > 0;
            let waits = |at: &usize| {
                let atom = &body.atoms[*at];
                let is_ground = wanted.is_empty() && asked.is_empty();
                !is_ground || !self.relations[atom.predicate].has_indexed(&atom.arguments)
            };
            let waiting: Vec<usize> = (0..body.atoms.len()).filter(waits).collect();
            let fires = (is_new || ranges_wider) && body.atoms.iter().all(has_turned);
            if !waiting.is_empty() {
                self.triggers.add(index, &self.rules[index], &waiting);
            }
            if fires {
                self.fire_all(index)?;
            }
        }
        Ok(())
    }

    /// Fires a rule for all bindings that the indexed tuples allow.
    fn fire_all(&mut self, rule: usize) -> Result<(), StopReason> {
        let plan = self.plan(rule, None);
        self.binding.clear();
        self.binding.resize(self.rules[rule].frame.len(), ObjectId::from_index(0));
        self.fire(rule, &plan, None)
    }

    /// Processes the tuples that are not indexed until there are none.
    fn saturate(&mut self) -> Result<(), StopReason> {
        let mut is_waiting = true;
        while is_waiting {
            is_waiting = false;
            for relation in 0..self.relations.len() {
                while let Some(row) = self.relations[relation].next_unindexed() {
                    is_waiting = true;
                    if row.is_multiple_of(TUPLES_BETWEEN_MEMORY_CHECKS) {
                        self.check_memory()?;
                    }
                    self.work.step()?;
                    self.relations[relation].index_next();
                    self.conclude(relation, row)?;
                }
            }
        }
        self.check_memory()
    }

    fn check_memory(&mut self) -> Result<(), StopReason> {
        self.bytes = self.relations.iter().map(Relation::bytes).sum();
        self.work.check_memory(self.bytes)
    }

    /// Draws all conclusions from a tuple and the tuples that were indexed before it.
    fn conclude(&mut self, relation: usize, row: usize) -> Result<(), StopReason> {
        let schema = relation.checked_sub(self.lifted.predicates.len());
        if let Some(adds) = schema.map(|schema| &self.adds[schema]) {
            self.binding.clear();
            self.binding.extend_from_slice(self.relations[relation].row(row));
            for add in adds {
                self.relations[add.predicate].insert_terms(&add.arguments, &self.binding);
            }
        }
        let mut due = std::mem::take(&mut self.due);
        self.triggers.due(relation, self.relations[relation].row(row), &mut due);
        for id in due.drain(..) {
            self.work.step()?;
            self.pull(id, relation, row)?;
        }
        self.due = due;
        Ok(())
    }

    fn pull(&mut self, id: usize, relation: usize, row: usize) -> Result<(), StopReason> {
        let Trigger { rule, position, action } = self.triggers.get_mut(id);
        let (rule, position) = (*rule, *position);
        match action {
            TriggerAction::Count => {
                let atom = &self.rules[rule].body.atoms[position];
                let tuple = self.relations[relation].row(row).iter();
                let is_it =
                    tuple.zip(&atom.arguments).all(|(object, term)| *object == term.object(&[]));
                if is_it && self.triggers.count_down(rule) && self.passes(rule) {
                    let head = &self.rules[rule].head;
                    self.relations[head.predicate].insert_terms(&head.arguments, &[]);
                }
                Ok(())
            }
            TriggerAction::Join(plan) => {
                let plan = plan.take();
                let HornRule { frame, body, .. } = &self.rules[rule];
                self.binding.clear();
                self.binding.resize(frame.len(), ObjectId::from_index(0));
                let tuple = self.relations[relation].row(row);
                let fits =
                    unify(&self.sets, frame, &body.atoms[position], tuple, &mut self.binding);
                // Join plans are created on demand, because most triggers of a large domain never
                // fire.
                let plan = match plan {
                    None if !fits => return Ok(()),
                    None => Box::new(self.plan(rule, Some(position))),
                    Some(plan) => plan,
                };
                let result =
                    if fits { self.fire(rule, &plan, Some((relation, row))) } else { Ok(()) };
                self.triggers.get_mut(id).action = TriggerAction::Join(Some(plan));
                result
            }
        }
    }

    /// Whether the tests and the static atoms of a rule without variables hold. Triggers do not
    /// count these parts, which remain in a rule if the last narrowing pass removed their
    /// variables.
    fn passes(&self, rule: usize) -> bool {
        let Conjunct { atoms, filters } = &self.rules[rule].body;
        let is_static = |atom: &&LiftedAtom| is_static(self.lifted, atom.predicate);
        let stands = |atom: &LiftedAtom| {
            self.relations[atom.predicate].find_terms(&atom.arguments, &[]).is_some()
        };
        atoms.iter().filter(is_static).all(stands)
            && filters.iter().all(|filter| {
                let mut is_ground = true;
                filter.slots(&mut |_| is_ground = false);
                // Joins also skip a test with an unbound variable.
                !is_ground || filter.passes(&self.relations, self.values, &[])
            })
    }

    /// Plans the join of a rule's body without the atom at the position `cause`, because its
    /// variables are already bound.
    fn plan(&mut self, rule: usize, cause: Option<usize>) -> JoinPlan {
        let HornRule { frame, body, wanted, .. } = &self.rules[rule];
        let mut bound = vec![false; frame.len()];
        if let Some(cause) = cause {
            variables(&body.atoms[cause]).iter().for_each(|slot| bound[*slot as usize] = true);
        }
        let others = body.atoms.iter().enumerate().filter(|(at, _)| Some(*at) != cause);
        let parts = others.map(|(at, atom)| JoinAtom {
            atom,
            is_new_to: cause
                .is_some_and(|cause| at < cause && body.atoms[cause].predicate == atom.predicate),
        });
        let mut catalog = Catalog {
            lifted: self.lifted,
            relations: &mut self.relations,
            sets: &self.sets,
            is_complete: false,
        };
        JoinPlan::compile(&mut catalog, frame, parts, &body.filters, wanted, &mut bound)
    }

    /// Adds a tuple of the rule's head for every binding that the join returns.
    fn fire(
        &mut self,
        rule: usize,
        plan: &JoinPlan,
        cause: Option<(usize, usize)>,
    ) -> Result<(), StopReason> {
        let head = self.rules[rule].head.predicate;
        if head >= self.lifted.predicates.len() {
            // The body of such a rule does not use the relation of its own action, and there may be
            // millions of tuples. The tuples are therefore written directly into the relation.
            let mut tuples = std::mem::replace(&mut self.relations[head], Relation::new(0));
            let result = self.collect(rule, plan, cause, &mut tuples);
            self.relations[head] = tuples;
            return result;
        }
        let mut found = std::mem::replace(&mut self.found, Relation::of_distinct(0));
        found.clear(self.relations[head].arity());
        let result = self.collect(rule, plan, cause, &mut found);
        for row in 0..found.len() {
            self.relations[head].insert(found.row(row));
        }
        self.found = found;
        result
    }

    /// Runs a join and writes the tuples of the rule's head into `found`. No atom of the join may
    /// use this relation.
    fn collect(
        &mut self,
        rule: usize,
        plan: &JoinPlan,
        cause: Option<(usize, usize)>,
        found: &mut Relation,
    ) -> Result<(), StopReason> {
        let HornRule { head, frame, .. } = &self.rules[rule];
        let Reachability { relations, sets, values, binding, work, .. } = self;
        let join = Join { relations, sets, values, frame, cause };
        let others = self.bytes;
        join.run(plan, binding, work, &mut |binding, work| {
            found.insert_terms(&head.arguments, binding);
            work.check_memory(others + found.bytes())
        })
    }
}

/// Binds the variables of an atom to the objects of a tuple. Returns `false` if the tuple does not
/// match.
fn unify(
    sets: &ObjectSets,
    frame: &[TypeIndex],
    atom: &LiftedAtom,
    tuple: &[ObjectId],
    binding: &mut [ObjectId],
) -> bool {
    for (position, (term, object)) in atom.arguments.iter().zip(tuple).enumerate() {
        let fits = match term {
            LiftedTerm::Object(expected) => expected == object,
            LiftedTerm::Variable(slot) => {
                let slot = *slot as usize;
                if atom.arguments[..position].contains(term) {
                    binding[slot] == *object
                } else {
                    binding[slot] = *object;
                    sets.get(frame[slot]).contains(*object)
                }
            }
        };
        if !fits {
            return false;
        }
    }
    true
}
