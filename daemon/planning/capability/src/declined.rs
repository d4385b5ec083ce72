//! Reasons why a Domain Maintainer declines an input. These cases are expected: the sender receives
//! a `refuse`.

use std::fmt;

use acl::content::{Reason, Refusal};
use acl::{AgentId, Incarnation};

/// Reason why a model, a heartbeat or a change was declined. No part of the declined input takes
/// effect.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Declined {
    /// The model describes an agent other than the one that sent it.
    OtherAgent {
        /// The agent that sent the model.
        sender: AgentId,
        /// The agent that the model describes.
        model: String,
    },
    /// The model is based on an ontology other than the shared one.
    OtherOntology {
        /// The ontology on which the model is based.
        named: String,
        /// The ontology that the agents of this ecosystem share.
        shared: String,
    },
    /// The message is late: a former incarnation of the agent sent it.
    FormerIncarnation {
        /// The agent that sent the message.
        agent: AgentId,
        /// The incarnation that sent the message.
        reported: Incarnation,
        /// The newest known incarnation of the agent.
        current: Incarnation,
    },
    /// The heartbeat is not newer than an earlier one.
    OldSequence {
        /// The agent that sent the heartbeat.
        agent: AgentId,
        /// The number of the heartbeat.
        reported: u64,
        /// The number of the newest heartbeat received.
        current: u64,
    },
    /// This incarnation of the agent has not announced its action model.
    UnknownAgent {
        /// The agent without an announced action model.
        agent: AgentId,
    },
    /// The input does not fit the composite domain.
    Meaningless {
        /// The message of the checker, as text for a person.
        detail: String,
    },
    /// An agent that is responsible for the fact contradicts the change.
    Owned {
        /// The fact that the sender wanted to be believed or retracted.
        fact: String,
        /// The agent that is responsible for the fact.
        owner: String,
        /// The contradicting fact that the responsible agent reports; `None` if it reports none.
        says: Option<String>,
    },
    /// The change would make the cost of plans negative.
    NegativeCost {
        /// The fact that the sender wanted to be believed.
        fact: String,
        /// The function that would get a negative value.
        function: String,
    },
    /// None of the named agents offers the action, or a request to give back an action names one
    /// that is not withheld.
    UnknownAction {
        /// The name of the action in the request.
        action: String,
        /// The agent named in the request; `None` if the request was about all agents.
        agent: Option<AgentId>,
        /// Whether the request was to give the action back; `false` if it was to withhold the
        /// action.
        is_given_back: bool,
    },
    /// The input exceeds one of the maintainer's limits.
    TooMany {
        /// The kind of thing of which there are too many, in the plural.
        what: &'static str,
        /// The limit that the input exceeds.
        limit: usize,
    },
}

impl Declined {
    /// Returns the reason as the code that a `refuse` carries for programs.
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

    /// Returns this reason as the content of a `refuse`.
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
