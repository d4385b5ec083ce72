//! A state of the world, defined by the domain and the problem: facts, values, and derived facts.
//!
//! - This module interprets the syntax tree itself, compiled to slots and numbers, and shares no
//!   code with grounding and search.
//! - A plan executor keeps a [`World`], applies confirmed steps to it, and tests which conditions
//!   hold.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::sync::{Arc, OnceLock};

use pddl::{
    Atom, Condition, Diagnostic, Domain, FluentTerm, InitElement, MetricDirection, Name, PlanStep,
    Problem, Term,
};

use super::compile::CompilationScope;
use super::failing_part::FailingPartSearch;
use super::model::Model;
use super::numeric_values::FunctionValues;
use super::query::WorldView;
use super::symbols::{Object, RelationId};
use super::tuple_table::TupleTable;
use super::work_meter::WorkMeter;
use super::{Fault, FaultPlace, FaultReason};
use crate::limits::Cancel;

/// A state of the world, together with its domain and problem. A clone copies the state and shares
/// the domain and the problem.
#[derive(Clone, Debug)]
pub struct World {
    pub(super) model: Arc<Model>,
    /// For each predicate: the facts that are true without axioms.
    pub(super) facts: Vec<TupleTable>,
    /// For each component of the axioms: its derived facts, computed on first use. If a component
    /// has not been computed, the components that depend on it have not been computed either.
    pub(super) derived: Vec<OnceLock<Vec<TupleTable>>>,
    /// For each function: the values of its fluents.
    pub(super) values: Vec<FunctionValues>,
    /// Number of steps applied since the initial state.
    pub(super) steps: usize,
    /// Amount of work still allowed for evaluations in this state.
    pub(super) work: WorkMeter,
}

// === impl World ===

impl World {
    /// Returns the initial state of a problem.
    ///
    /// # Errors
    ///
    /// Returns the diagnostics if the texts contain errors, or if the initial state is not defined:
    /// an axiom depends on its own negation, or `:init` contains timed literals or unknown facts.
    pub fn initial(domain: &Domain, problem: &Problem) -> Result<World, Vec<Diagnostic>> {
        let mut model = Model::new(domain, problem)?;
        let state = initially(&mut model, problem)?;
        Ok(World::of(Arc::new(model), state))
    }

    /// Returns the initial state of another problem with the same domain, objects and metric.
    /// Returns `None` if that initial state is not defined, or if another `World` still shares the
    /// model.
    pub(crate) fn with_problem(mut self, problem: &Problem) -> Option<World> {
        let state = initially(Arc::get_mut(&mut self.model)?, problem).ok()?;
        Some(World::of(self.model, state))
    }

    fn of(model: Arc<Model>, (facts, values): (Vec<TupleTable>, Vec<FunctionValues>)) -> World {
        let derived = model.axioms.components.iter().map(|_| OnceLock::new()).collect();
        World { facts, derived, values, model, steps: 0, work: WorkMeter::default() }
    }

    /// Limits the work of all later evaluations in this state, counted in steps of the search for
    /// bindings of quantified variables. A step takes some 100 ns. Each component of the axioms has
    /// a separate count. `cancel` ends evaluations earlier.
    ///
    /// After the limit is reached, every condition and its negation counts as false, no step is
    /// applicable, and [`World::work_limit_reached`] returns the limit. A clone has its own count,
    /// which starts with the remaining steps.
    #[must_use]
    pub fn limit_work(self, steps_max: u64, cancel: Option<&Cancel>) -> World {
        let work = self.work.with_limit(steps_max, cancel.cloned());
        World { work, ..self }
    }

    /// Restarts the count of work, for an evaluation that is independent of earlier ones. This has
    /// no effect if the limit has ended the evaluation of axioms, because derived facts are then
    /// missing.
    pub fn renew_work(&self) {
        self.work.renew();
    }

    /// Returns the limit of [`World::limit_work`] if an evaluation has reached it or was cancelled;
    /// `None` if all results of this state so far are complete.
    pub fn work_limit_reached(&self) -> Option<u64> {
        self.work.is_exhausted().then(|| self.work.limit())
    }

    /// Returns the constant part of the domain and the problem.
    pub(crate) fn model(&self) -> &Model {
        &self.model
    }

    /// Returns the facts that are true in this state but not in `other`, a state of the same domain
    /// and problem. The facts are sorted; derived facts come last.
    pub fn facts_missing_in(&self, other: &World) -> Vec<Atom> {
        if Arc::ptr_eq(&self.model, &other.model) {
            return self.atoms_where(|predicate, tuple| !other.is_true(predicate, tuple));
        }
        let others: HashSet<Atom> = other.atoms().collect();
        self.atoms().filter(|atom| !others.contains(atom)).collect()
    }

