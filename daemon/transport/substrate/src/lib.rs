//! Transport of messages (the paper, “Shared Communication Channel”): the trait through which
//! Communication Agents send, and a substrate within one process.
//!
//! - [`Substrate`] is the sending side of a daemon, [`Inbound`] is its receiving side.
//! - [`faulty`] carries messages within one process, over links that lose, double and delay
//!   messages and that break, as a seed decides.
//! - [`memory`] carries messages within one process; `substrate-zenoh` carries them between
//!   machines. The same agents run unchanged on both.
//! - [`ForwardingSubstrate`] is a substrate in front of another, which counts, loses or records
//!   messages.
//!
//! A substrate gives few guarantees: a message may be lost, late or doubled, and presence may be
//! wrong for the length of a lease. The Communication Agent adds receipts, retries and the removal
//! of duplicates.

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

/// The sending side of a daemon. Sending never blocks: the substrate takes the message, without a
/// guarantee that it is delivered.
pub trait Substrate: Send + Sync + 'static {
    /// Sends a message to one agent.
    ///
    /// # Errors
    ///
    /// Returns an error if the substrate is closed or refuses the message. Success does not mean
    /// delivery.
    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError>;

    /// Sends a message to all agents. Each performative has a global topic, as in the paper.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Substrate::send`].
    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError>;

    /// Sends the action model or a heartbeat of an agent to all agents.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Substrate::send`].
    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError>;

    /// Sends the heartbeats of several agents to all agents. Each heartbeat arrives as with
    /// [`Substrate::broadcast_state`]. A substrate may send all of them in one message.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Substrate::send`].
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

    /// Completes when every daemon that is present now receives this daemon's broadcasts, or after
    /// a short time even if some daemons do not. A sender that joins, broadcasts once and leaves
    /// must wait for this future. An agent must have been announced before.
    fn broadcast_ready(&self) -> BoxFuture<()> {
        Box::pin(std::future::ready(()))
    }

    /// Passes every message that any agent of the ecosystem sends to `listener`, from now on until
    /// the returned token is dropped: messages to one agent, messages to all agents, models and
    /// heartbeats, but no receipts. Messages may be lost, late or doubled, as those to an agent.
    ///
    /// In a secured ecosystem, only messages whose signature is valid are passed on; the caller
    /// drops those that come twice.
    ///
    /// # Errors
    ///
    /// Returns an error if the substrate is closed.
    fn overhear(&self, listener: OverhearCallback) -> Result<OverhearToken, SendError>;

    /// Closes the substrate. Queued messages may still be sent; no message is received any more.
    fn close(&self) -> BoxFuture<()>;
}

/// Function that receives overheard messages. It runs on threads of the substrate, so it must not
/// block.
pub type OverhearCallback = Arc<dyn Fn(OverheardMessage) + Send + Sync>;

/// A message between other agents that a listener has received as well.
#[derive(Clone, Debug)]
pub struct OverheardMessage {
    /// Destination that the message was sent to.
    pub destination: Destination,
    /// Payload of the message, as it was sent.
    pub payload: Bytes,
    /// Origin of the message, as its signature proves; `None` if messages are not signed.
    pub origin: Option<Origin>,
}

/// The receiving side of a daemon. The substrate calls these methods on its own threads, so no
/// method may block.
pub trait Inbound: Send + Sync + 'static {
    /// Called when a message has arrived.
    fn deliver(&self, delivery: Delivery);

    /// Called when the heartbeats of several agents have arrived in one message, each as its sender
    /// and its encoded message. All have the same origin. A daemon of ours sends at most one heartbeat
    /// of each agent in a message; of several of one sender, any may be handled first. The payloads
    /// share one allocation, so a receiver that keeps one must copy it. By default each is delivered
    /// as a message of its own.
    fn deliver_heartbeats(&self, beats: Vec<(AgentId, Bytes)>, origin: Option<&Origin>) {
        for (sender, payload) in beats {
            let payload = Bytes::copy_from_slice(&payload);
            let (destination, origin) = (Destination::AgentState(sender), origin.cloned());
            self.deliver(Delivery { destination, payload, origin });
        }
    }

    /// Called when an agent has joined or left.
    fn presence(&self, presence: Presence);

    /// Called when another daemon queries a resource. Dropping the question without a call of
    /// `answer` means that there is no answer.
    fn receive_query(&self, question: ReceivedQuery);

    /// Called when an incoming message, token or link was rejected. By default the rejection is not
    /// recorded.
    fn rejected(&self, _rejected: &Rejected<'_>) {}

    /// Whether the origin of an answer may give that answer. By default every answer is accepted.
    fn accepts_answer(&self, _answer: &Answer<'_>) -> bool {
        true
    }
}

