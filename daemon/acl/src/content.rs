//! Contents of messages, as the paper's roles send them (Table 1; docs/design.md, “Messages”).
//!
//! Facts, goals, models and plans are sent as PDDL text inside these types. All types ignore unknown
//! fields. The envelope does not interpret contents.

mod state;

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{AgentId, ConversationId, DaemonId, Deadline};

pub use self::state::{
    ActionOf, Auxiliary, BelievedFact, BelievedState, ChangeActions, ChangeMetric, ChangeState,
    Claim, EpochChange, Guard, Heartbeat, ModelAnnouncement, Observation, Requested, RequestedFact,
    RequestedSince, Snapshot,
};

/// Content of a `request`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "act", rename_all = "kebab-case")]
pub enum Request {
    /// To the Plan Requester: plan and achieve this goal, or keep it.
    Achieve(Achieve),
    /// To the Planning Agent: compute a plan for this domain and problem.
    Plan(PlanRequest),
    /// To the Plan Executor: execute this plan.
    Execute(Box<Execute>),
    /// To the Plan Executor: cancel this plan, which is no longer needed.
    CallOff(CallOff),
    /// To an actuator: execute this action, translated into its method.
    Act(Box<Act>),
    /// To the Domain Maintainer: change the state.
    ChangeState(ChangeState),
    /// To the Plan Requester: change the flow, centralised or decentralised.
    SetMode(SetMode),
    /// To a Keyboard Agent: a person's answer to one of its open questions.
    AnswerQuestion(AnswerQuestion),
    /// To the Domain Maintainer: change the metric of plans.
    ChangeMetric(ChangeMetric),
    /// To the Domain Maintainer: withhold actions, or give them back.
    ChangeActions(ChangeActions),
    /// To the Domain Maintainer: believe facts observed by the sender.
    Observe(Observation),
    /// To a Journal: keep these records; confirmed as soon as they are on disk.
    Keep(Keeping),
}

/// Request to change the flow.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetMode {
    /// The new flow.
    pub mode: Mode,
}

/// The flow of planning in an ecosystem (the paper, “Centralized Planning”, “Decentralized Planning”).
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The Planning Agent plans for all agents.
    Centralized,
    /// Each actuator plans for itself and bids.
    #[default]
    Decentralized,
}

/// Request that passes a person's answer to an open question to a Keyboard Agent.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerQuestion {
    /// Number of the question at that agent.
    pub question: u64,
    /// The person's answer.
    #[serde(flatten)]
    pub said: PersonsAnswer,
}

/// Request for a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Achieve {
    /// A PDDL condition over the ecosystem's ontology.
    pub goal: String,
    /// Whether the goal is to be reached once or kept.
    #[serde(default)]
    pub keep: Keep,
    /// Priority: a goal with a greater one takes precedence.
    #[serde(default)]
    pub priority: i32,
    /// Whether the goal is pursued during a partition.
    #[serde(default)]
    pub partition: Partition,
}

/// Treatment of a goal during a partition.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Partition {
    /// Every partition pursues the goal with the agents it has.
    #[default]
    Pursue,
    /// Only a partition with the quorum of Journals plans for the goal; there is one at most.
    Wait,
}

/// Whether a goal ends when it is reached.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Keep {
    /// The goal ends when it is reached.
    #[default]
    Achieve,
    /// The goal is kept: it is planned for again whenever it does not hold.
    Maintain,
}

/// Request for a plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanRequest {
    /// The PDDL domain.
    pub domain: String,
    /// The PDDL problem.
    pub problem: String,
    /// The epoch that both belong to.
    pub epoch: u64,
    /// Remaining steps of the interrupted plan, one per line, if that plan is to be continued where
    /// possible.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<String>,
}

