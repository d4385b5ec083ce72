//! Rewrites conditions over facts that may be unknown as classical PDDL.
//!
//! In a running ecosystem a fact is known to be true, known to be false, or unknown, and the value
//! of a function may be unknown, too. Planners have two truth values only. [`Knowledge`] rewrites a
//! domain and its goals so that a planner with two truth values handles unknown facts correctly (a
//! K0 translation: Bonet and Geffner, 2011):
//!
//! - `unknown-P` holds for a fact that is unknown. A fact that is known to be true is `P` itself,
//!   so only negated conditions change.
//! - `defined-F` holds for a function with a known value.
//! - `found-S` holds for a fact or function that an action of the plan observes (`:observe`). The
//!   plan assumes the observed value that its later steps need. If the real value differs, the
//!   executor detects the difference, and a new plan is made.
//! - `maybe-D` holds for a derived fact that cannot be ruled out.
//!
//! The caller maintains `unknown-P` and `defined-F` in `:init`. `found-S` is never in `:init`: a
//! goal that is only checked against a state, without planning, holds by known facts alone.
//!
//! **Invariant:** no function here reads a state, so the same domain always has the same auxiliary
//! predicates.

use std::collections::{BTreeMap, BTreeSet};

use crate::tree::{
    ActionSchema, Assign, Assignment, Atom, Compare, Condition, Derived, Domain, Effect,
    FluentTerm, Name, PredicateDeclaration, Privacy, Span, Term, Typed,
};

/// The auxiliary predicates that represent what is unknown about one predicate or function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AuxiliaryPredicates {
    /// Auxiliary predicates of a predicate that is not derived.
    Predicate {
        /// Predicate `unknown-P`, which holds for unknown facts.
        unknown: Name,
        /// Predicate `found-S`, which holds for facts that the plan has observed; `None` if no
        /// action observes the original predicate.
        found: Option<Name>,
    },
    /// Auxiliary predicates of a function.
    Function {
        /// Predicate `defined-F`, which holds if the value of the function is known.
        defined: Name,
        /// Predicate `found-S`, which holds if the plan has observed the value; `None` if no action
        /// observes the function.
        found: Option<Name>,
    },
    /// Auxiliary predicates of a predicate that axioms derive.
    Derived {
        /// Predicate `maybe-D`, which holds for facts that cannot be ruled out.
        maybe: Name,
        /// Predicate `unknown-D`, which holds for facts that may be true because an agent that
        /// their derivation depends on has left.
        unknown: Name,
    },
}

/// The symbols with facts or values that may be unknown, and their auxiliary predicates.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Knowledge {
    /// Auxiliary predicates of each symbol, by its name. Predicates and functions have different
    /// names.
    pub symbols: BTreeMap<Name, AuxiliaryPredicates>,
}

/// Certainty that a rewritten condition requires of the original condition.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Certainty {
    /// The rewritten condition requires that the original is known to hold.
    Sure,
    /// The rewritten condition requires that the original is not known to be false.
    Possible,
}

// === impl AuxiliaryPredicates ===

impl AuxiliaryPredicates {
    /// Returns all auxiliary predicates.
    pub fn names(&self) -> impl Iterator<Item = &Name> {
        let (one, other) = match self {
            AuxiliaryPredicates::Predicate { unknown, found } => (unknown, found.as_ref()),
            AuxiliaryPredicates::Function { defined, found } => (defined, found.as_ref()),
            AuxiliaryPredicates::Derived { maybe, unknown } => (maybe, Some(unknown)),
        };
        std::iter::once(one).chain(other)
    }
}

// === impl Knowledge ===