/// Origin of a message, as its signature proves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Daemon that sent the message, or a guest of a daemon.
    pub daemon: DaemonId,
    /// Daemon that owns the key with which the message was signed: the sending daemon itself, or
    /// the host of the guest.
    pub signing_daemon: DaemonId,
}

/// A rejected message, token or link.
#[derive(Clone, Copy, Debug)]
pub struct Rejected<'r> {
    /// Kind of violation that caused the rejection.
    pub violation: ViolationKind,
    /// Description of the violation; it continues the sentence “the message …”.
    pub detail: &'r str,
    /// Name of the claimed sender; `None` if it is not known.
    pub claimed: Option<&'r str>,
    /// Address or key under which the rejected message arrived, in the form that the substrate
    /// uses.
    pub key: &'r str,
}

/// Kind of violation that causes a rejection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ViolationKind {
    /// The message is not signed.
    Unsigned,
    /// The certificate of the signer was not issued by the ecosystem's authority, or has expired.
    Unknown,
    /// The message was changed, or names another sender than its signer.
    Forged,
    /// The message was received before, belongs to an earlier incarnation of its sender or
    /// receiver, or was delayed too long.
    Replayed,
    /// The certificate of the signer was revoked.
    Revoked,
    /// The sender exceeds its rate limit, or there is no room for its token.
    Flooded,
    /// The origin has no right to send this message.
    Unauthorized,
    /// The message is longer than allowed.
    Oversized,
    /// An announcement or heartbeat cannot be read, or cannot be accepted.
    NotUnderstood,
    /// The message has another version of the protocol.
    OtherVersion,
    /// A daemon tried to connect without a certificate that is valid here.
    RefusedLink,
}

/// An answer to a query, with its verified origin.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// Daemon that gave the answer.
    pub origin: &'a Origin,
    /// Resource that was queried.
    pub resource: Resource,
    /// Agent that was asked, if each agent has a value of the resource; otherwise `None`.
    pub agent: Option<&'a AgentId>,
    /// Content of the answer.
    pub payload: &'a [u8],
}

/// Address of an agent: its daemon and its name.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AgentAddress {
    /// Daemon that hosts the agent.
    pub daemon: DaemonId,
    /// Name of the agent.
    pub agent: AgentId,
}

/// Kind of a message to one agent, known without decoding it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Subject {
    /// An ACL message.
    Message(Performative),
    /// Receipts: the sender confirms that its Communication Agent has received messages. Receipts
    /// are no ACL message; the payload is a JSON list of the ids of the received messages.
    Receipt,
}

/// A message that has arrived.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// Destination that the message was sent to.
    pub destination: Destination,
    /// Payload of the message, as it was sent.
    pub payload: Bytes,
    /// Origin of the message, as its signature proves; `None` if messages are not signed.
    pub origin: Option<Origin>,
}

/// Destination of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// The message is for this agent of the daemon that receives it.
    To(AgentId, Subject),
    /// The message is a broadcast to all agents, from this sender.
    All(AgentId, Performative),
    /// The message is a broadcast of the action model or a heartbeat of this agent, which sent it.
    AgentState(AgentId),
}

/// One incarnation of an agent, with the daemon that hosts it.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Resident {
    /// Name of the agent.
    pub agent: AgentId,
    /// Daemon that hosts the agent.
    pub daemon: DaemonId,
    /// Incarnation of the agent.
    pub incarnation: Incarnation,
}

/// Change of the membership, as this daemon sees it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Presence {
    /// An agent has joined: the process that hosts it runs and can be reached.
    Joined(Resident),
    /// An agent has left: it cannot be reached from this daemon any more.
    Left(Resident),
}

/// Resource that a daemon can be queried for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Resource {
    /// The agents that a daemon hosts.
    Directory,
    /// The composite domain.
    Domain,
    /// The facts of the world in the domain model, with the sources of each.
    State,
    /// Goals and their progress.
    Goals,
    /// The action models of the agents, or that of one agent.
    Model,
    /// Number of messages in each mailbox of a daemon's agents, and counters.
    Mailbox,
    /// Questions to people that have no answer yet.
    Questions,
    /// The stops in force at each actuator.
    Stops,
    /// The records that a Journal keeps.
    Journal,
    /// The plugins of a daemon that run as processes, and their state.
    Plugins,
    /// Discovered agents, which no file names.
    Discovered,
    /// Digests of the domain and the map that a daemon has read.
    Files,
    /// A daemon's report about itself: its version, its replicas, its process.
    Daemon,
}

