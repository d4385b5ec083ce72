//! The vocabulary of one direction of an interface: the near name of each far symbol. Symbols
//! without an entry do not pass.

use std::collections::BTreeMap;

use acl::{AgentId, EcosystemId};
use pddl::Name;

use crate::interface_config::{InterfaceEntry, RuleEntry};

/// Vocabulary of one direction: the name on the near side of each exported symbol of the far side.
///
/// *Far* is the side where an agent runs, *near* the side of its proxy agent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InterfaceVocabulary {
    /// Near names of types, by far name.
    pub types: BTreeMap<String, Name>,
    /// Near names of predicates, by far name.
    pub predicates: BTreeMap<String, Name>,
    /// Near names of functions, by far name.
    pub functions: BTreeMap<String, Name>,
    /// Near names of objects, by far name.
    pub objects: BTreeMap<String, Name>,
}

/// Direction of a rule: which ecosystem the represented agent belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RuleDirection {
    /// An agent of the other ecosystem is represented in this one.
    Import,
    /// An agent of this ecosystem is represented in the other.
    Export,
}

/// Content of one rule about an agent: the part of the agent that passes from the far to the near
/// side.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentMapping {
    /// Name of the agent on the far side.
    pub agent: AgentId,
    /// Name of the proxy agent on the near side.
    pub proxy: AgentId,
    /// Name of the predicate that holds for the exported objects only. It is a precondition of the
    /// proxy agent's actions, because the near side has further objects that the far side does not
    /// have.
    pub guard: Name,
    /// Actions that pass: far name = near name.
    pub actions: BTreeMap<String, Name>,
    /// Costs of actions in plans of the near side, by near name.
    pub costs: BTreeMap<String, f64>,
}

// === impl InterfaceVocabulary ===

impl InterfaceVocabulary {
    /// Returns the vocabulary of an interface for the direction `way`.
    pub fn of(entry: &InterfaceEntry, way: RuleDirection) -> InterfaceVocabulary {
        let turned = |table: &BTreeMap<String, String>| far_to_near(table, way);
        InterfaceVocabulary {
            types: turned(&entry.types),
            predicates: turned(&entry.predicates),
            functions: turned(&entry.functions),
            objects: turned(&entry.objects),
        }
    }

    /// Returns the vocabulary for the opposite direction, with far and near exchanged.
    pub fn reversed(&self) -> InterfaceVocabulary {
        let reversed = |table: &BTreeMap<String, Name>| -> BTreeMap<String, Name> {
            table.iter().map(|(far, near)| (near.as_str().to_owned(), Name::new(far))).collect()
        };
        InterfaceVocabulary {
            types: reversed(&self.types),
            predicates: reversed(&self.predicates),
            functions: reversed(&self.functions),
            objects: reversed(&self.objects),
        }
    }
}

// === impl AgentMapping ===

impl AgentMapping {
    /// Returns the content of a rule about an agent of the ecosystem `far`; `None` if the rule is
    /// about goals.
    pub fn of(rule: &RuleEntry, far: &EcosystemId, way: RuleDirection) -> Option<AgentMapping> {
        Some(AgentMapping {
            agent: rule.agent.clone()?,
            proxy: rule.proxy_name.clone(),
            guard: Name::new(&format!("shared-with-{far}")),
            actions: far_to_near(&rule.actions, way),
            costs: rule.costs.clone(),
        })
    }
}

/// Converts a table “own name = other name” to one “far name = near name”.
fn far_to_near(table: &BTreeMap<String, String>, way: RuleDirection) -> BTreeMap<String, Name> {
    let entry = |(ours, theirs): (&String, &String)| match way {
        RuleDirection::Import => (theirs.clone(), Name::new(ours)),
        RuleDirection::Export => (ours.clone(), Name::new(theirs)),
    };
    table.iter().map(entry).collect()
}