impl Knowledge {
    /// Creates the auxiliary predicates of a domain. The following facts and values may be unknown:
    /// those of `unknowable` predicates, those of observed symbols, and those of predicates that
    /// axioms derive from any of these.
    pub fn of(domain: &Domain, unknowable: &BTreeSet<Name>) -> Knowledge {
        let observed: BTreeSet<&Name> = { domain.actions.iter() }
            .flat_map(|action| &action.observe)
            .map(|atom| &atom.predicate)
            .collect();
        let derived: BTreeSet<&Name> = domain.derived.iter().map(|it| &it.predicate).collect();
        let fluents = domain.derived.iter().flat_map(|axiom| axiom.condition.fluents());
        let compared: BTreeSet<Name> = fluents.map(|fluent| fluent.function.clone()).collect();
        let mut words = FreshNames::of(domain);
        let mut symbols = BTreeMap::new();
        for name in domain.predicates.iter().map(|it| &it.name) {
            let is_observed = observed.contains(name);
            if !derived.contains(name) && (is_observed || unknowable.contains(name)) {
                let unknown = words.fresh_name("unknown", name);
                let found = is_observed.then(|| words.fresh_name("found", name));
                symbols.insert(name.clone(), AuxiliaryPredicates::Predicate { unknown, found });
            }
        }
        for name in domain.functions.iter().map(|it| &it.name) {
            let is_observed = observed.contains(name);
            if is_observed || compared.contains(name) {
                let defined = words.fresh_name("defined", name);
                let found = is_observed.then(|| words.fresh_name("found", name));
                symbols.insert(name.clone(), AuxiliaryPredicates::Function { defined, found });
            }
        }
        let left: Vec<Name> =
            unknowable.iter().filter(|it| derived.contains(it)).cloned().collect();
        let rests = dependent(domain, &symbols, left);
        for name in rests {
            let (maybe, unknown) =
                (words.fresh_name("maybe", &name), words.fresh_name("unknown", &name));
            symbols.insert(name, AuxiliaryPredicates::Derived { maybe, unknown });
        }
        Knowledge { symbols }
    }

    /// Whether all facts and values are always known.
    pub fn is_empty(&self) -> bool {
        self.symbols.is_empty()
    }

    /// Whether a predicate is auxiliary.
    pub fn is_auxiliary(&self, predicate: &Name) -> bool {
        self.symbols.values().any(|auxiliary| auxiliary.names().any(|name| name == predicate))
    }

    /// Returns the symbol of which `predicate` is the auxiliary predicate `unknown-…`; `None` if
    /// `predicate` is not such an auxiliary predicate.
    pub fn unknown_by(&self, predicate: &Name) -> Option<&Name> {
        let is_it = |auxiliary: &AuxiliaryPredicates| match auxiliary {
            AuxiliaryPredicates::Predicate { unknown, .. }
            | AuxiliaryPredicates::Derived { unknown, .. } => unknown == predicate,
            AuxiliaryPredicates::Function { .. } => false,
        };
        self.symbols.iter().find(|(_, auxiliary)| is_it(auxiliary)).map(|(symbol, _)| symbol)
    }

    /// Returns the auxiliary fact that `fact` is unknown; `None` if `fact` is always known.
    pub fn unknown(&self, fact: &Atom) -> Option<Atom> {
        match self.symbols.get(&fact.predicate)? {
            AuxiliaryPredicates::Predicate { unknown, .. }
            | AuxiliaryPredicates::Derived { unknown, .. } => {
                Some(Atom { predicate: unknown.clone(), ..fact.clone() })
            }
            AuxiliaryPredicates::Function { .. } => None,
        }
    }

    /// Returns the auxiliary fact that `fluent` has a known value; `None` if the domain has no
    /// auxiliary predicate for this function.
    pub fn defined(&self, fluent: &FluentTerm) -> Option<Atom> {
        match self.symbols.get(&fluent.function)? {
            AuxiliaryPredicates::Function { defined, .. } => {
                Some(applied(defined, &fluent.arguments, fluent.span))
            }
            _ => None,
        }
    }

