//! Contents of messages between the roles of the paper (its Table 1; docs/design.md, “Messages”).
//!
//! Facts, goals, models and plans are sent as PDDL text in fields of these types. All types ignore
//! unknown fields. The envelope does not interpret contents.

mod daemon;
mod goal;
mod history;
mod schedule;
mod state;
mod stop;

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{AgentId, ConversationId, DaemonId, Millis};

pub use self::daemon::{ABSENT_MAX, AbsentAgent, DaemonReport};
pub use self::goal::{GoalPhase, GoalStatus, HISTORY_ENTRIES_MAX, HistoryEntry};
pub use self::history::{
    HISTORY_EVENTS_MAX, HISTORY_PAGE_BYTES_MAX, HISTORY_TEXT_BYTES_MAX, HistoryEvent, HistoryKind,
    HistoryPage, HistoryQuery, HistoryRoot, ReadHistory, UnknownHistoryKind,
};
pub use self::schedule::{DueStatus, GoalTimes, ScheduleGoal};
pub use self::state::{
    ActionOf, Auxiliary, BelievedFact, BelievedState, ChangeActions, ChangeMetric, ChangeState,
    Claim, EpochChange, Guard, Heartbeat, ModelAnnouncement, Observation, Requested, RequestedFact,
    RequestedSince, Snapshot,
};
pub use self::stop::{
    ButtonPosition, ButtonReport, ReleaseStops, STOP_ID_BYTES_MAX, STOP_NAMES_MAX, Stop,
    StopEffect, StopState,
};

/// Content of a `request`: the act that the receiver is to carry out.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "act", rename_all = "kebab-case")]
pub enum Request {
    /// To the Plan Requester: reach this goal once, or keep it.
    Achieve(Achieve),
    /// To the Plan Requester: pursue a goal at these times.
    Schedule(Box<ScheduleGoal>),
    /// To the Planning Agent: compute a plan for this domain and problem.
    Plan(PlanRequest),
    /// To the Plan Executor: execute this plan.
    Execute(Box<Execute>),
    /// To the Plan Executor: cancel a plan that is no longer needed.
    CancelPlan(CancelPlan),
    /// To an actuator: execute an action with the given method.
    Act(Box<Act>),
    /// To the Domain Maintainer: change the state.
    ChangeState(ChangeState),
    /// To the Plan Requester: change the planning mode, centralised or decentralised.
    SetMode(SetMode),
    /// To a Keyboard Agent: answer one of its open questions in the name of a person.
    AnswerQuestion(AnswerQuestion),
    /// To the Domain Maintainer: change the metric by which plans are compared.
    ChangeMetric(ChangeMetric),
    /// To the Domain Maintainer: withhold actions from planning, or give withheld actions back.
    ChangeActions(ChangeActions),
    /// To the Domain Maintainer: believe the facts that the sender has observed.
    Observe(Observation),
    /// To an actuator: end what it does, and begin nothing until the stop is released.
    Stop(Stop),
    /// To an actuator: end these stops.
    ReleaseStops(ReleaseStops),
    /// To a Journal: store records. The Journal confirms the request when the records are on disk.
    StoreRecords(StoreRecords),
    /// To a history agent: a page of what happened.
    ReadHistory(ReadHistory),
}

/// Request to change the planning mode, centralised or decentralised.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetMode {
    /// The new planning mode.
    pub mode: Mode,
}

/// The planning mode of an ecosystem (the paper, “Centralized Planning”, “Decentralized Planning”).
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

/// Request that gives a Keyboard Agent a person's answer to an open question.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerQuestion {
    /// Number of the question among the open questions of the Keyboard Agent.
    pub question: u64,
    /// The answer of the person.
    #[serde(flatten)]
    pub answer: PersonsAnswer,
}

