//! A dictionary of one direction: what each word of the ecosystem it comes from is called in the
//! one it goes to. What is not in it does not pass.

use std::collections::BTreeMap;

use acl::{AgentId, EcosystemId};
use pddl::Name;

use crate::entry::{InterfaceEntry, RuleEntry};

/// The words of the far ecosystem, as they are called in the near one.
///
/// *Far* is where an agent lives, *near* where its mirror does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Words {
    /// Types.
    pub types: BTreeMap<String, Name>,
    /// Predicates.
    pub predicates: BTreeMap<String, Name>,
    /// Functions.
    pub functions: BTreeMap<String, Name>,
    /// Objects.
    pub objects: BTreeMap<String, Name>,
}

/// Which way a rule lets an agent through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// One of theirs is mirrored here.
    Import,
    /// One of ours is mirrored there.
    Export,
}

/// What one rule lets through, read from the far side to the near one.
#[derive(Clone, Debug, PartialEq)]
pub struct Passage {
    /// The agent, where it lives.
    pub agent: AgentId,
    /// The same where its mirror is.
    pub mirror: AgentId,
    /// The predicate that holds of what is exported: over there are more rooms than here, and here
    /// more than over there.
    pub guard: Name,
    /// Far = near.
    pub actions: BTreeMap<String, Name>,
    /// What an action costs plans, under its near name.
    pub costs: BTreeMap<String, f64>,
}

// === impl Words ===

impl Words {
    /// The dictionary of an interface for what goes this way.
    pub fn of(entry: &InterfaceEntry, way: Way) -> Words {
        let turned = |table: &BTreeMap<String, String>| turned(table, way);
        Words {
            types: turned(&entry.types),
            predicates: turned(&entry.predicates),
            functions: turned(&entry.functions),
            objects: turned(&entry.objects),
        }
    }

    /// The same for what goes the other way.
    pub fn reversed(&self) -> Words {
        let reversed = |table: &BTreeMap<String, Name>| -> BTreeMap<String, Name> {
            table.iter().map(|(far, near)| (near.as_str().to_owned(), Name::new(far))).collect()
        };
        Words {
            types: reversed(&self.types),
            predicates: reversed(&self.predicates),
            functions: reversed(&self.functions),
            objects: reversed(&self.objects),
        }
    }
}

// === impl Passage ===

impl Passage {
    /// What a rule about an agent of the ecosystem `far` lets through.
    pub fn of(rule: &RuleEntry, far: &EcosystemId, way: Way) -> Option<Passage> {
        Some(Passage {
            agent: rule.agent.clone()?,
            mirror: rule.called.clone(),
            guard: Name::new(&format!("shared-with-{far}")),
            actions: turned(&rule.actions, way),
            costs: rule.costs.clone(),
        })
    }
}

/// Ours = theirs, as far = near.
fn turned(table: &BTreeMap<String, String>, way: Way) -> BTreeMap<String, Name> {
    let entry = |(ours, theirs): (&String, &String)| match way {
        Way::Import => (theirs.clone(), Name::new(ours)),
        Way::Export => (ours.clone(), Name::new(theirs)),
    };
    table.iter().map(entry).collect()
}
