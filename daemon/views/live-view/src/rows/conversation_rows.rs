//! Conversations, their messages, and the activity of the ecosystem in sentences.

use acl::{AgentId, ConversationId, Performative, Protocol};
use serde::Serialize;

use crate::moment::Moment;

/// How notable an activity is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ActivityLevel {
    /// The activity is a part of ordinary work.
    #[default]
    Routine,
    /// The activity begins or ends something that people care about.
    Notable,
    /// Something went wrong.
    Problem,
}

/// Something that happened, as a sentence.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ActivityEntry {
    /// Number of the entry among all entries so far, from 1.
    pub number: u64,
    /// Moment at which it was observed.
    pub at: Moment,
    /// How notable it is.
    pub level: ActivityLevel,
    /// The sentence, without a full stop.
    pub text: String,
    /// The conversation in which it happened; `None` if it happened outside any.
    pub conversation: Option<ConversationId>,
    /// The agent that the sentence is about; `None` if it is about none.
    pub agent: Option<AgentId>,
}

/// One conversation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConversationRow {
    /// The conversation.
    pub conversation: ConversationId,
    /// What the conversation is about: a goal, a question, an action; empty if that is not known.
    pub subject: String,
    /// The protocols of its messages.
    pub protocols: Vec<Protocol>,
    /// Moment of the first observed message.
    pub first_at: Moment,
    /// Moment of the last observed message.
    pub last_at: Moment,
    /// Number of observed messages.
    pub messages: u64,
    /// Number of agents that have sent a message.
    pub participants: u64,
    /// Number of messages that broke their protocol.
    pub out_of_turn: u64,
}

/// One conversation with its messages: the rows of a sequence diagram.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConversationDetail {
    /// The conversation.
    pub row: ConversationRow,
    /// The agents that take part, in the order in which they first appear.
    pub lanes: Vec<AgentId>,
    /// The messages, oldest first.
    pub messages: Vec<MessageRow>,
    /// Number of older messages, which are not kept.
    pub dropped: u64,
}

/// One message of a conversation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MessageRow {
    /// Moment at which the message was observed.
    pub at: Moment,
    /// The sender.
    pub from: AgentId,
    /// The receivers; empty if the message went to all.
    pub to: Vec<AgentId>,
    /// The performative.
    pub performative: Performative,
    /// The protocol; `None` for a message outside any.
    pub protocol: Option<Protocol>,
    /// The content in a few words, on one line. The answer of a person is never part of it.
    pub summary: String,
    /// How the message breaks its protocol, as text for a person; `None` if it does not.
    pub out_of_turn: Option<String>,
}
