//! Conflicts: parts of models that could not be composed as written. All other parts take effect.

use std::fmt;

use acl::AgentId;
use pddl::Name;

/// A part of a model that is left out, and the reason. Must be sent to all agents in `agents`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Conflict {
    /// The agent of the part that is left out, preceded by the agent of the part in force, unless that is
    /// the part of the ontology or the map.
    pub agents: Vec<AgentId>,
    /// The part that is left out.
    pub subject: ModelPart,
    /// The reason, for a person.
    pub detail: String,
}

/// A part of a model, by kind and name.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ModelPart {
    /// The kind of the part.
    pub kind: ModelPartKind,
    /// The name of the part.
    pub name: Name,
}

/// The kinds of parts of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ModelPartKind {
    /// A type.
    Type,
    /// A predicate, with the axioms that derive it.
    Predicate,
    /// A function.
    Function,
    /// An object.
    Object,
    /// An axiom for a predicate that the model does not declare.
    Axiom,
    /// An action.
    Action,
    /// An element of `:init`.
    Fact,
}

// === impl ModelPart ===

impl ModelPart {
    pub(crate) fn new(kind: ModelPartKind, name: &Name) -> ModelPart {
        ModelPart { kind, name: name.clone() }
    }
}

impl fmt::Display for ModelPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            ModelPartKind::Type => "type",
            ModelPartKind::Predicate => "predicate",
            ModelPartKind::Function => "function",
            ModelPartKind::Object => "object",
            ModelPartKind::Axiom => "axiom for",
            ModelPartKind::Action => "action",
            ModelPartKind::Fact => "fact about",
        };
        write!(f, "{kind} `{}`", self.name)
    }
}

// === impl Conflict ===

impl fmt::Display for Conflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Conflict { agents, subject, detail } = self;
        let names: Vec<String> = agents.iter().map(|agent| format!("`{agent}`")).collect();
        write!(f, "{subject} of {}: {detail}", names.join(" and "))
    }
}