    /// Rewrites a domain: conditions require known facts, effects make facts known, and
    /// observations add `found-S`. The domain must have the same axioms as the domain that this
    /// [`Knowledge`] was created from.
    pub fn compile(&self, domain: &mut Domain) {
        self.declare(domain);
        let mut derived = Vec::with_capacity(domain.derived.len());
        for axiom in &domain.derived {
            derived
                .push(Derived { condition: self.known_to_hold(&axiom.condition), ..axiom.clone() });
            if let Some(AuxiliaryPredicates::Derived { maybe, .. }) =
                self.symbols.get(&axiom.predicate)
            {
                let condition = self.rewrite(&axiom.condition, true, Certainty::Possible);
                derived.push(Derived { predicate: maybe.clone(), condition, ..axiom.clone() });
            }
        }
        derived.extend(self.departure_axioms(domain));
        domain.derived = derived;
        for action in &mut domain.actions {
            *action = self.action(action);
        }
    }

    /// Returns the action with rewritten conditions and effects.
    pub fn action(&self, action: &ActionSchema) -> ActionSchema {
        let found = action.observe.iter().filter_map(|observed| self.found(observed));
        let found: Vec<Effect> = found.map(Effect::Add).collect();
        let effect = match (self.effect(&action.effect), found) {
            (effect, found) if found.is_empty() => effect,
            (Effect::And(parts), found) => Effect::And(parts.into_iter().chain(found).collect()),
            (effect, found) => Effect::And(std::iter::once(effect).chain(found).collect()),
        };
        ActionSchema {
            precondition: self.known_to_hold(&action.precondition),
            effect,
            observe: Vec::new(),
            ..action.clone()
        }
    }

    /// Returns a condition that is true exactly if `condition` is known to hold.
    pub fn known_to_hold(&self, condition: &Condition) -> Condition {
        if !self.touches(condition) {
            return condition.clone();
        }
        self.rewrite(condition, true, Certainty::Sure)
    }

    /// Returns the original of a rewritten condition, in the symbols of its author and as if every
    /// fact were known.
    pub fn original_condition(&self, condition: &Condition) -> Condition {
        match condition {
            Condition::Atom(atom) => self.plain_atom(atom),
            Condition::Equal(..) | Condition::Compare(_) => condition.clone(),
            Condition::Not(inner) => match self.original_condition(inner) {
                Condition::And(parts) if parts.is_empty() => Condition::Or(parts),
                Condition::Or(parts) if parts.is_empty() => Condition::And(parts),
                inner => not(inner),
            },
            Condition::And(parts) => {
                let parts: Vec<_> =
                    parts.iter().map(|part| self.original_condition(part)).collect();
                if parts.iter().any(|part| matches!(part, Condition::Or(all) if all.is_empty())) {
                    return Condition::Or(Vec::new());
                }
                one_and(parts.into_iter().filter(|part| !part.is_always()).collect())
            }
            Condition::Or(parts) => {
                let mut parts: Vec<_> =
                    parts.iter().map(|part| self.original_condition(part)).collect();
                if parts.iter().any(Condition::is_always) {
                    return Condition::always();
                }
                parts.retain(|part| !matches!(part, Condition::Or(all) if all.is_empty()));
                one_or(parts)
            }
            Condition::Imply(left, right) => Condition::Imply(
                Box::new(self.original_condition(left)),
                Box::new(self.original_condition(right)),
            ),
            Condition::Exists(variables, inner) => {
                Condition::Exists(variables.clone(), Box::new(self.original_condition(inner)))
            }
            Condition::Forall(variables, inner) => {
                Condition::Forall(variables.clone(), Box::new(self.original_condition(inner)))
            }
        }
    }

    /// Replaces an auxiliary atom by its meaning in a state where everything is known and nothing
    /// was observed: no fact is unknown, every function has a value, and `maybe-D` is `D`.
    fn plain_atom(&self, atom: &Atom) -> Condition {
        let is_it = |name: &Name| *name == atom.predicate;
        for (symbol, auxiliary) in &self.symbols {
            match auxiliary {
                AuxiliaryPredicates::Derived { maybe, .. } if is_it(maybe) => {
                    return Condition::Atom(Atom { predicate: symbol.clone(), ..atom.clone() });
                }
                AuxiliaryPredicates::Function { defined, .. } if is_it(defined) => {
                    return Condition::always();
                }
                _ if auxiliary.names().any(is_it) => return Condition::Or(Vec::new()),
                _ => (),
            }
        }
        Condition::Atom(atom.clone())
    }

