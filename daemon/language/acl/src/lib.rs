//! FIPA ACL, the language of agents: the envelope, its performatives and its contents.
//!
//! - [`Message`] is the envelope (FIPA SC00061; docs/design.md, “Messages”).
//! - [`content`] has the contents of the messages between the paper's roles; PDDL is sent as text.
//! - [`Hello`] is the first input of a plugin that runs as a process.
//! - [`fnv`] is the hash function for values that several programs and releases must compute.
//! - [`codec`] converts messages to and from JSON. From an unreadable text it extracts the fields
//!   that an answer needs.
//!
//! The crate `conversation` decides which message may follow which. The agent that processes a
//! message decides its meaning (the paper, “Communication Protocols”).

pub mod codec;
pub mod content;
pub mod fnv;
mod hello;
mod message;
mod name;
mod performative;
#[cfg(test)]
mod schema;

pub use codec::{DecodeError, IDENTIFIER_BYTES_MAX, decode, encode, sender_of};
pub use hello::{Hello, HelloAgent, HostName};
pub use message::{
    ConversationId, Incarnation, Message, MessageId, Millis, Protocol, ReplyToken, SCHEMA_VERSION,
};
pub use name::{AgentId, DaemonId, EcosystemId, InvalidName};
pub use performative::Performative;
