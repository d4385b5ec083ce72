//! The events that a view is made from: messages, changes of presence, and answers to queries.

use acl::content::{
    BelievedState, DaemonReport, DiscoveryReport, GoalStatus, Mailboxes, OpenQuestion, Snapshot,
    StopState,
};
use acl::{AgentId, DaemonId, Incarnation, Message};
use serde::{Deserialize, Serialize};

use crate::moment::Moment;

/// An event of the ecosystem, as the observing process learns of it.
///
/// Events may come in any order, twice, or not at all, and their contents may be malformed.
#[derive(Clone, Debug)]
pub enum ViewEvent {
    /// A message was overheard, or is the answer to a query for action models.
    Message(Box<Message>),
    /// An agent has joined.
    Joined(AgentPlace),
    /// An agent has left.
    Left(AgentPlace),
    /// All agents that are present, as the daemons list them.
    Directory(Vec<AgentPlace>),
    /// The agents that should be present, as the ecosystem file names them.
    Expected(Vec<ExpectedAgent>),
    /// All facts that the Domain Maintainer believes.
    State(Box<BelievedState>),
    /// The composite domain, with the parts of action models that no plan can use.
    Domain(Box<Snapshot>),
    /// All goals that the Plan Requester knows.
    Goals(Vec<GoalStatus>),
    /// All questions without an answer.
    Questions(Vec<OpenQuestion>),
    /// The mailboxes of one daemon.
    Mailboxes(Mailboxes),
    /// The stops that each actuator knows.
    Stops(Vec<StopState>),
    /// The discovered agents of one daemon.
    Discovered(DiscoveryReport),
    /// What one daemon says about itself.
    Daemon(DaemonReport),
    /// One daemon has answered a query after this time.
    RoundTrip {
        /// The daemon that answered.
        daemon: DaemonId,
        /// Time from the query to the answer, in microseconds.
        micros: u64,
    },
    /// One daemon has not answered a query in time.
    NoAnswer(DaemonId),
    /// So many messages were not observed, because the observing process was too slow.
    Lost(u64),
    /// Nothing was observed since this moment, because nobody read what the view draws.
    Unread {
        /// Moment at which the view ceased to observe.
        since: Moment,
    },
    /// So many messages could not be parsed.
    Unreadable(u64),
    /// Whether the ecosystem is reached now.
    Reached(bool),
}

/// One incarnation of an agent, and the daemon that hosts it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct AgentPlace {
    /// The agent.
    pub agent: AgentId,
    /// The daemon that hosts the agent.
    pub daemon: DaemonId,
    /// The incarnation of the agent.
    pub incarnation: Incarnation,
}

/// An agent that the ecosystem file names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ExpectedAgent {
    /// The agent.
    pub agent: AgentId,
    /// The daemons that host the agent; empty if the file names none.
    pub daemons: Vec<DaemonId>,
}