/// Request to reach or keep a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Achieve {
    /// The goal: a PDDL condition over the ecosystem's ontology.
    pub goal: String,
    /// Whether the goal ends when it is reached, or is kept from then on.
    #[serde(default)]
    pub keep: Keep,
    /// Priority of the goal: a goal with a greater number takes precedence.
    #[serde(default)]
    pub priority: i32,
    /// Treatment of the goal during a partition.
    #[serde(default)]
    pub partition: Partition,
}

/// Treatment of a goal during a partition.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Partition {
    /// Every part of the partitioned ecosystem pursues the goal with its own agents.
    #[default]
    Pursue,
    /// Only the part of the ecosystem with a quorum of the Journals plans for the goal. At most one
    /// part has a quorum.
    Wait,
}

/// Whether a goal ends when it is reached, or is kept from then on.
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

/// Request to the Planning Agent for a plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanRequest {
    /// The PDDL domain to plan in.
    pub domain: String,
    /// The PDDL problem to solve.
    pub problem: String,
    /// Epoch of the domain and the problem: the number of changes of the set of capabilities.
    pub epoch: u64,
    /// Remaining steps of an interrupted plan, one per line, which the new plan should continue
    /// where possible; `None` if there is no such plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remaining_steps: Option<String>,
}

/// Request to execute a plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Execute {
    /// The PDDL domain in which the plan was made.
    pub domain: String,
    /// The PDDL problem that the plan solves: the objects, the known state, and the goal.
    pub problem: String,
    /// The plan to execute, one step per line.
    pub plan: String,
    /// Epoch of the domain, the problem and the plan: the number of changes of the set of
    /// capabilities.
    pub epoch: u64,
    /// Term of the Plan Requester that made the plan: see [`ActionToken::term`].
    #[serde(default)]
    pub term: u64,
    /// Number of the plan among the plans of its conversation and term, from 1.
    pub round: u32,
    /// Numbers of the steps that are known to be done, from 0; empty unless another Plan Executor
    /// has begun the plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub done: Vec<u32>,
    /// The actions that each agent in the plan offers.
    #[serde(default)]
    pub offers: Offers,
    /// The symbols of the domain that describe unknown facts; see [`Snapshot::knowledge`].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub knowledge: BTreeMap<String, Auxiliary>,
}

/// Request to cancel a plan for the goal of the message's conversation. A running plan is stopped.
/// If the plan has not arrived yet, it is not started when it arrives: a former leader may have
/// requested it, and that request may be slower than the cancellation.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CancelPlan {
    /// Term of the plan to cancel; see [`Execute::term`].
    pub term: u64,
    /// Number of the plan to cancel; see [`Execute::round`].
    pub round: u32,
}

/// The actions that each agent offers, under the agent's own name for each action.
pub type Offers = BTreeMap<AgentId, BTreeMap<String, Offer>>;

/// An action that an agent offers, as the composite domain contains it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Offer {
    /// Name of the action in the composite domain. This name differs from the agent's own name if
    /// two agents use one name for different actions.
    #[serde(alias = "inside")]
    pub schema: String,
    /// The guard: the PDDL fact that allows this agent to use the action.
    pub guard: String,
    /// The method by which the actuator carries out the action; `None` if the method is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<Method>,
    /// Number of agents that act in the action; more than one in a joint action. They are the first
    /// arguments of a step.
    #[serde(default = "one_agent", skip_serializing_if = "is_one_agent")]
    pub agents: usize,
}

fn one_agent() -> usize {
    1
}

fn is_one_agent(agents: &usize) -> bool {
    *agents == 1
}

/// Returns the agents that act in a step: the first argument, and in a joint action the next ones.
/// `action` is the name of the step's action, either the agent's own or that in the composite
/// domain. Without an offer for it, one agent acts.
pub fn acting_agents<'a>(
    offers: &Offers,
    action: &str,
    arguments: impl IntoIterator<Item = &'a str>,
) -> Vec<AgentId> {
    let mut names = arguments.into_iter();
    let Some(first) = names.next().and_then(|name| AgentId::new(name).ok()) else {
        return Vec::new();
    };
    let known = offers.get(&first).and_then(|actions| {
        let is_it = |(outside, offer): &(&String, &Offer)| {
            outside.eq_ignore_ascii_case(action) || offer.schema.eq_ignore_ascii_case(action)
        };
        actions.iter().find(is_it)
    });
    let agents = known.map_or(1, |(_, offer)| offer.agents.max(1));
    let partners = names.take(agents - 1).filter_map(|name| AgentId::new(name).ok());
    std::iter::once(first).chain(partners).collect()
}

