//! What the paper's roles put inside a message (Table 1; design, “Messages”).
//!
//! Facts, goals, models and plans travel as PDDL text inside these shapes. All of them tolerate
//! fields they do not know; none is understood by the envelope.

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
    /// To the Plan Executor: nobody needs this plan any more.
    CallOff(CallOff),
    /// To an actuator: execute this action, translated into its method.
    Act(Box<Act>),
    /// To the Domain Maintainer: change the state.
    ChangeState(ChangeState),
    /// To the Plan Requester: from now on one agent plans for all, or each for itself.
    SetMode(SetMode),
    /// To a Keyboard Agent: a person's answer to one of its open questions.
    AnswerQuestion(AnswerQuestion),
    /// To the Domain Maintainer: change what plans are measured by.
    ChangeMetric(ChangeMetric),
    /// To the Domain Maintainer: take actions off, or give them back.
    ChangeActions(ChangeActions),
    /// To the Domain Maintainer: believe what the asker has observed.
    Observe(Observation),
    /// To a Journal: keep these records; confirmed when they are on disk.
    Keep(Keeping),
}

/// Ask that one agent plans for all, or each for itself.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetMode {
    /// The flow from now on.
    pub mode: Mode,
}

/// Which flow an ecosystem uses (the paper, “Centralized Planning”, “Decentralized Planning”).
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// One Planning Agent plans for all.
    Centralized,
    /// Each actuator plans for itself and bids.
    #[default]
    Decentralized,
}

/// Give a person's answer to a question that a keyboard keeps.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerQuestion {
    /// Which of the keyboard's questions.
    pub question: u64,
    /// What the person says.
    #[serde(flatten)]
    pub said: PersonsAnswer,
}

/// Ask for a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Achieve {
    /// A PDDL condition over the ecosystem's ontology.
    pub goal: String,
    /// Reach it once, or keep it.
    #[serde(default)]
    pub keep: Keep,
    /// Greater goes first.
    #[serde(default)]
    pub priority: i32,
    /// What happens to it while the ecosystem is in pieces.
    #[serde(default)]
    pub partition: Partition,
}

/// What happens to a goal where not all daemons can be seen.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Partition {
    /// Every piece goes on with what it has.
    #[default]
    Pursue,
    /// It is planned for only where most Journals can be seen, which is in one piece at most.
    Wait,
}

/// How long a goal lasts.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Keep {
    /// It ends when it is reached.
    #[default]
    Achieve,
    /// It stays, and is planned for again whenever the state stops satisfying it.
    Maintain,
}

/// Ask for a plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanRequest {
    /// PDDL domain.
    pub domain: String,
    /// PDDL problem.
    pub problem: String,
    /// The capability epoch both belong to.
    pub epoch: u64,
    /// What is left of the plan that was under way, one step per line, if it is to be gone on with
    /// where that is possible.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<String>,
}

/// Ask for the execution of a plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Execute {
    /// The PDDL domain the plan belongs to.
    pub domain: String,
    /// The PDDL problem: objects, the state as known, the goal.
    pub problem: String,
    /// The plan, one step per line.
    pub plan: String,
    /// The capability epoch all three belong to.
    pub epoch: u64,
    /// In whose term the plan was made: see [`ActionToken::epoch`].
    #[serde(default)]
    pub term: u64,
    /// Counts the plans of this conversation, from 1.
    pub round: u32,
    /// The steps that are known to be done, from 0: the plan was begun by another executor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub done: Vec<u32>,
    /// What the agents in the plan offer.
    #[serde(default)]
    pub offers: Offers,
    /// The words of the domain for what is unknown: see [`Snapshot::knowledge`].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub knowledge: BTreeMap<String, Auxiliary>,
}

/// Ask that a plan of the conversation's goal be given up. One that runs is taken back, another is not
/// begun any more: it may have been asked for by a Plan Requester that acts no longer, and its request
/// may come later than this.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CallOff {
    /// See [`Execute::term`].
    pub term: u64,
    /// See [`Execute::round`].
    pub round: u32,
}

/// What each agent offers: its actions, under the names it knows them by.
pub type Offers = BTreeMap<AgentId, BTreeMap<String, Offer>>;

