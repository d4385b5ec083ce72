//! The envelope (FIPA SC00061), with a message id, the sender's incarnation and a version.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::{AgentId, EcosystemId, Performative};

/// The version of the envelope this crate writes and reads.
pub const SCHEMA_VERSION: u32 = 1;

/// One ACL message.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// Version of the envelope; [`SCHEMA_VERSION`].
    pub version: u32,
    /// Unique among all messages of all agents; retries keep it.
    pub id: MessageId,
    /// Type of the communicative act.
    pub performative: Performative,
    /// Who speaks.
    pub sender: AgentId,
    /// Which life of the sender speaks.
    pub incarnation: Incarnation,
    /// Who is spoken to; empty means all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub receiver: Vec<AgentId>,
    /// What is said: see [`crate::content`].
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub content: Value,
    /// Language of the content: `pddl` where it holds PDDL text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub language: Option<String>,
    /// Ontology of the content: the name of the shared PDDL domain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ontology: Option<String>,
    /// The interaction protocol this message is a turn of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocol: Option<Protocol>,
    /// All messages about one goal share it.
    pub conversation_id: ConversationId,
    /// Names the exchange this message opens.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply_with: Option<ReplyToken>,
    /// Names the exchange this message continues, in either direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_reply_to: Option<ReplyToken>,
    /// How long an answer is waited for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply_by: Option<Deadline>,
    /// The ecosystems its sender comes from, the farthest first: empty for an agent of this one.
    /// What would come back to an ecosystem that stands here is not passed on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub via: Vec<EcosystemId>,
    /// Fields of a newer schema or a foreign tool: kept, and sent on as they came.
    #[serde(flatten)]
    pub unknown: Map<String, Value>,
}

/// The interaction protocols: which message may follow which is decided in `conversation`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Protocol {
    /// A user or an agent asks the Plan Requester for a goal.
    Goal,
    /// The Plan Requester asks the Planning Agent for a plan (centralised).
    Planning,
    /// The Plan Requester calls all for proposals (decentralised).
    ContractNet,
    /// The Plan Requester asks the Plan Executor to execute a plan.
    Execution,
    /// The Plan Executor asks an actuator to act.
    Action,
    /// Anyone asks the Domain Maintainer for a change of the state, the Plan Requester for another
    /// flow, or gives a Keyboard Agent a person's answer.
    StateChange,
    /// Anyone asks a person.
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
            /// Takes any text as it is.
            pub fn new(text: &str) -> $name {
                $name(Arc::from(text))
            }

            /// The text.
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
    /// Unique among all messages; what receipts name and duplicates are known by.
    MessageId
}
text_type! {
    /// Shared by all messages about one thing: one goal, from request to outcome.
    ConversationId
}
text_type! {
    /// Names one exchange between two agents within a conversation: the opening message carries
    /// it in `reply_with`, every later one, of both sides, in `in_reply_to`.
    ReplyToken
}

/// Which life of an agent: a restarted agent has a greater one.
///
/// Microseconds since the Unix epoch at the agent's start: unique enough on one name, ordered,
/// and below 2⁵³, so that a tool in JavaScript reads it exactly.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Incarnation(pub u64);

/// How long an answer is waited for, counted from the receipt of the message.
///
/// Relative (FIPA's `+` form), because the clocks of boards without a battery disagree. On the
/// wire: milliseconds.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(from = "u64", into = "u64")]
pub struct Deadline(pub Duration);

impl From<u64> for Deadline {
    fn from(milliseconds: u64) -> Deadline {
        Deadline(Duration::from_millis(milliseconds))
    }
}

impl From<Deadline> for u64 {
    fn from(deadline: Deadline) -> u64 {
        u64::try_from(deadline.0.as_millis()).unwrap_or(u64::MAX)
    }
}

impl fmt::Display for Incarnation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

// === impl Message ===

impl Message {
    /// The exchange this message belongs to: the one it continues, or else the one it opens.
    pub fn exchange(&self) -> Option<&ReplyToken> {
        self.in_reply_to.as_ref().or(self.reply_with.as_ref())
    }

    /// Whether the message opens an exchange.
    pub fn opens_exchange(&self) -> bool {
        self.in_reply_to.is_none() && self.reply_with.is_some()
    }

    /// Reads the content as `T`.
    ///
    /// # Errors
    ///
    /// If the content has another shape; the error is worth a `not-understood`.
    pub fn content_as<T: DeserializeOwned>(&self) -> Result<T, serde_json::Error> {
        T::deserialize(&self.content)
    }
}