    /// Whether a condition must be rewritten: it contains a symbol that may be unknown, or a
    /// comparison. Without rewriting, the negation of a comparison with an undefined function would
    /// hold.
    fn touches(&self, condition: &Condition) -> bool {
        condition.parts().any(|part| match part {
            Condition::Atom(atom) => self.symbols.contains_key(&atom.predicate),
            Condition::Compare(_) => true,
            _ => false,
        })
    }

    /// Rewrites a condition, or its negation if `positive` is false.
    fn rewrite(&self, condition: &Condition, positive: bool, mode: Certainty) -> Condition {
        let all = |parts: &[Condition]| {
            parts.iter().map(|part| self.rewrite(part, positive, mode)).collect()
        };
        let inner = |inner: &Condition| Box::new(self.rewrite(inner, positive, mode));
        match (condition, positive) {
            (Condition::Atom(atom), true) => self.holds(atom, mode),
            (Condition::Atom(atom), false) => self.holds_not(atom, mode),
            (Condition::Equal(..), true) => condition.clone(),
            (Condition::Equal(..), false) => not(condition.clone()),
            (Condition::Compare(compare), _) => self.compare(compare, positive, mode),
            (Condition::Not(inner), _) => self.rewrite(inner, !positive, mode),
            (Condition::And(parts), true) | (Condition::Or(parts), false) => {
                Condition::And(all(parts))
            }
            (Condition::Or(parts), true) | (Condition::And(parts), false) => {
                Condition::Or(all(parts))
            }
            (Condition::Imply(left, right), true) => Condition::Or(vec![
                self.rewrite(left, false, mode),
                self.rewrite(right, true, mode),
            ]),
            (Condition::Imply(left, right), false) => Condition::And(vec![
                self.rewrite(left, true, mode),
                self.rewrite(right, false, mode),
            ]),
            (Condition::Exists(variables, body), true)
            | (Condition::Forall(variables, body), false) => {
                Condition::Exists(variables.clone(), inner(body))
            }
            (Condition::Forall(variables, body), true)
            | (Condition::Exists(variables, body), false) => {
                Condition::Forall(variables.clone(), inner(body))
            }
        }
    }

    fn holds(&self, atom: &Atom, mode: Certainty) -> Condition {
        let plain = Condition::Atom(atom.clone());
        let with = |name: &Name| Condition::Atom(Atom { predicate: name.clone(), ..atom.clone() });
        match (self.symbols.get(&atom.predicate), mode) {
            (Some(AuxiliaryPredicates::Derived { maybe, .. }), Certainty::Possible) => with(maybe),
            (
                Some(AuxiliaryPredicates::Predicate { unknown, found: Some(found) }),
                Certainty::Sure,
            ) => Condition::Or(vec![plain, Condition::And(vec![with(unknown), with(found)])]),
            (
                Some(AuxiliaryPredicates::Predicate { unknown, found: Some(found) }),
                Certainty::Possible,
            ) => Condition::Or(vec![plain, Condition::And(vec![with(unknown), not(with(found))])]),
            (
                Some(AuxiliaryPredicates::Predicate { unknown, found: None }),
                Certainty::Possible,
            ) => Condition::Or(vec![plain, with(unknown)]),
            _ => plain,
        }
    }

    fn holds_not(&self, atom: &Atom, mode: Certainty) -> Condition {
        let plain = not(Condition::Atom(atom.clone()));
        let with = |name: &Name| Condition::Atom(Atom { predicate: name.clone(), ..atom.clone() });
        match (self.symbols.get(&atom.predicate), mode) {
            (Some(AuxiliaryPredicates::Derived { maybe, .. }), Certainty::Sure) => not(with(maybe)),
            (
                Some(AuxiliaryPredicates::Predicate { unknown, found: Some(found) }),
                Certainty::Sure,
            ) => {
                let is_known = Condition::Or(vec![not(with(unknown)), with(found)]);
                Condition::And(vec![plain, is_known])
            }
            (Some(AuxiliaryPredicates::Predicate { unknown, found: None }), Certainty::Sure) => {
                Condition::And(vec![plain, not(with(unknown))])
            }
            (
                Some(AuxiliaryPredicates::Predicate { unknown, found: Some(found) }),
                Certainty::Possible,
            ) => {
                let is_free = Condition::Or(vec![not(with(unknown)), not(with(found))]);
                Condition::And(vec![plain, is_free])
            }
            _ => plain,
        }
    }

