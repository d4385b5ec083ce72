//! Transport of messages (the paper, “Shared Communication Channel”): the trait through which
//! Communication Agents send, and a substrate within one process.
//!
//! - [`Substrate`] is the sending side of a daemon, [`Inbound`] is its receiving side.
//! - [`faulty`] carries messages within one process over links that lose, double, delay and break,
//!   as a seed decides.
//! - [`memory`] carries messages within one process; `substrate-zenoh` carries them between
//!   machines. The same agents run unchanged on both.
//! - [`ForwardingSubstrate`] is a substrate in front of another, which counts, loses or records messages.
//!
//! A substrate promises little: a message may be lost, late or doubled, and presence may be wrong
//! for the length of a lease. Receipts, retries and the removal of duplicates are left to the
//! Communication Agent.

pub mod faulty;
mod forwarding;
pub mod memory;
#[cfg(test)]
mod recording_inbound;

use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation, Performative};
use bytes::Bytes;
use serde::{Deserialize, Serialize};

pub use crate::forwarding::ForwardingSubstrate;

/// A future that a trait object can return.
pub type BoxFuture<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// The sending side of a daemon. Sending never blocks: it hands the message over, and promises no
/// delivery.
pub trait Substrate: Send + Sync + 'static {
    /// Sends to one agent.
    ///
    /// # Errors
    ///
    /// Returns an error if the substrate is closed or refuses the message. Success does not mean
    /// delivery.
    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError>;

    /// Sends to all: the paper's global topic per message type.
    ///
    /// # Errors
    ///
    /// As [`Substrate::send`].
    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError>;

    /// Sends an agent's action model or heartbeat to all.
    ///
    /// # Errors
    ///
    /// As [`Substrate::send`].
    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError>;

    /// Sends the heartbeats of several agents to all: each as [`Substrate::broadcast_state`] does, but at the
    /// cost of one message where that is possible.
    ///
    /// # Errors
    ///
    /// As [`Substrate::send`].
    fn broadcast_heartbeats(&self, beats: Vec<(AgentId, Bytes)>) -> Result<(), SendError> {
        beats.into_iter().try_for_each(|(sender, payload)| self.broadcast_state(&sender, payload))
    }

    /// Makes an agent present until the returned token is dropped or the process dies.
    ///
    /// # Errors
    ///
    /// Returns an error if the substrate is closed.
    fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError>;

    /// Queries daemons for a resource. Resolves to all answers that come within `timeout`, which
    /// may be none.
    fn ask(&self, question: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>>;

    /// Completes when every daemon that is present now receives this daemon's broadcasts, or soon
    /// if some of them never will. A sender that joins, broadcasts once and leaves must wait for
    /// it. An agent must have been announced before.
    fn broadcast_ready(&self) -> BoxFuture<()> {
        Box::pin(std::future::ready(()))
    }

    /// Closes the substrate: what is still queued may go out, nothing comes in any more.
    fn close(&self) -> BoxFuture<()>;
}

/// The receiving side of a daemon. Called on the substrate's own threads: must not block.
pub trait Inbound: Send + Sync + 'static {
    /// Called when a message has arrived.
    fn deliver(&self, delivery: Delivery);

    /// Called when an agent has joined or left.
    fn presence(&self, presence: Presence);

    /// Called when a daemon queries a resource. Dropping the question gives no answer.
    fn receive_query(&self, question: ReceivedQuery);

    /// Called when something was rejected and is not passed on. By default this is not recorded.
    fn rejected(&self, _rejected: &Rejected<'_>) {}

    /// Whether the origin of an answer may give it. By default every answer is admitted.
    fn accepts_answer(&self, _answer: &Answer<'_>) -> bool {
        true
    }
}

/// Origin of a message, as its signature proves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Daemon that sent the message, or a guest of one.
    pub daemon: DaemonId,
    /// Daemon with the key that signed the message: the same daemon, or the host of the guest.
    pub signing_daemon: DaemonId,
}

/// Something that arrived and was rejected.
#[derive(Clone, Copy, Debug)]
pub struct Rejected<'r> {
    /// Kind of the violation.
    pub violation: ViolationKind,
    /// Description that continues the sentence “the message …”.
    pub detail: &'r str,
    /// Name of the claimed sender, as far as it is known.
    pub claimed: Option<&'r str>,
    /// Address or key that it arrived under, in the form that the substrate uses.
    pub key: &'r str,
}

/// Kind of violation by something that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ViolationKind {
    /// The message is not signed.
    Unsigned,
    /// The signer is not known to the ecosystem, or is not known any more.
    Unknown,
    /// The message was changed, or names another sender than its signer.
    Forged,
    /// The message was received before.
    Replayed,
    /// The certificate was revoked.
    Revoked,
    /// The sender sends too much.
    Flooded,
    /// The origin has no right to send this.
    Unauthorized,
    /// The message is longer than allowed.
    Oversized,
    /// An announcement or heartbeat cannot be read, or cannot be accepted.
    NotUnderstood,
    /// A daemon wanted to connect and showed no certificate that is valid here.
    RefusedLink,
}

/// An answer to a query, with its origin.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// Origin of the answer.
    pub origin: &'a Origin,
    /// Resource that was queried.
    pub resource: Resource,
    /// Agent that was asked, if the resource has one value per agent.
    pub agent: Option<&'a AgentId>,
    /// Content of the answer.
    pub payload: &'a [u8],
}

/// Address of an agent.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AgentAddress {
    /// The daemon that hosts it.
    pub daemon: DaemonId,
    /// The agent.
    pub agent: AgentId,
}

