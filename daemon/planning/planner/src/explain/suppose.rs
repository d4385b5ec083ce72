//! Builds the *supposed task*: the relaxed task with operators that suppose missing capabilities,
//! as a domain and a problem.
//!
//! Every action that an agent offers, or has offered, has a guard: a fact that allows an agent to
//! use the action. The task has four kinds of auxiliary operators:
//!
//! - `suppose` makes the guard true for one agent, which is present or new.
//! - `place` makes a fact about a new agent true that its action requires, or puts an agent without
//!   a place onto a new agent.
//! - `reach` represents that a part of the goal is reached.
//! - `touch` represents that a fact in such a part is reached.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pddl::{
    ActionModel, ActionSchema, Atom, Condition, Derived, Domain, Effect, InitElement, Name,
    ObjectDeclaration, PredicateDeclaration, Privacy, Problem, Span, Term, TypeExpr, Typed, Types,
};

use super::{ActionGuard, ExplanationInput, SupposedObject};

/// Maximum number of models of former agents that are used; further models are ignored. Each model
/// is checked separately.
const FORMER_MAX: usize = 64;

/// Name of an auxiliary predicate. PDDL does not allow such names, so they are different from all
/// names in the texts.
const THERE: &str = "%there";
const NEW: &str = "%new";
const EXPLAINED: &str = "%explained";

/// Meaning of an auxiliary operator of the [`SupposedTask`]. An operator is identified by the name
/// of its schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OperatorMeaning {
    /// An agent offers the capability with this index.
    Suppose(usize),
    /// The fact about a new agent with this index in [`SupposedTask::placements`] is true.
    Place(usize),
    /// The part of the goal with this number is reached.
    Reach(usize),
    /// A fact in a part of the goal is reached. The first number is that of the part, the second
    /// that of the fact.
    Touch(usize, usize),
}

/// An action that agents can be supposed to offer.
pub(super) struct SupposableAction {
    /// Name of the action in the agents' own models.
    pub(super) outside: Name,
    /// Predicates of the facts that the action makes true.
    added: BTreeSet<Name>,
    /// Number of agents that act in it.
    agents: usize,
}

/// A fact about a new agent that can be supposed.
pub(super) struct SupposableFact {
    pub(super) predicate: Name,
    /// Capability that requires the fact of its new agent; `None` if a capability of another agent
    /// requires it.
    pub(super) capability: Option<usize>,
}

/// The relaxed task in which missing capabilities can be supposed, with the meanings of its
/// auxiliary operators.
pub(super) struct SupposedTask {
    pub(super) domain: Domain,
    pub(super) problem: Problem,
    pub(super) meanings: BTreeMap<Name, OperatorMeaning>,
    pub(super) capabilities: Vec<SupposableAction>,
    pub(super) placements: Vec<SupposableFact>,
    /// For each part of the goal: the ground facts that the part requires.
    pub(super) atoms: Vec<Vec<Atom>>,
    /// New agents that may be supposed, by name, with their types.
    new: BTreeMap<Name, TypeExpr>,
}

// === impl SupposedTask ===

impl SupposedTask {
    pub(super) fn new(known: ExplanationInput<'_>, parts: &[Condition]) -> SupposedTask {
        let mut guards = known.guards.clone();
        let mut domain = known.domain.clone();
        for model in known.former.iter().take(FORMER_MAX) {
            add_former_model(&mut domain, &mut guards, model);
        }
        let mut supposed = SupposedTask {
            problem: Problem { metric: None, ..known.problem.clone() },
            domain,
            meanings: BTreeMap::new(),
            capabilities: Vec::new(),
            placements: Vec::new(),
            atoms: Vec::new(),
            new: BTreeMap::new(),
        };
        let acting: Vec<(ActionSchema, ActionGuard)> = { supposed.domain.actions.iter() }
            .filter_map(|action| Some((action.clone(), guards.get(&action.name)?.clone())))
            .filter(|(action, _)| action.agent.is_some())
            .collect();
        supposed.drop_numbers();
        supposed.add_new_agents(&acting);
        for (action, guard) in &acting {
            supposed.add_offer_operator(action, guard, &guards);
        }
        supposed.add_placing_operators(&acting, &guards);
        parts.iter().for_each(|part| supposed.add_goal_operators(part));
        supposed
    }