    /// Rewrites a comparison. If a function in it has no value, neither the comparison nor its
    /// negation must hold. The negation is therefore written as the opposite comparison.
    fn compare(&self, compare: &Compare, positive: bool, mode: Certainty) -> Condition {
        let with =
            |comparison| Condition::Compare(Box::new(Compare { comparison, ..compare.clone() }));
        let plain = match positive {
            true => with(compare.comparison),
            false => one_or(compare.comparison.negated().iter().copied().map(with).collect()),
        };
        let assumed = match mode {
            Certainty::Sure => self.assumed(compare),
            Certainty::Possible => self.undetermined(compare),
        };
        match assumed {
            Some(assumed) => Condition::Or(vec![plain, assumed]),
            None => plain,
        }
    }

    /// Returns the condition under which a comparison may be assumed to hold: the plan has observed
    /// every unknown value in it. Returns `None` if no value in the comparison can be observed.
    fn assumed(&self, compare: &Compare) -> Option<Condition> {
        let tracked = self.tracked(compare);
        let found: Vec<Condition> = { tracked.iter() }
            .filter_map(|(fluent, defined, found)| {
                let found =
                    Condition::Atom(applied(found.as_ref()?, &fluent.arguments, fluent.span));
                Some(Condition::And(vec![not(Condition::Atom(defined.clone())), found]))
            })
            .collect();
        if found.is_empty() {
            return None;
        }
        let is_settled = tracked.iter().map(|(fluent, defined, found)| {
            let found = found
                .as_ref()
                .map(|name| Condition::Atom(applied(name, &fluent.arguments, fluent.span)));
            let mut ways = vec![Condition::Atom(defined.clone())];
            ways.extend(found);
            one_or(ways)
        });
        match tracked.len() {
            1 => Some(one_or(found)),
            _ => Some(Condition::And(is_settled.chain([one_or(found)]).collect())),
        }
    }

    /// Returns the condition under which a comparison is undetermined: some value in it is neither
    /// known nor observed. Returns `None` if every value in it is always known.
    fn undetermined(&self, compare: &Compare) -> Option<Condition> {
        let open: Vec<Condition> = { self.tracked(compare).into_iter() }
            .map(|(fluent, defined, found)| {
                let mut parts = vec![not(Condition::Atom(defined))];
                parts.extend(found.map(|name| {
                    not(Condition::Atom(applied(&name, &fluent.arguments, fluent.span)))
                }));
                Condition::And(parts)
            })
            .collect();
        (!open.is_empty()).then(|| one_or(open))
    }

    /// Returns those functions of a comparison that may have no value. Each entry contains the
    /// function with its arguments, the auxiliary fact for “the function has a value”, and the name
    /// of the predicate for “the value was observed”, if there is one.
    fn tracked(&self, compare: &Compare) -> Vec<(FluentTerm, Atom, Option<Name>)> {
        let mut fluents: Vec<&FluentTerm> = Vec::new();
        for fluent in compare.left.fluents().chain(compare.right.fluents()) {
            if !fluents.contains(&fluent) {
                fluents.push(fluent);
            }
        }
        let tracked = fluents.into_iter().filter_map(|fluent| {
            let Some(AuxiliaryPredicates::Function { defined, found }) =
                self.symbols.get(&fluent.function)
            else {
                return None;
            };
            let defined = applied(defined, &fluent.arguments, fluent.span);
            Some((fluent.clone(), defined, found.clone()))
        });
        tracked.collect()
    }