/// The methods of an agent, each under the name of its action.
pub type Methods = BTreeMap<String, Method>;

/// The method that an actuator runs for an action (docs/design.md, “Action models”).
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Method {
    /// Name of the method.
    pub method: String,
    /// Arguments of the method, by name. A value is a variable of the action (`?to`) or a literal.
    #[serde(default)]
    pub arguments: BTreeMap<String, String>,
    /// Longest time that the method may take. After it, the action is reported as timed
    /// out.
    pub timeout: Millis,
}

impl Method {
    /// Creates a method. Each argument is its name and its value, as in [`Method::arguments`].
    pub fn new(method: &str, arguments: &[(&str, &str)], timeout: Duration) -> Method {
        let argument = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        let arguments = arguments.iter().map(argument).collect();
        Method { method: method.to_owned(), arguments, timeout: Millis(timeout) }
    }

    /// Returns the arguments of the method for the given values of the action's parameters. The keys are
    /// names of parameters, in lower case and without `?`.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if an argument is no parameter of the action.
    pub fn bind(&self, values: &BTreeMap<&str, &str>) -> Result<BTreeMap<String, String>, String> {
        let value = |template: &String| match template.strip_prefix('?') {
            None => Ok(template.clone()),
            Some(variable) => values
                .get(variable.to_lowercase().as_str())
                .map(|value| (*value).to_owned())
                .ok_or_else(|| {
                    let method = &self.method;
                    format!(
                        "method `{method}` uses `{template}`, which is no parameter of its action"
                    )
                }),
        };
        let arguments = self.arguments.iter();
        arguments.map(|(name, template)| Ok((name.clone(), value(template)?))).collect()
    }
}

/// Request to an actuator to carry out an action.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Act {
    /// The ground action, under the actuator's own name for it.
    pub action: String,
    /// Name of the method to run.
    pub method: String,
    /// Values of the method's arguments, by name.
    pub arguments: BTreeMap<String, String>,
    /// Identifier of the commitment to act. The action is executed at most once for each
    /// identifier.
    pub token: ActionToken,
    /// How long the actuator waits for the other agents of a joint action; `None` if it acts alone.
    /// With it, `agree` says that the actuator is ready, and the action begins with
    /// `accept-proposal`, which is sent to all of its agents when all are ready. With 0 all are ready:
    /// a daemon asks a plugin in this way, for which it has waited itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ready_for: Option<Millis>,
}

/// Identifier of one commitment to act (docs/design.md, “Execution”). For each token, the actuator
/// executes the action at most once; a repeated request with the same token is answered with the
/// result. If an actuator has received a newer plan for the same goal, it refuses the tokens of the
/// older plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ActionToken {
    /// Term of the Plan Requester that made the plan. A Plan Requester that takes over a goal has a
    /// greater term than all its predecessors.
    #[serde(alias = "epoch")]
    pub term: u64,
    /// Conversation of the goal.
    pub conversation: ConversationId,
    /// Number of the plan in the term, from 1.
    pub round: u32,
    /// Number of the step in the plan, from 0.
    pub step: u32,
}

/// Content of a `cancel` of an action. A `cancel` without content cancels unconditionally.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct CancelAction {
    /// Whether to cancel the action only if no other agent follows the same commitment. A former
    /// leader sets this field, because the new leader may follow the commitment.
    pub unless_followed: bool,
}

/// Request to a Journal to store records.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoreRecords {
    /// The records to store. Of several records with the same key, only the one with the greatest
    /// version is kept.
    pub records: Vec<Record>,
}

