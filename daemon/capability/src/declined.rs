//! Reasons why an input was declined. These are expected cases: they are answered with `refuse`.

use std::fmt;

use acl::content::{Reason, Refusal};
use acl::{AgentId, Incarnation};

/// The reason why a model, a heartbeat or a change was declined. No part of it takes effect.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Declined {
    /// The model describes another agent than the one that sent it.
    OtherAgent {
        /// The agent that sent it.
        sender: AgentId,
        /// The agent that it describes.
        model: String,
    },
    /// The model builds on another ontology.
    OtherOntology {
        /// The ontology that it names.
        named: String,
        /// The ontology that is shared here.
        shared: String,
    },
    /// A late message of a former incarnation of the agent.
    FormerIncarnation {
        /// The agent.
        agent: AgentId,
        /// The incarnation that sent the message.
        reported: Incarnation,
        /// The newest incarnation known.
        current: Incarnation,
    },
    /// A heartbeat that is not newer than one received before.
    OldSequence {
        /// The agent.
        agent: AgentId,
        /// The number of the heartbeat.
        reported: u64,
        /// The number of the newest heartbeat received.
        current: u64,
    },
    /// No agent of this name, or not this incarnation of it, has announced its model yet.
    UnknownAgent {
        /// The agent.
        agent: AgentId,
    },
    /// The input has no meaning in the composite domain.
    Meaningless {
        /// The reason, as the checker states it.
        detail: String,
    },
    /// An agent that is responsible for the fact reports otherwise.
    Owned {
        /// The fact that was to be believed or retracted.
        fact: String,
        /// The agent that is responsible for it.
        owner: String,
        /// The contradicting fact that the agent reports; `None` if it reports none.
        says: Option<String>,
    },
    /// The cost of plans would become negative.
    NegativeCost {
        /// The fact that was to be believed.
        fact: String,
        /// The function that would get a negative value.
        function: String,
    },
    /// No agent concerned offers such an action, or the action is not withheld.
    UnknownAction {
        /// The action.
        action: String,
        /// The agent named in the request; `None` if the request was about all agents.
        agent: Option<AgentId>,
        /// Whether the action was to be given back, rather than withheld.
        is_given_back: bool,
    },
    /// The input exceeds a limit of this maintainer.
    TooMany {
        /// The things that are limited, in the plural.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
}

impl Declined {
    /// Returns the reason in the form for programs, as a `refuse` carries it.
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

    /// Returns the content of a `refuse`.
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
                "`{agent}` is in incarnation {current}; incarnation {reported} is not believed"
            ),
            Declined::OldSequence { agent, reported, current } => write!(
                f,
                "heartbeat {reported} of `{agent}` came after heartbeat {current} and is not \
                 believed"
            ),
            Declined::UnknownAgent { agent } => {
                write!(
                    f,
                    "`{agent}` has not announced its action model; ask it for the model first"
                )
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
                "`{fact}` cannot be: `{function}` is part of the cost of actions, which is 0 or more"
            ),
            Declined::UnknownAction { action, agent, is_given_back } => {
                let of = agent.as_ref().map(|agent| format!(" of `{agent}`")).unwrap_or_default();
                match is_given_back {
                    true => write!(f, "`{action}`{of} is not withheld; name it as it was withheld"),
                    false => write!(f, "no agent offers `{action}`{of}"),
                }
            }
            Declined::TooMany { what, limit } => {
                write!(f, "there are more {what} than the {limit} that are taken")
            }
        }
    }
}

impl std::error::Error for Declined {}