/// One action of one agent.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Offer {
    /// Its name in the composite domain; another than its agent's where two agents mean
    /// different things by one name.
    pub inside: String,
    /// The PDDL fact that lets this agent act by this schema; without it, it cannot.
    pub guard: String,
    /// What the actuator runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<Method>,
}

/// A goal, for those who ask what the ecosystem is about.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalStatus {
    /// Its conversation: what `cancel` and `watch` name it by.
    pub conversation: ConversationId,
    /// The PDDL condition.
    pub goal: String,
    /// Reach it once, or keep it.
    pub keep: Keep,
    /// Greater goes first.
    pub priority: i32,
    /// Where it stands, for a person.
    pub phase: String,
    /// Plans made for it so far.
    pub rounds: u32,
    /// What has happened, oldest first; bounded.
    pub history: Vec<HistoryEntry>,
}

/// Something that happened to a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HistoryEntry {
    /// When: milliseconds since 1970-01-01 UTC, by the clock of the machine that pursued the goal then.
    pub at_ms: u64,
    /// The outcome that the asker was sent with this entry; `None` if it was not sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<Outcome>,
    /// What, for a person.
    pub text: String,
}

/// An agent's actions, each with the method that carries it out.
pub type Methods = BTreeMap<String, Method>;

/// What an actuator runs when an action is asked of it (design, “Action models”).
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Method {
    /// The method's name.
    pub method: String,
    /// Its arguments: a variable of the action (`?to`) or a literal.
    #[serde(default)]
    pub arguments: BTreeMap<String, String>,
    /// The longest it may take.
    pub timeout: Deadline,
}

/// Ask an actuator to act.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Act {
    /// The ground action under the name the actuator knows.
    pub action: String,
    /// The method to run.
    pub method: String,
    /// Its arguments, bound.
    pub arguments: BTreeMap<String, String>,
    /// Executed at most once.
    pub token: ActionToken,
}

/// Names one commitment to act (design, “Execution”). The actuator executes it at most once: asked
/// for it again, it answers what became of it. A token of an older plan for the same goal than the
/// newest it has seen it refuses.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ActionToken {
    /// In whose term the plan was made: greater for every Plan Requester that takes a goal over.
    pub epoch: u64,
    /// The goal's conversation.
    pub conversation: ConversationId,
    /// Which plan of that term.
    pub round: u32,
    /// Which step of that plan, from 0.
    pub step: u32,
}

/// Content of a `cancel`; where there is none, it is meant as it stands.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cancelling {
    /// Whoever cancels has stood down, and another may follow the same commitment: it is given up
    /// only if nobody does.
    pub unless_followed: bool,
}

/// Ask for records to be kept.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Keeping {
    /// The records; of one key, the newest version counts.
    pub records: Vec<Record>,
}

/// Something that must outlive its agent: a goal, a plan under way, how they ended.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// What it is about: `goal/CONVERSATION`, `plan/CONVERSATION`, `state/requested`.
    pub key: String,
    /// Which version of it.
    pub version: Version,
    /// What it says; null where it is to be forgotten.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub body: Value,
}

/// Orders what was written about one thing, whoever wrote it and whatever its clock says.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
pub struct Version {
    /// The writer's term: greater than any it has read.
    pub term: u64,
    /// Counts the versions of that term.
    pub count: u64,
}

/// Content of a `cfp`: propose plans for these conjuncts of a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CallForProposals {
    /// Ground PDDL conditions.
    pub conjuncts: Vec<String>,
    /// Whether one proposal for all conjuncts together is wanted and nothing else: the second
    /// round, after an agent was cheapest for several conjuncts alone.
    #[serde(default)]
    pub together: bool,
}

/// Content of an actuator's `agree` to a `cfp`. At most one of the proposals can be accepted.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bid {
    /// The alternatives.
    pub proposals: Vec<Proposal>,
    /// Digest of the local domain and state the bidder planned in; ask it for `domain` to read
    /// them.
    pub domain_digest: String,
}