/// A record that must outlive the agent that writes it: a goal, a running plan, or the end of
/// either.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Key of the record: `goal/CONVERSATION`, `plan/CONVERSATION`, `due/CONVERSATION` or
    /// `state/requested`.
    pub key: String,
    /// Version of the record; a greater version replaces a smaller one.
    pub version: Version,
    /// Data of the record; null to remove the record.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub body: Value,
}

/// Version of a record. Versions of all writers are ordered, without using their clocks.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
pub struct Version {
    /// Term of the writer, which is greater than every term that the writer has read.
    pub term: u64,
    /// Number of the version among those that the writer made in this term.
    pub count: u64,
}

/// Content of a `cfp`: a call for plans that reach these conjuncts of a goal, or for the agreement
/// to a part of a joint plan.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CallForProposals {
    /// The conjuncts to propose plans for: ground PDDL conditions.
    pub conjuncts: Vec<String>,
    /// Whether only a proposal for all conjuncts together is wanted. This is the case in a second
    /// round, if one agent had the cheapest proposals for several single conjuncts in the first
    /// round.
    #[serde(default)]
    pub together: bool,
    /// The receiver's part of a joint plan for the conjuncts, if the call asks for the agreement to
    /// this part instead of for proposals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<JointPlanPart>,
}

/// What one agent does in a joint plan (a plan in which several agents act), and what the other
/// agents change in between.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointPlanPart {
    /// Digest of the whole joint plan, the same in the calls to all its agents.
    pub digest: String,
    /// The receiver's steps and the changes by others, in the order of the plan.
    pub steps: Vec<PartStep>,
}

/// An element of a [`JointPlanPart`].
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PartStep {
    /// A step of the receiver, with its own name for the action.
    Own(String),
    /// What the steps of other agents change between two steps of the receiver: facts that become
    /// true, `(not FACT)` for facts that become false, and new values of functions.
    Others(String),
}

impl PartStep {
    /// Returns the PDDL of the element.
    pub fn text(&self) -> &str {
        let (PartStep::Own(text) | PartStep::Others(text)) = self;
        text
    }
}

/// Content of an actuator's `agree` to a `cfp`: alternative proposals, of which at most one can be
/// accepted.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bid {
    /// The alternative proposals of the bidder.
    pub proposals: Vec<Proposal>,
    /// Digest of the bidder's local domain and state, in which the proposals were planned. The
    /// bidder answers the query `domain` with this domain and state.
    pub domain_digest: String,
    /// Digest of the joint plan of which the bidder accepts a part: the answer to a call with a
    /// [`JointPlanPart`]. The only proposal then consists of the bidder's own steps. `None` in the
    /// answer to every other call.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agreed: Option<String>,
}

/// A plan that a bidder proposes for some conjuncts; one of the alternatives of a bid.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// The conjuncts that the plan reaches, in the spelling of the call for proposals.
    pub covers: Vec<String>,
    /// The proposed plan, one step per line.
    pub plan: String,
    /// Cost of the proposed plan in the bidder's local domain.
    pub cost: f64,
}

/// Content of an actuator's `agree` to an action.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Identifier of the commitment to act that the actuator has accepted.
    pub token: ActionToken,
    /// Whether the actuator has begun the action before, or its part of a joint action.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub has_begun: bool,
}

/// Content of the Planning Agent's `propose`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanProposal {
    /// How the search for a plan ended.
    pub status: PlanStatus,
    /// The plan, one step per line; `None` if no plan was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<String>,
    /// Cost of the plan, recomputed by the validator; `None` if no plan was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// The reason why there is no plan, as text for a person; `None` if there is a plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

/// Result of a search for a plan. A proof that no plan exists (`Unsolvable`) and a search that gave
/// up (`Exhausted`, `Limit`) are different variants.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlanStatus {
    /// A plan was found.
    Solved,
    /// The search has proved that no plan exists.
    Unsolvable,
    /// The search ended without a plan and without a proof.
    Exhausted,
    /// The search ended because it reached a limit on work, memory or time.
    Limit,
    /// The request for the plan was cancelled.
    Cancelled,
    /// The problem uses a feature that the planner does not support.
    Unsupported,
}