    /// Whether a condition without free variables holds in this state. Returns `false` if the work
    /// limit is reached.
    pub fn holds(&self, condition: &Condition) -> bool {
        let mut scope = CompilationScope::new(&self.model);
        let node = scope.node(condition, true);
        WorldView::of(self).holds(&node, &mut scope.frame()) && !self.work.is_exhausted()
    }

    /// Returns the smallest failing part of a condition without free variables; `None` if the
    /// condition holds. Returns the whole condition if the work limit is reached.
    pub fn failing(&self, condition: &Condition) -> Option<Condition> {
        FailingPartSearch::new(self).part(condition)
    }

    /// Iterates over the facts that are true in this state, in sorted order; derived facts come
    /// last.
    pub fn atoms(&self) -> impl Iterator<Item = Atom> + '_ {
        self.atoms_where(|_, _| true).into_iter()
    }

    /// Returns the true facts for which `shows` returns `true`; its arguments are the predicate and
    /// the objects. The facts are sorted; derived facts come last.
    fn atoms_where(&self, shows: impl Fn(RelationId, &[Object]) -> bool) -> Vec<Atom> {
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

    /// Whether a fact is true in this state, with or without axioms.
    fn is_true(&self, predicate: RelationId, tuple: &[Object]) -> bool {
        let is_in = |table: &TupleTable| table.contains(|column| tuple[column]);
        is_in(&self.facts[predicate.index()]) || { self.model.axioms.place(predicate) }
            .is_some_and(|(component, at)| is_in(&self.derived(component)[at]))
    }

    /// Returns the value of a grounded fluent; `None` if it is undefined.
    pub fn value(&self, fluent: &FluentTerm) -> Option<f64> {
        let function = self.model.functions.find(&fluent.function, fluent.arguments.len())?;
        let objects = fluent.arguments.iter().map(|term| self.model.objects.find(term.name()));
        let objects = objects.collect::<Option<Vec<Object>>>()?;
        self.values[function.index()].get(|column| objects[column])
    }

    /// Returns the value of the metric after the steps applied so far. Without a metric, returns
    /// the number of these steps.
    ///
    /// # Errors
    ///
    /// Returns a fault if the metric contains a fluent without a value.
    pub fn cost(&self) -> Result<f64, Box<Fault>> {
        let Some(metric) = &self.model.metric else { return Ok(self.steps as f64) };
        let expression = CompilationScope::new(&self.model).expression(&metric.expression);
        let value = WorldView::of(self).evaluate(&expression, &[]);
        // Zero has two signs in IEEE 754; adding 0.0 makes them equal.
        value.map(|value| value + 0.0).map_err(|fluent| {
            let reason = FaultReason::Undefined(fluent);
            Box::new(Fault { place: FaultPlace::Metric, reason, span: metric.span })
        })
    }

    /// Whether the metric is to be maximized. Returns `false` if there is no metric.
    pub fn maximizes(&self) -> bool {
        self.model
            .metric
            .as_ref()
            .is_some_and(|metric| metric.direction == MetricDirection::Maximize)
    }

    /// Applies one step.
    ///
    /// # Errors
    ///
    /// Returns a fault if the step is not an action of the domain with declared objects, if its
    /// precondition does not hold, or if its effects are undefined or contradict each other. The
    /// state then remains unchanged.
    pub fn apply(&mut self, step: &PlanStep) -> Result<(), Box<Fault>> {
        let fault = |reason| {
            let place = FaultPlace::Step { index: self.steps, step: step.clone() };
            Box::new(Fault { place, reason, span: step.span })
        };
        let mut changes = self.changes(step).map_err(fault)?;
        let values = WorldView::of(self).new_values(&mut changes).map_err(fault)?;
        if let Some(limit) = self.work_limit_reached() {
            return Err(fault(FaultReason::WorkLimit { limit }));
        }
        let model = Arc::clone(&self.model);
        for (predicate, tuple) in changes.deletes.iter() {
            if self.facts[predicate.index()].remove(tuple) {
                self.invalidate(model.axioms.fact_readers(predicate));
            }
        }
        // Additions follow deletions: a fact that is both deleted and added is true.
        for (predicate, tuple) in changes.adds.iter() {
            if self.facts[predicate.index()].insert(tuple) {
                self.invalidate(model.axioms.fact_readers(predicate));
            }
        }
        for (function, objects, value) in values {
            self.values[function.index()].set(&objects, value);
            self.invalidate(model.axioms.value_readers(function));
        }
        self.steps += 1;
        self.invalidate(model.axioms.time_readers());
        Ok(())
    }

    /// Returns the facts that are true without axioms, sorted.
    fn base_facts(&self) -> Vec<Atom> {
        self.claimed_where(|_, _| true)
    }

    /// Returns the facts that are true without axioms and for which `shows` returns `true`, sorted.
    pub(super) fn claimed_where(&self, shows: impl Fn(RelationId, &[Object]) -> bool) -> Vec<Atom> {
        let mut claimed = Vec::new();
        for predicate in self.model.predicates.iter() {
            let facts = self.facts[predicate.index()].tuples();
            let shown = facts.filter(|tuple| shows(predicate, tuple));
            claimed.extend(shown.filter_map(|tuple| self.atom(predicate, tuple)));
        }
        claimed.sort_by(by_name);
        claimed
    }

    /// Returns all fluents that have a value, sorted. Each entry is the fluent, written as an atom,
    /// and its value.
    fn defined_fluents(&self) -> Vec<(Atom, f64)> {
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

    fn atom(&self, predicate: RelationId, tuple: &[Object]) -> Option<Atom> {
        self.named(self.model.predicates.name(predicate), tuple)
    }

    /// Returns an atom with this name and these objects; `None` if one of the objects has no name
    /// in the texts.
    pub(super) fn named(&self, name: &Name, tuple: &[Object]) -> Option<Atom> {
        let term = |object: &Object| self.model.objects.name(*object).cloned().map(Term::Object);
        let arguments = tuple.iter().map(term).collect::<Option<Vec<Term>>>()?;
        Some(Atom { predicate: name.clone(), arguments, span: pddl::Span::default() })
    }
}

impl PartialEq for World {
    /// Compares the facts and values of two states; ignores the numbers of applied steps.
    fn eq(&self, other: &World) -> bool {
        if Arc::ptr_eq(&self.model, &other.model) {
            return self.values == other.values && self.facts == other.facts;
        }
        self.defined_fluents() == other.defined_fluents() && self.base_facts() == other.base_facts()
    }
}

/// Compares atoms by predicate, then by arguments.
pub(super) fn by_name(left: &Atom, right: &Atom) -> Ordering {
    let arguments = || {
        let right = right.arguments.iter().map(Term::name);
        left.arguments.iter().map(Term::name).cmp(right)
    };
    left.predicate.cmp(&right.predicate).then_with(arguments)
}

/// Returns the tables of facts and of function values in the initial state, each by number of the
/// predicate or function. Names that occur only in `:init` get their numbers here.
fn initially(
    model: &mut Model,
    problem: &Problem,
) -> Result<(Vec<TupleTable>, Vec<FunctionValues>), Vec<Diagnostic>> {
    // `total-cost` is zero unless `:init` assigns a value: many domains declare it, and problems
    // omit it.
    let total_cost = model.functions.insert(&Name::new(pddl::TOTAL_COST), 0);
    let mut values: Vec<FunctionValues> =
        model.functions.arities().map(FunctionValues::new).collect();
    let mut facts: Vec<TupleTable> = model.predicates.arities().map(TupleTable::new).collect();
    values[total_cost.index()].set(&[], 0.0);
    let mut tuple = Vec::new();
    // Most facts of one predicate are adjacent in `:init`; the lookup of the previous fact is
    // reused.
    let mut last: Option<(&Atom, RelationId)> = None;
    for element in &problem.init {
        tuple.clear();
        match element {
            InitElement::Atom(atom) => {
                let arity = atom.arguments.len();
                let is_same = |(other, _): &(&Atom, RelationId)| {
                    other.predicate == atom.predicate && other.arguments.len() == arity
                };
                let predicate = match last.filter(is_same) {
                    Some((_, predicate)) => predicate,
                    None => model.predicates.insert(&atom.predicate, arity),
                };
                last = Some((atom, predicate));
                tuple.extend(atom.arguments.iter().map(|term| model.objects.insert(term.name())));
                if predicate.index() == facts.len() {
                    facts.push(TupleTable::new(arity));
                }
                facts[predicate.index()].insert(&tuple);
            }
            InitElement::Not(_) => (),
            InitElement::Assign(fluent, number) => {
                let arity = fluent.arguments.len();
                let function = model.functions.insert(&fluent.function, arity);
                tuple.extend(fluent.arguments.iter().map(|term| model.objects.insert(term.name())));
                if function.index() == values.len() {
                    values.push(FunctionValues::new(arity));
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