    /// Returns the number of agents that act in the actions with one of these names, which the agents
    /// use; the greatest if they differ.
    pub(super) fn agents_of(&self, actions: &[Name]) -> usize {
        let named = self.capabilities.iter().filter(|action| actions.contains(&action.outside));
        named.map(|action| action.agents).max().unwrap_or(1)
    }

    /// Returns the actions that could make one of `atoms` true, under the agents' own names for
    /// them.
    pub(super) fn adding(&self, atoms: &[Atom]) -> Vec<Name> {
        let adds = |action: &&SupposableAction| {
            atoms.iter().any(|atom| action.added.contains(&atom.predicate))
        };
        let adding = self.capabilities.iter().filter(adds);
        let names: BTreeSet<&Name> = adding.map(|action| &action.outside).collect();
        names.into_iter().cloned().collect()
    }

    /// Returns the object as a present object or as a new agent of its type.
    pub(super) fn who(&self, object: &Name) -> SupposedObject {
        match self.new.get(object) {
            Some(ty) => SupposedObject::New(ty.clone()),
            None => SupposedObject::Here(object.clone()),
        }
    }

    fn drop_numbers(&mut self) {
        for action in &mut self.domain.actions {
            action.precondition = without_numbers(&action.precondition, true);
            action.effect = without_amounts(&action.effect);
        }
        for derived in &mut self.domain.derived {
            derived.condition = without_numbers(&derived.condition, true);
        }
        self.problem.init.retain(|element| matches!(element, InitElement::Atom(_)));
        self.problem.goal = fact(EXPLAINED, Vec::new());
        self.domain.predicates.extend([
            declaration(THERE, vec![typed("x", TypeExpr::default())]),
            declaration(NEW, vec![typed("x", TypeExpr::default())]),
            declaration(EXPLAINED, Vec::new()),
        ]);
    }

    /// Adds a new agent for every type of agent with actions. A new agent takes part in no action
    /// until an operator supposes that it is present.
    fn add_new_agents(&mut self, acting: &[(ActionSchema, ActionGuard)]) {
        let objects = self.problem.objects.iter().map(|declared| &declared.object);
        let here: Vec<Name> =
            objects.chain(&self.domain.constants).map(|object| object.name.clone()).collect();
        for object in here {
            self.problem.init.push(InitElement::Atom(atom(THERE, vec![Term::Object(object)])));
        }
        let mut kinds: Vec<TypeExpr> = Vec::new();
        for agent in acting.iter().flat_map(|(action, _)| action.agents()) {
            // An object that is declared by `either` is of both types, which no new agent has to be.
            let each: Vec<TypeExpr> = match agent.ty.alternatives.as_slice() {
                several @ [_, _, ..] => several.iter().cloned().map(TypeExpr::of).collect(),
                _ => vec![agent.ty.clone()],
            };
            for ty in each {
                if !kinds.contains(&ty) {
                    kinds.push(ty);
                }
            }
        }
        // A joint action may lack two agents of one kind.
        let types = Types::of(&self.domain);
        let may_be = |ty: &TypeExpr, action: &ActionSchema| {
            action.agents().filter(|agent| types.accepts(&agent.ty, ty)).count() > 1
        };
        let twice = |ty: &TypeExpr| acting.iter().any(|(action, _)| may_be(ty, action));
        let twice: Vec<TypeExpr> = kinds.iter().filter(|ty| twice(ty)).cloned().collect();
        for (number, ty) in kinds.into_iter().chain(twice).enumerate() {
            let name = Name::new(&format!("%new-{number}"));
            self.new.insert(name.clone(), ty.clone());
            let object = Typed { name: name.clone(), ty };
            let privacy = Privacy::Public;
            Arc::make_mut(&mut self.problem.objects).push(ObjectDeclaration { object, privacy });
            self.problem.init.push(InitElement::Atom(atom(NEW, vec![Term::Object(name)])));
        }
        let types = Types::of(&self.domain);
        let new = &self.new;
        let may_be_new = |ty: &TypeExpr| new.values().any(|kind| types.accepts(ty, kind));
        for action in &mut self.domain.actions {
            let others = action.partners.iter().chain(&action.parameters);
            let others = others.filter(|parameter| may_be_new(&parameter.ty));
            let mut wanted: Vec<Condition> =
                others.map(|parameter| fact(THERE, vec![variable(parameter)])).collect();
            wanted.push(action.precondition.clone());
            action.precondition = Condition::And(wanted);
        }
    }