/// Request to execute a plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Execute {
    /// The PDDL domain the plan belongs to.
    pub domain: String,
    /// The PDDL problem: objects, the state as known, the goal.
    pub problem: String,
    /// The plan, one step per line.
    pub plan: String,
    /// The epoch that all three belong to.
    pub epoch: u64,
    /// Term of the Plan Requester that made the plan: see [`ActionToken::epoch`].
    #[serde(default)]
    pub term: u64,
    /// Number of the plan in its conversation, from 1.
    pub round: u32,
    /// Numbers of the steps that are known to be done, from 0: another executor has begun the plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub done: Vec<u32>,
    /// The actions that the agents in the plan offer.
    #[serde(default)]
    pub offers: Offers,
    /// The symbols of the domain that describe what is unknown: see [`Snapshot::knowledge`].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub knowledge: BTreeMap<String, Auxiliary>,
}

/// Request to cancel a plan for the conversation's goal. A running plan is stopped. A plan that is not
/// known yet will not be started: a former leader may have requested it, and that request may arrive
/// later than this one.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CallOff {
    /// See [`Execute::term`].
    pub term: u64,
    /// See [`Execute::round`].
    pub round: u32,
}

/// The actions that each agent offers, under the agent's own names for them.
pub type Offers = BTreeMap<AgentId, BTreeMap<String, Offer>>;

/// One action of one agent.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Offer {
    /// Name of the action in the composite domain. It differs from the agent's own name for it if two
    /// agents use one name for different actions.
    pub inside: String,
    /// The PDDL fact that allows this agent to use the action (the guard).
    pub guard: String,
    /// The method that the actuator runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<Method>,
}

/// The state of a goal, as shown to users.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalStatus {
    /// Conversation of the goal, which identifies it in `cancel` and `watch`.
    pub conversation: ConversationId,
    /// The PDDL condition.
    pub goal: String,
    /// Whether the goal is to be reached once or kept.
    pub keep: Keep,
    /// Priority: a goal with a greater one takes precedence.
    pub priority: i32,
    /// The current phase, for a person.
    pub phase: String,
    /// Number of plans made for it so far.
    pub rounds: u32,
    /// Past events, oldest first; their number is limited.
    pub history: Vec<HistoryEntry>,
}

/// An event in the history of a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HistoryEntry {
    /// Time in milliseconds since 1970-01-01 UTC, by the clock of the machine that pursued the goal
    /// then.
    pub at_ms: u64,
    /// Outcome that was sent to the requester with this event; `None` if none was sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<Outcome>,
    /// Description of the event, for a person.
    pub text: String,
}

/// An agent's actions, each with the method that carries it out.
pub type Methods = BTreeMap<String, Method>;

/// The method that an actuator runs for an action (docs/design.md, “Action models”).
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Method {
    /// The method's name.
    pub method: String,
    /// Arguments by name; a value is a variable of the action (`?to`) or a literal.
    #[serde(default)]
    pub arguments: BTreeMap<String, String>,
    /// Longest time that it may take.
    pub timeout: Deadline,
}

/// Request to an actuator to carry out an action.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Act {
    /// The ground action, under the actuator's own name for it.
    pub action: String,
    /// The method to run.
    pub method: String,
    /// Arguments of the method by name, with values.
    pub arguments: BTreeMap<String, String>,
    /// Identifier of the commitment; the action is executed at most once for each.
    pub token: ActionToken,
}

/// Identifier of one commitment to act (docs/design.md, “Execution”). The actuator executes it at most
/// once; if it is requested again, the actuator answers with the result. The actuator refuses a token of
/// a plan that is older than the newest one it has seen for the same goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ActionToken {
    /// Term of the Plan Requester that made the plan: each one that takes over a goal has a greater
    /// term.
    pub epoch: u64,
    /// The goal's conversation.
    pub conversation: ConversationId,
    /// Number of the plan in that term.
    pub round: u32,
    /// Number of the step in that plan, from 0.
    pub step: u32,
}

