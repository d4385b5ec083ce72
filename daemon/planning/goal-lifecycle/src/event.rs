//! Events that happen to a goal, and the commands that its owner must carry out.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{Outcome, Report};
use acl::{AgentId, ConversationId};

/// Number of a piece of work that a command began for a goal. Later work has a greater number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Attempt(pub u64);

/// The other plans and goals that a round of planning must respect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanningMode {
    /// The new plan respects all running plans and all kept goals.
    #[default]
    Cooperative,
    /// The new plan respects only goals of at least the priority of its own goal. The other goals
    /// yield.
    Preemptive,
    /// The new plan respects no other plan or goal. The plan is not executed: its only use is to
    /// explain a conflict.
    DiagnoseConflict,
}

/// Agents that compute a plan: the Planning Agent, or the actuators.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanningFlow {
    /// The Planning Agent computes the plan, in the centralised flow.
    Centralized,
    /// The actuators propose plans, and the cheapest set of proposals is chosen.
    Decentralized,
}

/// Event that happened to a goal.
#[derive(Clone, Debug)]
pub enum GoalEvent {
    /// The goal is to be checked now: a timer has fired, planning for another goal has ended, or
    /// the world has changed.
    Considered(Turn),
    /// No Domain Maintainer has answered the query for the domain and the state.
    DomainMissing(Attempt),
    /// The domain or the state that this attempt fetched cannot be used. The text gives the reason.
    DomainUnusable(Attempt, String),
    /// This attempt has found that the goal does not fit the domain, or contradicts itself. The
    /// text gives the reason.
    GoalInvalid(Attempt, String),
    /// The goal holds in the known state.
    GoalHolds(Attempt),
    /// This attempt has found that the goal uses names that are no longer valid, because the agent
    /// that declared them has left. The text gives the reason.
    GoalLost(Attempt, String),
    /// This attempt has found that the goal does not hold, and that the listed blockers use all
    /// agents that offer any action.
    AgentsBusy(Attempt, Blockers),
    /// This attempt has found that the goal does not hold, and that it can be planned for, in the
    /// given flow.
    GoalOpen(Attempt, PlanningFlow),
    /// The Planning Agent has not answered this attempt in time, or has declined it. The text gives
    /// the reason; planning is tried again after the duration.
    PlannerFailed(Attempt, String, Duration),
    /// The Planning Agent is absent, or has no time for this attempt. The text gives the reason;
    /// planning is tried again after the duration at least.
    PlannerBusy(Attempt, String, Duration),
    /// An agent of this attempt's joint plan has other work, or has just announced another model, so it
    /// does not agree to its part now. The
    /// text gives the reason; planning is tried again after a delay, which is longer by this share of
    /// it (in 256ths). Goals that want the same agents at the same time have different shares.
    MembersBusy(Attempt, String, u8),
    /// Bids for this attempt use action models that are newer than the known domain. The text gives
    /// the reason to wait.
    BidsOutdated(Attempt, String),
    /// This attempt has found a valid plan. The decision tells whether to execute it.
    PlanFound(Attempt, PlanDecision),
    /// This attempt has found no valid plan.
    PlanMissing(Attempt),
    /// This attempt has found the reason why there is no plan.
    Explained(Attempt, MissingPlan),
    /// The Plan Executor was restarted, or a replica of it has become the leader, so the plan may
    /// be lost.
    ExecutorRestarted(Attempt),
    /// The Plan Executor has declined the plan of this attempt, because a different plan runs for
    /// the goal. The number is that of the running plan.
    OtherPlanRuns(Attempt, u32),
    /// The execution of this attempt's plan has ended, in the given way.
    ExecutionEnded(Attempt, ExecutionEnd),
    /// This attempt has compared the known state with the goal after the plan was executed, with
    /// the given result.
    Verified(Attempt, GoalVerdict),
    /// The initiator has cancelled the goal.
    Cancelled,
    /// The goal must yield to a different goal or to a better plan. The text gives the reason, for
    /// the initiator.
    Yielded(String),
    /// Agents that other goals used are available again.
    AgentsReleased,
    /// The known state has changed.
    WorldChanged {
        /// Agents that have joined, or have announced their action models anew.
        joined: Vec<AgentId>,
        /// Whether agents have joined or left.
        have_agents_changed: bool,
        /// Whether any goal is being planned for. If so, the end of that planning starts the next
        /// one.
        is_planning_busy: bool,
    },
    /// A different replica has ended the goal.
    EndedElsewhere,
    /// A different replica of the Plan Requester pursues the goal from now on.
    TakenOver,
}