    /// Adds the operator that supposes an action of an agent, and the operators for the facts about
    /// a new agent that the action requires.
    fn add_offer_operator(
        &mut self,
        action: &ActionSchema,
        guard: &ActionGuard,
        guards: &BTreeMap<Name, ActionGuard>,
    ) {
        let capability = self.capabilities.len();
        self.capabilities.push(SupposableAction {
            outside: guard.outside.clone(),
            added: action.effect.added().map(|atom| atom.predicate.clone()).collect(),
            agents: action.agents().count(),
        });
        for (position, agent) in action.agents().enumerate() {
            if action.agents().take(position).all(|other| other.ty != agent.ty) {
                self.add_offer_of_one(action, (guard, capability), agent, guards);
            }
        }
    }

    /// Adds the operators of [`SupposedTask::add_offer_operator`] for one of the agents of an action.
    fn add_offer_of_one(
        &mut self,
        action: &ActionSchema,
        (guard, capability): (&ActionGuard, usize),
        agent: &Typed,
        guards: &BTreeMap<Name, ActionGuard>,
    ) {
        let offers = atom(guard.predicate.as_str(), vec![variable(agent)]);
        let there = atom(THERE, vec![variable(agent)]);
        let effect = Effect::And(vec![Effect::Add(offers.clone()), Effect::Add(there)]);
        let name = format!("%suppose {} {}", action.name, agent.name);
        let always = Condition::always();
        self.act(&name, vec![agent.clone()], always, effect, OperatorMeaning::Suppose(capability));
        let mut facts = Vec::new();
        let others = action.all_parameters().filter(|other| other.name != agent.name);
        let mut scope: Vec<Typed> = others.cloned().collect();
        positive(&action.precondition, &mut scope, &mut |atom, scope| {
            if atom.arguments.contains(&variable(agent)) {
                facts.push((atom.clone(), scope.to_vec()));
            }
        });
        for (said, scope) in facts {
            let is_guard = guards.values().any(|guard| guard.predicate == said.predicate);
            let derives = |derived: &Derived| derived.predicate == said.predicate;
            if is_guard || said.predicate == THERE || self.domain.derived.iter().any(derives) {
                continue;
            }
            let others = scope.iter().filter(|typed| said.arguments.contains(&variable(typed)));
            let others: Vec<Typed> = others.cloned().collect();
            let mut wanted =
                vec![Condition::Atom(offers.clone()), fact(NEW, vec![variable(agent)])];
            wanted.extend(others.iter().map(|other| fact(THERE, vec![variable(other)])));
            let parameters = std::iter::once(agent.clone()).chain(others).collect();
            self.place(said, parameters, wanted, Some(capability));
        }
    }

    /// Adds operators that put a present agent without a place onto a new agent. Such an agent is,
    /// for example, a sensor after the departure of its robot.
    fn add_placing_operators(
        &mut self,
        acting: &[(ActionSchema, ActionGuard)],
        guards: &BTreeMap<Name, ActionGuard>,
    ) {
        let mut changed = BTreeSet::new();
        let added = acting.iter().flat_map(|(action, _)| action.effect.added());
        changed.extend(added.map(|atom| atom.predicate.clone()));
        changed.extend(self.domain.derived.iter().map(|derived| derived.predicate.clone()));
        changed.extend(guards.values().map(|guard| guard.predicate.clone()));
        let mut linked = BTreeSet::new();
        for (action, _) in acting {
            let Some(agent) = &action.agent else { continue };
            let others = action.partners.iter().chain(&action.parameters);
            let mut scope: Vec<Typed> = others.cloned().collect();
            let mut links = Vec::new();
            positive(&action.precondition, &mut scope, &mut |atom, scope| {
                if let [Term::Variable(first), Term::Variable(second)] = atom.arguments.as_slice()
                    && *first == agent.name
                    && let Some(other) = scope.iter().rev().find(|typed| typed.name == *second)
                {
                    links.push((atom.clone(), other.clone()));
                }
            });
            for (said, other) in links {
                if !changed.contains(&said.predicate) && linked.insert(said.predicate.clone()) {
                    self.link_by(&said, agent, other);
                }
            }
        }
    }

