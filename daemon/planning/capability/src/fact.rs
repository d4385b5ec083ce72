//! Facts, independent of the agents that claim them.

use std::fmt;
use std::sync::Arc;

use acl::AgentId;
use pddl::{Atom, FluentTerm, InitElement, Name, Number, Span, Term};

/// Kind of symbol that a fact is about: a predicate or a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum FactSymbolKind {
    Predicate,
    Function,
}

/// The identity of a fact, which does not include its value: a predicate or a function, and the
/// arguments.
///
/// A key is cheap to clone: several tables of each maintainer contain it, and a machine may run
/// many maintainers.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct FactKey(Arc<FactTerm>);

#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct FactTerm {
    space: FactSymbolKind,
    symbol: Name,
    arguments: Box<[Name]>,
}

/// The value that a claim states for a fact. A false fact has no value, because no owner claims it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FactValue {
    /// The fact of a predicate is true.
    True,
    /// The fact of a predicate is neither known to be true nor known to be false.
    Unknown,
    /// The value of the function is this number.
    Number(Number),
}

/// Meaning of an element of `:init`, as a statement about a fact.
pub(crate) enum FactStatement {
    /// The fact or function has the given value.
    Is(FactKey, FactValue),
    /// The fact is false.
    Not(FactKey),
    /// The element is no fact that can be believed: it contains a variable, or is about a time
    /// other than the start.
    Unusable,
}

/// The owner of a claim: the agent or the map that is responsible for whether the fact holds.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Owner {
    /// The map. The fact holds until a request changes it.
    Map,
    /// An agent. The fact is removed when the agent is removed.
    Agent(AgentId),
}

/// The source of a claim: how the Domain Maintainer came to know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum ClaimSource {
    /// The claim comes from the `:init` of a model or of the map.
    Model,
    /// The claim comes from a heartbeat of the owner.
    Heartbeat,
    /// The claim is an effect of a confirmed action.
    Effect,
    /// The claim comes from a request to change the state.
    Request,
    /// The claim is an observation that the owner sent.
    Observation,
    /// The fact is claimed to be unknown, because the agent that was responsible for it has left.
    Departure,
    /// The central Domain Maintainer has sent this claim, which a different owner makes.
    Announced,
}

// === impl FactKey ===

impl FactKey {
    fn new(space: FactSymbolKind, symbol: &Name, arguments: &[Term]) -> Option<FactKey> {
        let arguments = arguments
            .iter()
            .map(|term| match term {
                Term::Object(name) => Some(name.clone()),
                Term::Variable(_) => None,
            })
            .collect::<Option<_>>()?;
        Some(FactKey(Arc::new(FactTerm { space, symbol: symbol.clone(), arguments })))
    }

    /// Returns the key of a predicate's fact; `None` if an argument is a variable.
    pub(crate) fn of_predicate(symbol: &Name, arguments: &[Term]) -> Option<FactKey> {
        FactKey::new(FactSymbolKind::Predicate, symbol, arguments)
    }

    /// Returns a lower bound of the keys of all facts of the symbol, for searches in sorted tables.
    pub(crate) fn first_of(space: FactSymbolKind, symbol: &Name) -> FactKey {
        FactKey(Arc::new(FactTerm { space, symbol: symbol.clone(), arguments: Box::default() }))
    }

    /// Whether the fact is about the given symbol.
    pub(crate) fn is_of(&self, space: FactSymbolKind, symbol: &Name) -> bool {
        self.space() == space && self.symbol() == symbol
    }

    pub(crate) fn space(&self) -> FactSymbolKind {
        self.0.space
    }

    pub(crate) fn symbol(&self) -> &Name {
        &self.0.symbol
    }

    pub(crate) fn arguments(&self) -> &[Name] {
        &self.0.arguments
    }

    /// Returns the element of `:init` that states `value` for this fact.
    pub(crate) fn element(&self, value: FactValue) -> InitElement {
        let arguments = self.arguments().iter().cloned().map(Term::Object).collect();
        let span = Span::default();
        match value {
            FactValue::True => {
                InitElement::Atom(Atom { predicate: self.symbol().clone(), arguments, span })
            }
            FactValue::Unknown => {
                InitElement::Unknown(Atom { predicate: self.symbol().clone(), arguments, span })
            }
            FactValue::Number(number) => {
                let function = self.symbol().clone();
                InitElement::Assign(FluentTerm { function, arguments, span }, number)
            }
        }
    }
}

// === impl FactStatement ===

impl FactStatement {
    pub(crate) fn of(element: &InitElement) -> FactStatement {
        let atom_key =
            |atom: &Atom| FactKey::new(FactSymbolKind::Predicate, &atom.predicate, &atom.arguments);
        let statement = match element {
            InitElement::Atom(atom) => {
                atom_key(atom).map(|key| FactStatement::Is(key, FactValue::True))
            }
            InitElement::Not(atom) => atom_key(atom).map(FactStatement::Not),
            InitElement::Unknown(atom) => {
                atom_key(atom).map(|key| FactStatement::Is(key, FactValue::Unknown))
            }
            InitElement::Assign(fluent, number) => {
                FactKey::new(FactSymbolKind::Function, &fluent.function, &fluent.arguments)
                    .map(|key| FactStatement::Is(key, FactValue::Number(*number)))
            }
            InitElement::At(..) => None,
        };
        statement.unwrap_or(FactStatement::Unusable)
    }
}

// === impl Owner ===

impl fmt::Display for Owner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Owner::Map => f.pad("the map"),
            Owner::Agent(agent) => agent.fmt(f),
        }
    }
}

impl From<AgentId> for Owner {
    fn from(agent: AgentId) -> Owner {
        Owner::Agent(agent)
    }
}