/// Content of `accept-proposal` and `reject-proposal`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// The conjuncts of the receiver's accepted proposal; empty if its proposals are rejected.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub covers: Vec<String>,
    /// Whether all agents of a joint action have done their parts, so that the action is done. Without
    /// it, an `accept-proposal` to such an agent says that all are ready, and that the action begins.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub are_parts_done: bool,
    /// The reason for the choice, as text for a person.
    pub detail: String,
}

impl Choice {
    /// Creates a choice about proposals, which has the conjuncts of the accepted one.
    pub fn new(covers: Vec<String>, detail: impl Into<String>) -> Choice {
        Choice { covers, are_parts_done: false, detail: detail.into() }
    }
}

/// Content of a `refuse` and of a `not-understood`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refusal {
    /// Reason why the message was declined, as a code for programs.
    pub reason: Reason,
    /// Reason why the message was declined, as text for a person.
    pub detail: String,
    /// The running plan for the same goal that another Plan Requester made, because of which the
    /// requested plan is refused; `None` if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub under_way: Option<Box<Execute>>,
}

/// Reason why a message was declined, as a code for programs.
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
    /// The agent's action model does not offer the requested action now.
    Incapable,
    /// No plan reaches the goal.
    Unreachable,
    /// The mailbox of the receiver is full.
    MailboxFull,
    /// Other work has to finish first, or the limit on concurrent work is reached.
    Busy,
    /// A newer plan for the same goal has arrived, so the older plan's token is no longer valid.
    StaleToken,
    /// The agent, goal or record that the message names does not exist.
    Unknown,
    /// The requested feature is planned, but not implemented yet.
    NotBuilt,
    /// The content contradicts another agent or the ontology.
    Conflict,
    /// A stop forbids the action, until the stop is released.
    Stopped,
    /// The daemon is draining: its agents cancel what they have begun, and begin nothing more.
    Stopping,
    /// This replica is a standby; another replica with the same name is the leader.
    StandingBy,
    /// The agent was restarted during the action, so whether the action was done is unknown.
    Uncertain,
    /// The action exceeded its time limit or was ended from outside, so whether it was done is
    /// unknown.
    TimedOut,
    /// No person answered the question in time.
    Unanswered,
    /// The rights in the ecosystem file do not allow the sender to send this message.
    Forbidden,
    /// The agent has found that its action model promised too much, and has announced a more precise
    /// one: the next plan can be made with it.
    ModelChanged,
    /// The reason is defined by a newer version only.
    #[serde(other)]
    Other,
}

/// Content of a `confirm`: progress and outcome of an action, a plan or a goal; observations.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// State of the reported action, plan or goal: under way, or how it ended.
    pub outcome: Outcome,
    /// Description of the outcome, as one line of text for a person.
    pub detail: String,
    /// The ground action that the report is about, under the acting agent's own name for it; `None`
    /// if the report is about something else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action: Option<String>,
    /// The agent that failed to carry out `action`; `None` if it is the first argument of the action, or
    /// if no agent failed by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<AgentId>,
    /// Whether the agent has done its part of a joint action, and waits for the others. Only with the
    /// outcome `progress`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_part_done: bool,
    /// Number of the completed step in the plan, from 0; `None` if the report is not about a
    /// completed step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
    /// The chosen plan; `None` in a report of any other event.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<String>,
    /// Cost of the chosen plan; `None` in a report of any other event.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// PDDL facts that were observed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub observations: String,
    /// Reason why the reported action was refused or failed, as a code; `None` if there is no code for
    /// it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub declined: Option<Reason>,
    /// What the report says about the time by which a goal should be reached; `None` if it says
    /// nothing about that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lateness: Option<GoalLateness>,
    /// Effect of the stop that the report confirms; `None` if the report is about something else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop_effect: Option<StopEffect>,
    /// Earlier reports about the goal. Only a final report that is repeated to a reconnected
    /// requester has them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<HistoryEntry>,
    /// The events that were asked for; `None` in a report of anything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub history_page: Option<Box<HistoryPage>>,
}