/// Content of a `cancel` of an action. A `cancel` without content cancels unconditionally.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cancelling {
    /// Whether to cancel only if no other agent follows the same commitment: the sender is no longer
    /// the leader, and the new leader may follow it.
    pub unless_followed: bool,
}

/// Request to keep records.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Keeping {
    /// The records; of those with the same key, the one with the greatest version counts.
    pub records: Vec<Record>,
}

/// A record that must outlive its agent: a goal, a plan under way, or how they ended.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Key of the record: `goal/CONVERSATION`, `plan/CONVERSATION` or `state/requested`.
    pub key: String,
    /// Version of the record.
    pub version: Version,
    /// The data; null if the record is to be removed.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub body: Value,
}

/// Version of a record. It orders the versions of all writers, independently of their clocks.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
pub struct Version {
    /// Term of the writer: greater than any that the writer has read.
    pub term: u64,
    /// Number of the version in that term.
    pub count: u64,
}

/// Content of a `cfp`: propose plans for these conjuncts of a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CallForProposals {
    /// The conjuncts: ground PDDL conditions.
    pub conjuncts: Vec<String>,
    /// Whether only a proposal for all conjuncts together is wanted. This is so in the second round,
    /// after one agent was cheapest for several single conjuncts.
    #[serde(default)]
    pub together: bool,
}

/// Content of an actuator's `agree` to a `cfp`. At most one of its proposals can be accepted.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bid {
    /// The alternative proposals.
    pub proposals: Vec<Proposal>,
    /// Digest of the local domain and state in which the bidder planned. They can be queried from the
    /// bidder as `domain`.
    pub domain_digest: String,
}

/// One of the alternatives of a bid.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// The conjuncts that it covers, spelled as in the call.
    pub covers: Vec<String>,
    /// The plan, one step per line.
    pub plan: String,
    /// Cost of the plan in the bidder's local domain.
    pub cost: f64,
}

/// Content of an actuator's `agree` to an action.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// The accepted commitment.
    pub token: ActionToken,
}

/// Content of the Planning Agent's `propose`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanProposal {
    /// How the search ended.
    pub status: PlanStatus,
    /// The plan, one step per line, if one was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<String>,
    /// Cost of the plan, recomputed by the validator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// The reason why there is no plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

/// How a search ended. "Unsolvable" (proved) and "gave up" (exhausted or limit reached) are different
/// variants.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlanStatus {
    /// A plan was found.
    Solved,
    /// There is no plan, which is proved.
    Unsolvable,
    /// The search ended without a plan and without a proof.
    Exhausted,
    /// A limit on work, memory or time was reached.
    Limit,
    /// The request was cancelled.
    Cancelled,
    /// The problem uses a feature that the planner does not support.
    Unsupported,
}

/// Content of `accept-proposal` and `reject-proposal`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// The conjuncts of the receiver's accepted proposal; empty in a rejection.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub covers: Vec<String>,
    /// The reason.
    pub detail: String,
}

/// Content of a `refuse` and of a `not-understood`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refusal {
    /// The reason, for a program.
    pub reason: Reason,
    /// The reason, for a person.
    pub detail: String,
    /// The plan for the same goal that runs instead, if another Plan Requester made it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub under_way: Option<Box<Execute>>,
}

/// Why a message was declined.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Reason {
    /// The text could not be read as a message of this version.
    Unreadable,
    /// The content could not be read, or contains names that do not exist.
    BadContent,
    /// The agent does not handle this performative or request.
    UnexpectedPerformative,
    /// The protocol does not allow this message at this point.
    OutOfTurn,
    /// The agent's action model does not offer this now.
    Incapable,
    /// No plan reaches the goal.
    Unreachable,
    /// The mailbox is full.
    MailboxFull,
    /// Other work has to finish first, or the limit on work in progress is reached.
    Busy,
    /// A newer plan for the same goal has been received.
    StaleToken,
    /// There is no object of this name.
    Unknown,
    /// The feature is planned, but not implemented yet.
    NotBuilt,
    /// The content contradicts another agent or the ontology.
    Conflict,
    /// The daemon is draining.
    Stopping,
    /// This replica is a standby; another replica with the same name is the leader.
    StandingBy,
    /// Whether the action was done is unknown: the agent was restarted during it.
    Uncertain,
    /// Whether the action was done is unknown: it exceeded its time limit and was ended.
    TimedOut,
    /// No person answered the question in time.
    Unanswered,
    /// The rights in the ecosystem file do not allow the sender to send this.
    Forbidden,
    /// A reason that a newer version defines.
    #[serde(other)]
    Other,
}