/// One alternative of a bid.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// The conjuncts it covers, as the call spelled them.
    pub covers: Vec<String>,
    /// The plan, one step per line.
    pub plan: String,
    /// Its cost in the bidder's local domain.
    pub cost: f64,
}

/// Content of an actuator's `agree` to an action.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// The commitment taken on.
    pub token: ActionToken,
}

/// Content of the Planning Agent's `propose`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanProposal {
    /// How the search ended.
    pub status: PlanStatus,
    /// The plan, one step per line, where one was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<String>,
    /// Its cost, recomputed by the validator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// Why there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

/// How a search ended; proof and resignation are never confused.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlanStatus {
    /// There is a plan.
    Solved,
    /// It is proven that there is none.
    Unsolvable,
    /// The search ended without a plan and without a proof.
    Exhausted,
    /// A limit on work, memory or time ended it.
    Limit,
    /// The request was cancelled.
    Cancelled,
    /// The problem uses what the planner does not support.
    Unsupported,
}

/// Content of `accept-proposal` and `reject-proposal`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// What was chosen of the receiver's proposals; empty in a rejection.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub covers: Vec<String>,
    /// Why.
    pub detail: String,
}

/// Content of a `refuse` and of a `not-understood`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refusal {
    /// Why, for a program.
    pub reason: Reason,
    /// Why, for a person.
    pub detail: String,
    /// The plan for the same goal that is under way instead, where another Plan Requester made it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub under_way: Option<Box<Execute>>,
}

/// Why something was declined.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Reason {
    /// The text could not be read as a message of this version.
    Unreadable,
    /// The content could not be read, or names things that do not exist.
    BadContent,
    /// Nothing this agent's callbacks know how to take.
    UnexpectedPerformative,
    /// The protocol does not allow this turn here.
    OutOfTurn,
    /// Outside what this agent's action model offers now.
    Incapable,
    /// No plan reaches the goal.
    Unreachable,
    /// The mailbox is full.
    MailboxFull,
    /// Something else has to finish first, or the bound on work in progress is reached.
    Busy,
    /// A newer plan for the same goal was seen.
    StaleToken,
    /// There is nothing under this name.
    Unknown,
    /// Part of the design, not built yet.
    NotBuilt,
    /// It contradicts what another agent, or the ontology, says.
    Conflict,
    /// The daemon is draining.
    Stopping,
    /// Another agent of this name acts.
    StandingBy,
    /// Whether it was done cannot be known: the agent was restarted while it acted.
    Uncertain,
    /// Whether it was done cannot be known: it took longer than it may, and was ended.
    TimedOut,
    /// Nobody answered a question to a person in time.
    Unanswered,
    /// The ecosystem's file does not let the sender say this.
    Forbidden,
    /// A reason of a newer version.
    #[serde(other)]
    Other,
}

/// Content of a `confirm`: progress and outcome of an action, a plan or a goal; observations.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// How it stands.
    pub outcome: Outcome,
    /// For a person: one line.
    pub detail: String,
    /// The ground action it is about, under its agent's name for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action: Option<String>,
    /// Which step of the plan that was, from 0, where it is done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
    /// The plan that was chosen, where this is the news.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<String>,
    /// The cost of that plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// PDDL facts observed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub observations: String,
    /// Why the agent of that action declined it, where it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub declined: Option<Reason>,
    /// The earlier reports of a goal, sent with an end that is repeated to an asker that was disconnected.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<HistoryEntry>,
}

/// How an action, a plan or a goal stands.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// On its way.
    Progress,
    /// A maintained goal holds now; it goes on being watched.
    Holds,
    /// Done: the last word.
    Done,
    /// Failed: the last word.
    Failed,
    /// Given up as asked: the last word.
    Cancelled,
}

/// Content of an `inform`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum Inform {
    /// An actuator: my whole action model; on activation, on change, and when asked for.
    Model(Box<ModelAnnouncement>),
    /// An actuator: I work, my model is still the one of this digest, and this is my state.
    Heartbeat(Heartbeat),
    /// The Domain Maintainer: a new capability epoch or a changed state, and what changed.
    Epoch(EpochChange),
    /// A Keyboard Agent: what a person answered to a `query-ref`.
    Answer(PersonsAnswer),
}