/// Kind of a [`GoalEvent`], for the table of transitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum GoalEventKind {
    /// Kind of [`GoalEvent::Considered`].
    Considered,
    /// Kind of [`GoalEvent::DomainMissing`].
    DomainMissing,
    /// Kind of [`GoalEvent::DomainUnusable`].
    DomainUnusable,
    /// Kind of [`GoalEvent::GoalInvalid`].
    GoalInvalid,
    /// Kind of [`GoalEvent::GoalHolds`].
    GoalHolds,
    /// Kind of [`GoalEvent::GoalLost`].
    GoalLost,
    /// Kind of [`GoalEvent::AgentsBusy`].
    AgentsBusy,
    /// Kind of [`GoalEvent::GoalOpen`].
    GoalOpen,
    /// Kind of [`GoalEvent::PlannerFailed`].
    PlannerFailed,
    /// Kind of [`GoalEvent::PlannerBusy`].
    PlannerBusy,
    /// Kind of [`GoalEvent::MembersBusy`].
    MembersBusy,
    /// Kind of [`GoalEvent::BidsOutdated`].
    BidsOutdated,
    /// Kind of [`GoalEvent::PlanFound`].
    PlanFound,
    /// Kind of [`GoalEvent::PlanMissing`].
    PlanMissing,
    /// Kind of [`GoalEvent::Explained`].
    Explained,
    /// Kind of [`GoalEvent::ExecutorRestarted`].
    ExecutorRestarted,
    /// Kind of [`GoalEvent::OtherPlanRuns`].
    OtherPlanRuns,
    /// Kind of [`GoalEvent::ExecutionEnded`].
    ExecutionEnded,
    /// Kind of [`GoalEvent::Verified`].
    Verified,
    /// Kind of [`GoalEvent::Cancelled`].
    Cancelled,
    /// Kind of [`GoalEvent::Yielded`].
    Yielded,
    /// Kind of [`GoalEvent::AgentsReleased`].
    AgentsReleased,
    /// Kind of [`GoalEvent::WorldChanged`].
    WorldChanged,
    /// Kind of [`GoalEvent::EndedElsewhere`].
    EndedElsewhere,
    /// Kind of [`GoalEvent::TakenOver`].
    TakenOver,
}

/// Conditions that decide whether a goal may be planned for now.
#[derive(Clone, Debug, Default)]
pub struct Turn {
    /// Reason why this partition must not plan for the goal; `None` if planning is allowed.
    pub missing_quorum: Option<String>,
    /// Whether planning is under way for a different goal.
    pub is_planning_busy: bool,
    /// Agents that other goals use and that this goal must not take, in its planning mode.
    pub agents_in_use: BTreeSet<AgentId>,
}

/// Goals that a goal must wait for.
#[derive(Clone, Debug, Default)]
pub struct Blockers {
    /// Conditions of the goals to wait for, as text.
    pub goals: Vec<String>,
    /// Agents that planning was not allowed to use, because the goals in `goals` use them. The set
    /// is empty if the wait has a reason other than agents in use.
    pub agents: BTreeSet<AgentId>,
}

/// Decision about a plan that was found.
#[derive(Clone, Debug)]
pub enum PlanDecision {
    /// Execute the plan at once.
    Run,
    /// Execute the plan after the listed goals have yielded. The blockers describe these goals.
    Preempt(Vec<ConversationId>, Blockers),
    /// Do not execute the plan yet. Wait for other goals.
    WaitFor(Blockers),
    /// Do not execute the plan, because it would undo the kept goals that the text names.
    Conflict(String),
}

/// Reason why there is no plan for a goal, and remedies that may apply.
#[derive(Clone, Debug, Default)]
pub struct MissingPlan {
    /// Reason why there is no plan, as text for a person.
    pub why: String,
    /// Whether the goal can be reached with the actions of all agents.
    pub has_hope: bool,
    /// Whether planning left out agents that are free now.
    pub are_agents_free_again: bool,
    /// Whether goals of lower priority use agents.
    pub can_preempt: bool,
    /// Goals of at least the same priority that use agents, and the agents that planning left out.
    pub blockers: Blockers,
    /// Whether any kept goal holds now that a plan must not undo.
    pub has_kept_goals: bool,
}

/// How the execution of a plan ended.
#[derive(Clone, Debug)]
pub enum ExecutionEnd {
    /// Every step is done.
    Done,
    /// The Plan Executor has cancelled the plan. The text gives its reason.
    Cancelled(String),
    /// The plan has failed, as the report says. The pair is the agent of the failed action, and the
    /// agent's own name for the action; `None` if no action is to blame.
    Failed(Report, Option<(AgentId, String)>),
    /// The Plan Executor does not answer, or has no time for the plan, so the end of the execution is
    /// not known. The text gives the reason; planning is tried again after the duration at least.
    Unknown(String, Duration),
}

/// Result of comparing the known state with a goal after the plan was executed.
#[derive(Clone, Debug)]
pub enum GoalVerdict {
    /// The goal holds.
    Holds,
    /// A part of the goal does not hold. The text names that part.
    Unmet(String),
    /// The goal cannot be compared with the state. The text gives the reason.
    Unusable(String),
    /// No Domain Maintainer has answered the query for the state.
    Unanswered,
}

