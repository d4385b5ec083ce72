//! The overview: whether all is well, and why not; and the stops in force.

use acl::content::Stop;
use acl::{AgentId, ConversationId, DaemonId, EcosystemId};
use serde::Serialize;

use crate::moment::Moment;

/// How well something is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum HealthLevel {
    /// All is well.
    #[default]
    Well,
    /// A person should look at it.
    Attention,
    /// Something that was wanted does not work.
    Bad,
}

/// The answer to “is all well?”.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overview {
    /// The observed ecosystem.
    pub ecosystem: EcosystemId,
    /// The moment of the overview.
    pub at: Moment,
    /// The verdict: the worst level of the concerns.
    pub verdict: HealthLevel,
    /// Moment since which the ecosystem is not reached; `None` if it is.
    pub not_reached_since: Option<Moment>,
    /// The verdict as one sentence.
    pub summary: String,
    /// What is not well: what is not reached first, then stops, what is gone, and goals.
    pub concerns: Vec<Concern>,
    /// Number of further concerns, which are not listed.
    pub more_concerns: u64,
    /// How many there are of everything.
    pub counts: ViewCounts,
}

/// Something that is not well.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Concern {
    /// How bad it is.
    pub level: HealthLevel,
    /// Kind of the concern, for programs.
    pub kind: ConcernKind,
    /// The concern as one sentence.
    pub text: String,
    /// The thing that the concern is about; `None` if it has no page of its own.
    pub subject: Option<ViewSubject>,
}

/// Kind of a concern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ConcernKind {
    /// The ecosystem is not reached.
    NotReached,
    /// A goal has failed a short time ago.
    GoalFailed,
    /// A goal waits for a capability or for a change.
    GoalWaits,
    /// A step of a plan takes much longer than usual.
    StepLate,
    /// An agent is gone, silent, or absent although the ecosystem file names it.
    AgentGone,
    /// A part of an agent's action model cannot be used.
    AgentProblem,
    /// A stop is in force.
    Stopped,
    /// A hardware stop is silent or in an unknown position.
    StopButton,
    /// A person is asked a question.
    Question,
    /// A daemon does not answer.
    DaemonSilent,
    /// A certificate ends soon, or has ended.
    Certificate,
    /// Messages were refused, unreadable, not sent, or did not fit.
    Messages,
    /// A message broke the protocol of its exchange.
    OutOfTurn,
    /// Not everything was observed.
    Lost,
}

/// A thing with a page of its own.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(tag = "of", content = "name", rename_all = "kebab-case")]
pub enum ViewSubject {
    /// The goal of this conversation.
    Goal(ConversationId),
    /// An agent.
    Agent(AgentId),
    /// A daemon.
    Daemon(DaemonId),
    /// The open questions.
    Questions,
    /// A conversation.
    Conversation(ConversationId),
}

/// How many there are of everything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ViewCounts {
    /// Agents that are present.
    pub agents: u64,
    /// Agents that are gone or silent.
    pub agents_gone: u64,
    /// Daemons.
    pub daemons: u64,
    /// Goals that have not ended, without those that wait for their times.
    pub goals: u64,
    /// Goals that wait for their times.
    pub goals_scheduled: u64,
    /// Goals that hold.
    pub goals_holding: u64,
    /// Goals with a plan that runs.
    pub goals_running: u64,
    /// Goals that wait.
    pub goals_waiting: u64,
    /// Goals that are being planned for.
    pub goals_planning: u64,
    /// Steps that agents carry out now.
    pub steps_running: u64,
    /// Facts.
    pub facts: u64,
    /// Facts that are unknown.
    pub facts_unknown: u64,
    /// Open questions.
    pub questions: u64,
    /// Stops in force.
    pub stops: u64,
    /// Messages that were observed.
    pub messages: u64,
    /// Messages that were sent, but not observed.
    pub lost: u64,
    /// Messages that could not be parsed.
    pub unreadable: u64,
    /// Messages that broke the protocol of their exchange.
    pub out_of_turn: u64,
}

/// One stop in force.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StopRow {
    /// The stop.
    pub stop: Stop,
    /// Moment at which the stop was first observed.
    pub at: Moment,
    /// Number of actuators that repeat the stop.
    pub holders: u64,
}
