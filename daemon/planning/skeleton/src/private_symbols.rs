//! Decides which occurrences of predicates in an agent's task are private.
//!
//! A fact is private if its predicate is declared `:private`, or if one of its arguments is a private
//! object (the rule of the CoDMAP competition). In action schemas, an argument is private if all
//! objects of its type are private to the agent.

use std::collections::{BTreeMap, BTreeSet};

use pddl::factored::AgentFiles;
use pddl::{
    ActionSchema, Atom, Condition, Effect, InitElement, Name, Privacy, Problem, TOTAL_COST, Term,
    TypeExpr, Typed, Types,
};

use crate::terms::{UsedTerms, used_by};

/// A private predicate; for a predicate that is public with other arguments, with the argument
/// positions that have private objects.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PrivateSymbol {
    pub(crate) predicate: Name,
    /// Positions of the private arguments; empty if the predicate is declared `:private`.
    pub(crate) positions: Vec<usize>,
}

/// How many of the objects that a variable can stand for are private.
#[derive(Clone, Copy, PartialEq, Eq)]
enum TypePrivacy {
    Private,
    Public,
    Mixed,
}

/// The private symbols of one agent's task.
#[derive(Clone)]
pub(crate) struct PrivateSymbols {
    types: Types,
    objects: BTreeMap<Name, Typed>,
    /// The private objects, in the order of their declarations.
    in_order: Vec<Typed>,
    private_objects: BTreeSet<Name>,
    private_predicates: BTreeSet<Name>,
    private_functions: BTreeSet<Name>,
    /// Public objects that the task does not declare.
    further_objects: BTreeSet<Name>,
    /// Argument positions at which a variable stands for private and for public objects. There, a
    /// private object does not make a fact private.
    mixed: BTreeSet<(Name, usize)>,
}

/// The variables in scope, with their types.
pub(crate) type Scope = BTreeMap<Name, TypeExpr>;

// === impl PrivateSymbols ===

impl PrivateSymbols {
    pub(crate) fn of(task: &AgentFiles) -> PrivateSymbols {
        let AgentFiles { domain, problem, .. } = task;
        let declared = problem.objects.iter();
        let private = declared.clone().filter(|it| it.privacy != Privacy::Public);
        let in_order: Vec<Typed> = private.map(|it| it.object.clone()).collect();
        let private_objects = in_order.iter().map(|object| object.name.clone()).collect();
        let objects = domain.constants.iter().chain(declared.map(|it| &it.object));
        let predicates = domain.predicates.iter().filter(|it| it.privacy != Privacy::Public);
        let functions = domain.functions.iter().filter(|it| it.privacy != Privacy::Public);
        let mut symbols = PrivateSymbols {
            types: Types::of(domain),
            objects: objects.map(|object| (object.name.clone(), object.clone())).collect(),
            in_order,
            private_objects,
            private_predicates: predicates.map(|it| it.name.clone()).collect(),
            private_functions: functions.map(|it| it.name.clone()).collect(),
            further_objects: BTreeSet::new(),
            mixed: BTreeSet::new(),
        };
        let mut mixed = BTreeSet::new();
        let mut note = |atom: &Atom, scope: &Scope| {
            let is_mixed =
                |argument: &&Term| symbols.privacy_of(argument, scope) == TypePrivacy::Mixed;
            let places = atom.arguments.iter().enumerate();
            let places = places.filter(|(_, argument)| is_mixed(argument));
            mixed.extend(places.map(|(place, _)| (atom.predicate.clone(), place)));
        };
        domain.actions.iter().for_each(|action| atoms_of(action, &mut note));
        atoms(&problem.goal, &mut Scope::new(), &mut note);
        symbols.mixed = mixed;
        symbols
    }

    /// Returns the same symbols, with public objects that the task does not declare. They do not
    /// change what is private.
    pub(crate) fn with_objects(&self, objects: impl Iterator<Item = Name>) -> PrivateSymbols {
        PrivateSymbols { further_objects: objects.collect(), ..self.clone() }
    }

