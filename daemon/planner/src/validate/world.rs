//! One state of the world, as the lifted texts mean it: facts, values, and what the axioms derive.
//!
//! - Interprets the syntax tree itself; shares no code with grounding and search.
//! - An executor keeps one, applies confirmed steps, and asks what holds.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pddl::{
    ActionSchema, Assign, Assignment, Atom, Condition, Diagnostic, Direction, Domain, Effect,
    FluentTerm, InitElement, Name, PlanStep, Problem, Term,
};

use super::evaluate::{Bindings, TOLERANCE};
use super::model::Model;
use super::{Fault, FaultReason, Place};

/// Facts by predicate. A sorted table, so that whatever walks it does so the same way every time.
type Facts = BTreeMap<Name, BTreeSet<Vec<Name>>>;

/// A fluent: its function and the objects it is about.
type FluentKey = (Name, Vec<Name>);

/// A state, and the texts it is a state of. Cloning copies the state and shares the texts.
#[derive(Clone, Debug)]
pub struct World {
    pub(crate) model: Arc<Model>,
    facts: Facts,
    derived: Facts,
    pub(super) values: BTreeMap<FluentKey, f64>,
    /// Steps applied so far.
    pub(super) steps: usize,
}

/// What the effects of one step do, all read in the state before it.
#[derive(Default)]
struct Changes {
    adds: Vec<(Name, Vec<Name>)>,
    deletes: Vec<(Name, Vec<Name>)>,
    numeric: BTreeMap<FluentKey, Vec<(Assignment, f64)>>,
}

// === impl World ===

impl World {
    /// The initial state of a problem.
    ///
    /// Fails where no such state can be told: an axiom depends on its own negation, or `:init` speaks
    /// of times to come.
    pub fn initial(domain: &Domain, problem: &Problem) -> Result<World, Vec<Diagnostic>> {
        let mut world = World {
            model: Arc::new(Model::new(domain, problem)?),
            facts: Facts::new(),
            derived: Facts::new(),
            values: BTreeMap::new(),
            steps: 0,
        };
        // Domains declare `total-cost` and problems forget to start it.
        world.values.insert((Name::new("total-cost"), Vec::new()), 0.0);
        for element in &problem.init {
            world.assert_initially(element)?;
        }
        world.derive();
        Ok(world)
    }

    /// Whether a closed condition holds.
    pub fn holds(&self, condition: &Condition) -> bool {
        self.holds_under(condition, &mut Bindings::default())
    }

    /// The smallest part of a closed condition that does not hold; `None` if all of it does.
    pub fn failing(&self, condition: &Condition) -> Option<Condition> {
        self.failing_under(condition, &mut Bindings::default())
    }

