//! What carries messages (the paper, “Shared Communication Channel”): the trait a Communication
//! Agent speaks through, and a substrate within one process.
//!
//! - [`Substrate`] is how a daemon speaks, [`Inbound`] is how it is spoken to.
//! - [`faulty`] carries them within one process over links that lose, double, delay and break, as a
//!   seed decides.
//! - [`memory`] carries messages within one process; `substrate-zenoh` carries them between
//!   machines. The same agents run unchanged on both.
//!
//! - [`Through`] is a wire before another, for whoever counts, loses or listens.
//!
//! A substrate promises little: a message may be lost, late or doubled, and presence may err for
//! the length of a lease. Receipts, retries and duplicates are the Communication Agent's.

#[cfg(test)]
mod ear;
pub mod faulty;
pub mod memory;
mod through;

use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation, Performative};
use bytes::Bytes;
use serde::{Deserialize, Serialize};

pub use crate::through::Through;

/// A future that a trait object can return.
pub type BoxFuture<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// How a daemon speaks. Sending never waits: it hands over, and promises nothing.
pub trait Substrate: Send + Sync + 'static {
    /// Sends to one agent.
    ///
    /// # Errors
    ///
    /// If the substrate is closed or refuses the message; success is not delivery.
    fn send(&self, to: &Address, subject: Subject, payload: Bytes) -> Result<(), SendError>;

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
    fn beat(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError>;

    /// Sends what several agents say of themselves at one moment, to all: each as
    /// [`Substrate::beat`] would, and all of it for the price of one message, where that is possible.
    ///
    /// # Errors
    ///
    /// As [`Substrate::send`].
    fn beat_together(&self, beats: Vec<(AgentId, Bytes)>) -> Result<(), SendError> {
        beats.into_iter().try_for_each(|(sender, payload)| self.beat(&sender, payload))
    }

    /// Makes an agent present until the returned token is dropped or the process dies.
    ///
    /// # Errors
    ///
    /// If the substrate is closed.
    fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError>;

    /// Asks daemons for a resource; resolves to all answers that came within `timeout`, which
    /// may be none.
    fn ask(&self, question: Ask, timeout: Duration) -> BoxFuture<Vec<Bytes>>;

    /// Resolves when those who are here now hear what is said to all, or soon if some of them never
    /// will: to be waited for by who comes, says one thing to all, and goes. An agent has to be
    /// announced before.
    fn introduced(&self) -> BoxFuture<()> {
        Box::pin(std::future::ready(()))
    }

    /// Closes the substrate: what is still queued may go out, nothing comes in any more.
    fn close(&self) -> BoxFuture<()>;
}

/// How a daemon is spoken to. Called on the substrate's own threads: must not block.
pub trait Inbound: Send + Sync + 'static {
    /// A message has come.
    fn deliver(&self, delivery: Delivery);

    /// An agent is here, or is not.
    fn presence(&self, presence: Presence);

    /// Somebody asks for a resource. Dropping the question answers nothing.
    fn question(&self, question: Question);

    /// Something came that is not believed, and goes no further. Nothing is done about it unless
    /// it is written down.
    fn rejected(&self, _rejected: &Rejected<'_>) {}

    /// Whether an answer is one that its origin may give; all are, unless somebody knows better.
    fn admits(&self, _answer: &Answer<'_>) -> bool {
        true
    }
}

/// Who a message comes from, as its signature proves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The daemon that spoke, or a guest of one.
    pub daemon: DaemonId,
    /// The daemon whose key it has signed with: the same, or the guest's host.
    pub voucher: DaemonId,
}

/// Something that came and is not believed.
#[derive(Clone, Copy, Debug)]
pub struct Rejected<'r> {
    /// What is wrong with it.
    pub breach: Breach,
    /// The same in words, to follow “the message …”.
    pub detail: &'r str,
    /// In whose name it came, as far as that can be known.
    pub claimed: Option<&'r str>,
    /// What it was about, as the substrate addresses things.
    pub key: &'r str,
}

/// What can be wrong with something that came.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Breach {
    /// Nobody has signed it.
    Unsigned,
    /// It is signed by somebody the ecosystem does not know, or knows no longer.
    Unknown,
    /// It was changed, or speaks in another's name.
    Forged,
    /// It was heard before.
    Replayed,
    /// The certificate was taken back.
    Revoked,
    /// There is too much of it.
    Flooded,
    /// Its origin may not say this.
    Overstepped,
    /// It is longer than anything may be.
    Oversized,
    /// It says of its sender what cannot be read, or cannot be taken.
    NotUnderstood,
    /// Somebody wanted a link and has shown no certificate that is good here.
    Unlinked,
}