    fn found(&self, observed: &Atom) -> Option<Atom> {
        let auxiliary = self.symbols.get(&observed.predicate)?;
        let (AuxiliaryPredicates::Predicate { found, .. }
        | AuxiliaryPredicates::Function { found, .. }) = auxiliary
        else {
            return None;
        };
        Some(Atom { predicate: found.clone()?, ..observed.clone() })
    }

    fn effect(&self, effect: &Effect) -> Effect {
        match effect {
            Effect::And(parts) => Effect::And(parts.iter().map(|part| self.effect(part)).collect()),
            Effect::Add(atom) | Effect::Delete(atom) => match self.unknown(atom) {
                Some(unknown) => Effect::And(vec![effect.clone(), Effect::Delete(unknown)]),
                None => effect.clone(),
            },
            Effect::Assign(assign) => {
                let Assign { assignment, fluent, .. } = &**assign;
                match self.defined(fluent).filter(|_| *assignment == Assignment::Assign) {
                    Some(defined) => Effect::And(vec![effect.clone(), Effect::Add(defined)]),
                    None => effect.clone(),
                }
            }
            Effect::Forall(variables, inner) => {
                Effect::Forall(variables.clone(), Box::new(self.effect(inner)))
            }
            Effect::When(condition, inner) => {
                let condition = self.known_to_hold(condition);
                Effect::When(Box::new(condition), Box::new(self.effect(inner)))
            }
        }
    }

    /// Declares the auxiliary predicates, each with the parameters of its symbol.
    fn declare(&self, domain: &mut Domain) {
        let of_predicates = domain.predicates.iter().map(|it| (&it.name, &it.parameters));
        let of_functions = domain.functions.iter().map(|it| (&it.name, &it.parameters));
        let parameters: BTreeMap<&Name, &Vec<Typed>> = of_predicates.chain(of_functions).collect();
        let mut added = Vec::new();
        for (symbol, auxiliary) in &self.symbols {
            let Some(parameters) = parameters.get(symbol) else { continue };
            added.extend(auxiliary.names().map(|name| PredicateDeclaration {
                name: name.clone(),
                parameters: (*parameters).clone(),
                privacy: Privacy::Public,
            }));
        }
        domain.predicates.extend(added);
    }

    /// Returns the axioms `unknown-D` → `maybe-D`, one for each derived predicate: a derived fact
    /// cannot be ruled out if an agent that it depends on has left.
    fn departure_axioms(&self, domain: &Domain) -> Vec<Derived> {
        let axiom = |(symbol, auxiliary): (&Name, &AuxiliaryPredicates)| {
            let AuxiliaryPredicates::Derived { maybe, unknown } = auxiliary else { return None };
            let parameters = &domain.predicates.iter().find(|it| it.name == *symbol)?.parameters;
            let variables = parameters.iter().map(|it| Term::Variable(it.name.clone()));
            let unknown = applied(unknown, &variables.collect::<Vec<_>>(), Span::default());
            Some(Derived {
                predicate: maybe.clone(),
                parameters: parameters.clone(),
                condition: Condition::Atom(unknown),
                span: Span::default(),
            })
        };
        self.symbols.iter().filter_map(axiom).collect()
    }
}

fn not(condition: Condition) -> Condition {
    Condition::Not(Box::new(condition))
}

fn one_or(mut parts: Vec<Condition>) -> Condition {
    match parts.len() {
        1 => parts.remove(0),
        _ => Condition::Or(parts),
    }
}

fn one_and(mut parts: Vec<Condition>) -> Condition {
    match parts.len() {
        1 => parts.remove(0),
        _ => Condition::And(parts),
    }
}

fn applied(predicate: &Name, arguments: &[Term], span: Span) -> Atom {
    Atom { predicate: predicate.clone(), arguments: arguments.to_vec(), span }
}

