//! Agents, what each of them does, and the questions that they ask people.

use acl::content::{Discovered, MailboxStatus, Stop};
use acl::{AgentId, ConversationId, DaemonId, Incarnation};
use serde::Serialize;

use super::{ActivityEntry, FactRow, StepState};
use crate::moment::Moment;

/// Whether an agent is present.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AgentPresence {
    /// The agent is present.
    Present,
    /// The agent is present, but its heartbeats have stopped.
    Silent,
    /// The agent has left.
    Gone,
    /// The ecosystem file names the agent, but it was never observed.
    Absent,
    /// Messages of the agent were observed, but nothing says whether it is present.
    #[default]
    Unknown,
}

/// One agent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AgentRow {
    /// The agent.
    pub agent: AgentId,
    /// The daemon that hosts the agent, or the one of its leading replica; `None` if that is not
    /// known.
    pub daemon: Option<DaemonId>,
    /// Whether the agent is present.
    pub presence: AgentPresence,
    /// Moment since which the agent is present or gone; `None` if that is not known.
    pub since: Option<Moment>,
    /// Time since the last heartbeat, in milliseconds; `None` if none was observed.
    pub heartbeat_age_ms: Option<u64>,
    /// Names of the actions that the agent offers now.
    pub actions: Vec<String>,
    /// Sentence about the step that the agent carries out now; `None` if it carries none out.
    pub doing: Option<String>,
    /// Moment at which that step began.
    pub doing_since: Option<Moment>,
    /// How much longer than usual that step takes, in milliseconds.
    pub late_ms: Option<u64>,
    /// Number of messages that wait in the agent's mailbox; `None` if that is not known.
    pub waiting: Option<u64>,
    /// Number of replicas of the agent.
    pub replicas: u64,
    /// Whether a stop concerns the agent.
    pub is_stopped: bool,
    /// Problems of the agent, each as one sentence.
    pub problems: Vec<String>,
}

/// One agent with everything that is known about it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AgentDetail {
    /// The agent.
    pub row: AgentRow,
    /// The replicas of the agent.
    pub replicas: Vec<ReplicaRow>,
    /// The actions of the agent: those that it offers, and those that it has offered.
    pub actions: Vec<ActionRow>,
    /// The action model of the agent, as PDDL; `None` if it was not observed or is too long.
    pub model: Option<String>,
    /// The facts that the agent owns.
    pub facts: Vec<FactRow>,
    /// The stops that concern the agent.
    pub stops: Vec<Stop>,
    /// State of the agent's mailbox; `None` if it is not known.
    pub mailbox: Option<MailboxStatus>,
    /// The steps that the agent carries out now.
    pub running: Vec<CurrentStep>,
    /// The last activities of the agent, oldest first.
    pub recent: Vec<ActivityEntry>,
    /// How the agent was discovered; `None` if the ecosystem file names it.
    pub discovered: Option<Discovered>,
    /// Longest time between two heartbeats in milliseconds, as the agent says; `None` if it sends
    /// none.
    pub heartbeat_period_ms: Option<u64>,
}

/// One replica of an agent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ReplicaRow {
    /// The daemon that hosts the replica.
    pub daemon: DaemonId,
    /// The incarnation of the replica.
    pub incarnation: Incarnation,
    /// Whether the replica leads; `None` if that is not known.
    pub leads: Option<bool>,
    /// Moment at which the replica was first observed.
    pub since: Moment,
}

/// One action of an agent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ActionRow {
    /// Name of the action.
    pub action: String,
    /// Parameters of the action, as PDDL.
    pub parameters: String,
    /// Whether the agent offers the action now. An action that is withdrawn was offered before.
    pub is_offered: bool,
    /// Number of runs that were observed to their end.
    pub runs: u64,
    /// Number of these runs that did not succeed.
    pub failures: u64,
    /// The usual time of the action in milliseconds; `None` if no run was observed.
    pub usual_ms: Option<u64>,
}

/// A step that an agent carries out now.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CurrentStep {
    /// The step, as PDDL.
    pub step: String,
    /// The step, as a sentence.
    pub text: String,
    /// The goal that the step serves; `None` if it serves none.
    pub conversation: Option<ConversationId>,
    /// State of the step.
    pub state: StepState,
    /// Moment at which the step was requested.
    pub started_at: Moment,
    /// The usual time of the step in milliseconds.
    pub usual_ms: Option<u64>,
    /// How much longer than usual the step takes, in milliseconds.
    pub late_ms: Option<u64>,
    /// The last report about the step; empty if there is none.
    pub detail: String,
}

/// One question to people that has no answer yet.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QuestionRow {
    /// Identifier of the question for `althing answer`: `KEYBOARD/NUMBER`; `None` until the
    /// keyboard has said the number.
    pub id: Option<String>,
    /// The Keyboard Agent with the question; `None` if the question went to all of them.
    pub keyboard: Option<AgentId>,
    /// The agent that asks.
    pub from: AgentId,
    /// The question.
    pub text: String,
    /// Whether the answer is secret: it must be typed hidden, and is sealed.
    pub is_secret: bool,
    /// Remaining time for an answer, in milliseconds; `None` if that is not known.
    pub remaining_ms: Option<u64>,
}