    fn link_by(&mut self, said: &Atom, agent: &Typed, other: Typed) {
        let types = Types::of(&self.domain);
        let taken = |object: &Name| {
            self.problem.init.iter().any(|element| match element {
                InitElement::Atom(atom) => {
                    atom.predicate == said.predicate
                        && atom.arguments.first() == Some(&Term::Object(object.clone()))
                }
                _ => false,
            })
        };
        let objects = self.problem.objects.iter().map(|declared| &declared.object);
        let free: Vec<Name> = { objects.chain(&self.domain.constants) }
            .filter(|object| !self.new.contains_key(&object.name))
            .filter(|object| types.holds(&agent.ty, &object.ty) && !taken(&object.name))
            .map(|object| object.name.clone())
            .collect();
        if free.is_empty() || !self.new.values().any(|ty| types.accepts(&other.ty, ty)) {
            return;
        }
        let unplaced = format!("%unplaced {}", said.predicate);
        let parameter = typed("x", TypeExpr::default());
        self.domain.predicates.push(declaration(&unplaced, vec![parameter]));
        for object in free {
            let fact = atom(&unplaced, vec![Term::Object(object)]);
            self.problem.init.push(InitElement::Atom(fact));
        }
        let wanted = vec![
            fact(NEW, vec![variable(&other)]),
            fact(THERE, vec![variable(&other)]),
            fact(&unplaced, vec![variable(agent)]),
        ];
        self.place(said.clone(), vec![other, agent.clone()], wanted, None);
    }

    /// Adds an operator that makes a fact about a new agent true. The new agent must be the first
    /// of `parameters`.
    fn place(
        &mut self,
        said: Atom,
        parameters: Vec<Typed>,
        wanted: Vec<Condition>,
        capability: Option<usize>,
    ) {
        let number = self.placements.len();
        self.placements.push(SupposableFact { predicate: said.predicate.clone(), capability });
        let (name, effect) = (format!("%place {number}"), Effect::Add(said));
        self.act(&name, parameters, Condition::And(wanted), effect, OperatorMeaning::Place(number));
    }

    /// Adds the operators for a part of the goal and for the facts in it.
    fn add_goal_operators(&mut self, part: &Condition) {
        let number = self.atoms.len();
        let explained = || Effect::Add(atom(EXPLAINED, Vec::new()));
        let wanted = without_numbers(part, true);
        let name = format!("%reach {number}");
        self.act(&name, Vec::new(), wanted, explained(), OperatorMeaning::Reach(number));
        let mut atoms: Vec<Atom> = Vec::new();
        positive(part, &mut Vec::new(), &mut |atom, _| {
            let is_ground = atom.arguments.iter().all(|term| matches!(term, Term::Object(_)));
            if is_ground && !atoms.contains(atom) {
                atoms.push(atom.clone());
            }
        });
        for (index, atom) in atoms.iter().enumerate() {
            let (name, wanted) =
                (format!("%touch {number} {index}"), Condition::Atom(atom.clone()));
            self.act(&name, Vec::new(), wanted, explained(), OperatorMeaning::Touch(number, index));
        }
        self.atoms.push(atoms);
    }

    fn act(
        &mut self,
        name: &str,
        parameters: Vec<Typed>,
        precondition: Condition,
        effect: Effect,
        meaning: OperatorMeaning,
    ) {
        let (name, span) = (Name::new(name), Span::default());
        self.meanings.insert(name.clone(), meaning);
        let (agent, partners, observe) = (None, Vec::new(), Vec::new());
        let action =
            ActionSchema { name, agent, partners, parameters, precondition, effect, observe, span };
        self.domain.actions.push(action);
    }
}

/// Adds the actions of a former agent's model that are compatible with the present domain.
fn add_former_model(
    domain: &mut Domain,
    guards: &mut BTreeMap<Name, ActionGuard>,
    model: &ActionModel,
) {
    let mut with = domain.clone();
    let types = Types::of(domain);
    let new = model.types.iter().filter(|typed| !types.contains(typed.name.as_str()));
    with.types.extend(new.cloned());
    let news = model.predicates.iter();
    let news = news.filter(|new| domain.predicates.iter().all(|known| known.name != new.name));
    let news: Vec<PredicateDeclaration> = news.cloned().collect();
    let axioms = model.derived.iter();
    let axioms = axioms.filter(|axiom| news.iter().any(|new| new.name == axiom.predicate));
    with.derived.extend(axioms.cloned());
    with.predicates.extend(news);
    let functions = model.functions.iter();
    let functions =
        functions.filter(|new| domain.functions.iter().all(|known| known.name != new.name));
    with.functions.extend(functions.cloned());
    for action in &model.actions {
        let Some(agent) = &action.agent else { continue };
        let name = Name::new(&format!("%former {} {}", guards.len(), action.name));
        let predicate = Name::new(&format!("%offers {}", guards.len()));
        with.predicates.push(declaration(predicate.as_str(), vec![agent.clone()]));
        let offers = fact(predicate.as_str(), vec![variable(agent)]);
        let precondition = Condition::And(vec![offers, action.precondition.clone()]);
        let observe = Vec::new();
        with.actions.push(ActionSchema {
            name: name.clone(),
            precondition,
            observe,
            ..action.clone()
        });
        let outside = action.name.clone();
        guards.insert(name, ActionGuard { outside, predicate });
    }
    if !pddl::check_domain(&with).iter().any(pddl::Diagnostic::is_error) {
        *domain = with;
    }
}

