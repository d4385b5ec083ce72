//! Goals, their plans with the steps of each, and the calls for proposals.

use acl::content::{GoalPhase, Keep, Outcome};
use acl::{AgentId, ConversationId};
use serde::Serialize;

use crate::moment::Moment;

/// How a goal stands, in few words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum GoalStage {
    /// Too little was observed to know.
    #[default]
    Unknown,
    /// The goal waits for its time, and is then pursued in another conversation.
    Scheduled,
    /// The goal waits: for another goal, a capability, or a change.
    Waiting,
    /// A plan is being made.
    Planning,
    /// A plan is being executed.
    Running,
    /// The kept goal holds.
    Holding,
    /// The goal was reached.
    Done,
    /// The goal has failed.
    Failed,
    /// The goal was cancelled.
    Cancelled,
}

impl GoalStage {
    /// Whether the goal has ended.
    pub fn has_ended(self) -> bool {
        matches!(self, GoalStage::Done | GoalStage::Failed | GoalStage::Cancelled)
    }
}

/// One goal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalRow {
    /// Conversation of the goal, which identifies it.
    pub conversation: ConversationId,
    /// Number of the goal, by which people name it; `None` if it was not observed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub number: Option<u32>,
    /// The goal: a PDDL condition, on one line; empty if it was not observed.
    pub goal: String,
    /// The agent that requested the goal; `None` if the request was not observed. Goals of the file
    /// are requested by the Plan Requester.
    pub requester: Option<AgentId>,
    /// Whether the goal is kept after it is reached; `None` if that is not known.
    pub keep: Option<Keep>,
    /// Priority of the goal; a goal with a greater number takes precedence.
    pub priority: i32,
    /// How the goal stands.
    pub stage: GoalStage,
    /// The phase that the Plan Requester reports; `None` if it has not reported one.
    pub phase: Option<GoalPhase>,
    /// How the goal stands, as a short text for a person, with the reason if it waits or has
    /// failed.
    pub text: String,
    /// Moment of the request; `None` if it was not observed.
    pub asked_at: Option<Moment>,
    /// Moment of the last change.
    pub changed_at: Moment,
    /// Moment at which the goal ended; `None` if it has not.
    pub ended_at: Option<Moment>,
    /// Number of plans so far.
    pub rounds: u32,
    /// Number of steps of the newest plan; 0 if it has none.
    pub steps: u32,
    /// Number of steps of the newest plan that are done.
    pub steps_done: u32,
    /// Cost of the newest plan; `None` if it is not known.
    pub cost: Option<f64>,
    /// Sentences about the steps that run now.
    pub now: Vec<String>,
    /// How much later than usual the latest running step is, in milliseconds; `None` if none is.
    pub late_ms: Option<u64>,
    /// Expected end of the running plan; `None` if there is none, or the usual time of a step is
    /// not known.
    pub expected_end: Option<Moment>,
    /// The times of a goal by the clock; `None` if it has none.
    pub due: Option<DueRow>,
    /// Whether the goal stands in the ecosystem file, and is asked for by itself.
    pub is_of_file: bool,
}

/// The times of a goal by the clock: of one that waits for them, or of one that is pursued and has a
/// deadline or an end.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DueRow {
    /// The times of a goal that waits for them, in the words of the person that wrote them; empty if
    /// the goal is pursued.
    pub words: String,
    /// Moment at which the goal is asked for next; `None` if it is not asked for again.
    pub next_at: Option<Moment>,
    /// The same moment as text for a person, in the time zone of the goal: `Thursday 08:00`.
    pub next: Option<String>,
    /// Conversation of the goal that was asked for last and is pursued now; `None` if there is none.
    pub pursued: Option<ConversationId>,
    /// Moment by which the goal should be reached; `None` if there is no deadline.
    pub reach_by: Option<Moment>,
    /// Moment at which the goal is given up; `None` if it is not given up by the clock.
    pub given_up_at: Option<Moment>,
}

/// One goal with its plans.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalDetail {
    /// The goal.
    pub row: GoalRow,
    /// Past events of the goal, oldest first.
    pub history: Vec<GoalHistoryRow>,
    /// The plans of the goal, newest first.
    pub plans: Vec<PlanDetail>,
    /// The calls for proposals for the goal, newest first.
    pub calls: Vec<CallDetail>,
}

/// A past event of a goal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalHistoryRow {
    /// Moment of the event.
    pub at: Moment,
    /// Outcome that was reported; `None` if none was.
    pub outcome: Option<Outcome>,
    /// The event, as text for a person.
    pub text: String,
}

