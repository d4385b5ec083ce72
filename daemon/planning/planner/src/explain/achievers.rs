//! What could make a fact true: actions and axioms, and the conditions that they need for it.
//!
//! Used by `plain`, which explains why a fact is never made true.

use std::collections::BTreeSet;

use pddl::{Atom, Condition, Derived, Effect, Name, Term, TypeExpr, Typed};

use super::plain::UnsolvabilityExplainer;
use crate::validate::bindings::Bindings;

/// An action or an axiom that could make a fact true.
pub(super) struct Achiever {
    pub(super) name: Name,
    pub(super) is_axiom: bool,
    /// Conjuncts of the achiever's conditions, with the objects of the fact. Other variables are
    /// existentially quantified.
    pub(super) needs: Vec<Condition>,
    /// Position in `needs` of the first condition of the effect; those before it are of the action.
    pub(super) effect_needs_start: usize,
    /// Conjunction of all conditions of the achiever, for the same objects.
    pub(super) whole: Condition,
    /// A parameter of the achiever without an object of its type; `None` if every parameter has
    /// one.
    pub(super) vacant: Option<Typed>,
}

/// A fact that is to be true or false, of any objects that its variables stand for.
#[derive(Clone)]
pub(super) struct Literal<'c> {
    pub(super) atom: &'c Atom,
    pub(super) is_positive: bool,
    /// Variables of the atom that are existentially quantified, the outermost first.
    pub(super) variables: Vec<&'c Typed>,
}

/// Replacements of variables: each entry is a variable and the term that replaces it.
type TermBindings = Vec<(Name, Term)>;

/// Conditions and variables around a part of an effect.
#[derive(Clone, Default)]
struct EffectScope<'e> {
    /// Conditions of the `when`s around the part.
    conditions: Vec<&'e Condition>,
    /// Parameters of the action, and variables of the `forall`s around the part.
    variables: Vec<&'e Typed>,
}

// === impl Achiever ===

impl Achiever {
    /// Says what the achiever does: “`open` makes it true”.
    pub(super) fn what(&self, subject: &str) -> String {
        match self.is_axiom {
            true => format!("an axiom derives {subject}"),
            false => format!("`{}` makes {subject} true", self.name),
        }
    }
}

// === impl Literal ===

impl<'c> Literal<'c> {
    /// Returns the literal of an atom, of its negation, or of an `exists` over one of these; `None`
    /// for other conditions.
    pub(super) fn of(condition: &'c Condition) -> Option<Literal<'c>> {
        let literal =
            |atom, is_positive| Some(Literal { atom, is_positive, variables: Vec::new() });
        match condition {
            Condition::Atom(atom) => literal(atom, true),
            Condition::Not(inner) => match &**inner {
                Condition::Atom(atom) => literal(atom, false),
                _ => None,
            },
            Condition::Exists(variables, inner) => {
                let mut literal = Literal::of(inner)?;
                literal.variables.splice(0..0, variables);
                Some(literal)
            }
            _ => None,
        }
    }

    /// Returns the type of the variable with this name; `None` if it is not quantified here.
    fn type_of(&self, variable: &Name) -> Option<&'c TypeExpr> {
        let mut inner = self.variables.iter().rev();
        inner.find(|one| one.name == *variable).map(|one| &one.ty)
    }

    /// Returns the types of the variables of the atom, each once, as text.
    pub(super) fn types(&self) -> Vec<String> {
        let mut types: Vec<String> = Vec::new();
        for term in &self.atom.arguments {
            let Term::Variable(name) = term else { continue };
            let ty = self.type_of(name).filter(|ty| !ty.is_object()).map(|ty| format!("`{ty}`"));
            types.extend(ty.filter(|ty| !types.contains(ty)));
        }
        types
    }
}

// === impl UnsolvabilityExplainer ===

