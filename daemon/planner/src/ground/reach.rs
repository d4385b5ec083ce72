//! Relaxed reachability: which facts can ever hold and which actions can ever apply, if nothing is
//! ever deleted.
//!
//! Every schema, effect and axiom becomes Horn rules over relations; each newly found tuple is
//! joined once with what came before it (semi-naive evaluation). Where a condition has no Horn
//! form, it is taken to hold: the answer errs on the side of reachable, never of unreachable.

use super::join::{Filter, Join, JoinPlan, Work};
use super::relation::Relation;
use super::values::Values;
use crate::normalize::lifted::{Formula, Lifted, LiftedAtom, LiftedTerm, Slot, TypeIndex};
use crate::outcome::StopReason;
use crate::task::ObjectId;

/// Alternatives of one condition, beyond which a disjunction is taken to hold.
const DISJUNCTS_MAX: usize = 8;

/// `head(terms) :- body`
struct Rule {
    head: LiftedAtom,
    frame: Vec<TypeIndex>,
    body: Conjunct,
    /// Variables that no atom of the body may bind, and the head needs.
    wanted: Vec<Slot>,
}

/// Atoms and tests that hold together.
#[derive(Clone, Default)]
struct Conjunct {
    atoms: Vec<LiftedAtom>,
    filters: Vec<Filter>,
}

/// What to do when a tuple of some relation turns up.
struct Trigger {
    rule: usize,
    /// Which atom of the rule's body the tuple stands for.
    atom: LiftedAtom,
    plan: JoinPlan,
}

/// The relation of a schema's applicable bindings.
pub(super) fn action_relation(lifted: &Lifted, schema: usize) -> usize {
    lifted.predicates.len() + schema
}

/// All tuples that can be reached: predicates first, then one relation per schema.
pub(super) fn reach(
    lifted: &Lifted,
    values: &Values,
    work: &mut Work<'_>,
) -> Result<Vec<Relation>, StopReason> {
    let mut relations = initial_relations(lifted);
    let rules = rules(lifted);
    let mut triggers: Vec<Vec<Trigger>> = relations.iter().map(|_| Vec::new()).collect();
    let mut found = Vec::new();
    for (index, rule) in rules.iter().enumerate() {
        let changing: Vec<usize> = (0..rule.body.atoms.len())
            .filter(|position| !is_static(lifted, rule.body.atoms[*position].predicate))
            .collect();
        for &position in &changing {
            let trigger = compile_trigger(lifted, &mut relations, rule, index, position);
            triggers[trigger.atom.predicate].push(trigger);
        }
        if changing.is_empty() {
            let plan = compile(
                lifted,
                &mut relations,
                rule,
                &rule.body.atoms,
                vec![false; rule.frame.len()],
            );
            let mut binding = vec![ObjectId::from_index(0); rule.frame.len()];
            fire(lifted, &relations, values, rule, &plan, &mut binding, work, &mut found)?;
            insert_all(&mut relations, rule, &found);
            found.clear();
        }
    }
    saturate(lifted, values, &rules, &triggers, &mut relations, work)?;
    Ok(relations)
}

/// Takes every waiting tuple once, until none waits.
fn saturate(
    lifted: &Lifted,
    values: &Values,
    rules: &[Rule],
    triggers: &[Vec<Trigger>],
    relations: &mut [Relation],
    work: &mut Work<'_>,
) -> Result<(), StopReason> {
    let mut found = Vec::new();
    let mut binding = Vec::new();
    let mut waiting = true;
    while waiting {
        waiting = false;
        for relation in 0..relations.len() {
            while let Some(row) = relations[relation].next_unindexed() {
                waiting = true;
                work.step()?;
                relations[relation].index_next();
                for trigger in &triggers[relation] {
                    let rule = &rules[trigger.rule];
                    binding.clear();
                    binding.resize(rule.frame.len(), ObjectId::from_index(0));
                    let join = Join { lifted, relations, values, frame: &rule.frame };
                    if !unify(&join, &trigger.atom, relations[relation].row(row), &mut binding) {
                        continue;
                    }
                    fire(
                        lifted,
                        relations,
                        values,
                        rule,
                        &trigger.plan,
                        &mut binding,
                        work,
                        &mut found,
                    )?;
                    insert_all(relations, rule, &found);
                    found.clear();
                }
            }
            work.check_memory(relations.iter().map(Relation::bytes).sum())?;
        }
    }
    Ok(())
}

