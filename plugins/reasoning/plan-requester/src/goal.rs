//! One goal of the Plan Requester: the requested condition, the goal's state, and the work in
//! progress for the goal.

use std::sync::Arc;
use std::time::SystemTime;

use acl::content::{
    Achieve, Execute, GoalStatus, HISTORY_ENTRIES_MAX, HistoryEntry, Keep, Offers, Outcome,
    Partition, Version,
};
use acl::{AgentId, ConversationId, Incarnation, ReplyToken};
use agent::{Participation, TimerId, TrackedGoal, WorkHandle};
use goal_lifecycle::{Attempt, GoalState};
use pddl::{Condition, Plan, PlanStep};
use planner::Cancel;
use tokio::time::Instant;

use crate::due_goal::GoalLimits;
use crate::explanations::GoalContext;
use crate::joint_state::JointPlanState;
use crate::planning_snapshot::{PlanningSnapshot, actors, outside};
use crate::proposals::ContractNetState;

/// A goal that the Plan Requester pursues.
pub(crate) struct Goal {
    pub(crate) participation: Participation,
    /// Number of the goal, by which people name it.
    pub(crate) number: u32,
    /// Incarnation of the initiator that asked for this goal.
    pub(crate) initiator_incarnation: Incarnation,
    pub(crate) text: String,
    pub(crate) condition: Condition,
    pub(crate) keep: Keep,
    pub(crate) priority: i32,
    pub(crate) partition: Partition,
    /// Times at which the goal is late or given up; `None` if there are none.
    pub(crate) limits: Option<GoalLimits>,
    /// Since when agents decline parts of joint plans because they know other facts than this agent;
    /// `None` if none does.
    pub(crate) views_differ_since: Option<Instant>,
    pub(crate) state: GoalState,
    pub(crate) work: Work,
    /// Data of the present round of planning; `None` if no plan is being made for the goal.
    pub(crate) round: Option<PlanningRound>,
    /// The plan of this goal that runs or ran last, as it was requested from the Plan Executor,
    /// with the steps that are known to be done. `None` if there is no such plan.
    pub(crate) plan: Option<Box<Execute>>,
    /// A plan for this goal that the Plan Executor runs instead of the requested plan, and that
    /// this replica is to adopt; `None` if there is none.
    pub(crate) other_plan: Option<Box<Execute>>,
    /// Steps of the running plan that are not known to be done, with the action names that their
    /// agents use.
    pub(crate) steps_left: Vec<PlanStep>,
    /// Steps of the failed plan that were not done; the planner may reuse them.
    pub(crate) failed_steps: Vec<PlanStep>,
    /// Version of the last record of this goal that was sent to the Journals.
    pub(crate) version: Version,
    pub(crate) timer: Option<TimerId>,
    /// Facts and offered actions that concerned the goal in the last round of planning; `None`
    /// before the first round.
    pub(crate) last_context: Option<GoalContext>,
    /// Counts the goal in its phase; `None` until its state machine gets the first event.
    pub(crate) tracked: Option<TrackedGoal>,
    history: Vec<HistoryEntry>,
}

/// The work in progress for a goal.
#[derive(Default)]
pub(crate) enum Work {
    /// No work is in progress.
    #[default]
    Nothing,
    /// A query for the domain and the state is running.
    Question(#[expect(dead_code, reason = "ends the question when it is dropped")] WorkHandle),
    /// The Planning Agent was requested to make a plan, in this exchange.
    Planning(ReplyToken),
    /// A call for proposals was sent to the actuators.
    Proposals(Box<ContractNetState>),
    /// A joint plan is being made, or its agents are asked to agree.
    Joint(Box<JointPlanState>),
    /// The reason for a missing plan is being computed.
    Explanation(#[expect(dead_code, reason = "ends the work when it is dropped")] ExplanationTask),
    /// A plan is being executed; its reports arrive in this exchange.
    Execution(ReplyToken),
}

/// Background computation of the reason why there is no plan for a goal. Dropping the task cancels
/// the computation.
pub(crate) struct ExplanationTask {
    pub(crate) cancel: Cancel,
    pub(crate) _work: WorkHandle,
}

/// A function that returns the reason, as text for a person, why there is no plan.
pub(crate) type WhyMissing = Box<dyn FnOnce(&PlanningSnapshot, &Cancel) -> String + Send>;

/// A round of planning for a goal.
pub(crate) struct PlanningRound {
    pub(crate) known: Arc<PlanningSnapshot>,
    /// The parts of the goal that do not hold.
    pub(crate) open: Vec<Condition>,
    /// The plan that was found, and its cost; `None` if no plan was found yet.
    pub(crate) found: Option<(Plan, f64)>,
    /// Function that explains why no plan was found; `None` until planning has failed.
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
            number: 0,
            initiator_incarnation: incarnation,
            text: goal,
            condition,
            keep,
            priority,
            partition,
            limits: None,
            state: GoalState::new(keep),
            work: Work::Nothing,
            views_differ_since: None,
            round: None,
            plan: None,
            other_plan: None,
            steps_left: Vec::new(),
            failed_steps: Vec::new(),
            version: Version::default(),
            timer: None,
            last_context: None,
            tracked: None,
            history: Vec::new(),
        }
    }

    pub(crate) fn conversation(&self) -> &ConversationId {
        &self.participation.conversation
    }

    /// Returns `true` if `attempt` is the latest attempt for this goal.
    pub(crate) fn is_current(&self, attempt: Attempt) -> bool {
        self.state.attempt() == attempt
    }

    /// Drops the data of work that has ended.
    pub(crate) fn drop_ended_work(&mut self) {
        let phase = self.state.phase();
        if !phase.is_planning() {
            self.round = None;
        }
        if !phase.is_planning() && !phase.is_running() {
            self.work = Work::Nothing;
        }
    }

    /// Returns the agents that act in those steps of the plan that are not known to be done.
    pub(crate) fn acting(&self) -> impl Iterator<Item = AgentId> + '_ {
        let none = Offers::new();
        let offers = self.plan.as_ref().map_or(&none, |plan| &plan.offers);
        let acting = self.steps_left.iter().flat_map(|step| actors(step, offers));
        acting.collect::<Vec<_>>().into_iter()
    }

    /// Adopts `plan` as the running plan of this goal. The steps `done` were carried out for
    /// another replica.
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

    /// Restores the earlier history of the goal, from before this replica took the goal over.
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

    /// Adds an entry to the history of the goal, at wall-clock time `at`. Drops the oldest entry if
    /// the history is full.
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

    /// Returns `true` if the request `asked` repeats the request of this goal. An initiator repeats
    /// a request if it received no confirmation of the first one.
    pub(crate) fn is_asked_again(&self, by: &Participation, asked: &Achieve) -> bool {
        let is_same = self.text == asked.goal && self.keep == asked.keep;
        is_same && self.participation.initiator == by.initiator
    }

    /// Returns `true` if `asked` requests the same as this goal, but comes from a later incarnation
    /// of the initiator. Two requests of one incarnation are two goals.
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
            number: self.number,
            goal: self.text.clone(),
            keep: self.keep,
            priority: self.priority,
            phase: self.state.phase(),
            waits_because: self.state.waits_because().to_owned(),
            rounds: self.state.rounds(),
            history: self.history.clone(),
            due: self.limits.as_ref().and_then(GoalLimits::status),
        }
    }
}