impl UnsolvabilityExplainer<'_> {
    /// Returns every action and axiom with an effect that unifies with the literal. Axioms make
    /// nothing false.
    pub(super) fn achievers(&self, literal: &Literal<'_>) -> Vec<Achiever> {
        let mut achievers: Vec<Achiever> = Vec::new();
        for action in &self.domain.actions {
            let mut scope = EffectScope {
                conditions: Vec::new(),
                variables: action.all_parameters().collect(),
            };
            changed(&action.effect, literal.is_positive, &mut scope, &mut |effect, scope| {
                if effect.predicate != literal.atom.predicate {
                    return;
                }
                let Some((bindings, parameters)) =
                    self.unify(&effect.arguments, literal, &scope.variables)
                else {
                    return;
                };
                let own = std::iter::once(&action.precondition);
                let all = own.clone().chain(scope.conditions.iter().copied());
                achievers.push(Achiever {
                    name: action.name.clone(),
                    is_axiom: false,
                    whole: whole(all.clone(), &bindings, &parameters),
                    needs: needs(all, &bindings, &parameters),
                    effect_needs_start: needs(own, &bindings, &parameters).len(),
                    vacant: self.vacant(&bindings, &parameters),
                });
            });
        }
        if literal.is_positive {
            let axioms = self.domain.derived.iter();
            achievers.extend(axioms.filter_map(|axiom| self.axiom(axiom, literal)));
        }
        achievers
    }

    fn axiom(&self, axiom: &Derived, literal: &Literal<'_>) -> Option<Achiever> {
        let parameters: Vec<&Typed> = axiom.parameters.iter().collect();
        let terms: Vec<Term> =
            parameters.iter().map(|one| Term::Variable(one.name.clone())).collect();
        if axiom.predicate != literal.atom.predicate {
            return None;
        }
        let (bindings, parameters) = self.unify(&terms, literal, &parameters)?;
        let body = std::iter::once(&axiom.condition);
        let needs = needs(body.clone(), &bindings, &parameters);
        Some(Achiever {
            name: axiom.predicate.clone(),
            is_axiom: true,
            effect_needs_start: needs.len(),
            needs,
            whole: whole(body, &bindings, &parameters),
            vacant: self.vacant(&bindings, &parameters),
        })
    }

    /// Returns what must hold so that no axiom derives a fact; `None` if the literal is no negated
    /// fact of this kind, or has variables.
    pub(super) fn negated_axioms(&self, literal: &Literal<'_>) -> Option<Vec<Condition>> {
        if literal.is_positive || !literal.variables.is_empty() {
            return None;
        }
        let mut parts = Vec::new();
        let named = |axiom: &&Derived| axiom.predicate == literal.atom.predicate;
        for axiom in self.domain.derived.iter().filter(named) {
            let bound = axiom.parameters.iter().map(|one| one.name.clone());
            let bindings = bound.zip(literal.atom.arguments.iter().cloned()).collect();
            let negated = simplified(&negated(&substituted(&axiom.condition, &bindings)));
            match negated {
                Condition::And(all) => parts.extend(all),
                other => parts.push(other),
            }
        }
        (!parts.is_empty()).then_some(parts)
    }

    pub(super) fn is_derived(&self, literal: &Literal<'_>) -> bool {
        self.domain.derived.iter().any(|axiom| axiom.predicate == literal.atom.predicate)
    }

    /// Whether an action or an axiom makes the predicate of a literal true, or false, of any objects.
    pub(super) fn is_changed(&self, literal: &Literal<'_>) -> bool {
        let name = &literal.atom.predicate;
        let mut is_changed = self.is_derived(literal);
        for action in &self.domain.actions {
            let mut scope = EffectScope::default();
            changed(&action.effect, literal.is_positive, &mut scope, &mut |other, _| {
                is_changed |= other.predicate == *name;
            });
        }
        is_changed
    }

    /// Returns the bindings of `parameters` that make an effect with the arguments `own` equal to
    /// the atom of a literal, and the parameters with the types that they have then; `None` if there
    /// are no such bindings.
    fn unify(
        &self,
        own: &[Term],
        literal: &Literal<'_>,
        parameters: &[&Typed],
    ) -> Option<(TermBindings, Vec<Typed>)> {
        let wanted = &literal.atom.arguments;
        if own.len() != wanted.len() {
            return None;
        }
        let mut parameters: Vec<Typed> = parameters.iter().map(|one| (*one).clone()).collect();
        let mut bindings: TermBindings = Vec::new();
        for (own, wanted) in own.iter().zip(wanted) {
            match (own, wanted) {
                (Term::Object(own), Term::Object(wanted)) if own != wanted => return None,
                (Term::Object(_), Term::Object(_)) => (),
                (Term::Variable(name), Term::Object(object)) => {
                    let known = bindings.iter().find(|(bound, _)| bound == name);
                    if known.is_some_and(|(_, term)| term != wanted) {
                        return None;
                    }
                    let parameter = parameters.iter().find(|one| one.name == *name);
                    if parameter.is_some_and(|one| !self.is_of(object, &one.ty)) {
                        return None;
                    }
                    bindings.push((name.clone(), wanted.clone()));
                }
                (Term::Object(own), Term::Variable(variable)) => {
                    let ty = literal.type_of(variable);
                    if ty.is_some_and(|ty| !self.is_of(own, ty)) {
                        return None;
                    }
                }
                (Term::Variable(name), Term::Variable(variable)) => {
                    let parameter = parameters.iter_mut().find(|one| one.name == *name);
                    if let (Some(parameter), Some(ty)) = (parameter, literal.type_of(variable)) {
                        self.narrow(parameter, ty)?;
                    }
                }
            }
        }
        Some((bindings, parameters))
    }

    /// Gives a parameter the type of the variable that it has to stand for, if all objects of that
    /// type fit the parameter. Returns `None` if both have objects, but none in common.
    fn narrow(&self, parameter: &mut Typed, ty: &TypeExpr) -> Option<()> {
        let members = |ty: &TypeExpr| -> BTreeSet<&Name> {
            let of = self.objects().filter(|one| self.types.holds(ty, &one.ty));
            of.map(|one| &one.name).collect()
        };
        let (wanted, own) = (members(ty), members(&parameter.ty));
        let fitting = wanted.intersection(&own).count();
        if fitting == 0 && !own.is_empty() && !wanted.is_empty() {
            return None;
        }
        if fitting == wanted.len() && fitting > 0 {
            parameter.ty = ty.clone();
        }
        Some(())
    }

    fn objects(&self) -> impl Iterator<Item = &Typed> {
        let declared = self.problem.objects.iter().map(|declaration| &declaration.object);
        self.domain.constants.iter().chain(declared)
    }

    fn is_of(&self, object: &Name, ty: &TypeExpr) -> bool {
        self.objects().any(|one| one.name == *object && self.types.holds(ty, &one.ty))
    }

    /// Returns the first unbound parameter without an object of its type; `None` if there is none.
    fn vacant(&self, bindings: &TermBindings, parameters: &[Typed]) -> Option<Typed> {
        let is_empty =
            |one: &&Typed| !self.objects().any(|object| self.types.holds(&one.ty, &object.ty));
        parameters.iter().filter(|one| !is_bound(bindings, one)).find(is_empty).cloned()
    }
}