/// One plan of a goal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlanDetail {
    /// Term of the Plan Requester that made the plan.
    pub term: u64,
    /// Number of the plan in its term, from 1.
    pub round: u32,
    /// Cost of the plan; `None` if it is not known.
    pub cost: Option<f64>,
    /// Moment at which the plan was first observed.
    pub made_at: Moment,
    /// Moment at which the plan ended; `None` if it runs.
    pub ended_at: Option<Moment>,
    /// How the plan ended; `None` if it runs.
    pub outcome: Option<Outcome>,
    /// Why the plan ended, as text for a person; empty if that is not known.
    pub ended_because: String,
    /// The steps, in the order of the plan.
    pub steps: Vec<StepRow>,
    /// Number of further steps, which are not listed.
    pub more_steps: u64,
    /// Start of the time axis: the start of the first step, or the moment at which the plan was
    /// first observed.
    pub begins_at: Moment,
    /// End of the time axis: the end of the plan, or its expected end, but not before now.
    pub ends_at: Moment,
    /// How much later than usual the plan is, in milliseconds: the lateness of its running steps.
    pub late_ms: Option<u64>,
}

/// State of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StepState {
    /// The step has not begun.
    #[default]
    Next,
    /// The agent carries the step out.
    Running,
    /// The step is done.
    Done,
    /// The step has failed.
    Failed,
    /// The agent has refused the step.
    Refused,
    /// The step was cancelled, or its plan ended before it began.
    Cancelled,
}

/// One step of a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StepRow {
    /// Number of the step in the plan, from 0.
    pub number: u32,
    /// The step as PDDL: `(move turtlebot-1 corridor office1)`.
    pub step: String,
    /// The step as a sentence: `turtlebot-1 moves to office1`.
    pub text: String,
    /// Name of the action.
    pub action: String,
    /// The acting agent; `None` if the step names none.
    pub agent: Option<AgentId>,
    /// The arguments of the action, without the agent.
    pub arguments: Vec<String>,
    /// State of the step.
    pub state: StepState,
    /// Moment at which the step was requested; `None` if that was not observed.
    pub started_at: Option<Moment>,
    /// Moment at which the step ended; `None` if it has not.
    pub ended_at: Option<Moment>,
    /// Expected start of a step that has not begun; `None` if the usual time of a step before it
    /// is not known.
    pub expected_start: Option<Moment>,
    /// Expected end of a step that has not ended; `None` if its usual time is not known.
    pub expected_end: Option<Moment>,
    /// The usual time of the step in milliseconds: the median of its earlier runs, or of the same
    /// action of the same agent with other arguments; `None` if neither was observed.
    pub usual_ms: Option<u64>,
    /// How much longer than usual the step takes, or took, in milliseconds; `None` if it is not
    /// late.
    pub late_ms: Option<u64>,
    /// The last report about the step, or the reason why it failed; empty if there is none.
    pub detail: String,
}

/// One call for proposals, with the answers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CallDetail {
    /// Moment of the call.
    pub at: Moment,
    /// The conjuncts of the goal to propose plans for.
    pub conjuncts: Vec<String>,
    /// Whether only one proposal for all conjuncts together was wanted.
    pub together: bool,
    /// The agent that was called; `None` if all were.
    pub called: Option<AgentId>,
    /// The answers, in the order of their arrival.
    pub bids: Vec<BidRow>,
    /// Number of further answers, which are not listed.
    pub more_bids: u64,
    /// Moment at which the first bidder was told of the choice; `None` if none was.
    pub decided_at: Option<Moment>,
}

/// State of a bid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum BidState {
    /// The bidder has made proposals, and there is no choice yet.
    #[default]
    Offered,
    /// A proposal of the bidder was accepted.
    Won,
    /// The proposals of the bidder were rejected.
    Lost,
    /// The agent has declined to propose anything.
    Declined,
}

/// The answer of one agent to a call for proposals.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BidRow {
    /// The bidder.
    pub agent: AgentId,
    /// Moment of the answer.
    pub at: Moment,
    /// Time from the call to the answer, in milliseconds.
    pub after_ms: u64,
    /// State of the bid.
    pub state: BidState,
    /// The alternative proposals of the bidder; none if it declined.
    pub proposals: Vec<ProposalRow>,
    /// Reason of the choice or of the refusal, as text for a person; empty if there is none.
    pub detail: String,
}

/// One proposal of a bid.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProposalRow {
    /// The conjuncts that the proposed plan reaches.
    pub covers: Vec<String>,
    /// Cost of the proposed plan.
    pub cost: f64,
    /// The steps of the proposed plan, as PDDL.
    pub steps: Vec<String>,
    /// Whether this proposal was accepted.
    pub is_chosen: bool,
}