/// Whether a goal is late that should be reached by some time. It goes on nevertheless.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GoalLateness {
    /// The goal will probably not be reached by the time.
    Expected,
    /// The time has passed, and the goal is not reached.
    Late,
    /// The lateness is defined by a newer version only.
    #[serde(other)]
    Other,
}

/// State of an action, a plan or a goal: under way, or how it ended.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// The action, plan or goal is under way.
    Progress,
    /// The kept goal holds now; changes of the state are still watched.
    Holds,
    /// The action or plan is done, or the goal is reached (final).
    Done,
    /// The action, plan or goal has failed (final).
    Failed,
    /// The action, plan or goal has been cancelled as requested (final).
    Cancelled,
}

/// Content of an `inform`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum Inform {
    /// From an actuator: its whole action model. Sent on activation, on each change of the model,
    /// and on request.
    Model(Box<ModelAnnouncement>),
    /// From an actuator: its heartbeat, which contains its state and the digest of its model.
    Heartbeat(Heartbeat),
    /// From the Domain Maintainer: a new epoch or a changed state, as differences to the previous
    /// one.
    Epoch(EpochChange),
    /// From a Keyboard Agent: a person's answer to a `query-ref`.
    Answer(PersonsAnswer),
}

/// Content of a `query-ref`: a question to a person.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// The question, as text for a person.
    pub text: String,
    /// Public key for sealing the answer; `None` if the answer is not secret. The sender made this
    /// X25519 key for this question only. It is written as 64 hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seal_to: Option<String>,
}

impl Question {
    /// Creates a question without a secret answer.
    pub fn new(text: impl Into<String>) -> Question {
        Question { text: text.into(), seal_to: None }
    }
}

/// Content of a `cancel` that withdraws a question.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Withdrawal {
    /// Reason why the question no longer needs an answer, as text for a person.
    pub detail: String,
}

/// The answer of a person to a question.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PersonsAnswer {
    /// The answer as typed; empty if the answer is sealed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// The sealed answer: a sealed box (libsodium's `crypto_box_seal`) of the UTF-8 text, made with
    /// the key of the question, in hexadecimal digits. `None` if the answer is not sealed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sealed: Option<String>,
}

impl PersonsAnswer {
    /// Creates an answer that is not sealed.
    pub fn plain(text: impl Into<String>) -> PersonsAnswer {
        PersonsAnswer { text: text.into(), sealed: None }
    }
}

/// A question to a person without an answer yet, in the list of open questions that agents can
/// query.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OpenQuestion {
    /// The Keyboard Agent with the open question.
    pub keyboard: AgentId,
    /// Number of the question among the open questions of that Keyboard Agent.
    pub question: u64,
    /// The agent that asks the question.
    pub from: AgentId,
    /// The question, as text for a person.
    pub text: String,
    /// Remaining time for which the asking agent waits for an answer.
    pub remaining: Millis,
    /// Public key for sealing the answer; `None` if the answer is not secret.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seal_to: Option<String>,
}

/// State of the mailboxes of one daemon's agents, for operators.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mailboxes {
    /// The daemon that hosts the agents.
    pub daemon: DaemonId,
    /// The mailboxes of the daemon's agents, sorted by name of the agent.
    pub mailboxes: Vec<MailboxStatus>,
    /// Number of messages that arrived for agents that the daemon does not host.
    pub unknown_receiver: u64,
    /// Number of broadcast messages that could not be parsed.
    pub unreadable: u64,
    /// Number of messages that the substrate did not accept for sending.
    pub not_sent: u64,
    /// Number of records that could not be stored, because the disk is full or the stored data
    /// cannot be read.
    #[serde(default)]
    pub not_persisted: u64,
    /// Number of rejected messages, by the kind of rule that they broke.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rejected: BTreeMap<String, u64>,
}

