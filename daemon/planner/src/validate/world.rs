//! One state of the world, as the lifted texts mean it: facts, values, and what the axioms derive.
//!
//! - Interprets the syntax tree itself, compiled to slots and numbers; shares no code with grounding
//!   and search.
//! - An executor keeps one, applies confirmed steps, and asks what holds.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::sync::{Arc, OnceLock};

use pddl::{
    Atom, Condition, Diagnostic, Direction, Domain, FluentTerm, InitElement, Name, PlanStep,
    Problem, Term,
};

use super::compile::Scope;
use super::failing::Failing;
use super::model::Model;
use super::numbers::Values;
use super::query::View;
use super::symbols::{Object, Relation};
use super::table::Table;
use super::{Fault, FaultReason, Place};

/// A state, and the texts it is a state of. Cloning copies the state and shares the texts.
#[derive(Clone, Debug)]
pub struct World {
    pub(super) model: Arc<Model>,
    /// By predicate: what is true without axioms.
    pub(super) facts: Vec<Table>,
    /// By component of the axioms: what they derive, once somebody has asked. Nothing is settled
    /// that rests on something unsettled.
    pub(super) derived: Vec<OnceLock<Vec<Table>>>,
    /// By function.
    pub(super) values: Vec<Values>,
    /// Steps applied so far.
    pub(super) steps: usize,
}

// === impl World ===

impl World {
    /// The initial state of a problem.
    ///
    /// Fails where no such state can be told: an axiom depends on its own negation, or `:init` speaks
    /// of times to come.
    pub fn initial(domain: &Domain, problem: &Problem) -> Result<World, Vec<Diagnostic>> {
        let mut model = Model::new(domain, problem)?;
        let state = initially(&mut model, problem)?;
        Ok(World::of(Arc::new(model), state))
    }

    /// The initial state of another problem of the same domain, with the same objects and metric;
    /// `None` if it cannot be told, or others still read the texts of this one.
    pub(crate) fn again(mut self, problem: &Problem) -> Option<World> {
        let state = initially(Arc::get_mut(&mut self.model)?, problem).ok()?;
        Some(World::of(self.model, state))
    }

    fn of(model: Arc<Model>, (facts, values): (Vec<Table>, Vec<Values>)) -> World {
        let derived = model.axioms.components.iter().map(|_| OnceLock::new()).collect();
        World { facts, derived, values, model, steps: 0 }
    }

    /// The texts that it is a state of.
    pub(crate) fn model(&self) -> &Model {
        &self.model
    }

    /// What is true here and is not in `other`, a state of the same texts: facts, sorted; those of
    /// axioms come last.
    pub fn beyond(&self, other: &World) -> Vec<Atom> {
        if Arc::ptr_eq(&self.model, &other.model) {
            return self.atoms_where(|predicate, tuple| !other.is_true(predicate, tuple));
        }
        let others: HashSet<Atom> = other.atoms().collect();
        self.atoms().filter(|atom| !others.contains(atom)).collect()
    }

    /// Whether a closed condition holds.
    pub fn holds(&self, condition: &Condition) -> bool {
        let mut scope = Scope::new(&self.model);
        let node = scope.node(condition, true);
        View::of(self).holds(&node, &mut scope.frame())
    }

    /// The smallest part of a closed condition that does not hold; `None` if all of it does.
    pub fn failing(&self, condition: &Condition) -> Option<Condition> {
        Failing::new(self).part(condition)
    }

