//! Simulator of PDDL's semantics, written to be as simple as possible. Every variable is tried with
//! every object, axioms are applied until nothing follows, and effects happen for every binding.
//! The simulator is slow, but easy to verify.
//!
//! The simulator shares only the syntax tree with the crate. Actions and objects are identified by
//! their names. Axioms are applied in the order of the text: an axiom may negate only predicates
//! that earlier axioms derive.

use std::collections::{BTreeMap, BTreeSet};

use pddl::{
    ActionSchema, Assignment, Comparison, Condition, Domain, Effect, Expression, InitElement, Name,
    Operator, PlanStep, Problem, Term, Typed, Types,
};

/// A predicate or a function with its arguments.
pub(crate) type Cell = (Name, Vec<Name>);

/// The object of each variable in scope.
pub(crate) type Bindings = BTreeMap<Name, Name>;

/// Reason why a step is not applicable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Wrong {
    Arguments,
    Precondition,
    Undefined,
    Conflict,
}

/// A state of the task. `facts` contains the facts that are true without axioms.
#[derive(Clone, Debug)]
pub(crate) struct State<'t> {
    domain: &'t Domain,
    types: Types,
    objects: Vec<Typed>,
    pub(crate) facts: BTreeSet<Cell>,
    pub(crate) derived: BTreeSet<Cell>,
    pub(crate) values: BTreeMap<Cell, f64>,
}

