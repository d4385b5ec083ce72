//! What an action makes true of what its agent answers for.

use std::collections::BTreeMap;

use pddl::{Atom, Effect, InitElement, Name, Term};

/// What the agent answers for, by the text of each fact; of a number, of what it is the number.
#[derive(Debug, Default)]
pub(crate) struct Known(BTreeMap<String, InitElement>);

impl Known {
    pub(crate) fn new(facts: Vec<InitElement>) -> Known {
        let mut known = Known::default();
        facts.into_iter().for_each(|fact| known.add(fact));
        known
    }

    pub(crate) fn facts(&self) -> impl Iterator<Item = InitElement> {
        self.0.values().cloned()
    }

    pub(crate) fn add(&mut self, fact: InitElement) {
        let key = match &fact {
            InitElement::Assign(fluent, _) => format!("= {fluent}"),
            other => other.to_string(),
        };
        self.0.insert(key, fact);
    }

    /// Makes an action's effect true; what of it can be said to others.
    pub(crate) fn apply(
        &mut self,
        effect: &Effect,
        arguments: &BTreeMap<String, String>,
    ) -> Vec<InitElement> {
        let mut added = Vec::new();
        match effect {
            Effect::And(effects) => {
                // What is both taken and given is there (PDDL).
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
            // Costs; `check` lets nothing else through.
            Effect::Assign(_) | Effect::Forall(..) | Effect::When(..) => (),
        }
        added
    }

    /// Whether an action's effect came about is not known: nothing is said any more of what it would
    /// have made untrue.
    pub(crate) fn doubt(&mut self, effect: &Effect, arguments: &BTreeMap<String, String>) {
        match effect {
            Effect::And(effects) => effects.iter().for_each(|each| self.doubt(each, arguments)),
            Effect::Delete(_) => drop(self.apply(effect, arguments)),
            _ => (),
        }
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

/// Whether an effect is one that a program which ended well has brought about, whatever the state was.
///
/// # Errors
///
/// What is not, and what would be right.
pub(crate) fn check(effect: &Effect) -> Result<(), String> {
    match effect {
        Effect::And(effects) => effects.iter().try_for_each(check),
        Effect::Add(_) | Effect::Delete(_) => Ok(()),
        Effect::Assign(assign) if assign.fluent.function == "total-cost" => Ok(()),
        Effect::Assign(assign) => Err(format!(
            "its effect changes {}, which only the program can know: let it print the number, as in \
             (= {} 21.5)",
            assign.fluent, assign.fluent
        )),
        Effect::Forall(..) | Effect::When(..) => Err(
            "its effect has `forall` or `when`: say what is true whenever the program ends well, and \
             let it print the rest"
                .to_owned(),
        ),
    }
}
