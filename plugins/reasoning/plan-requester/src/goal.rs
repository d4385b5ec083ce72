//! One goal of the Plan Requester: what was asked for, its state, and the work that is under way for it.

use std::sync::Arc;
use std::time::SystemTime;

use acl::content::{
    Achieve, Execute, GoalStatus, HISTORY_ENTRIES_MAX, HistoryEntry, Keep, Outcome, Partition,
    Version,
};
use acl::{AgentId, ConversationId, Incarnation, ReplyToken};
use agent::{Participation, TimerId, WorkHandle};
use goal_lifecycle::{Attempt, GoalState};
use pddl::{Condition, Plan, PlanStep};
use planner::Cancel;

use crate::explanations::GoalContext;
use crate::planning_snapshot::{PlanningSnapshot, outside};
use crate::proposals::ContractNetState;

/// A goal that the Plan Requester pursues.
pub(crate) struct Goal {
    pub(crate) participation: Participation,
    /// Incarnation of the initiator that asked for this goal.
    pub(crate) initiator_incarnation: Incarnation,
    pub(crate) text: String,
    pub(crate) condition: Condition,
    pub(crate) keep: Keep,
    pub(crate) priority: i32,
    pub(crate) partition: Partition,
    pub(crate) state: GoalState,
    pub(crate) work: Work,
    /// What the present round of planning works with; `None` if the goal is not being planned for.
    pub(crate) round: Option<PlanningRound>,
    /// The plan of this goal that runs or ran last, as it was requested from the Plan Executor, with
    /// the steps that are known to be done.
    pub(crate) plan: Option<Box<Execute>>,
    /// A plan for this goal that the Plan Executor runs instead of the requested one, to be adopted.
    pub(crate) other_plan: Option<Box<Execute>>,
    /// Steps of the running plan that are not known to be done, with the action names that their agents
    /// use.
    pub(crate) steps_left: Vec<PlanStep>,
    /// Steps of the failed plan that were not done; the planner may reuse them.
    pub(crate) failed_steps: Vec<PlanStep>,
    /// Version of the last record of this goal that was sent to the Journals.
    pub(crate) version: Version,
    pub(crate) timer: Option<TimerId>,
    /// Facts and offered actions that concern the goal, as the last round of planning saw them.
    pub(crate) last_context: Option<GoalContext>,
    history: Vec<HistoryEntry>,
}