    /// The facts that are true, sorted; those of axioms come last.
    pub fn atoms(&self) -> impl Iterator<Item = Atom> + '_ {
        self.atoms_where(|_, _| true).into_iter()
    }

    /// Those of them that `shows` tells.
    fn atoms_where(&self, shows: impl Fn(Relation, &[Object]) -> bool) -> Vec<Atom> {
        let mut derived = Vec::new();
        for predicate in self.model.predicates.iter() {
            if let Some((component, at)) = self.model.axioms.place(predicate) {
                let claimed = &self.facts[predicate.index()];
                let all = self.derived(component)[at].tuples();
                let new = all.filter(|tuple| !claimed.contains(|column| tuple[column]));
                let shown = new.filter(|tuple| shows(predicate, tuple));
                derived.extend(shown.filter_map(|tuple| self.atom(predicate, tuple)));
            }
        }
        derived.sort_by(by_name);
        let mut atoms = self.claimed_where(shows);
        atoms.append(&mut derived);
        atoms
    }

    /// Whether a fact is true, claimed or derived.
    fn is_true(&self, predicate: Relation, tuple: &[Object]) -> bool {
        let is_in = |table: &Table| table.contains(|column| tuple[column]);
        is_in(&self.facts[predicate.index()]) || { self.model.axioms.place(predicate) }
            .is_some_and(|(component, at)| is_in(&self.derived(component)[at]))
    }

    /// The value of a ground fluent, if it has one.
    pub fn value(&self, fluent: &FluentTerm) -> Option<f64> {
        let function = self.model.functions.find(&fluent.function, fluent.arguments.len())?;
        let objects = fluent.arguments.iter().map(|term| self.model.objects.find(term.name()));
        let objects = objects.collect::<Option<Vec<Object>>>()?;
        self.values[function.index()].get(|column| objects[column])
    }

    /// What the metric says of the steps applied so far; their number where there is no metric.
    pub fn cost(&self) -> Result<f64, Box<Fault>> {
        let Some(metric) = &self.model.metric else { return Ok(self.steps as f64) };
        let expression = Scope::new(&self.model).expression(&metric.expression);
        let value = View::of(self).evaluate(&expression, &[]);
        // Zero has two signs, and they are one number.
        value.map(|value| value + 0.0).map_err(|fluent| {
            let reason = FaultReason::Undefined(fluent);
            Box::new(Fault { place: Place::Metric, reason, span: metric.span })
        })
    }

    /// Whether more is better under the metric.
    pub fn maximizes(&self) -> bool {
        self.model.metric.as_ref().is_some_and(|metric| metric.direction == Direction::Maximize)
    }

    /// Applies one step. After a fault the world is as it was.
    pub fn apply(&mut self, step: &PlanStep) -> Result<(), Box<Fault>> {
        let fault = |reason| {
            let place = Place::Step { index: self.steps, step: step.clone() };
            Box::new(Fault { place, reason, span: step.span })
        };
        let mut changes = self.changes(step).map_err(fault)?;
        let values = View::of(self).new_values(&mut changes).map_err(fault)?;
        let model = Arc::clone(&self.model);
        for (predicate, tuple) in changes.deletes.iter() {
            if self.facts[predicate.index()].remove(tuple) {
                self.unsettle(model.axioms.fact_readers(predicate));
            }
        }
        // After the deletes: a fact both deleted and added is true.
        for (predicate, tuple) in changes.adds.iter() {
            if self.facts[predicate.index()].insert(tuple) {
                self.unsettle(model.axioms.fact_readers(predicate));
            }
        }
        for (function, objects, value) in values {
            self.values[function.index()].set(&objects, value);
            self.unsettle(model.axioms.value_readers(function));
        }
        self.steps += 1;
        self.unsettle(model.axioms.time_readers());
        Ok(())
    }

    /// The facts that are true without axioms, sorted.
    fn claimed(&self) -> Vec<Atom> {
        self.claimed_where(|_, _| true)
    }

    /// Those of them that `shows` tells.
    fn claimed_where(&self, shows: impl Fn(Relation, &[Object]) -> bool) -> Vec<Atom> {
        let mut claimed = Vec::new();
        for predicate in self.model.predicates.iter() {
            let facts = self.facts[predicate.index()].tuples();
            let shown = facts.filter(|tuple| shows(predicate, tuple));
            claimed.extend(shown.filter_map(|tuple| self.atom(predicate, tuple)));
        }
        claimed.sort_by(by_name);
        claimed
    }

    /// All fluents that have a value, as atoms, sorted.
    fn valued(&self) -> Vec<(Atom, f64)> {
        let functions = &self.model.functions;
        let mut valued = Vec::new();
        for function in functions.iter() {
            let values = self.values[function.index()].iter();
            valued.extend(values.filter_map(|(tuple, value)| {
                Some((self.named(functions.name(function), tuple)?, value))
            }));
        }
        valued.sort_by(|(left, _), (right, _)| by_name(left, right));
        valued
    }

    fn atom(&self, predicate: Relation, tuple: &[Object]) -> Option<Atom> {
        self.named(self.model.predicates.name(predicate), tuple)
    }

    /// `None` if one of the objects has no name in the texts.
    fn named(&self, name: &Name, tuple: &[Object]) -> Option<Atom> {
        let term = |object: &Object| self.model.objects.name(*object).cloned().map(Term::Object);
        let arguments = tuple.iter().map(term).collect::<Option<Vec<Term>>>()?;
        Some(Atom { predicate: name.clone(), arguments, span: pddl::Span::default() })
    }
}