fn initial_relations(lifted: &Lifted) -> Vec<Relation> {
    let mut relations: Vec<Relation> =
        lifted.predicates.iter().map(|predicate| Relation::new(predicate.arity)).collect();
    relations.extend(lifted.schemas.iter().map(|schema| Relation::new(schema.parameter_count)));
    for (predicate, arguments) in &lifted.init {
        relations[*predicate].insert(arguments);
    }
    for (index, relation) in relations.iter_mut().enumerate() {
        relation.initial = relation.len();
        if is_static(lifted, index) {
            while relation.next_unindexed().is_some() {
                relation.index_next();
            }
        }
    }
    relations
}

fn is_static(lifted: &Lifted, relation: usize) -> bool {
    lifted.predicates.get(relation).is_some_and(|predicate| predicate.is_static())
}

/// Binds the variables of an atom to a tuple; whether it fits.
fn unify(join: &Join<'_>, atom: &LiftedAtom, row: &[ObjectId], binding: &mut [ObjectId]) -> bool {
    for (position, (term, object)) in atom.arguments.iter().zip(row).enumerate() {
        let fits = match term {
            LiftedTerm::Object(expected) => expected == object,
            LiftedTerm::Variable(slot) => {
                let earlier = &atom.arguments[..position];
                if earlier.contains(term) {
                    binding[*slot as usize] == *object
                } else {
                    binding[*slot as usize] = *object;
                    join.fits(*slot, *object)
                }
            }
        };
        if !fits {
            return false;
        }
    }
    true
}

/// Collects the head's tuples, one after the other, into `found`.
#[expect(clippy::too_many_arguments, reason = "the parts of one evaluation, borrowed differently")]
fn fire(
    lifted: &Lifted,
    relations: &[Relation],
    values: &Values,
    rule: &Rule,
    plan: &JoinPlan,
    binding: &mut [ObjectId],
    work: &mut Work<'_>,
    found: &mut Vec<ObjectId>,
) -> Result<(), StopReason> {
    let join = Join { lifted, relations, values, frame: &rule.frame };
    join.run(plan, binding, work, &mut |binding, _| {
        found.extend(crate::normalize::lifted::objects(&rule.head.arguments, binding));
        // A head without arguments leaves no trace above; one object stands for it.
        if rule.head.arguments.is_empty() {
            found.push(ObjectId::from_index(0));
        }
        Ok(())
    })
}

fn insert_all(relations: &mut [Relation], rule: &Rule, found: &[ObjectId]) {
    let arity = rule.head.arguments.len();
    let relation = &mut relations[rule.head.predicate];
    if arity == 0 && !found.is_empty() {
        relation.insert(&[]);
    } else if arity > 0 {
        found.chunks_exact(arity).for_each(|tuple| {
            relation.insert(tuple);
        });
    }
}

fn compile_trigger(
    lifted: &Lifted,
    relations: &mut [Relation],
    rule: &Rule,
    index: usize,
    position: usize,
) -> Trigger {
    let atom = rule.body.atoms[position].clone();
    let mut bound = vec![false; rule.frame.len()];
    for term in &atom.arguments {
        if let LiftedTerm::Variable(slot) = term {
            bound[*slot as usize] = true;
        }
    }
    let mut others = rule.body.atoms.clone();
    others.remove(position);
    let plan = compile(lifted, relations, rule, &others, bound);
    Trigger { rule: index, atom, plan }
}

fn compile(
    lifted: &Lifted,
    relations: &mut [Relation],
    rule: &Rule,
    atoms: &[LiftedAtom],
    mut bound: Vec<bool>,
) -> JoinPlan {
    JoinPlan::compile(lifted, relations, atoms, &rule.body.filters, &rule.wanted, &mut bound)
}