/// Calls `visit` for every atom that an effect adds, or deletes if `is_positive` is false, with the
/// conditions and variables around it.
fn changed<'e>(
    effect: &'e Effect,
    is_positive: bool,
    scope: &mut EffectScope<'e>,
    visit: &mut dyn FnMut(&'e Atom, &EffectScope<'e>),
) {
    match effect {
        Effect::And(parts) => {
            parts.iter().for_each(|part| changed(part, is_positive, scope, visit));
        }
        Effect::Add(atom) if is_positive => visit(atom, scope),
        Effect::Delete(atom) if !is_positive => visit(atom, scope),
        Effect::Add(_) | Effect::Delete(_) | Effect::Assign(_) => (),
        Effect::Forall(variables, inner) => {
            let is_known = |one: &Typed| scope.variables.iter().any(|known| known.name == one.name);
            let mut inside = scope.clone();
            match variables.iter().any(is_known) {
                // The variables would be confused with others of the same name, so conditions that
                // use them are left out.
                true => inside.conditions.clear(),
                false => inside.variables.extend(variables),
            }
            let is_confused = inside.variables.len() == scope.variables.len();
            changed(inner, is_positive, &mut inside, &mut |atom, within| match is_confused {
                true => visit(atom, scope),
                false => visit(atom, within),
            });
        }
        Effect::When(condition, inner) => {
            scope.conditions.push(condition);
            changed(inner, is_positive, scope, visit);
            scope.conditions.pop();
        }
    }
}

fn is_bound(bindings: &TermBindings, variable: &Typed) -> bool {
    bindings.iter().any(|(name, _)| *name == variable.name)
}

/// Returns the conjuncts of conditions. Bound variables are replaced by their terms, and free
/// variables are quantified.
fn needs<'c>(
    conditions: impl Iterator<Item = &'c Condition>,
    bindings: &TermBindings,
    parameters: &[Typed],
) -> Vec<Condition> {
    let mut parts = Vec::new();
    conditions.for_each(|condition| flatten(condition, &mut parts));
    let free: Vec<&Typed> = parameters.iter().filter(|one| !is_bound(bindings, one)).collect();
    let mut needs: Vec<Condition> = Vec::new();
    for part in parts {
        let need = quantified(&free, substituted(part, bindings));
        if !needs.contains(&need) {
            needs.push(need);
        }
    }
    needs
}

