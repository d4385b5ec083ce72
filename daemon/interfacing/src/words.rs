//! The vocabulary of one direction: the near name of each far symbol. Symbols without an entry do not pass.

use std::collections::BTreeMap;

use acl::{AgentId, EcosystemId};
use pddl::Name;

use crate::entry::{InterfaceEntry, RuleEntry};

/// Near names of far symbols.
///
/// *Far* is the side where an agent runs, *near* the side of its proxy agent.
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

/// Direction of a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// An agent of the other ecosystem is represented here.
    Import,
    /// An agent of this ecosystem is represented there.
    Export,
}

/// Content of one rule about an agent, from the far side to the near one.
#[derive(Clone, Debug, PartialEq)]
pub struct Passage {
    /// Far name of the agent.
    pub agent: AgentId,
    /// Name of its proxy agent.
    pub mirror: AgentId,
    /// Predicate that holds of the exported objects. Actions of the proxy agent require it, because each
    /// side has objects that the other does not know.
    pub guard: Name,
    /// Actions, far name = near name.
    pub actions: BTreeMap<String, Name>,
    /// Cost of an action in plans, by its near name.
    pub costs: BTreeMap<String, f64>,
}

// === impl Words ===

impl Words {
    /// Returns the vocabulary of an interface for one direction.
    pub fn of(entry: &InterfaceEntry, way: Way) -> Words {
        let turned = |table: &BTreeMap<String, String>| turned(table, way);
        Words {
            types: turned(&entry.types),
            predicates: turned(&entry.predicates),
            functions: turned(&entry.functions),
            objects: turned(&entry.objects),
        }
    }

    /// Returns the vocabulary for the opposite direction.
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
    /// Returns the content of a rule about an agent of the ecosystem `far`; `None` if the rule is about
    /// goals.
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

/// Converts a table “own = other” to “far = near”.
fn turned(table: &BTreeMap<String, String>, way: Way) -> BTreeMap<String, Name> {
    let entry = |(ours, theirs): (&String, &String)| match way {
        Way::Import => (theirs.clone(), Name::new(ours)),
        Way::Export => (ours.clone(), Name::new(theirs)),
    };
    table.iter().map(entry).collect()
}