/// Returns the derived predicates that depend on one of `symbols`, directly or through other
/// derived predicates, and the predicates in `left`.
fn dependent(
    domain: &Domain,
    symbols: &BTreeMap<Name, AuxiliaryPredicates>,
    left: Vec<Name>,
) -> BTreeSet<Name> {
    let uses: Vec<(&Name, BTreeSet<&Name>)> = { domain.derived.iter() }
        .map(|axiom| (&axiom.predicate, axiom.condition.symbols().collect()))
        .collect();
    let mut found: BTreeSet<Name> = left.into_iter().collect();
    loop {
        let before = found.len();
        for (head, used) in &uses {
            if used.iter().any(|name| symbols.contains_key(*name) || found.contains(*name)) {
                found.insert((*head).clone());
            }
        }
        if found.len() == before {
            return found;
        }
    }
}

/// Chooses names that are different from those of all predicates and functions.
struct FreshNames {
    taken: BTreeSet<Name>,
}

// === impl FreshNames ===

impl FreshNames {
    fn of(domain: &Domain) -> FreshNames {
        let predicates = domain.predicates.iter().map(|it| &it.name);
        let functions = domain.functions.iter().map(|it| &it.name);
        FreshNames { taken: predicates.chain(functions).cloned().collect() }
    }

    /// Returns `PREFIX-SYMBOL` if this name is free; otherwise the first free name among
    /// `PREFIX-SYMBOL-2`, `PREFIX-SYMBOL-3` and so on.
    fn fresh_name(&mut self, prefix: &str, symbol: &Name) -> Name {
        let wanted = format!("{prefix}-{}", symbol.as_str());
        let numbered = (2..).map(|number| Name::new(&format!("{wanted}-{number}")));
        let word = std::iter::once(Name::new(&wanted))
            .chain(numbered)
            .find(|name| !self.taken.contains(name))
            .expect("invariant: finitely many names are taken");
        self.taken.insert(word.clone());
        word
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOMAIN: &str = "(define (domain d) (:types room lamp)
        (:predicates (in ?l - lamp ?r - room) (on ?l - lamp) (lit ?r - room) (motion ?r - room)
            (door-open ?r - room))
        (:functions (warmth ?r - room) (limit ?r - room) (total-cost))
        (:derived (lit ?r - room) (exists (?l - lamp) (and (in ?l ?r) (on ?l))))
        (:action turn-off :parameters (?l - lamp) :precondition (on ?l) :effect (not (on ?l)))
        (:action pass :parameters (?r - room) :precondition (not (motion ?r))
            :effect (when (lit ?r) (door-open ?r)))
        (:action look :parameters (?r - room)
            :observe (and (motion ?r) (warmth ?r))))";

    fn domain() -> Domain {
        crate::parse_domain(DOMAIN).into_result().expect("a domain")
    }

    fn knowledge() -> Knowledge {
        Knowledge::of(&domain(), &[Name::new("on")].into())
    }

    #[track_caller]
    fn check(condition: &str, expected: &str) {
        let parsed = |text| crate::parse_condition(text).into_result().expect("a condition");
        let sure = knowledge().known_to_hold(&parsed(condition));
        assert_eq!(sure.to_string(), parsed(expected).to_string());
        // The reverse direction must give the same condition.
        let plain = knowledge().original_condition(&sure);
        assert_eq!(knowledge().known_to_hold(&plain).to_string(), sure.to_string(), "{plain}");
    }

    #[test]
    fn conditions_on_known_facts_stay_unchanged() {
        check("(door-open hall)", "(door-open hall)");
        check("(not (door-open hall))", "(not (door-open hall))");
        check("(imply (in a hall) (in b hall))", "(imply (in a hall) (in b hall))");
    }

