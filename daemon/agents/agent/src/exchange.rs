//! Types for the exchanges of an agent: the opening, the events for the initiator, the
//! participant's side, and a summary of the open exchanges.

use acl::{AgentId, ConversationId, Incarnation, Message, Performative, Protocol, ReplyToken};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::time::Instant;

/// First message of an exchange, without the fields that the Communication Agent adds.
#[derive(Clone, Debug)]
pub struct ExchangeOpening {
    /// Agent that receives the message; `None` for all agents.
    pub to: Option<AgentId>,
    /// Performative of the first message.
    pub performative: Performative,
    /// Protocol of the exchange.
    pub protocol: Protocol,
    /// Conversation that the exchange belongs to.
    pub conversation: ConversationId,
    /// Content of the first message.
    pub content: Value,
}

/// Event of an exchange, which the callback of the initiator gets.
#[derive(Clone, Debug)]
pub enum ExchangeEvent {
    /// A participant has sent a message that the protocol allows.
    Message(Box<Message>),
    /// The deadline has passed; the exchange is closed.
    TimedOut,
    /// A message of this agent could not be delivered; the exchange is closed.
    Undelivered(DeliveryError),
}

/// Reason why a message could not be delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeliveryError {
    /// No agent of the receiver's name appeared within the deadline.
    #[error("no agent of that name is here")]
    NotHere,
    /// The receiver left, and the grace has passed.
    #[error("it has left")]
    Left,
    /// The receiver was restarted; its new incarnation has no record of the message.
    #[error("it was restarted")]
    Restarted,
    /// The receiver is present, and sent neither a receipt nor an answer within the deadline.
    #[error("it gave no receipt in time")]
    NoReceipt,
    /// The outbox of this agent is full: too many messages wait for a receipt.
    #[error("too many messages are under way")]
    OutboxFull,
}

/// The participant's side of an exchange: the data that an answer needs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Participation {
    /// Initiator of the exchange.
    pub initiator: AgentId,
    /// Incarnation of the initiator. If the initiator has several replicas, the one that opened the
    /// exchange gets the answer. `None` means the oldest present agent of the initiator's name.
    #[serde(default, alias = "life")]
    pub incarnation: Option<Incarnation>,
    /// Token of the exchange.
    pub exchange: ReplyToken,
    /// Conversation that the exchange belongs to.
    pub conversation: ConversationId,
    /// Protocol of the exchange.
    pub protocol: Option<Protocol>,
}

/// The exchanges that an agent has opened and not closed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExchangeSummary {
    /// Number of open exchanges.
    pub open_count: usize,
    /// Earliest deadline among the open exchanges; `None` if no exchange is open.
    pub due: Option<Instant>,
}

impl Participation {
    /// Returns the participant's side of the exchange that `message` opened.
    ///
    /// A message of a foreign tool may name no exchange; then the id of the message takes the place
    /// of the token.
    pub fn of(message: &Message) -> Participation {
        let own_id = || ReplyToken::new(message.id.as_str());
        Participation {
            initiator: message.sender.clone(),
            incarnation: Some(message.incarnation),
            exchange: message.exchange().cloned().unwrap_or_else(own_id),
            conversation: message.conversation_id.clone(),
            protocol: message.protocol,
        }
    }
}