impl PartialEq for World {
    /// Same facts and values; how many steps led there does not matter.
    fn eq(&self, other: &World) -> bool {
        if Arc::ptr_eq(&self.model, &other.model) {
            return self.values == other.values && self.facts == other.facts;
        }
        self.valued() == other.valued() && self.claimed() == other.claimed()
    }
}

/// By predicate, then by arguments.
fn by_name(left: &Atom, right: &Atom) -> Ordering {
    let arguments = || {
        let right = right.arguments.iter().map(Term::name);
        left.arguments.iter().map(Term::name).cmp(right)
    };
    left.predicate.cmp(&right.predicate).then_with(arguments)
}

/// The facts and the values of an initial state. What only `:init` names gets its number here.
fn initially(
    model: &mut Model,
    problem: &Problem,
) -> Result<(Vec<Table>, Vec<Values>), Vec<Diagnostic>> {
    // Domains declare `total-cost` and problems forget to start it.
    let total_cost = model.functions.insert(&Name::new("total-cost"), 0);
    let mut values: Vec<Values> = model.functions.arities().map(Values::new).collect();
    let mut facts: Vec<Table> = model.predicates.arities().map(Table::new).collect();
    values[total_cost.index()].set(&[], 0.0);
    let mut tuple = Vec::new();
    // Facts of one predicate mostly come one after the other.
    let mut last: Option<(&Atom, Relation)> = None;
    for element in &problem.init {
        tuple.clear();
        match element {
            InitElement::Atom(atom) => {
                let arity = atom.arguments.len();
                let is_same = |(other, _): &(&Atom, Relation)| {
                    other.predicate == atom.predicate && other.arguments.len() == arity
                };
                let predicate = match last.filter(is_same) {
                    Some((_, predicate)) => predicate,
                    None => model.predicates.insert(&atom.predicate, arity),
                };
                last = Some((atom, predicate));
                tuple.extend(atom.arguments.iter().map(|term| model.objects.insert(term.name())));
                if predicate.index() == facts.len() {
                    facts.push(Table::new(arity));
                }
                facts[predicate.index()].insert(&tuple);
            }
            InitElement::Not(_) => (),
            InitElement::Assign(fluent, number) => {
                let arity = fluent.arguments.len();
                let function = model.functions.insert(&fluent.function, arity);
                tuple.extend(fluent.arguments.iter().map(|term| model.objects.insert(term.name())));
                if function.index() == values.len() {
                    values.push(Values::new(arity));
                }
                values[function.index()].set(&tuple, number.0);
            }
            InitElement::Unknown(_) => return Err(vec![unknown(element)]),
            InitElement::At(_, later) => return Err(vec![timed(later)]),
        }
    }
    Ok((facts, values))
}

fn unknown(element: &InitElement) -> Diagnostic {
    let message = "an unknown fact has no meaning in a plan that knows all of its state";
    Diagnostic::error(element.span(), message)
}

fn timed(later: &InitElement) -> Diagnostic {
    let message = "a timed initial literal has no meaning in a plan without times";
    Diagnostic::error(later.span(), message)
}