/// Quantifies the variables that a condition contains.
fn quantified(variables: &[&Typed], condition: Condition) -> Condition {
    let mentioned = variables.iter().filter(|one| mentions(&condition, &one.name));
    let mentioned: Vec<Typed> = mentioned.map(|one| (*one).clone()).collect();
    match mentioned.is_empty() {
        true => condition,
        false => Condition::Exists(mentioned, Box::new(condition)),
    }
}

fn flatten<'c>(condition: &'c Condition, parts: &mut Vec<&'c Condition>) {
    match condition {
        Condition::And(all) => all.iter().for_each(|part| flatten(part, parts)),
        other => parts.push(other),
    }
}

fn substituted(condition: &Condition, bindings: &TermBindings) -> Condition {
    let mut names = Bindings::default();
    for (name, term) in bindings {
        names.bind(name, term.name().clone());
    }
    names.substitute(condition)
}

/// Whether a condition contains a variable. If so, substituting the variable changes the condition.
fn mentions(condition: &Condition, variable: &Name) -> bool {
    let mut names = Bindings::default();
    names.bind(variable, Name::new(""));
    names.substitute(condition) != *condition
}

/// Returns the conjunction of all conditions, so that they are checked for the same objects.
fn whole<'c>(
    conditions: impl Iterator<Item = &'c Condition>,
    bindings: &TermBindings,
    parameters: &[Typed],
) -> Condition {
    let all = conditions.map(|condition| substituted(condition, bindings)).collect();
    let is_free = |one: &&Typed| !is_bound(bindings, one);
    let free: Vec<Typed> = parameters.iter().filter(is_free).cloned().collect();
    match free.is_empty() {
        true => Condition::And(all),
        false => Condition::Exists(free, Box::new(Condition::And(all))),
    }
}

/// Returns the conditions that a conjunction, or an `exists` over one, needs each; `None` for other
/// conditions.
pub(super) fn conjuncts_of(condition: &Condition) -> Option<Vec<Condition>> {
    match condition {
        Condition::And(all) if !all.is_empty() => Some(all.clone()),
        Condition::Exists(variables, inner) => match &**inner {
            Condition::And(all) if !all.is_empty() => {
                let variables: Vec<&Typed> = variables.iter().collect();
                Some(all.iter().map(|part| quantified(&variables, part.clone())).collect())
            }
            _ => None,
        },
        _ => None,
    }
}

/// Returns an equal condition in which the outermost operator is no implication, and no negation of
/// anything but a fact or a comparison.
pub(super) fn simplified(condition: &Condition) -> Condition {
    let each = |parts: &[Condition]| parts.iter().map(negated).collect::<Vec<_>>();
    match condition {
        Condition::And(parts) | Condition::Or(parts) if parts.len() == 1 => simplified(&parts[0]),
        Condition::Imply(left, right) => Condition::Or(vec![negated(left), (**right).clone()]),
        Condition::Exists(variables, inner) => match simplified(inner) {
            Condition::Or(parts) if !parts.is_empty() => {
                let of = |part| Condition::Exists(variables.clone(), Box::new(part));
                Condition::Or(parts.into_iter().map(of).collect())
            }
            inner => Condition::Exists(variables.clone(), Box::new(inner)),
        },
        Condition::Not(inner) => match &**inner {
            Condition::Not(inner) => simplified(inner),
            Condition::And(parts) => simplified(&Condition::Or(each(parts))),
            Condition::Or(parts) => simplified(&Condition::And(each(parts))),
            Condition::Imply(left, right) => Condition::And(vec![(**left).clone(), negated(right)]),
            Condition::Exists(variables, inner) => {
                Condition::Forall(variables.clone(), Box::new(negated(inner)))
            }
            Condition::Forall(variables, inner) => {
                simplified(&Condition::Exists(variables.clone(), Box::new(negated(inner))))
            }
            Condition::Atom(_) | Condition::Equal(..) | Condition::Compare(_) => condition.clone(),
        },
        other => other.clone(),
    }
}

fn negated(condition: &Condition) -> Condition {
    match condition {
        Condition::Not(inner) => (**inner).clone(),
        other => Condition::Not(Box::new(other.clone())),
    }
}