/// An answer that has come, and from whom.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// Who has given it.
    pub origin: &'a Origin,
    /// To what.
    pub resource: Resource,
    /// Of which agent, where the resource has one per agent.
    pub agent: Option<&'a AgentId>,
    /// Its bytes.
    pub payload: &'a [u8],
}

/// Where an agent is reached.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Address {
    /// The daemon that hosts it.
    pub daemon: DaemonId,
    /// The agent.
    pub agent: AgentId,
}

/// What a message to one agent is, before anyone opens it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Subject {
    /// An ACL message.
    Message(Performative),
    /// The receiver's Communication Agent has put a message into its agent's mailbox. No ACL
    /// message; the payload is the message's id.
    Receipt,
}

/// A message that has come.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// How it was addressed.
    pub addressed: Addressed,
    /// The bytes as they were sent.
    pub payload: Bytes,
    /// Who has signed it; nobody, where nothing is signed.
    pub origin: Option<Origin>,
}

/// How a message was addressed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Addressed {
    /// To one agent of this daemon.
    To(AgentId, Subject),
    /// To all, by its sender.
    All(AgentId, Performative),
    /// An action model or a heartbeat, by its sender.
    Beat(AgentId),
}

/// One life of one agent at one place.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Resident {
    /// The agent.
    pub agent: AgentId,
    /// The daemon that hosts it.
    pub daemon: DaemonId,
    /// Which life of it.
    pub incarnation: Incarnation,
}

/// Our view of who is here.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Presence {
    /// The process that hosts this agent lives and can be reached.
    Joined(Resident),
    /// It cannot be reached from here any more.
    Left(Resident),
}

/// What a daemon can be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Resource {
    /// The agents this daemon hosts and the daemons it sees.
    Directory,
    /// The composite domain.
    Domain,
    /// The state of the world as believed, with provenance.
    State,
    /// Goals and their progress.
    Goals,
    /// One agent's action model, or all.
    Model,
    /// How full the mailboxes of a daemon's agents are.
    Mailbox,
    /// Questions to people that nobody has answered.
    Questions,
    /// What a Journal keeps.
    Journal,
    /// The plugins of a daemon that run as processes, and how they are.
    Plugins,
    /// Agents that have appeared and that no file names.
    Discovered,
    /// Which domain and which map a daemon has read, as digests.
    Files,
}

/// A question to daemons.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ask {
    /// Whom; `None` asks all.
    pub daemon: Option<DaemonId>,
    /// For what.
    pub resource: Resource,
    /// Of which agent, where the resource has one per agent.
    pub agent: Option<AgentId>,
}

/// A question that has come.
pub struct Question {
    /// For what.
    pub resource: Resource,
    /// Of which agent.
    pub agent: Option<AgentId>,
    /// Gives one answer; may be called more than once, and not at all.
    pub answer: Arc<dyn Fn(Bytes) + Send + Sync>,
}

/// Keeps an agent present while it lives.
pub struct PresenceToken(Option<Box<dyn FnOnce() + Send + Sync>>);

/// Why a message could not be handed over.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SendError {
    /// The substrate is closed.
    #[error("send on a closed substrate")]
    Closed,
    /// It is longer than anything may be.
    #[error("send {bytes} bytes: a message has at most {bytes_max}")]
    TooLong {
        /// How long it is.
        bytes: usize,
        /// How long it may be.
        bytes_max: usize,
    },
    /// The substrate declined.
    #[error("send: {0}")]
    Declined(String),
}

impl PresenceToken {
    /// A token that runs `withdraw` when it is dropped.
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
    /// Who it is about.
    pub fn resident(&self) -> &Resident {
        match self {
            Presence::Joined(resident) | Presence::Left(resident) => resident,
        }
    }
}

impl Breach {
    /// The name, for people and programs that count.
    pub fn as_str(self) -> &'static str {
        match self {
            Breach::Unsigned => "unsigned",
            Breach::Unknown => "unknown",
            Breach::Forged => "forged",
            Breach::Replayed => "replayed",
            Breach::Revoked => "revoked",
            Breach::Flooded => "flooded",
            Breach::Overstepped => "overstepped",
            Breach::Oversized => "oversized",
            Breach::NotUnderstood => "not-understood",
            Breach::Unlinked => "unlinked",
        }
    }
}

impl Resource {
    /// All of them.
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

    /// Whether, of several agents of one name, only the one that acts answers.
    pub fn is_of_who_acts(self) -> bool {
        matches!(self, Resource::Domain | Resource::State | Resource::Goals)
    }

    /// The name, as one chunk of a key expression.
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