    /// The facts that are true, those of axioms included, sorted.
    pub fn atoms(&self) -> impl Iterator<Item = Atom> + '_ {
        let all = self.facts.iter().chain(&self.derived);
        all.flat_map(|(predicate, tuples)| {
            tuples.iter().map(|objects| Atom {
                predicate: predicate.clone(),
                arguments: objects.iter().cloned().map(Term::Object).collect(),
                span: pddl::Span::default(),
            })
        })
    }

    /// The value of a ground fluent, if it has one.
    pub fn value(&self, fluent: &FluentTerm) -> Option<f64> {
        let key = (fluent.function.clone(), Bindings::default().objects(&fluent.arguments));
        self.values.get(&key).copied()
    }

    /// What the metric says of the steps applied so far; their number where there is no metric.
    pub fn cost(&self) -> Result<f64, Box<Fault>> {
        let Some(metric) = &self.model.metric else { return Ok(self.steps as f64) };
        let value = self.evaluate(&metric.expression, &Bindings::default());
        // Sums of decimal fractions are not exact in binary; nine digits are nobody's intention.
        value.map(|value| (value * 1e9).round() / 1e9).map_err(|fluent| {
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
        let changes = self.changes(step).map_err(fault)?;
        let values = self.new_values(&changes).map_err(fault)?;
        for (predicate, objects) in &changes.deletes {
            if let Some(tuples) = self.facts.get_mut(predicate) {
                tuples.remove(objects);
            }
        }
        // After the deletes: a fact both deleted and added is true.
        for (predicate, objects) in changes.adds {
            self.facts.entry(predicate).or_default().insert(objects);
        }
        self.values.extend(values);
        self.steps += 1;
        self.derive();
        Ok(())
    }

    pub(super) fn has(&self, predicate: &Name, objects: &[Name]) -> bool {
        let within = |facts: &Facts| facts.get(predicate).is_some_and(|all| all.contains(objects));
        within(&self.facts) || within(&self.derived)
    }

    pub(super) fn facts_of(&self, predicate: &Name) -> impl Iterator<Item = &Vec<Name>> {
        self.facts.get(predicate).into_iter().chain(self.derived.get(predicate)).flatten()
    }

    fn assert_initially(&mut self, element: &InitElement) -> Result<(), Vec<Diagnostic>> {
        match element {
            InitElement::Atom(atom) => {
                let objects = Bindings::default().objects(&atom.arguments);
                self.facts.entry(atom.predicate.clone()).or_default().insert(objects);
            }
            InitElement::Not(_) => (),
            InitElement::Assign(fluent, number) => {
                let objects = Bindings::default().objects(&fluent.arguments);
                self.values.insert((fluent.function.clone(), objects), number.0);
            }
            InitElement::At(_, later) => {
                let span = match &**later {
                    InitElement::Atom(atom) | InitElement::Not(atom) => atom.span,
                    InitElement::Assign(fluent, _) => fluent.span,
                    InitElement::At(..) => pddl::Span::default(),
                };
                let message = "a timed initial literal has no meaning in a plan without times";
                return Err(vec![Diagnostic::error(span, message)]);
            }
        }
        Ok(())
    }

    /// Finds the action, checks arguments and precondition, and reads the effects.
    fn changes(&self, step: &PlanStep) -> Result<Changes, FaultReason> {
        let model = Arc::clone(&self.model);
        let schemas = model.domain.actions.iter().filter(|schema| schema.name == step.action);
        let mut reason = FaultReason::UnknownAction;
        if model.domain.durative_actions.iter().any(|action| action.name == step.action) {
            reason = FaultReason::Durative;
        }
        // Action names may be overloaded; the fault told is that of the last one tried.
        for schema in schemas {
            match self.changes_by(schema, step) {
                Ok(changes) => return Ok(changes),
                Err(err) => reason = err,
            }
        }
        Err(reason)
    }

    fn changes_by(&self, schema: &ActionSchema, step: &PlanStep) -> Result<Changes, FaultReason> {
        let expected = schema.all_parameters().count();
        if expected != step.arguments.len() {
            return Err(FaultReason::ArgumentCount { expected, found: step.arguments.len() });
        }
        let mut bindings = Bindings::default();
        for (parameter, object) in schema.all_parameters().zip(&step.arguments) {
            if !self.model.knows(object) {
                return Err(FaultReason::UnknownObject(object.clone()));
            }
            if !self.model.is_a(object, &parameter.ty) {
                let expected = parameter.ty.clone();
                return Err(FaultReason::WrongType { object: object.clone(), expected });
            }
            bindings.bind(&parameter.name, object.clone());
        }
        if let Some(condition) = self.failing_under(&schema.precondition, &mut bindings) {
            return Err(FaultReason::Precondition(condition));
        }
        let mut changes = Changes::default();
        self.collect(&schema.effect, &mut bindings, &mut changes)?;
        Ok(changes)
    }

    fn collect(
        &self,
        effect: &Effect,
        bindings: &mut Bindings,
        changes: &mut Changes,
    ) -> Result<(), FaultReason> {
        let ground = |atom: &Atom, bindings: &Bindings| {
            (atom.predicate.clone(), bindings.objects(&atom.arguments))
        };
        match effect {
            Effect::And(parts) => {
                for part in parts {
                    self.collect(part, bindings, changes)?;
                }
            }
            Effect::Add(atom) => changes.adds.push(ground(atom, bindings)),
            Effect::Delete(atom) => changes.deletes.push(ground(atom, bindings)),
            Effect::Assign(assign) => self.collect_assign(assign, bindings, changes)?,
            Effect::When(condition, inner) => {
                if self.holds_under(condition, bindings) {
                    self.collect(inner, bindings, changes)?;
                }
            }
            Effect::Forall(variables, inner) => {
                let mut outcome = Ok(());
                self.every(variables, bindings, &mut |world, bindings| {
                    outcome = world.collect(inner, bindings, changes);
                    outcome.is_ok()
                });
                outcome?;
            }
        }
        Ok(())
    }

    fn collect_assign(
        &self,
        assign: &Assign,
        bindings: &Bindings,
        changes: &mut Changes,
    ) -> Result<(), FaultReason> {
        let value = self.evaluate(&assign.value, bindings).map_err(FaultReason::Undefined)?;
        let key = (assign.fluent.function.clone(), bindings.objects(&assign.fluent.arguments));
        if assign.assignment != Assignment::Assign && !self.values.contains_key(&key) {
            return Err(FaultReason::Undefined(bindings.fluent(&assign.fluent)));
        }
        changes.numeric.entry(key).or_default().push((assign.assignment, value));
        Ok(())
    }

    fn new_values(&self, changes: &Changes) -> Result<Vec<(FluentKey, f64)>, FaultReason> {
        let mut values = Vec::new();
        for (key, updates) in &changes.numeric {
            let old = self.values.get(key).copied();
            match combine(old, updates) {
                Some(value) if value.is_finite() => values.push((key.clone(), value)),
                _ => return Err(FaultReason::Conflict(fluent_term(key))),
            }
        }
        Ok(values)
    }

    /// Derives what the axioms say, stratum by stratum, each up to its fixpoint.
    fn derive(&mut self) {
        self.derived.clear();
        let model = Arc::clone(&self.model);
        for stratum in &model.strata {
            while self.derive_once(stratum, &model) {}
        }
    }

    /// One round over the axioms of a stratum; whether it derived anything new.
    fn derive_once(&mut self, stratum: &[usize], model: &Model) -> bool {
        let mut new = Vec::new();
        for &index in stratum {
            let axiom = &model.domain.derived[index];
            let head: Vec<Term> =
                axiom.parameters.iter().map(|one| Term::Variable(one.name.clone())).collect();
            let mut bindings = Bindings::default();
            self.each(
                &axiom.parameters,
                &axiom.condition,
                &mut bindings,
                &mut |world, bindings| {
                    let objects = bindings.objects(&head);
                    if !world.has(&axiom.predicate, &objects)
                        && world.holds_under(&axiom.condition, bindings)
                    {
                        new.push((axiom.predicate.clone(), objects));
                    }
                    true
                },
            );
        }
        let grew = !new.is_empty();
        for (predicate, objects) in new {
            self.derived.entry(predicate).or_default().insert(objects);
        }
        grew
    }
}

impl PartialEq for World {
    /// Same facts and values; how many steps led there does not matter.
    fn eq(&self, other: &World) -> bool {
        let facts = |world: &World| -> Vec<(Name, Vec<Name>)> {
            let flat = |(predicate, tuples): (&Name, &BTreeSet<Vec<Name>>)| {
                let predicate = predicate.clone();
                tuples
                    .iter()
                    .map(move |tuple| (predicate.clone(), tuple.clone()))
                    .collect::<Vec<_>>()
            };
            world.facts.iter().flat_map(flat).collect()
        };
        self.values == other.values && facts(self) == facts(other)
    }
}

/// The value after all updates of one fluent; `None` where they contradict each other.
///
/// Increases and decreases add up, and so do scalings among themselves; an assignment stands alone,
/// unless the others assign the same.
fn combine(old: Option<f64>, updates: &[(Assignment, f64)]) -> Option<f64> {
    let (first, first_value) = updates.first()?;
    let is_additive = |one| matches!(one, Assignment::Increase | Assignment::Decrease);
    if *first == Assignment::Assign {
        let agrees = |(assignment, value): &(Assignment, f64)| {
            *assignment == Assignment::Assign && (value - first_value).abs() <= TOLERANCE
        };
        return updates.iter().all(agrees).then_some(*first_value);
    }
    let additive = is_additive(*first);
    let alike =
        |(one, _): &(Assignment, f64)| *one != Assignment::Assign && is_additive(*one) == additive;
    if !updates.iter().all(alike) {
        return None;
    }
    updates.iter().try_fold(old?, |value, (assignment, operand)| {
        Some(match assignment {
            Assignment::Assign => return None,
            Assignment::Increase => value + operand,
            Assignment::Decrease => value - operand,
            Assignment::ScaleUp => value * operand,
            Assignment::ScaleDown => value / operand,
        })
    })
}

fn fluent_term((function, objects): &FluentKey) -> FluentTerm {
    FluentTerm {
        function: function.clone(),
        arguments: objects.iter().cloned().map(Term::Object).collect(),
        span: pddl::Span::default(),
    }
}

/// The action that a step names, with as many parameters as the step has arguments and of fitting
/// types.
pub(super) fn schema_of<'m>(model: &'m Model, step: &PlanStep) -> Option<&'m ActionSchema> {
    model.domain.actions.iter().find(|schema| {
        schema.name == step.action
            && schema.all_parameters().count() == step.arguments.len()
            && schema
                .all_parameters()
                .zip(&step.arguments)
                .all(|(parameter, object)| model.knows(object) && model.is_a(object, &parameter.ty))
    })
}
