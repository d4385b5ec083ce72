//! Conflicts: parts of models that could not be composed as written. All other parts of the models
//! take effect.

use std::fmt;

use acl::AgentId;
use pddl::Name;

/// A part of a model that is left out of the composition, with the reason. The conflict must be
/// reported to all agents in `agents`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Conflict {
    /// The agents that the conflict concerns. The last one is the agent with the part that is left
    /// out. If the part in force belongs to another agent, and not to the ontology or the map, that
    /// agent comes before it.
    pub agents: Vec<AgentId>,
    /// The part of a model that is left out.
    pub subject: ModelPart,
    /// The reason why the part is left out, as text for a person.
    pub detail: String,
}

/// A part of a model, identified by its kind and its name.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ModelPart {
    /// Kind of the part, such as a type or an action.
    pub kind: ModelPartKind,
    /// Name of the type, predicate, function, object or action.
    pub name: Name,
}

/// The kinds of parts of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ModelPartKind {
    /// A declaration of a type.
    Type,
    /// A declaration of a predicate, with the axioms that derive the predicate.
    Predicate,
    /// A declaration of a function.
    Function,
    /// A declaration of an object.
    Object,
    /// An axiom for a predicate that the model does not declare.
    Axiom,
    /// A declaration of an action.
    Action,
    /// A fact, which is an element of `:init`.
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
