//! Applies the effects of actions to the facts of an agent.

use std::collections::BTreeMap;

use pddl::{Atom, Effect, FluentTerm, InitElement, Name, Term};

use crate::device::MethodCall;

/// Facts of the agent, by the text of the fact. The value of a function is listed by the text of
/// the function.
#[derive(Clone, Debug, Default)]
pub struct AgentFacts(BTreeMap<String, InitElement>);

impl AgentFacts {
    /// Creates the facts of an agent from those of its model, or of its file.
    pub fn new(facts: Vec<InitElement>) -> AgentFacts {
        let mut known = AgentFacts::default();
        facts.into_iter().for_each(|fact| known.add(fact));
        known
    }

    /// Returns all facts, in the order of their texts.
    pub fn facts(&self) -> impl Iterator<Item = InitElement> {
        self.0.values().cloned()
    }

    fn add(&mut self, fact: InitElement) {
        let key = match &fact {
            InitElement::Assign(fluent, _) => format!("= {fluent}"),
            // An atom is true, false or unknown; the latest of these replaces the others.
            InitElement::Not(atom) | InitElement::Unknown(atom) => atom.to_string(),
            other => other.to_string(),
        };
        self.0.insert(key, fact);
    }

    /// Returns `true` or `false` for a fact; `None` if it is unknown. A fact that is not listed is
    /// false.
    fn value_of(&self, atom: &Atom) -> Option<bool> {
        match self.0.get(&atom.to_string()) {
            Some(InitElement::Unknown(_)) => None,
            listed => Some(matches!(listed, Some(InitElement::Atom(_)))),
        }
    }

    /// Returns the facts after `call` has succeeded, and those of them that the action or its result
    /// (`told`) has made known.
    pub fn after_success(
        &self,
        effect: Option<&Effect>,
        call: &MethodCall,
        told: &[InitElement],
    ) -> (AgentFacts, Vec<InitElement>) {
        let mut after = self.clone();
        let mut observed =
            effect.map(|effect| after.apply(effect, &call.arguments)).unwrap_or_default();
        told.iter().for_each(|fact| after.add(fact.clone()));
        observed.extend(told.iter().cloned());
        (after, observed)
    }

    /// Returns the facts after `call` has not succeeded. If it is unknown how much of it was done, so
    /// are the facts that the effect changes.
    pub fn after_failure(
        &self,
        effect: Option<&Effect>,
        call: &MethodCall,
        is_end_unknown: bool,
    ) -> AgentFacts {
        let mut after = self.clone();
        if let Some(effect) = effect.filter(|_| is_end_unknown) {
            after.apply_uncertain(effect, &call.arguments);
        }
        after
    }

    /// Applies an action's effect, and returns the added facts.
    fn apply(&mut self, effect: &Effect, arguments: &BTreeMap<String, String>) -> Vec<InitElement> {
        let mut added = Vec::new();
        match effect {
            Effect::And(effects) => {
                // In PDDL, a fact that is both deleted and added is true afterwards.
                let is_delete = |effect: &&Effect| matches!(effect, Effect::Delete(_));
                let (first, then): (Vec<_>, Vec<_>) = effects.iter().partition(is_delete);
                for effect in first.into_iter().chain(then) {
                    added.extend(self.apply(effect, arguments));
                }
            }
            Effect::Add(atom) => {
                let fact = InitElement::Atom(ground(atom, arguments));
                self.add(fact.clone());
                added.push(fact);
            }
            Effect::Delete(atom) => {
                let fact = InitElement::Atom(ground(atom, arguments));
                self.0.remove(&fact.to_string());
            }
            // The remaining effects are only costs, because `check_effect` refuses all others.
            Effect::Assign(_) | Effect::Forall(..) | Effect::When(..) => (),
        }
        added
    }

    /// Applies an effect that may or may not have happened: each fact that the effect would change
    /// becomes unknown.
    fn apply_uncertain(&mut self, effect: &Effect, arguments: &BTreeMap<String, String>) {
        let mut after = self.clone();
        after.apply(effect, arguments);
        for atom in atoms(effect) {
            let atom = ground(atom, arguments);
            if self.value_of(&atom) != after.value_of(&atom) {
                self.add(InitElement::Unknown(atom));
            }
        }
    }
}

/// Returns the atoms that an effect adds or deletes.
fn atoms(effect: &Effect) -> Vec<&Atom> {
    match effect {
        Effect::And(effects) => effects.iter().flat_map(atoms).collect(),
        Effect::Add(atom) | Effect::Delete(atom) => vec![atom],
        // The remaining effects are only costs, because `check_effect` refuses all others.
        Effect::Assign(_) | Effect::Forall(..) | Effect::When(..) => Vec::new(),
    }
}

fn ground(atom: &Atom, arguments: &BTreeMap<String, String>) -> Atom {
    let bound = |term: &Term| match term {
        Term::Variable(name) => {
            let value = arguments.get(name.as_str()).map(|value| Name::new(value));
            value.map_or_else(|| term.clone(), Term::Object)
        }
        Term::Object(_) => term.clone(),
    };
    Atom { arguments: atom.arguments.iter().map(bound).collect(), ..atom.clone() }
}

/// Part of an effect that does not follow from the success of its action alone.
#[derive(Clone, Debug, PartialEq)]
pub enum UncertainEffect {
    /// The effect changes this number.
    Number(FluentTerm),
    /// The effect has `forall` or `when`.
    Conditional,
}

/// Checks that an effect depends only on the success of its action, and not on the state before it.
///
/// # Errors
///
/// Returns the first conditional or quantified part, or the first number that the effect changes.
pub fn check_effect(effect: &Effect) -> Result<(), UncertainEffect> {
    match effect {
        Effect::And(effects) => effects.iter().try_for_each(check_effect),
        Effect::Add(_) | Effect::Delete(_) => Ok(()),
        Effect::Assign(assign) if assign.fluent.function == "total-cost" => Ok(()),
        Effect::Assign(assign) => Err(UncertainEffect::Number(assign.fluent.clone())),
        Effect::Forall(..) | Effect::When(..) => Err(UncertainEffect::Conditional),
    }
}
