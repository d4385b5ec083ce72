//! Why something was not taken: expected turns, answered on the wire, never panics.

use std::fmt;

use acl::content::{Reason, Refusal};
use acl::{AgentId, Incarnation};

/// Why a model, a heartbeat or a change was not taken. Nothing of it is believed.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Declined {
    /// The model describes another agent than the one that sent it.
    OtherAgent {
        /// Who sent it.
        sender: AgentId,
        /// Whom it describes.
        model: String,
    },
    /// The model builds on another ontology.
    OtherOntology {
        /// The one it names.
        named: String,
        /// The one that is shared here.
        shared: String,
    },
    /// A late report of a former life of the agent.
    FormerIncarnation {
        /// The agent.
        agent: AgentId,
        /// The life that reports.
        reported: Incarnation,
        /// The newest life known.
        current: Incarnation,
    },
    /// A heartbeat that is not newer than one already believed.
    OldSequence {
        /// The agent.
        agent: AgentId,
        /// Its number.
        reported: u64,
        /// The newest number believed.
        current: u64,
    },
    /// Nobody of this name, or of this life, has told its model yet.
    UnknownAgent {
        /// The agent.
        agent: AgentId,
    },
    /// It means nothing in the composite domain.
    Meaningless {
        /// Why, in the checker's words.
        detail: String,
    },
    /// The agent whose fact it is says otherwise.
    Owned {
        /// The fact that was to be believed, or not to be.
        fact: String,
        /// The agent that answers for it.
        owner: String,
        /// What that says instead, if anything.
        says: Option<String>,
    },
    /// Plans would cost less than nothing.
    NegativeCost {
        /// The fact that was to be believed.
        fact: String,
        /// What it gives a value.
        function: String,
    },
    /// Nobody offers such an action, or it is not withheld.
    UnknownAction {
        /// The action.
        action: String,
        /// Of whom it was said; `None`: of all.
        agent: Option<AgentId>,
        /// Whether it was to be given back.
        is_given_back: bool,
    },
    /// More than this maintainer takes.
    TooMany {
        /// Of what, in the plural.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
}

impl Declined {
    /// The reason for a program, as a `refuse` carries it.
    pub fn reason(&self) -> Reason {
        match self {
            Declined::OtherAgent { .. }
            | Declined::OtherOntology { .. }
            | Declined::Meaningless { .. }
            | Declined::NegativeCost { .. } => Reason::BadContent,
            Declined::Owned { .. } => Reason::Conflict,
            Declined::FormerIncarnation { .. } | Declined::OldSequence { .. } => Reason::OutOfTurn,
            Declined::UnknownAgent { .. } | Declined::UnknownAction { .. } => Reason::Unknown,
            Declined::TooMany { .. } => Reason::Busy,
        }
    }

    /// The content of a `refuse`.
    pub fn refusal(&self) -> Refusal {
        Refusal::new(self.reason(), self.to_string())
    }
}

impl fmt::Display for Declined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Declined::OtherAgent { sender, model } => write!(
                f,
                "the model describes `{model}` and was sent by `{sender}`; an agent describes \
                 itself: write `(define (agent {sender}) …)`"
            ),
            Declined::OtherOntology { named, shared } => write!(
                f,
                "the model builds on `{named}`, and this ecosystem shares `{shared}`; write \
                 `(:domain {shared})`"
            ),
            Declined::FormerIncarnation { agent, reported, current } => write!(
                f,
                "`{agent}` lives in incarnation {current}; incarnation {reported} is not believed"
            ),
            Declined::OldSequence { agent, reported, current } => write!(
                f,
                "heartbeat {reported} of `{agent}` came after heartbeat {current} and is not \
                 believed"
            ),
            Declined::UnknownAgent { agent } => {
                write!(f, "`{agent}` has not told its action model; ask it for the model first")
            }
            Declined::Meaningless { detail } => f.write_str(detail),
            Declined::Owned { fact, owner, says: Some(says) } => {
                write!(f, "`{owner}` answers for `{fact}`, and it says `{says}`")
            }
            Declined::Owned { fact, owner, says: None } => {
                write!(f, "`{owner}` answers for `{fact}`, and it does not say so")
            }
            Declined::NegativeCost { fact, function } => write!(
                f,
                "`{fact}` cannot be: what actions cost is made of `{function}`, which is 0 or more"
            ),
            Declined::UnknownAction { action, agent, is_given_back } => {
                let of = agent.as_ref().map(|agent| format!(" of `{agent}`")).unwrap_or_default();
                match is_given_back {
                    true => write!(f, "`{action}`{of} is not withheld; name it as it was withheld"),
                    false => write!(f, "nobody offers `{action}`{of}"),
                }
            }
            Declined::TooMany { what, limit } => {
                write!(f, "there are more {what} than the {limit} that are taken")
            }
        }
    }
}

impl std::error::Error for Declined {}