/// Content of a `query-ref`: a question to a person.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// The question.
    pub text: String,
    /// The key that the answer is to be sealed to, which may be a secret: an X25519 public key of the
    /// asker's, made for this question alone, as 64 hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seal_to: Option<String>,
}

impl Question {
    /// A question whose answer is no secret.
    pub fn new(text: impl Into<String>) -> Question {
        Question { text: text.into(), seal_to: None }
    }
}

/// Content of a `cancel` that withdraws a question.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Withdrawal {
    /// Why nobody need answer any more, for a person.
    pub detail: String,
}

/// What a person answered.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PersonsAnswer {
    /// The answer, as it was typed; empty where it is sealed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// The answer, sealed to the key of the question: a sealed box (libsodium's `crypto_box_seal`) of
    /// its UTF-8 text, in hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sealed: Option<String>,
}

impl PersonsAnswer {
    /// An answer that anybody may read.
    pub fn plain(text: impl Into<String>) -> PersonsAnswer {
        PersonsAnswer { text: text.into(), sealed: None }
    }
}

/// A question to a person that nobody has answered, for those who ask what is open.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OpenQuestion {
    /// The keyboard that keeps it.
    pub keyboard: AgentId,
    /// Its number at that keyboard.
    pub question: u64,
    /// Who asks.
    pub from: AgentId,
    /// The question.
    pub text: String,
    /// How long an answer is still waited for.
    pub left: Deadline,
    /// The key that the answer is to be sealed to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seal_to: Option<String>,
}

/// How full the mailboxes of one daemon's agents are, for those who look after it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mailboxes {
    /// The daemon.
    pub daemon: DaemonId,
    /// Its agents' mailboxes, in the order of their names.
    pub mailboxes: Vec<MailboxStatus>,
    /// Messages that came for agents it does not host.
    pub unknown_receiver: u64,
    /// Messages to all that it could not read.
    pub unreadable: u64,
    /// Messages that its substrate did not take.
    pub unsent: u64,
    /// What its disk did not keep: it is full, or what is on it cannot be read.
    #[serde(default)]
    pub unkept: u64,
    /// What came and was not believed, or was not to be said: by what was wrong with it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rejected: BTreeMap<String, u64>,
}

/// How full one mailbox is. Counts begin with the agent's life.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MailboxStatus {
    /// Whose it is.
    pub agent: AgentId,
    /// Letters that lie in it now.
    pub waiting: u64,
    /// Letters it holds at most.
    pub waiting_max: u64,
    /// Letters that were put in.
    pub received: u64,
    /// Letters that found no room: requests were refused, the rest is repeated by its sender.
    pub overflowed: u64,
}

/// Turns a content into what an envelope carries.
///
/// Contents are plain data, so this cannot fail; were it to, the receiver answers
/// `not-understood` to a null content.
pub fn value(content: &impl Serialize) -> Value {
    serde_json::to_value(content).unwrap_or(Value::Null)
}

impl Achieve {
    /// A goal that every piece of the ecosystem pursues.
    pub fn new(goal: impl Into<String>, keep: Keep, priority: i32) -> Achieve {
        Achieve { goal: goal.into(), keep, priority, partition: Partition::Pursue }
    }
}

impl Outcome {
    /// Whether nothing more follows.
    pub fn is_final(self) -> bool {
        matches!(self, Outcome::Done | Outcome::Failed | Outcome::Cancelled)
    }
}

impl Report {
    /// A report of `outcome` with one line for a person.
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
    /// A refusal for a program and a person.
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

/// What a daemon answers when it is asked what has appeared: agents that no file names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Appeared {
    /// The daemon.
    pub daemon: DaemonId,
    /// Each, by what has found it and by name.
    pub discovered: Vec<Discovered>,
}

/// An agent that has appeared and that no file names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Discovered {
    /// Its name.
    pub agent: AgentId,
    /// What has found it, for a person: `plugin thermometer`, `zigbee`.
    pub by: String,
    /// Whether it takes part.
    pub joined: bool,
    /// Why not, or what of it cannot be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
    /// The lines that would configure it.
    pub toml: String,
}