/// State of the mailbox of one agent. All counts start at zero with the agent's incarnation.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MailboxStatus {
    /// The agent that the mailbox belongs to.
    pub agent: AgentId,
    /// Number of messages that wait in the mailbox now.
    pub waiting: u64,
    /// Largest number of messages that have waited in the mailbox at one time in this incarnation.
    pub waiting_max: u64,
    /// Number of messages that were put into the mailbox.
    pub received: u64,
    /// Number of messages that did not fit into the mailbox. Requests among them were refused; the
    /// senders retry the other messages.
    pub overflowed: u64,
}

/// Converts a content to the JSON of an envelope.
///
/// Contents are plain data, so the conversion cannot fail. If it did, the content would be null,
/// and the receiver would answer with `not-understood`.
pub fn value(content: &impl Serialize) -> Value {
    serde_json::to_value(content).unwrap_or(Value::Null)
}

impl Request {
    /// Returns the goal that is to be pursued from now on; `None` if the request is of another kind,
    /// or asks for a goal at times of its own.
    pub fn goal(&self) -> Option<&Achieve> {
        match self {
            Request::Achieve(goal) => Some(goal),
            Request::Schedule(scheduled) if scheduled.times.is_at_once() => Some(&scheduled.goal),
            _ => None,
        }
    }
}

impl Achieve {
    /// Creates a request for a goal that every part of a partitioned ecosystem pursues.
    pub fn new(goal: impl Into<String>, keep: Keep, priority: i32) -> Achieve {
        Achieve { goal: goal.into(), keep, priority, partition: Partition::Pursue }
    }
}

impl Outcome {
    /// The final outcomes.
    pub const FINAL: [Outcome; 3] = [Outcome::Done, Outcome::Failed, Outcome::Cancelled];

    /// Whether this outcome is final, so that no further report follows.
    pub fn is_final(self) -> bool {
        matches!(self, Outcome::Done | Outcome::Failed | Outcome::Cancelled)
    }
}

impl Report {
    /// Creates a report with an outcome, and with `detail` as one line of text for a person.
    pub fn new(outcome: Outcome, detail: impl Into<String>) -> Report {
        Report {
            outcome,
            detail: detail.into(),
            action: None,
            agent: None,
            is_part_done: false,
            step: None,
            plan: None,
            cost: None,
            observations: String::new(),
            declined: None,
            lateness: None,
            stop_effect: None,
            history: Vec::new(),
            history_page: None,
        }
    }
}

impl Refusal {
    /// Creates a refusal with a reason for programs, and with `detail` as text for a person.
    pub fn new(reason: Reason, detail: impl Into<String>) -> Refusal {
        Refusal { reason, detail: detail.into(), under_way: None }
    }
}

impl fmt::Display for ActionToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ActionToken { term, conversation, round, step } = self;
        write!(f, "{term}/{conversation}/{round}/{step}")
    }
}

impl Mode {
    /// Both modes.
    pub const ALL: [Mode; 2] = [Mode::Centralized, Mode::Decentralized];

    /// Returns the name of the mode, as in messages.
    pub const fn as_str(self) -> &'static str {
        match self {
            Mode::Centralized => "centralized",
            Mode::Decentralized => "decentralized",
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
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
pub struct DiscoveryReport {
    /// The daemon that answers.
    pub daemon: DaemonId,
    /// The discovered agents, sorted by discoverer and then by name.
    pub discovered: Vec<Discovered>,
}

/// An agent that was discovered; no ecosystem file names it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Discovered {
    /// Name of the discovered agent.
    pub agent: AgentId,
    /// Name of the discoverer, as text for a person: `plugin thermometer`, `zigbee`.
    pub by: String,
    /// Whether the discovered agent takes part in the ecosystem.
    pub joined: bool,
    /// Reason why the discovered agent does not take part, or why a part of it cannot be used;
    /// `None` if there is no problem.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
    /// Lines for an ecosystem file that configure the discovered agent.
    pub toml: String,
}