/// Kind of a message to one agent, known without decoding it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Subject {
    /// An ACL message.
    Message(Performative),
    /// Receipts: the receiver's Communication Agent has received messages. This is no ACL message;
    /// the payload is a JSON list of the ids of the messages.
    Receipt,
}

/// A message that has arrived.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// Address of the message.
    pub destination: Destination,
    /// The bytes as they were sent.
    pub payload: Bytes,
    /// Origin proved by the signature; `None` if messages are not signed.
    pub origin: Option<Origin>,
}

/// Address of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// To one agent of this daemon.
    To(AgentId, Subject),
    /// To all agents, from this sender.
    All(AgentId, Performative),
    /// An action model or a heartbeat, from this sender.
    AgentState(AgentId),
}

/// One incarnation of an agent at one daemon.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Resident {
    /// The agent.
    pub agent: AgentId,
    /// The daemon that hosts it.
    pub daemon: DaemonId,
    /// Incarnation of the agent.
    pub incarnation: Incarnation,
}

/// Change of the membership, as this daemon sees it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Presence {
    /// The process that hosts this agent runs and can be reached.
    Joined(Resident),
    /// The agent cannot be reached from here any more.
    Left(Resident),
}

/// Resource that a daemon can be queried for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Resource {
    /// The agents that a daemon hosts.
    Directory,
    /// The composite domain.
    Domain,
    /// The state of the world as believed, with provenance.
    State,
    /// Goals and their progress.
    Goals,
    /// The action model of one agent, or of all.
    Model,
    /// Fill levels of the mailboxes of a daemon's agents.
    Mailbox,
    /// Questions to people that have no answer yet.
    Questions,
    /// The records that a Journal keeps.
    Journal,
    /// The plugins of a daemon that run as processes, and their state.
    Plugins,
    /// Discovered agents, which no file names.
    Discovered,
    /// Digests of the domain and the map that a daemon has read.
    Files,
}

/// A query to daemons.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResourceQuery {
    /// Daemon to ask; `None` asks all.
    pub daemon: Option<DaemonId>,
    /// Resource to ask for.
    pub resource: Resource,
    /// Agent to ask, if the resource has one value per agent.
    pub agent: Option<AgentId>,
}

/// A query that has arrived.
pub struct ReceivedQuery {
    /// Resource that is asked for.
    pub resource: Resource,
    /// Agent that is asked; `None` for all.
    pub agent: Option<AgentId>,
    /// Gives one answer; may be called more than once, and not at all.
    pub answer: Arc<dyn Fn(Bytes) + Send + Sync>,
}

/// Keeps an agent present until it is dropped.
pub struct PresenceToken(Option<Box<dyn FnOnce() + Send + Sync>>);

/// Reason why a message could not be handed over.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SendError {
    /// The substrate is closed.
    #[error("send on a closed substrate")]
    Closed,
    /// The message is longer than allowed.
    #[error("send {bytes} bytes: a message has at most {bytes_max}")]
    TooLong {
        /// Length of the message, in bytes.
        bytes: usize,
        /// Longest allowed length, in bytes.
        bytes_max: usize,
    },
    /// The substrate refused the message.
    #[error("send: {0}")]
    Declined(String),
}

impl PresenceToken {
    /// Creates a token that runs `withdraw` when it is dropped.
    pub fn new(withdraw: impl FnOnce() + Send + Sync + 'static) -> PresenceToken {
        PresenceToken(Some(Box::new(withdraw)))
    }
}

impl Drop for PresenceToken {
    fn drop(&mut self) {
        if let Some(withdraw) = self.0.take() {
            withdraw();
        }
    }
}

impl fmt::Debug for PresenceToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("PresenceToken")
    }
}

impl Presence {
    /// Returns the agent that has joined or left.
    pub fn resident(&self) -> &Resident {
        match self {
            Presence::Joined(resident) | Presence::Left(resident) => resident,
        }
    }
}

impl ViolationKind {
    /// Returns the name, for people and for programs that count.
    pub fn as_str(self) -> &'static str {
        match self {
            ViolationKind::Unsigned => "unsigned",
            ViolationKind::Unknown => "unknown",
            ViolationKind::Forged => "forged",
            ViolationKind::Replayed => "replayed",
            ViolationKind::Revoked => "revoked",
            ViolationKind::Flooded => "flooded",
            ViolationKind::Unauthorized => "overstepped",
            ViolationKind::Oversized => "oversized",
            ViolationKind::NotUnderstood => "not-understood",
            ViolationKind::RefusedLink => "unlinked",
        }
    }
}

impl Resource {
    /// All resources.
    pub const ALL: [Resource; 11] = [
        Resource::Directory,
        Resource::Domain,
        Resource::State,
        Resource::Goals,
        Resource::Model,
        Resource::Mailbox,
        Resource::Questions,
        Resource::Journal,
        Resource::Plugins,
        Resource::Discovered,
        Resource::Files,
    ];

    /// Whether only the leader answers, if an agent has several replicas.
    pub fn is_answered_by_leader(self) -> bool {
        matches!(self, Resource::Domain | Resource::State | Resource::Goals)
    }

    /// Returns the name, as one chunk of a key expression.
    pub fn as_str(self) -> &'static str {
        match self {
            Resource::Directory => "directory",
            Resource::Domain => "domain",
            Resource::State => "state",
            Resource::Goals => "goals",
            Resource::Model => "model",
            Resource::Mailbox => "mailbox",
            Resource::Questions => "questions",
            Resource::Journal => "journal",
            Resource::Plugins => "plugins",
            Resource::Discovered => "discovered",
            Resource::Files => "files",
        }
    }
}
