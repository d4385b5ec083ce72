//! FIPA ACL, the language of agents: the envelope, its performatives and its contents.
//!
//! - [`Message`] is the envelope (FIPA SC00061; docs/design.md, “Messages”).
//! - [`content`] has the contents that the paper's roles send; PDDL is sent as text.
//! - [`Hello`] is the first input of a plugin that is a process of its own.
//! - [`fnv`] is the hash that several programs and releases must compute alike.
//! - [`codec`] writes and reads JSON. It extracts enough from an unreadable text to answer it.
//!
//! This crate leaves to others: which message may follow which (`conversation`), and the meaning of a
//! message, which the agent that processes the message decides (the paper, “Communication Protocols”).

pub mod codec;
pub mod content;
pub mod fnv;
mod hello;
mod message;
mod name;
mod performative;
#[cfg(test)]
mod schema;

pub use codec::{DecodeError, decode, encode, sender_of};
pub use hello::{Hello, HelloAgent, HostName};
pub use message::{
    ConversationId, Incarnation, Message, MessageId, Millis, Protocol, ReplyToken, SCHEMA_VERSION,
};
pub use name::{AgentId, DaemonId, EcosystemId, InvalidName};
pub use performative::Performative;