    /// Whether the task has anything private.
    pub(crate) fn are_any(&self) -> bool {
        !(self.private_objects.is_empty()
            && self.private_predicates.is_empty()
            && self.private_functions.is_empty())
    }

    /// Whether an element of a state is private or names something private.
    pub(crate) fn concern(&self, element: &InitElement) -> bool {
        let (name, arguments) = match (atom_of(element), element) {
            (Some(atom), _) => (&atom.predicate, &atom.arguments),
            (None, InitElement::Assign(fluent, _)) => (&fluent.function, &fluent.arguments),
            // A timed assignment, which agents do not report.
            (None, _) => return true,
        };
        self.private_predicates.contains(name)
            || self.private_functions.contains(name)
            || arguments.iter().any(|argument| self.is_private_object(argument.name()))
    }

    /// Whether a condition is about something private.
    pub(crate) fn concern_condition(&self, condition: &Condition) -> bool {
        let used = used_by(condition);
        let mut is_private = used.functions.iter().any(|name| self.is_private_function(name))
            || used.objects.iter().any(|name| self.is_private_object(name));
        atoms(condition, &mut Scope::new(), &mut |atom, scope| {
            is_private |= self.symbol(atom, scope).is_some();
        });
        is_private
    }

    pub(crate) fn is_private_predicate(&self, name: &Name) -> bool {
        self.private_predicates.contains(name)
    }

    pub(crate) fn is_private_object(&self, name: &Name) -> bool {
        self.private_objects.contains(name)
    }

    pub(crate) fn is_private_function(&self, name: &Name) -> bool {
        self.private_functions.contains(name)
    }

    pub(crate) fn knows_object(&self, name: &Name) -> bool {
        self.objects.contains_key(name) || self.further_objects.contains(name)
    }

    /// Returns the objects that are private, in the order of their declarations.
    pub(crate) fn private_objects(&self) -> &[Typed] {
        &self.in_order
    }

    /// Whether an object can be of a type.
    pub(crate) fn accepts(&self, expected: &TypeExpr, object: &Typed) -> bool {
        self.types.holds(expected, &object.ty)
    }

    /// Returns the private symbol of an atom; `None` if the atom is public.
    pub(crate) fn symbol(&self, atom: &Atom, scope: &Scope) -> Option<PrivateSymbol> {
        let predicate = atom.predicate.clone();
        if self.private_predicates.contains(&predicate) {
            return Some(PrivateSymbol { predicate, positions: Vec::new() });
        }
        let is_private = |(place, argument): &(usize, &Term)| {
            !self.mixed.contains(&(predicate.clone(), *place))
                && self.privacy_of(argument, scope) == TypePrivacy::Private
        };
        let places = atom.arguments.iter().enumerate().filter(is_private);
        let positions: Vec<usize> = places.map(|(place, _)| place).collect();
        (!positions.is_empty()).then_some(PrivateSymbol { predicate, positions })
    }

    /// Returns the private objects that a variable of this type can stand for; `None` if it can stand
    /// for public ones, or for none that is private.
    pub(crate) fn private_choices(&self, ty: &TypeExpr) -> Option<Vec<Name>> {
        let fitting: Vec<&Typed> =
            self.objects.values().filter(|object| self.accepts(ty, object)).collect();
        let are_private = fitting.iter().all(|object| self.is_private_object(&object.name));
        let names = || fitting.iter().map(|object| object.name.clone()).collect();
        (are_private && !fitting.is_empty()).then(names)
    }

    fn privacy_of(&self, argument: &Term, scope: &Scope) -> TypePrivacy {
        let all_or_none = |is_private: bool| match is_private {
            true => TypePrivacy::Private,
            false => TypePrivacy::Public,
        };
        let ty = match argument {
            Term::Object(name) => return all_or_none(self.is_private_object(name)),
            Term::Variable(name) => scope.get(name).cloned().unwrap_or_default(),
        };
        let fitting = self.objects.values().filter(|object| self.accepts(&ty, object));
        let (private, public): (Vec<&Typed>, Vec<&Typed>) =
            fitting.partition(|object| self.is_private_object(&object.name));
        match (private.is_empty(), public.is_empty()) {
            (false, true) => TypePrivacy::Private,
            (false, false) => TypePrivacy::Mixed,
            (true, _) => TypePrivacy::Public,
        }
    }

