//! The envelope of a message (FIPA SC00061), with three additional fields: a message identifier,
//! the sender's incarnation and a version.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::{AgentId, EcosystemId, Performative};

/// Version of the envelope that this crate writes and reads.
pub const SCHEMA_VERSION: u32 = 2;

/// One ACL message.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// Version of the envelope: [`SCHEMA_VERSION`].
    pub version: u32,
    /// Identifier of the message, unique among all messages of all agents; a retry has the same
    /// identifier.
    pub id: MessageId,
    /// Performative of the message: the type of the communicative act.
    pub performative: Performative,
    /// The agent that sends the message.
    pub sender: AgentId,
    /// Incarnation of the sender.
    pub incarnation: Incarnation,
    /// The agents that the message is for; empty for a broadcast to all agents.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub receiver: Vec<AgentId>,
    /// Content of the message; see [`crate::content`].
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub content: Value,
    /// Language of the content: `pddl` if the content contains PDDL text; otherwise `None`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub language: Option<String>,
    /// Ontology of the content: the name of the shared PDDL domain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ontology: Option<String>,
    /// The interaction protocol of the message; `None` for a message outside any protocol.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocol: Option<Protocol>,
    /// Identifier of the conversation, which all messages about one goal share.
    pub conversation_id: ConversationId,
    /// Token of the exchange that this message opens; `None` if it opens none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply_with: Option<ReplyToken>,
    /// Token of the exchange that this message continues; `None` if it continues none. Unlike in
    /// FIPA, both sides use the same token in all messages after the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_reply_to: Option<ReplyToken>,
    /// Time within which an answer is useful, counted from the receipt of the message. FIPA has
    /// `reply_by` instead, a point in time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply_within: Option<Millis>,
    /// Ecosystems through which the message's sender is represented here, the farthest first; empty
    /// if the sender is an agent of this ecosystem. Messages and facts of the sender are not sent
    /// to an ecosystem in this list, so that they cannot return there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub via: Vec<EcosystemId>,
    /// Fields of the envelope that this version does not define. They are kept and sent on
    /// unchanged.
    #[serde(flatten)]
    pub unknown: Map<String, Value>,
}

/// Interaction protocol. The crate `conversation` defines which message may follow which.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Protocol {
    /// A user or an agent requests a goal from the Plan Requester.
    Goal,
    /// The Plan Requester requests a plan from the Planning Agent (in centralised mode).
    Planning,
    /// The Plan Requester calls all actuators for proposals (in decentralised mode).
    ContractNet,
    /// The Plan Requester requests the execution of a plan from the Plan Executor.
    Execution,
    /// The Plan Executor requests an action from an actuator.
    Action,
    /// Requests that get one answer: a change of the state from the Domain Maintainer, a change of
    /// the planning mode from the Plan Requester, a person's answer to a Keyboard Agent, or a page
    /// of the history from a history agent.
    StateChange,
    /// An agent asks a person a question.
    Query,
}

macro_rules! text_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(Arc<str>);

        impl $name {
            /// Creates the identifier from any text, without a check.
            pub fn new(text: &str) -> $name {
                $name(Arc::from(text))
            }

            /// Returns the identifier as text.
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(&self.0)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Debug::fmt(&*self.0, f)
            }
        }
    };
}

text_type! {
    /// Identifier of a message, unique among all messages. Used in receipts and to detect
    /// duplicates.
    MessageId
}
text_type! {
    /// Identifier of a conversation, which all messages about one matter share: for example one
    /// goal from its request to its outcome.
    ConversationId
}
text_type! {
    /// Identifier of one exchange between two agents within a conversation. The first message has
    /// it in `reply_with`; each later message of both sides has it in `in_reply_to`.
    ReplyToken
}

/// Beginning of the conversations of goals of the ecosystem file, before the name of the goal.
const FILE_GOAL: &str = "goals.";

impl ConversationId {
    /// Returns the conversation of a goal of the ecosystem file that is asked for by itself.
    pub fn of_file_goal(name: &str) -> ConversationId {
        ConversationId::new(&format!("{FILE_GOAL}{name}"))
    }

    /// Returns the agent that has opened the conversation, as its name says; `None` if the
    /// conversation is that of a goal of the ecosystem file.
    pub fn opener(&self) -> Option<&str> {
        let text = self.as_str();
        let (agent, rest) = text.split_once('.').unwrap_or((text, ""));
        let is_number = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
        // An agent may have any name, and numbers its conversations.
        let is_of_agent = rest.split('.').all(is_number);
        (is_of_agent || !text.starts_with(FILE_GOAL)).then_some(agent)
    }
}

/// Number of an agent's incarnation. A restarted agent has a greater number than before.
///
/// The number is the time of the agent's start, in microseconds since the Unix epoch. It is
/// practically unique for one name, and later starts have greater numbers. All numbers are below
/// 2⁵³, so that a program in JavaScript reads them exactly.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Incarnation(pub u64);

/// A duration, sent as a number of milliseconds.
///
/// Messages contain durations, and no points in time, because the clocks of boards without a
/// battery differ.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(from = "u64", into = "u64")]
pub struct Millis(pub Duration);

impl From<u64> for Millis {
    fn from(milliseconds: u64) -> Millis {
        Millis(Duration::from_millis(milliseconds))
    }
}

impl From<Millis> for u64 {
    fn from(duration: Millis) -> u64 {
        u64::try_from(duration.0.as_millis()).unwrap_or(u64::MAX)
    }
}

impl fmt::Display for Incarnation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

// === impl Message ===

impl Message {
    /// Returns the token of the message's exchange: the exchange that it continues, or else the
    /// exchange that it opens. Returns `None` for a message outside any exchange.
    pub fn exchange(&self) -> Option<&ReplyToken> {
        self.in_reply_to.as_ref().or(self.reply_with.as_ref())
    }

    /// Whether the message opens an exchange.
    pub fn opens_exchange(&self) -> bool {
        self.in_reply_to.is_none() && self.reply_with.is_some()
    }

    /// Parses the content as `T`.
    ///
    /// # Errors
    ///
    /// Returns an error if the content does not have the shape of `T`. Such a message should be
    /// answered with `not-understood`.
    pub fn content_as<T: DeserializeOwned>(&self) -> Result<T, serde_json::Error> {
        T::deserialize(&self.content)
    }
}
