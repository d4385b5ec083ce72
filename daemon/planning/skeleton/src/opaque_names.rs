//! Opaque names: what is private is named to others by its agent and a number.

use std::collections::{BTreeMap, BTreeSet};

use pddl::Name;

use crate::private_symbols::{PrivateSymbol, PrivateSymbols};

/// The opaque names of one agent, the same in each of its projections.
#[derive(Clone)]
pub(crate) struct OpaqueNames {
    agent: String,
    objects: BTreeMap<Name, Name>,
    functions: BTreeMap<Name, Name>,
    predicates: BTreeMap<PrivateSymbol, Name>,
}

// === impl OpaqueNames ===

impl OpaqueNames {
    pub(crate) fn new(
        agent: &str,
        symbols: &PrivateSymbols,
        predicates: &BTreeSet<PrivateSymbol>,
        functions: impl Iterator<Item = Name>,
    ) -> OpaqueNames {
        let objects = symbols.private_objects().map(|object| object.name.clone());
        OpaqueNames {
            agent: agent.to_owned(),
            objects: numbered(agent, "o", objects),
            functions: numbered(agent, "f", functions),
            predicates: numbered(agent, "p", predicates.iter().cloned()),
        }
    }

    pub(crate) fn object(&self, name: &Name) -> Name {
        self.objects.get(name).unwrap_or(name).clone()
    }

    /// Returns the object with an opaque name, or the public object of that name.
    pub(crate) fn object_of(&self, opaque: &Name) -> Name {
        let own = self.objects.iter().find(|(_, name)| *name == opaque);
        own.map_or(opaque, |(name, _)| name).clone()
    }

    pub(crate) fn function(&self, name: &Name) -> Name {
        self.functions.get(name).unwrap_or(name).clone()
    }

    pub(crate) fn predicate(&self, symbol: &PrivateSymbol) -> Name {
        self.predicates.get(symbol).unwrap_or(&symbol.predicate).clone()
    }

    /// Returns the name of an action in the projection: unique to the agent, and opaque for an
    /// action that changes nothing public.
    pub(crate) fn action(&self, number: usize, name: &Name, is_public: bool) -> Name {
        let agent = &self.agent;
        match is_public {
            true => Name::new(&format!("{agent}--{name}")),
            false => Name::new(&format!("{agent}--a{number}")),
        }
    }
}

fn numbered<T: Ord>(agent: &str, kind: &str, names: impl Iterator<Item = T>) -> BTreeMap<T, Name> {
    let name = |(number, own)| (own, Name::new(&format!("{agent}--{kind}{number}")));
    names.enumerate().map(name).collect()
}