    /// Whether what an action observes is public.
    pub(crate) fn is_public_observation(&self, observed: &Atom, scope: &Scope) -> bool {
        !self.is_private_function(&observed.predicate) && self.symbol(observed, scope).is_none()
    }

    /// Returns the private symbols of the facts that an action adds or deletes, and whether the
    /// action changes or observes something public.
    pub(crate) fn changed_by(&self, action: &ActionSchema) -> (BTreeSet<PrivateSymbol>, bool) {
        let scope = scope_of(action);
        let is_seen = |observed: &Atom| self.is_public_observation(observed, &scope);
        let (mut changed, mut is_public) = (BTreeSet::new(), action.observe.iter().any(is_seen));
        effects(&action.effect, &mut scope_of(action), &mut |literal, scope| match literal {
            EffectLiteral::Atom(atom) => match self.symbol(atom, scope) {
                Some(symbol) => {
                    changed.insert(symbol);
                }
                None => is_public = true,
            },
            EffectLiteral::Function(name) => {
                is_public |= !self.is_private_function(name) && *name != *TOTAL_COST;
            }
            EffectLiteral::Condition(_) => (),
        });
        (changed, is_public)
    }

    /// Returns the private symbols of the precondition of an action.
    pub(crate) fn required_by(&self, action: &ActionSchema) -> BTreeSet<PrivateSymbol> {
        let mut required = BTreeSet::new();
        atoms(&action.precondition, &mut scope_of(action), &mut |atom, scope| {
            required.extend(self.symbol(atom, scope));
        });
        required
    }

    /// Returns the private symbols in conditions of conditional effects.
    pub(crate) fn conditions_of_effects(&self, action: &ActionSchema) -> BTreeSet<PrivateSymbol> {
        let mut found = BTreeSet::new();
        effects(&action.effect, &mut scope_of(action), &mut |literal, scope| {
            if let EffectLiteral::Condition(condition) = literal {
                atoms(condition, &mut scope.clone(), &mut |atom, scope| {
                    found.extend(self.symbol(atom, scope));
                });
            }
        });
        found
    }

    /// Whether an action changes something public in a way that depends on something private: the
    /// skeleton could then not say what it changes. Costs of plans may depend on private functions.
    pub(crate) fn hides_a_public_effect(&self, action: &ActionSchema) -> bool {
        self.hides(&action.effect, &scope_of(action), false)
    }

    fn hides(&self, effect: &Effect, scope: &Scope, is_under_secret: bool) -> bool {
        match effect {
            Effect::And(parts) => parts.iter().any(|it| self.hides(it, scope, is_under_secret)),
            Effect::Add(atom) | Effect::Delete(atom) => {
                is_under_secret && self.symbol(atom, scope).is_none()
            }
            Effect::Assign(assign) => {
                let name = &assign.fluent.function;
                let mut value = UsedTerms::default();
                value.expression(&assign.value);
                let is_secret = value.functions.iter().any(|it| self.is_private_function(it));
                let is_public = !self.is_private_function(name) && *name != *TOTAL_COST;
                is_public && (is_secret || is_under_secret)
            }
            Effect::Forall(variables, inner) => {
                let mut wider = scope.clone();
                wider.extend(variables.iter().map(|it| (it.name.clone(), it.ty.clone())));
                self.hides(inner, &wider, is_under_secret)
            }
            Effect::When(condition, inner) => {
                let mut is_secret = used_by(condition)
                    .functions
                    .iter()
                    .any(|function| self.is_private_function(function));
                atoms(condition, &mut scope.clone(), &mut |atom, scope| {
                    is_secret |= self.symbol(atom, scope).is_some();
                });
                self.hides(inner, scope, is_under_secret || is_secret)
            }
        }
    }

