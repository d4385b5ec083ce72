//! What could not be composed as its agent wrote it. The rest keeps working.

use std::fmt;

use acl::AgentId;
use pddl::Name;

/// Something of a model that is left out, and why. To be told to all the agents it names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Conflict {
    /// The agent whose word is left out; before it, the one whose word stands, if it is an
    /// agent's and not the ontology's or the map's.
    pub agents: Vec<AgentId>,
    /// What it is about.
    pub subject: Subject,
    /// Why, for a person.
    pub detail: String,
}

/// A part of a model.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Subject {
    /// Which kind of part.
    pub kind: Kind,
    /// Its name.
    pub name: Name,
}

/// The kinds of parts a model has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
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

// === impl Subject ===

impl Subject {
    pub(crate) fn new(kind: Kind, name: &Name) -> Subject {
        Subject { kind, name: name.clone() }
    }
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            Kind::Type => "type",
            Kind::Predicate => "predicate",
            Kind::Function => "function",
            Kind::Object => "object",
            Kind::Axiom => "axiom for",
            Kind::Action => "action",
            Kind::Fact => "fact about",
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