/// Calls `visit` for the atoms that a condition requires to be true, with the quantified variables
/// around each atom. Conditions other than conjunctions, disjunctions, `exists` and atoms are
/// ignored.
fn positive(condition: &Condition, scope: &mut Vec<Typed>, visit: &mut dyn FnMut(&Atom, &[Typed])) {
    match condition {
        Condition::Atom(atom) => visit(atom, scope),
        Condition::And(parts) | Condition::Or(parts) => {
            parts.iter().for_each(|part| positive(part, scope, visit));
        }
        Condition::Exists(variables, inner) => {
            let outer = scope.len();
            scope.extend(variables.iter().cloned());
            positive(inner, scope, visit);
            scope.truncate(outer);
        }
        Condition::Not(_)
        | Condition::Imply(..)
        | Condition::Forall(..)
        | Condition::Equal(..)
        | Condition::Compare(_) => (),
    }
}

/// Whether a condition contains a comparison of numbers.
pub(super) fn has_comparison(condition: &Condition) -> bool {
    condition.parts().any(|part| matches!(part, Condition::Compare(_)))
}

/// Replaces each comparison by the truth value that is easier to satisfy.
fn without_numbers(condition: &Condition, positive: bool) -> Condition {
    let all = |parts: &[Condition]| {
        parts.iter().map(|part| without_numbers(part, positive)).collect::<Vec<_>>()
    };
    match condition {
        Condition::Compare(_) if positive => Condition::always(),
        Condition::Compare(_) => Condition::Or(Vec::new()),
        Condition::Atom(_) | Condition::Equal(..) => condition.clone(),
        Condition::Not(inner) => Condition::Not(Box::new(without_numbers(inner, !positive))),
        Condition::And(parts) => Condition::And(all(parts)),
        Condition::Or(parts) => Condition::Or(all(parts)),
        Condition::Imply(left, right) => Condition::Imply(
            Box::new(without_numbers(left, !positive)),
            Box::new(without_numbers(right, positive)),
        ),
        Condition::Exists(variables, inner) => {
            Condition::Exists(variables.clone(), Box::new(without_numbers(inner, positive)))
        }
        Condition::Forall(variables, inner) => {
            Condition::Forall(variables.clone(), Box::new(without_numbers(inner, positive)))
        }
    }
}

fn without_amounts(effect: &Effect) -> Effect {
    match effect {
        Effect::Assign(_) => Effect::nothing(),
        Effect::Add(_) | Effect::Delete(_) => effect.clone(),
        Effect::And(parts) => Effect::And(parts.iter().map(without_amounts).collect()),
        Effect::Forall(variables, inner) => {
            Effect::Forall(variables.clone(), Box::new(without_amounts(inner)))
        }
        Effect::When(condition, inner) => Effect::When(
            Box::new(without_numbers(condition, true)),
            Box::new(without_amounts(inner)),
        ),
    }
}

fn atom(predicate: &str, arguments: Vec<Term>) -> Atom {
    Atom { predicate: Name::new(predicate), arguments, span: Span::default() }
}

fn fact(predicate: &str, arguments: Vec<Term>) -> Condition {
    Condition::Atom(atom(predicate, arguments))
}

fn variable(typed: &Typed) -> Term {
    Term::Variable(typed.name.clone())
}

fn typed(name: &str, ty: TypeExpr) -> Typed {
    Typed { name: Name::new(name), ty }
}

fn declaration(name: &str, parameters: Vec<Typed>) -> PredicateDeclaration {
    PredicateDeclaration { name: Name::new(name), parameters, privacy: Privacy::Public }
}