/// A query to one daemon or to all daemons, about their agents or themselves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResourceQuery {
    /// Daemon to ask; `None` asks all daemons.
    pub daemon: Option<DaemonId>,
    /// Resource to ask for.
    pub resource: Resource,
    /// Agent to ask, if each agent has a value of the resource; `None` asks all agents.
    pub agent: Option<AgentId>,
}

/// A query that has arrived at this daemon.
pub struct ReceivedQuery {
    /// Resource that the query asks for.
    pub resource: Resource,
    /// Agent that the query is about; `None` for all agents.
    pub agent: Option<AgentId>,
    /// Function that sends one answer. The function may be called more than once, or not at all.
    pub answer: Arc<dyn Fn(Bytes) + Send + Sync>,
}

/// Token that keeps an agent present until the token is dropped.
pub struct PresenceToken(#[expect(dead_code, reason = "its drop withdraws the presence")] OnDrop);

/// Token that keeps a listener of overheard messages until the token is dropped.
pub struct OverhearToken(#[expect(dead_code, reason = "its drop removes the listener")] OnDrop);

/// Function that is called once, when the value is dropped.
struct OnDrop(Option<Box<dyn FnOnce() + Send + Sync>>);

/// Reason why the substrate did not take a message.
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
    /// The substrate did not accept the message, for the reason in this text.
    #[error("send: {0}")]
    Declined(String),
}

impl PresenceToken {
    /// Creates a token that calls `withdraw` when it is dropped, to end the presence of an agent.
    pub fn new(withdraw: impl FnOnce() + Send + Sync + 'static) -> PresenceToken {
        PresenceToken(OnDrop(Some(Box::new(withdraw))))
    }
}

impl OverhearToken {
    /// Creates a token that calls `remove` when it is dropped, to remove a listener.
    pub fn new(remove: impl FnOnce() + Send + Sync + 'static) -> OverhearToken {
        OverhearToken(OnDrop(Some(Box::new(remove))))
    }
}

impl Drop for OnDrop {
    fn drop(&mut self) {
        if let Some(act) = self.0.take() {
            act();
        }
    }
}

impl fmt::Debug for OverhearToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("OverhearToken")
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
    /// All kinds.
    pub const ALL: [ViolationKind; 11] = [
        ViolationKind::Unsigned,
        ViolationKind::Unknown,
        ViolationKind::Forged,
        ViolationKind::Replayed,
        ViolationKind::Revoked,
        ViolationKind::Flooded,
        ViolationKind::Unauthorized,
        ViolationKind::Oversized,
        ViolationKind::NotUnderstood,
        ViolationKind::OtherVersion,
        ViolationKind::RefusedLink,
    ];

    /// Returns the name of the kind, for people and for programs that count violations.
    pub fn as_str(self) -> &'static str {
        match self {
            ViolationKind::Unsigned => "unsigned",
            ViolationKind::Unknown => "unknown",
            ViolationKind::Forged => "forged",
            ViolationKind::Replayed => "replayed",
            ViolationKind::Revoked => "revoked",
            ViolationKind::Flooded => "flooded",
            ViolationKind::Unauthorized => "unauthorized",
            ViolationKind::Oversized => "oversized",
            ViolationKind::NotUnderstood => "not-understood",
            ViolationKind::OtherVersion => "other-version",
            ViolationKind::RefusedLink => "refused-link",
        }
    }
}

impl Resource {
    /// All resources.
    pub const ALL: [Resource; 13] = [
        Resource::Directory,
        Resource::Domain,
        Resource::State,
        Resource::Goals,
        Resource::Model,
        Resource::Mailbox,
        Resource::Questions,
        Resource::Stops,
        Resource::Journal,
        Resource::Plugins,
        Resource::Discovered,
        Resource::Files,
        Resource::Daemon,
    ];

    /// Whether only the leader answers queries for this resource, if an agent has several replicas.
    pub fn is_answered_by_leader(self) -> bool {
        matches!(self, Resource::Domain | Resource::State | Resource::Goals)
    }

    /// Returns the name of the resource, as one chunk of a key expression.
    pub fn as_str(self) -> &'static str {
        match self {
            Resource::Directory => "directory",
            Resource::Domain => "domain",
            Resource::State => "state",
            Resource::Goals => "goals",
            Resource::Model => "model",
            Resource::Mailbox => "mailbox",
            Resource::Questions => "questions",
            Resource::Stops => "stops",
            Resource::Journal => "journal",
            Resource::Plugins => "plugins",
            Resource::Discovered => "discovered",
            Resource::Files => "files",
            Resource::Daemon => "daemon",
        }
    }
}