/// Command that the owner of a goal must carry out.
#[derive(Clone, Debug)]
pub enum GoalCommand {
    /// Check the goal again at once.
    Consider,
    /// Check the goal after this time. The command replaces an earlier timer of the goal.
    ConsiderAfter(Duration),
    /// Stop the goal's timer.
    StopTimer,
    /// Fetch the domain and the state.
    FetchDomain(Attempt),
    /// Search for a plan.
    Plan(Attempt),
    /// Find out why there is no plan.
    Explain(Attempt),
    /// Reject all proposals, with this reason.
    RejectProposals(&'static str),
    /// Execute the plan that was found.
    Execute(Attempt),
    /// Request the running plan of the goal from the Plan Executor again.
    RequestExecution(Attempt),
    /// Replace the goal's plan by the plan that the Plan Executor runs.
    AdoptRunningPlan,
    /// Request the Plan Executor to cancel the goal's plan.
    CancelExecution,
    /// Request the Planning Agent to stop planning.
    CancelPlanning,
    /// Compare the known state with the goal after the given time, in this attempt.
    Verify(Attempt, Duration),
    /// Forget the goal's plan, because the goal holds.
    ForgetPlan,
    /// Free the agents that the goal's plan used.
    ReleaseAgents,
    /// Request these goals to yield.
    Preempt(Vec<ConversationId>),
    /// Plan for the next goal in the queue.
    ScheduleNext,
    /// Send this report to the initiator.
    Report(Report),
    /// End the goal with the given outcome. The text gives the reason.
    End(Outcome, String),
    /// Drop all work for the goal, because a different replica pursues it.
    Abandon,
}

// === impl GoalEvent ===

impl GoalEvent {
    /// Returns the kind of this event.
    pub fn kind(&self) -> GoalEventKind {
        match self {
            GoalEvent::Considered(_) => GoalEventKind::Considered,
            GoalEvent::DomainMissing(_) => GoalEventKind::DomainMissing,
            GoalEvent::DomainUnusable(..) => GoalEventKind::DomainUnusable,
            GoalEvent::GoalInvalid(..) => GoalEventKind::GoalInvalid,
            GoalEvent::GoalHolds(_) => GoalEventKind::GoalHolds,
            GoalEvent::GoalLost(..) => GoalEventKind::GoalLost,
            GoalEvent::AgentsBusy(..) => GoalEventKind::AgentsBusy,
            GoalEvent::GoalOpen(..) => GoalEventKind::GoalOpen,
            GoalEvent::PlannerFailed(..) => GoalEventKind::PlannerFailed,
            GoalEvent::PlannerBusy(..) => GoalEventKind::PlannerBusy,
            GoalEvent::MembersBusy(..) => GoalEventKind::MembersBusy,
            GoalEvent::BidsOutdated(..) => GoalEventKind::BidsOutdated,
            GoalEvent::PlanFound(..) => GoalEventKind::PlanFound,
            GoalEvent::PlanMissing(_) => GoalEventKind::PlanMissing,
            GoalEvent::Explained(..) => GoalEventKind::Explained,
            GoalEvent::ExecutorRestarted(_) => GoalEventKind::ExecutorRestarted,
            GoalEvent::OtherPlanRuns(..) => GoalEventKind::OtherPlanRuns,
            GoalEvent::ExecutionEnded(..) => GoalEventKind::ExecutionEnded,
            GoalEvent::Verified(..) => GoalEventKind::Verified,
            GoalEvent::Cancelled => GoalEventKind::Cancelled,
            GoalEvent::Yielded(_) => GoalEventKind::Yielded,
            GoalEvent::AgentsReleased => GoalEventKind::AgentsReleased,
            GoalEvent::WorldChanged { .. } => GoalEventKind::WorldChanged,
            GoalEvent::EndedElsewhere => GoalEventKind::EndedElsewhere,
            GoalEvent::TakenOver => GoalEventKind::TakenOver,
        }
    }

    /// Returns the attempt (piece of work) that this event reports on; `None` if the event does not
    /// belong to an attempt.
    pub fn attempt(&self) -> Option<Attempt> {
        match self {
            GoalEvent::DomainMissing(attempt)
            | GoalEvent::DomainUnusable(attempt, _)
            | GoalEvent::GoalInvalid(attempt, _)
            | GoalEvent::GoalHolds(attempt)
            | GoalEvent::GoalLost(attempt, _)
            | GoalEvent::AgentsBusy(attempt, _)
            | GoalEvent::GoalOpen(attempt, _)
            | GoalEvent::PlannerFailed(attempt, ..)
            | GoalEvent::PlannerBusy(attempt, ..)
            | GoalEvent::MembersBusy(attempt, ..)
            | GoalEvent::BidsOutdated(attempt, _)
            | GoalEvent::PlanFound(attempt, _)
            | GoalEvent::PlanMissing(attempt)
            | GoalEvent::Explained(attempt, _)
            | GoalEvent::ExecutorRestarted(attempt)
            | GoalEvent::OtherPlanRuns(attempt, _)
            | GoalEvent::ExecutionEnded(attempt, _)
            | GoalEvent::Verified(attempt, _) => Some(*attempt),
            GoalEvent::Considered(_)
            | GoalEvent::Cancelled
            | GoalEvent::Yielded(_)
            | GoalEvent::AgentsReleased
            | GoalEvent::WorldChanged { .. }
            | GoalEvent::EndedElsewhere
            | GoalEvent::TakenOver => None,
        }
    }
}