/// Content of a `confirm`: progress and outcome of an action, a plan or a goal; observations.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Outcome so far.
    pub outcome: Outcome,
    /// Description, one line for a person.
    pub detail: String,
    /// The ground action that the report is about, under its agent's name for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action: Option<String>,
    /// Number of the step in the plan, from 0, if a step is done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
    /// The chosen plan, if the report announces one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<String>,
    /// Cost of that plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// Observed PDDL facts.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub observations: String,
    /// Why the agent of that action refused it, if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub declined: Option<Reason>,
    /// Earlier reports of a goal. Sent with a final report that is repeated to a requester that had
    /// been disconnected.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<HistoryEntry>,
}

/// Outcome so far of an action, a plan or a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// Under way.
    Progress,
    /// A kept goal holds now; it continues to be watched.
    Holds,
    /// Done (final).
    Done,
    /// Failed (final).
    Failed,
    /// Cancelled as requested (final).
    Cancelled,
}

/// Content of an `inform`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum Inform {
    /// From an actuator: its whole action model. Sent on activation, on each change, and on request.
    Model(Box<ModelAnnouncement>),
    /// From an actuator: its heartbeat, with the digest of its model and its state.
    Heartbeat(Heartbeat),
    /// From the Domain Maintainer: a new epoch or a changed state, and the changes.
    Epoch(EpochChange),
    /// From a Keyboard Agent: a person's answer to a `query-ref`.
    Answer(PersonsAnswer),
}

/// Content of a `query-ref`: a question to a person.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// The question.
    pub text: String,
    /// The key that the answer must be sealed to, if the answer may be a secret: an X25519 public key
    /// that the sender made for this question only, as 64 hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seal_to: Option<String>,
}

impl Question {
    /// Creates a question with an answer that is not secret.
    pub fn new(text: impl Into<String>) -> Question {
        Question { text: text.into(), seal_to: None }
    }
}

/// Content of a `cancel` that withdraws a question.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Withdrawal {
    /// Why no answer is needed any more, for a person.
    pub detail: String,
}

/// The answer of a person to a question.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PersonsAnswer {
    /// The answer as it was typed; empty if it is sealed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// The answer, sealed to the key of the question: a sealed box (libsodium's `crypto_box_seal`) of
    /// its UTF-8 text, in hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sealed: Option<String>,
}

impl PersonsAnswer {
    /// Creates an answer that is not sealed.
    pub fn plain(text: impl Into<String>) -> PersonsAnswer {
        PersonsAnswer { text: text.into(), sealed: None }
    }
}

/// A question to a person that has not been answered yet, for agents that query the open questions.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OpenQuestion {
    /// The Keyboard Agent that keeps it.
    pub keyboard: AgentId,
    /// Number of the question at that agent.
    pub question: u64,
    /// The agent that asks.
    pub from: AgentId,
    /// The question.
    pub text: String,
    /// Time for which an answer is still awaited.
    pub left: Deadline,
    /// The key that the answer must be sealed to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seal_to: Option<String>,
}