/// Every schema, effect and axiom as rules.
fn rules(lifted: &Lifted) -> Vec<Rule> {
    let mut rules = Vec::new();
    for (index, schema) in lifted.schemas.iter().enumerate() {
        let parameters: Vec<Slot> = (0..schema.parameter_count as Slot).collect();
        let arguments = parameters.iter().map(|slot| LiftedTerm::Variable(*slot)).collect();
        let applies = LiftedAtom { predicate: action_relation(lifted, index), arguments };
        for body in relax(lifted, &schema.precondition) {
            let (head, frame) = (applies.clone(), schema.frame.clone());
            rules.push(Rule { head, frame, body, wanted: parameters.clone() });
        }
        for effect in schema.effects.iter().filter(|effect| effect.adds) {
            for mut body in relax(lifted, &effect.condition) {
                body.atoms.push(applies.clone());
                let (head, frame) = (effect.atom.clone(), schema.frame.clone());
                rules.push(Rule { head, frame, body, wanted: effect.variables.clone() });
            }
        }
    }
    for axiom in &lifted.axioms {
        let wanted: Vec<Slot> = (0..axiom.parameter_count as Slot).collect();
        let arguments = wanted.iter().map(|slot| LiftedTerm::Variable(*slot)).collect();
        let head = LiftedAtom { predicate: axiom.head, arguments };
        for body in relax(lifted, &axiom.body) {
            let (head, frame, wanted) = (head.clone(), axiom.frame.clone(), wanted.clone());
            rules.push(Rule { head, frame, body, wanted });
        }
    }
    rules
}

/// Horn bodies of which at least one holds wherever the formula can.
fn relax(lifted: &Lifted, formula: &Formula) -> Vec<Conjunct> {
    match formula {
        Formula::Constant(true) | Formula::Forall(..) => vec![Conjunct::default()],
        Formula::Constant(false) => Vec::new(),
        Formula::Literal { positive, atom } => vec![relax_literal(lifted, *positive, atom)],
        Formula::Equal { positive, left, right } => {
            vec![Conjunct::of(Filter::Equal { positive: *positive, left: *left, right: *right })]
        }
        Formula::Compare { positive, comparison, sides } => {
            let mut varies = false;
            formula.functions(&mut |one| varies |= lifted.functions[one].is_numeric_fluent());
            if varies {
                return vec![Conjunct::default()];
            }
            let (positive, comparison, sides) = (*positive, *comparison, sides.clone());
            vec![Conjunct::of(Filter::Compare { positive, comparison, sides })]
        }
        Formula::And(parts) => relax_all(lifted, parts),
        Formula::Or(parts) => {
            let any: Vec<Conjunct> = parts.iter().flat_map(|part| relax(lifted, part)).collect();
            if any.len() > DISJUNCTS_MAX { vec![Conjunct::default()] } else { any }
        }
        Formula::Exists(_, inner) => relax(lifted, inner),
    }
}

fn relax_literal(lifted: &Lifted, positive: bool, atom: &LiftedAtom) -> Conjunct {
    let predicate = &lifted.predicates[atom.predicate];
    match positive {
        true => Conjunct { atoms: vec![atom.clone()], filters: Vec::new() },
        false if predicate.deleted || predicate.derived => Conjunct::default(),
        false => Conjunct::of(Filter::NotInitially(atom.clone())),
    }
}

fn relax_all(lifted: &Lifted, parts: &[Formula]) -> Vec<Conjunct> {
    let mut whole = vec![Conjunct::default()];
    for part in parts {
        let alternatives = relax(lifted, part);
        if alternatives.len() > 1 && alternatives.len() * whole.len() > DISJUNCTS_MAX {
            continue;
        }
        let pairs =
            whole.iter().flat_map(|left| alternatives.iter().map(move |right| left.and(right)));
        whole = pairs.collect();
    }
    whole
}

// === impl Conjunct ===

impl Conjunct {
    fn of(filter: Filter) -> Conjunct {
        Conjunct { atoms: Vec::new(), filters: vec![filter] }
    }

    fn and(&self, other: &Conjunct) -> Conjunct {
        let mut both = self.clone();
        let new = other.atoms.iter().filter(|atom| !self.atoms.contains(atom));
        both.atoms.extend(new.cloned());
        both.filters.extend(other.filters.iter().cloned());
        both
    }
}
