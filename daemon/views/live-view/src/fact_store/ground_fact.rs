//! A ground fact, parsed from PDDL.

use pddl::{Atom, FluentTerm, InitElement, Term};

use crate::rows::FactTruth;
use crate::text::number;

/// Maximum length of a text with facts, in bytes; a longer one is not read. Heartbeats are at most
/// 256 KiB long.
pub(crate) const FACTS_TEXT_BYTES_MAX: usize = 4 << 20;

/// A fact: that something is true, false or unknown, or the value of a function.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GroundFact {
    pub(crate) predicate: String,
    pub(crate) arguments: Vec<String>,
    pub(crate) value: Option<f64>,
    pub(crate) truth: FactTruth,
}

impl GroundFact {
    fn of(element: &InitElement) -> Option<GroundFact> {
        match element {
            InitElement::Atom(atom) => Some(GroundFact::of_atom(atom, FactTruth::True)),
            InitElement::Not(atom) => Some(GroundFact::of_atom(atom, FactTruth::False)),
            InitElement::Unknown(atom) => Some(GroundFact::of_atom(atom, FactTruth::Unknown)),
            InitElement::Assign(FluentTerm { function, arguments, .. }, value) => {
                Some(GroundFact {
                    predicate: function.as_str().to_owned(),
                    arguments: names(arguments),
                    value: Some(value.0),
                    truth: FactTruth::True,
                })
            }
            InitElement::At(..) => None,
        }
    }

    fn of_atom(atom: &Atom, truth: FactTruth) -> GroundFact {
        GroundFact {
            predicate: atom.predicate.as_str().to_owned(),
            arguments: names(&atom.arguments),
            value: None,
            truth,
        }
    }

    /// Parses facts. Parts of the text that are not PDDL are left out.
    pub(crate) fn parse_all(text: &str) -> Vec<GroundFact> {
        if text.trim().is_empty() || text.len() > FACTS_TEXT_BYTES_MAX {
            return Vec::new();
        }
        let parsed = pddl::parse_init_elements(text).value.unwrap_or_default();
        parsed.iter().filter_map(GroundFact::of).collect()
    }

    /// Converts the elements of `:init`.
    pub(crate) fn of_all(elements: &[InitElement]) -> Vec<GroundFact> {
        elements.iter().filter_map(GroundFact::of).collect()
    }

    /// Returns the key that all facts with the same symbol and arguments share.
    pub(crate) fn key(&self) -> String {
        let bytes = self.arguments.iter().map(|argument| argument.len() + 1).sum::<usize>();
        let mut key = String::with_capacity(self.predicate.len() + bytes + 2);
        key.push('(');
        key.push_str(&self.predicate);
        for argument in &self.arguments {
            key.push(' ');
            key.push_str(argument);
        }
        key.push(')');
        key
    }

    /// Returns what the fact says about its key.
    pub(crate) fn saying(&self) -> Saying {
        Saying { value: self.value, truth: self.truth }
    }
}

/// What is said about a predicate or function with arguments: its truth, or its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Saying {
    pub(crate) value: Option<f64>,
    pub(crate) truth: FactTruth,
}

impl Saying {
    /// Returns the fact with the key `key` as PDDL.
    pub(crate) fn printed(self, key: &str) -> String {
        let (before, value) = match (self.value, self.truth) {
            (None, FactTruth::True) => return key.to_owned(),
            (Some(value), FactTruth::True) => ("(= ", number(value)),
            (_, FactTruth::Unknown) => ("(unknown ", String::new()),
            (_, FactTruth::False) => ("(not ", String::new()),
        };
        let mut text = String::with_capacity(before.len() + key.len() + value.len() + 2);
        text.push_str(before);
        text.push_str(key);
        if !value.is_empty() {
            text.push(' ');
            text.push_str(&value);
        }
        text.push(')');
        text
    }
}

fn names(terms: &[Term]) -> Vec<String> {
    terms.iter().map(|term| term.name().as_str().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_are_parsed_and_printed() {
        let text =
            "(At R1 hall) (= (temperature hall) 21.50) (unknown (motion hall)) (not (lit hall))";
        let facts = GroundFact::parse_all(text);
        let printed: Vec<_> = facts.iter().map(|fact| fact.saying().printed(&fact.key())).collect();
        assert_eq!(
            printed,
            [
                "(at r1 hall)",
                "(= (temperature hall) 21.5)",
                "(unknown (motion hall))",
                "(not (lit hall))"
            ]
        );
        assert_eq!(facts[1].key(), "(temperature hall)");
        assert!(GroundFact::parse_all(")(").is_empty());
    }
}