/// State of the mailboxes of one daemon's agents, for operators.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mailboxes {
    /// The daemon.
    pub daemon: DaemonId,
    /// The mailboxes of its agents, sorted by name.
    pub mailboxes: Vec<MailboxStatus>,
    /// Number of messages that arrived for agents that the daemon does not host.
    pub unknown_receiver: u64,
    /// Number of messages to all agents that could not be parsed.
    pub unreadable: u64,
    /// Number of messages that the substrate did not accept for sending.
    pub unsent: u64,
    /// Number of records that could not be stored: the disk is full, or its data cannot be read.
    #[serde(default)]
    pub unkept: u64,
    /// Number of messages that were rejected, by kind of breach.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rejected: BTreeMap<String, u64>,
}

/// State of one mailbox. Counts begin with the agent's incarnation.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MailboxStatus {
    /// The agent.
    pub agent: AgentId,
    /// Number of messages in it now.
    pub waiting: u64,
    /// Largest number of messages in it.
    pub waiting_max: u64,
    /// Number of messages that were put in.
    pub received: u64,
    /// Number of messages for which there was no room: requests were refused, others are retried by
    /// their sender.
    pub overflowed: u64,
}

/// Converts a content to the JSON of an envelope.
///
/// Contents are plain data, so that this cannot fail. If it did, the content would be null, and the
/// receiver would answer `not-understood`.
pub fn value(content: &impl Serialize) -> Value {
    serde_json::to_value(content).unwrap_or(Value::Null)
}

impl Achieve {
    /// Creates a goal that every partition pursues.
    pub fn new(goal: impl Into<String>, keep: Keep, priority: i32) -> Achieve {
        Achieve { goal: goal.into(), keep, priority, partition: Partition::Pursue }
    }
}

impl Outcome {
    /// Whether no further report follows.
    pub fn is_final(self) -> bool {
        matches!(self, Outcome::Done | Outcome::Failed | Outcome::Cancelled)
    }
}

impl Report {
    /// Creates a report of `outcome` with one line for a person.
    pub fn new(outcome: Outcome, detail: impl Into<String>) -> Report {
        Report {
            outcome,
            detail: detail.into(),
            action: None,
            step: None,
            plan: None,
            cost: None,
            observations: String::new(),
            declined: None,
            history: Vec::new(),
        }
    }
}

impl Refusal {
    /// Creates a refusal, with its reason for programs and for persons.
    pub fn new(reason: Reason, detail: impl Into<String>) -> Refusal {
        Refusal { reason, detail: detail.into(), under_way: None }
    }
}

impl fmt::Display for ActionToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ActionToken { epoch, conversation, round, step } = self;
        write!(f, "{epoch}/{conversation}/{round}/{step}")
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Mode::Centralized => "centralized",
            Mode::Decentralized => "decentralized",
        })
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Outcome::Progress => "progress",
            Outcome::Holds => "holds",
            Outcome::Done => "done",
            Outcome::Failed => "failed",
            Outcome::Cancelled => "cancelled",
        })
    }
}

impl fmt::Display for PlanStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            PlanStatus::Solved => "solved",
            PlanStatus::Unsolvable => "proven unsolvable",
            PlanStatus::Exhausted => "search ended without a plan or a proof",
            PlanStatus::Limit => "a limit was reached",
            PlanStatus::Cancelled => "cancelled",
            PlanStatus::Unsupported => "unsupported",
        })
    }
}

/// Answer of a daemon to a query for discovered agents.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Appeared {
    /// The daemon.
    pub daemon: DaemonId,
    /// The discovered agents, sorted by discoverer and by name.
    pub discovered: Vec<Discovered>,
}

/// An agent that was discovered, and that no file names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Discovered {
    /// Name of the agent.
    pub agent: AgentId,
    /// The discoverer, for a person: `plugin thermometer`, `zigbee`.
    pub by: String,
    /// Whether it takes part in the ecosystem.
    pub joined: bool,
    /// Why it does not, or which part of it cannot be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
    /// The lines of an ecosystem file that would configure it.
    pub toml: String,
}