impl<'t> State<'t> {
    pub(crate) fn initial(domain: &'t Domain, problem: &Problem) -> State<'t> {
        let declared = problem.objects.iter().map(|declaration| &declaration.object);
        let mut state = State {
            domain,
            types: Types::of(domain),
            objects: domain.constants.iter().chain(declared).cloned().collect(),
            facts: BTreeSet::new(),
            derived: BTreeSet::new(),
            values: BTreeMap::from([((Name::new("total-cost"), Vec::new()), 0.0)]),
        };
        for element in &problem.init {
            match element {
                InitElement::Atom(atom) => {
                    let cell = ground(&atom.predicate, &atom.arguments, &Bindings::new());
                    state.facts.insert(cell);
                }
                InitElement::Assign(fluent, value) => {
                    let cell = ground(&fluent.function, &fluent.arguments, &Bindings::new());
                    state.values.insert(cell, value.0);
                }
                InitElement::Not(_) => (),
                InitElement::Unknown(_) => panic!("all is known here"),
                InitElement::At(..) => panic!("there is no time here"),
            }
        }
        state.derive();
        state
    }

    pub(crate) fn apply(&mut self, step: &PlanStep) -> Result<(), Wrong> {
        let action = self.domain.actions.iter().find(|action| action.name == step.action);
        let action = action.expect("the action exists");
        let bindings = self.bound(action, &step.arguments).ok_or(Wrong::Arguments)?;
        if !self.holds(&action.precondition, &bindings) {
            return Err(Wrong::Precondition);
        }
        let mut happening = Vec::new();
        self.happening(&action.effect, &bindings, &mut happening);
        let values = self.values_after(&happening)?;
        for (effect, bindings) in &happening {
            if let Effect::Delete(atom) = effect {
                self.facts.remove(&ground(&atom.predicate, &atom.arguments, bindings));
            }
        }
        for (effect, bindings) in &happening {
            if let Effect::Add(atom) = effect {
                self.facts.insert(ground(&atom.predicate, &atom.arguments, bindings));
            }
        }
        self.values.extend(values);
        self.derive();
        Ok(())
    }

    pub(crate) fn holds(&self, condition: &Condition, bindings: &Bindings) -> bool {
        self.is(true, condition, bindings)
    }

    /// Whether a condition holds, or its negation if `positive` is false. For a comparison with an
    /// undefined side, neither holds.
    fn is(&self, positive: bool, condition: &Condition, bindings: &Bindings) -> bool {
        let all = |parts: &[Condition]| parts.iter().all(|part| self.is(positive, part, bindings));
        let any = |parts: &[Condition]| parts.iter().any(|part| self.is(positive, part, bindings));
        match condition {
            Condition::Atom(atom) => {
                let cell = ground(&atom.predicate, &atom.arguments, bindings);
                (self.facts.contains(&cell) || self.derived.contains(&cell)) == positive
            }
            Condition::Equal(left, right, _) => {
                (object(left, bindings) == object(right, bindings)) == positive
            }
            Condition::Compare(compare) => {
                let left = self.value(&compare.left, bindings);
                let right = self.value(&compare.right, bindings);
                let holds = |left: f64, right: f64| match compare.comparison {
                    Comparison::Less => left < right,
                    Comparison::LessOrEqual => left <= right,
                    Comparison::Equal => left == right,
                    Comparison::GreaterOrEqual => left >= right,
                    Comparison::Greater => left > right,
                };
                left.zip(right).is_some_and(|(left, right)| holds(left, right) == positive)
            }
            Condition::Not(inner) => self.is(!positive, inner, bindings),
            Condition::And(parts) => {
                if positive {
                    all(parts)
                } else {
                    any(parts)
                }
            }
            Condition::Or(parts) => {
                if positive {
                    any(parts)
                } else {
                    all(parts)
                }
            }
            Condition::Imply(left, right) => {
                let (left, right) =
                    (self.is(!positive, left, bindings), self.is(positive, right, bindings));
                if positive { left || right } else { left && right }
            }
            Condition::Exists(variables, inner) | Condition::Forall(variables, inner) => {
                let instances = self.instances(variables, bindings);
                let mut instances = instances.iter();
                match matches!(condition, Condition::Exists(..)) == positive {
                    true => instances.any(|it| self.is(positive, inner, it)),
                    false => instances.all(|it| self.is(positive, inner, it)),
                }
            }
        }
    }

    fn value(&self, expression: &Expression, bindings: &Bindings) -> Option<f64> {
        match expression {
            Expression::Number(number) => Some(number.0),
            Expression::Fluent(fluent) => {
                let cell = ground(&fluent.function, &fluent.arguments, bindings);
                self.values.get(&cell).copied()
            }
            Expression::Negate(inner) => Some(-self.value(inner, bindings)?),
            Expression::Apply(operator, operands) => {
                let values: Option<Vec<f64>> =
                    operands.iter().map(|operand| self.value(operand, bindings)).collect();
                values?.into_iter().reduce(|left, right| match operator {
                    Operator::Add => left + right,
                    Operator::Subtract => left - right,
                    Operator::Multiply => left * right,
                    Operator::Divide => panic!("nothing is divided here"),
                })
            }
            other => panic!("{other:?} has no place here"),
        }
    }

    /// Collects the simple effects that happen in this state, each with its bindings.
    fn happening<'e>(
        &self,
        effect: &'e Effect,
        bindings: &Bindings,
        found: &mut Vec<(&'e Effect, Bindings)>,
    ) {
        match effect {
            Effect::And(parts) => {
                parts.iter().for_each(|part| self.happening(part, bindings, found));
            }
            Effect::When(condition, inner) => {
                if self.holds(condition, bindings) {
                    self.happening(inner, bindings, found);
                }
            }
            Effect::Forall(variables, inner) => {
                for instance in self.instances(variables, bindings) {
                    self.happening(inner, &instance, found);
                }
            }
            Effect::Add(_) | Effect::Delete(_) | Effect::Assign(_) => {
                found.push((effect, bindings.clone()));
            }
        }
    }

    fn values_after(
        &self,
        happening: &[(&Effect, Bindings)],
    ) -> Result<BTreeMap<Cell, f64>, Wrong> {
        let mut updates: BTreeMap<Cell, Vec<(Assignment, f64)>> = BTreeMap::new();
        for (effect, bindings) in happening {
            let Effect::Assign(assign) = effect else { continue };
            let cell = ground(&assign.fluent.function, &assign.fluent.arguments, bindings);
            let value = self.value(&assign.value, bindings).ok_or(Wrong::Undefined)?;
            if assign.assignment != Assignment::Assign && !self.values.contains_key(&cell) {
                return Err(Wrong::Undefined);
            }
            updates.entry(cell).or_default().push((assign.assignment, value));
        }
        let mut values = BTreeMap::new();
        for (cell, updates) in updates {
            let all = |kinds: &[Assignment]| updates.iter().all(|(kind, _)| kinds.contains(kind));
            let numbers = updates.iter().map(|(_, number)| *number);
            let value = if all(&[Assignment::Assign]) {
                let first = updates[0].1;
                numbers.clone().all(|number| number == first).then_some(first)
            } else if all(&[Assignment::Increase, Assignment::Decrease]) {
                let signed = updates.iter().map(|(kind, number)| match kind {
                    Assignment::Increase => *number,
                    _ => -number,
                });
                Some(self.values[&cell] + signed.sum::<f64>())
            } else if all(&[Assignment::ScaleUp]) {
                Some(self.values[&cell] * numbers.product::<f64>())
            } else {
                None
            };
            values.insert(cell, value.ok_or(Wrong::Conflict)?);
        }
        Ok(values)
    }

    /// Applies the axioms in the order of their predicates, those of one predicate until nothing
    /// new follows.
    fn derive(&mut self) {
        self.derived.clear();
        let axioms = &self.domain.derived;
        for group in axioms.chunk_by(|left, right| left.predicate == right.predicate) {
            loop {
                let mut new = BTreeSet::new();
                for axiom in group {
                    for instance in self.instances(&axiom.parameters, &Bindings::new()) {
                        if self.holds(&axiom.condition, &instance) {
                            let arguments =
                                axiom.parameters.iter().map(|one| instance[&one.name].clone());
                            new.insert((axiom.predicate.clone(), arguments.collect()));
                        }
                    }
                }
                if new.is_subset(&self.derived) {
                    break;
                }
                self.derived.extend(new);
            }
        }
    }

    /// Returns the bindings, extended by every combination of objects for the variables.
    fn instances(&self, variables: &[Typed], bindings: &Bindings) -> Vec<Bindings> {
        let mut instances = vec![bindings.clone()];
        for variable in variables {
            let members: Vec<&Name> = { self.objects.iter() }
                .filter(|object| self.is_of(object, variable))
                .map(|object| &object.name)
                .collect();
            let extended = |instance: &Bindings, object: &Name| {
                let mut instance = instance.clone();
                instance.insert(variable.name.clone(), object.clone());
                instance
            };
            instances = { instances.iter() }
                .flat_map(|instance| members.iter().map(move |object| extended(instance, object)))
                .collect();
        }
        instances
    }

    fn bound(&self, action: &ActionSchema, arguments: &[Name]) -> Option<Bindings> {
        let mut bindings = Bindings::new();
        for (parameter, name) in action.all_parameters().zip(arguments) {
            let object = self.objects.iter().find(|object| object.name == *name)?;
            if !self.is_of(object, parameter) {
                return None;
            }
            bindings.insert(parameter.name.clone(), name.clone());
        }
        (action.all_parameters().count() == arguments.len()).then_some(bindings)
    }

    fn is_of(&self, object: &Typed, variable: &Typed) -> bool {
        self.types.holds(&variable.ty, &object.ty)
    }
}

fn object(term: &Term, bindings: &Bindings) -> Name {
    match term {
        Term::Object(name) => name.clone(),
        Term::Variable(name) => bindings[name].clone(),
    }
}

fn ground(name: &Name, terms: &[Term], bindings: &Bindings) -> Cell {
    (name.clone(), terms.iter().map(|term| object(term, bindings)).collect())
}