    /// Returns the private symbols of the goal.
    pub(crate) fn wanted(&self, problem: &Problem) -> BTreeSet<PrivateSymbol> {
        let mut found = BTreeSet::new();
        atoms(&problem.goal, &mut Scope::new(), &mut |atom, scope| {
            found.extend(self.symbol(atom, scope));
        });
        found
    }
}

/// A part of an effect.
pub(crate) enum EffectLiteral<'e> {
    /// An atom that is added or deleted.
    Atom(&'e Atom),
    /// A function that is changed.
    Function(&'e Name),
    /// The condition of a conditional effect.
    Condition(&'e Condition),
}

/// Returns the parameters of an action, with their types.
pub(crate) fn scope_of(action: &ActionSchema) -> Scope {
    action.all_parameters().map(|typed| (typed.name.clone(), typed.ty.clone())).collect()
}

/// Calls `visit` with each atom of an action, and the variables in scope.
fn atoms_of(action: &ActionSchema, visit: &mut dyn FnMut(&Atom, &Scope)) {
    atoms(&action.precondition, &mut scope_of(action), visit);
    effects(&action.effect, &mut scope_of(action), &mut |literal, scope| match literal {
        EffectLiteral::Atom(atom) => visit(atom, scope),
        EffectLiteral::Condition(condition) => atoms(condition, &mut scope.clone(), visit),
        EffectLiteral::Function(_) => (),
    });
}

/// Calls `visit` with each atom of a condition, and the variables in scope.
pub(crate) fn atoms(
    condition: &Condition,
    scope: &mut Scope,
    visit: &mut dyn FnMut(&Atom, &Scope),
) {
    match condition {
        Condition::Atom(atom) => visit(atom, scope),
        Condition::Not(inner) => atoms(inner, scope, visit),
        Condition::And(parts) | Condition::Or(parts) => {
            parts.iter().for_each(|part| atoms(part, scope, visit));
        }
        Condition::Imply(left, right) => {
            atoms(left, scope, visit);
            atoms(right, scope, visit);
        }
        Condition::Exists(variables, inner) | Condition::Forall(variables, inner) => {
            within(scope, variables, |scope| atoms(inner, scope, visit));
        }
        Condition::Equal(..) | Condition::Compare(_) => (),
    }
}

/// Calls `visit` with each part of an effect, and the variables in scope.
pub(crate) fn effects(
    effect: &Effect,
    scope: &mut Scope,
    visit: &mut dyn FnMut(EffectLiteral<'_>, &Scope),
) {
    match effect {
        Effect::And(parts) => parts.iter().for_each(|part| effects(part, scope, visit)),
        Effect::Add(atom) | Effect::Delete(atom) => visit(EffectLiteral::Atom(atom), scope),
        Effect::Assign(assign) => visit(EffectLiteral::Function(&assign.fluent.function), scope),
        Effect::Forall(variables, inner) => {
            within(scope, variables, |scope| effects(inner, scope, visit));
        }
        Effect::When(condition, inner) => {
            visit(EffectLiteral::Condition(condition), scope);
            effects(inner, scope, visit);
        }
    }
}

/// Calls `inside` with the variables added to the scope.
fn within(scope: &mut Scope, variables: &[Typed], inside: impl FnOnce(&mut Scope)) {
    let mut wider = scope.clone();
    wider.extend(variables.iter().map(|typed| (typed.name.clone(), typed.ty.clone())));
    inside(&mut wider);
}

/// Returns the atom of an element of an initial state; `None` if it is about a function.
pub(crate) fn atom_of(element: &InitElement) -> Option<&Atom> {
    match element {
        InitElement::Atom(atom) | InitElement::Not(atom) | InitElement::Unknown(atom) => Some(atom),
        InitElement::Assign(..) => None,
        InitElement::At(_, inner) => atom_of(inner),
    }
}
