//! FIPA ACL, the language agents converse in: the envelope, its performatives and its contents.
//!
//! - [`Message`] is the envelope (FIPA SC00061; design, “Messages”).
//! - [`content`] is what the paper's roles put inside it; PDDL travels there as text.
//! - [`Hello`] is what a daemon tells a plugin in a process of its own.
//! - [`codec`] is JSON in and out, and what can still be answered when a text cannot be read.
//!
//! Which message may follow which is decided in `conversation`; what a message means, by the
//! agent that processes it (the paper, “Communication Protocols”).

pub mod codec;
pub mod content;
mod hello;
mod message;
mod name;
mod performative;
#[cfg(test)]
mod schema;

pub use codec::{DecodeError, decode, encode, sender_of};
pub use hello::{Hello, HelloAgent, HostName};
pub use message::{
    ConversationId, Deadline, Incarnation, Message, MessageId, Protocol, ReplyToken, SCHEMA_VERSION,
};
pub use name::{AgentId, DaemonId, EcosystemId, InvalidName};
pub use performative::Performative;