/// The work that is under way for a goal.
#[derive(Default)]
pub(crate) enum Work {
    /// There is none.
    #[default]
    Nothing,
    /// The domain and the state are asked for.
    Question(#[expect(dead_code, reason = "ends the question when it is dropped")] WorkHandle),
    /// The Planning Agent is asked for a plan, in this exchange.
    Planning(ReplyToken),
    /// The actuators are called for proposals.
    Proposals(Box<ContractNetState>),
    /// The reason for a missing plan is computed.
    Explanation(#[expect(dead_code, reason = "ends the work when it is dropped")] ExplanationTask),
    /// A plan is executed; its reports come in this exchange.
    Execution(ReplyToken),
}

/// Background computation of the reason why there is no plan for a goal; cancelled when it is dropped.
pub(crate) struct ExplanationTask {
    pub(crate) cancel: Cancel,
    pub(crate) _work: WorkHandle,
}

/// A computation that returns the reason why there is no plan.
pub(crate) type WhyMissing = Box<dyn FnOnce(&PlanningSnapshot, &Cancel) -> String + Send>;

/// A round of planning for a goal.
pub(crate) struct PlanningRound {
    pub(crate) known: Arc<PlanningSnapshot>,
    /// The parts of the goal that do not hold.
    pub(crate) open: Vec<Condition>,
    /// The plan that was found, with its cost.
    pub(crate) found: Option<(Plan, f64)>,
    /// The computation that explains why no plan was found.
    pub(crate) why_missing: Option<WhyMissing>,
}

impl Drop for ExplanationTask {
    fn drop(&mut self) {
        self.cancel.set();
    }
}

impl Goal {
    pub(crate) fn new(
        participation: Participation,
        incarnation: Incarnation,
        asked: Achieve,
        condition: Condition,
    ) -> Goal {
        let Achieve { goal, keep, priority, partition } = asked;
        Goal {
            participation,
            initiator_incarnation: incarnation,
            text: goal,
            condition,
            keep,
            priority,
            partition,
            state: GoalState::new(keep),
            work: Work::Nothing,
            round: None,
            plan: None,
            other_plan: None,
            steps_left: Vec::new(),
            failed_steps: Vec::new(),
            version: Version::default(),
            timer: None,
            last_context: None,
            history: Vec::new(),
        }
    }

    pub(crate) fn conversation(&self) -> &ConversationId {
        &self.participation.conversation
    }

    /// Whether `attempt` is the work that was begun last for this goal.
    pub(crate) fn is_current(&self, attempt: Attempt) -> bool {
        self.state.attempt() == attempt
    }

    /// Drops what belongs to work that has ended.
    pub(crate) fn drop_ended_work(&mut self) {
        let phase = self.state.phase();
        if !phase.is_planning() {
            self.round = None;
        }
        if !phase.is_planning() && !phase.is_running() {
            self.work = Work::Nothing;
        }
    }

    /// Returns the agents that act in the plan's steps that are not known to be done.
    pub(crate) fn acting(&self) -> impl Iterator<Item = AgentId> + '_ {
        let actors = self.steps_left.iter().filter_map(|step| step.arguments.first());
        actors.filter_map(|actor| AgentId::new(actor.as_str()).ok())
    }

    /// Adopts `plan`, of which the steps `done` were carried out for another replica.
    pub(crate) fn adopt_plan(&mut self, plan: Execute, done: Vec<u32>) {
        let steps = pddl::parse_plan(&plan.plan).into_result().map(|plan| plan.steps);
        let is_left = |step: &usize| u32::try_from(*step).is_ok_and(|step| !done.contains(&step));
        let left = steps.unwrap_or_default().into_iter().enumerate();
        let left = left.filter(|(step, _)| is_left(step));
        self.steps_left = left.map(|(_, step)| outside(&step, &plan.offers)).collect();
        self.plan = Some(Box::new(Execute { done, ..plan }));
    }

    /// Returns the history of the goal, oldest entry first.
    pub(crate) fn history(&self) -> &[HistoryEntry] {
        &self.history
    }

    /// Restores the part of the goal's history from before this replica took the goal over.
    pub(crate) fn recall_history(&mut self, mut history: Vec<HistoryEntry>) {
        let surplus = history.len().saturating_sub(HISTORY_ENTRIES_MAX);
        history.drain(..surplus);
        self.history = history;
    }

    /// Marks a step of the running plan as done.
    pub(crate) fn step_done(&mut self, action: &str, step: Option<u32>) {
        if let (Some(plan), Some(step)) = (&mut self.plan, step)
            && !plan.done.contains(&step)
        {
            plan.done.push(step);
        }
        if let Some(index) = self.steps_left.iter().position(|step| step.to_string() == action) {
            self.steps_left.remove(index);
        }
    }

    /// Adds an entry to the history of the goal, at wall-clock time `at`. Drops the oldest entry if the
    /// history is full.
    pub(crate) fn add_history(
        &mut self,
        at: SystemTime,
        outcome: Option<Outcome>,
        text: impl Into<String>,
    ) {
        if self.history.len() == HISTORY_ENTRIES_MAX {
            self.history.remove(0);
        }
        let at = at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let at_ms = u64::try_from(at.as_millis()).unwrap_or(u64::MAX);
        self.history.push(HistoryEntry { at_ms, outcome, text: text.into() });
    }

    /// Whether the request `asked` repeats the request of this goal. An initiator repeats a request if
    /// it did not learn that the goal was received.
    pub(crate) fn is_asked_again(&self, by: &Participation, asked: &Achieve) -> bool {
        let is_same = self.text == asked.goal && self.keep == asked.keep;
        is_same && self.participation.initiator == by.initiator
    }

    /// Whether `asked` requests the same as this goal, but comes from a later incarnation of the
    /// initiator. Two requests of one incarnation are two goals.
    pub(crate) fn is_asked_anew(
        &self,
        by: &AgentId,
        incarnation: Incarnation,
        asked: &Achieve,
    ) -> bool {
        let is_same = self.text == asked.goal && self.keep == asked.keep;
        is_same && self.participation.initiator == *by && self.initiator_incarnation < incarnation
    }

    pub(crate) fn status(&self) -> GoalStatus {
        GoalStatus {
            conversation: self.conversation().clone(),
            goal: self.text.clone(),
            keep: self.keep,
            priority: self.priority,
            phase: self.state.phase(),
            waits_because: self.state.waits_because().to_owned(),
            rounds: self.state.rounds(),
            history: self.history.clone(),
        }
    }
}