    #[test]
    fn unknown_is_neither_true_nor_false() {
        check("(on a)", "(on a)");
        check("(not (on a))", "(and (not (on a)) (not (unknown-on a)))");
        check(
            "(not (and (on a) (on b)))",
            "(or (and (not (on a)) (not (unknown-on a)))
            (and (not (on b)) (not (unknown-on b))))",
        );
    }

    #[test]
    fn an_observable_fact_may_be_assumed_true_or_false() {
        check(
            "(motion hall)",
            "(or (motion hall) (and (unknown-motion hall) (found-motion hall)))",
        );
        check(
            "(not (motion hall))",
            "(and (not (motion hall)) (or (not (unknown-motion hall)) (found-motion hall)))",
        );
    }

    #[test]
    fn a_derived_fact_is_false_only_if_it_is_impossible() {
        check("(lit hall)", "(lit hall)");
        check("(not (lit hall))", "(not (maybe-lit hall))");
        let mut compiled = domain();
        knowledge().compile(&mut compiled);
        let axioms: Vec<String> = compiled.derived.iter().map(ToString::to_string).collect();
        let maybe = "(exists (?l - lamp) (and (in ?l ?r) (or (on ?l) (unknown-on ?l))))";
        let shown = axioms.join("\n").split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(shown.contains(&format!("(:derived (maybe-lit ?r - room) {maybe})")), "{shown}");
        assert!(shown.contains("(:derived (maybe-lit ?r - room) (unknown-lit ?r))"), "{shown}");
    }

    #[test]
    fn a_number_without_a_value_is_neither_above_nor_below() {
        let found = "(and (not (defined-warmth hall)) (found-warmth hall))";
        check("(>= (warmth hall) 21)", &format!("(or (>= (warmth hall) 21) {found})"));
        check("(not (>= (warmth hall) 21))", &format!("(or (< (warmth hall) 21) {found})"));
        // The limit cannot be observed.
        check("(not (< (limit hall) 21))", "(>= (limit hall) 21)");
        check("(not (= (limit hall) 21))", "(or (< (limit hall) 21) (> (limit hall) 21))");
    }

    #[test]
    fn actions_make_changed_facts_known_and_observed_facts_found() {
        let mut compiled = domain();
        knowledge().compile(&mut compiled);
        let action = |name: &str| {
            let action = compiled.actions.iter().find(|action| action.name == name);
            action
                .expect("an action")
                .effect
                .to_string()
                .split_whitespace()
                .collect::<Vec<_>>()
                .join(" ")
        };
        assert_eq!(action("turn-off"), "(and (not (on ?l)) (not (unknown-on ?l)))");
        assert_eq!(action("look"), "(and (found-motion ?r) (found-warmth ?r))");
        assert_eq!(action("pass"), "(when (lit ?r) (door-open ?r))");
        let mistakes = crate::check_domain(&compiled);
        assert!(mistakes.is_empty(), "{mistakes:?}");
        let again = crate::parse_domain(&compiled.to_string()).into_result().expect("PDDL");
        assert_eq!(again, compiled);
    }

    #[test]
    fn a_compiled_condition_is_translated_back() {
        let parsed = |text| crate::parse_condition(text).into_result().expect("a condition");
        for (asked, told) in [
            ("(not (lit hall))", "(not (lit hall))"),
            ("(not (motion hall))", "(not (motion hall))"),
            ("(and (motion hall) (not (on a)))", "(and (motion hall) (not (on a)))"),
            ("(not (>= (warmth hall) 21))", "(< (warmth hall) 21)"),
            ("(unknown-on a)", "(or)"),
        ] {
            let plain = knowledge().original_condition(&knowledge().known_to_hold(&parsed(asked)));
            assert_eq!(plain.to_string(), told);
        }
    }

    #[test]
    fn auxiliary_predicates_avoid_the_authors_names() {
        let text = DOMAIN
            .replace("(door-open ?r - room)", "(unknown-on ?l - lamp)")
            .replace("(door-open ?r)", "(lit ?r)");
        let text = text.replace("(:derived (lit ?r - room)", "(:derived (motion ?r - room)");
        let domain = crate::parse_domain(&text).into_result().expect("a domain");
        let knowledge = Knowledge::of(&domain, &[Name::new("on")].into());
        let Some(AuxiliaryPredicates::Predicate { unknown, .. }) = knowledge.symbols.get("on")
        else {
            panic!("{knowledge:?}");
        };
        assert_eq!(unknown.as_str(), "unknown-on-2");
    }
}
