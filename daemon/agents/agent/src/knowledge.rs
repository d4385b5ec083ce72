//! Conversion of the auxiliary symbols that are sent with a composite domain. These symbols state
//! which facts are unknown.

use std::collections::BTreeMap;

use acl::content;
use pddl::Name;
use pddl::knowledge::{AuxiliaryPredicates, Knowledge};

/// Converts the auxiliary symbols that were sent with a composite domain to the form that `pddl`
/// uses.
pub fn knowledge(sent: &BTreeMap<String, content::Auxiliary>) -> Knowledge {
    let name = |text: &String| Name::new(text);
    let read = |(symbol, sent): (&String, &content::Auxiliary)| {
        let auxiliary = match sent {
            content::Auxiliary::Predicate { unknown, found } => AuxiliaryPredicates::Predicate {
                unknown: name(unknown),
                found: found.as_ref().map(name),
            },
            content::Auxiliary::Function { defined, found } => AuxiliaryPredicates::Function {
                defined: name(defined),
                found: found.as_ref().map(name),
            },
            content::Auxiliary::Derived { maybe, unknown } => {
                AuxiliaryPredicates::Derived { maybe: name(maybe), unknown: name(unknown) }
            }
        };
        (Name::new(symbol), auxiliary)
    };
    Knowledge { symbols: sent.iter().map(read).collect() }
}
