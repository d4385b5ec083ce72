//! What happens to a goal, and what its owner must do about it.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{Outcome, Report};
use acl::{AgentId, ConversationId};

/// Number of a piece of work that a command began for a goal. A later piece has a greater number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Attempt(pub u64);

/// The other plans and goals that a round of planning must respect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanningMode {
    /// The new plan respects all running plans and all kept goals.
    #[default]
    Cooperative,
    /// The new plan respects only goals of at least the priority of its own goal; the other goals
    /// yield.
    Preemptive,
    /// The new plan respects no other plan or goal. It is not executed; it only explains a conflict.
    DiagnoseConflict,
}

/// The flow of control by which a plan is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanningFlow {
    /// The Planning Agent computes the plan.
    Centralized,
    /// The actuators propose plans, and the cheapest set of proposals is chosen.
    Decentralized,
}

/// Something that happened to a goal.
#[derive(Clone, Debug)]
pub enum GoalEvent {
    /// The goal is looked at: a timer has fired, another goal is done with planning, or the world has
    /// changed.
    Considered(Turn),
    /// No Domain Maintainer has answered the question for the domain and the state.
    DomainMissing(Attempt),
    /// The domain or the state cannot be used. The text is the reason.
    DomainUnusable(Attempt, String),
    /// The goal does not fit the domain, or contradicts itself. The text is the reason.
    GoalInvalid(Attempt, String),
    /// The goal holds in the known state.
    GoalHolds(Attempt),
    /// Names in the goal were valid before, and are not now, because the agent that declared them has
    /// left. The text is the reason.
    GoalLost(Attempt, String),
    /// The goal does not hold, and all agents that offer any action are in use by other goals.
    AgentsBusy(Attempt, Blockers),
    /// The goal does not hold, and a plan can be looked for.
    GoalOpen(Attempt, PlanningFlow),
    /// The Planning Agent has not answered, or has declined. Planning is tried again after the time.
    PlannerFailed(Attempt, String, Duration),
    /// Bids use action models that are newer than the known domain. The text is the reason to wait.
    BidsOutdated(Attempt, String),
    /// A valid plan was found.
    PlanFound(Attempt, PlanDecision),
    /// No valid plan was found.
    PlanMissing(Attempt),
    /// The reason why there is no plan is known.
    Explained(Attempt, MissingPlan),
    /// The Plan Executor was restarted, or another one leads: it may not have the plan.
    ExecutorRestarted(Attempt),
    /// The Plan Executor already runs another plan for the goal, whose number is given.
    OtherPlanRuns(Attempt, u32),
    /// The execution of the plan has ended.
    ExecutionEnded(Attempt, ExecutionEnd),
    /// The known state was compared with the goal after the plan was carried out.
    Verified(Attempt, GoalVerdict),
    /// The initiator has cancelled the goal.
    Cancelled,
    /// Another goal or a better plan comes first. The text is the reason, as the initiator is told.
    Yielded(String),
    /// Agents that other goals used are free.
    AgentsReleased,
    /// The known state has changed.
    WorldChanged {
        /// Agents that have joined or have announced themselves anew.
        joined: Vec<AgentId>,
        /// Whether agents have joined or left.
        have_agents_changed: bool,
        /// Whether any goal is being planned for. The queue then goes on when that planning ends.
        is_planning_busy: bool,
    },
    /// The goal has ended for another replica.
    EndedElsewhere,
    /// Another replica pursues the goal from now on.
    TakenOver,
}

/// The kind of an [`GoalEvent`], for the table of transitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum GoalEventKind {
    /// [`GoalEvent::Considered`].
    Considered,
    /// [`GoalEvent::DomainMissing`].
    DomainMissing,
    /// [`GoalEvent::DomainUnusable`].
    DomainUnusable,
    /// [`GoalEvent::GoalInvalid`].
    GoalInvalid,
    /// [`GoalEvent::GoalHolds`].
    GoalHolds,
    /// [`GoalEvent::GoalLost`].
    GoalLost,
    /// [`GoalEvent::AgentsBusy`].
    AgentsBusy,
    /// [`GoalEvent::GoalOpen`].
    GoalOpen,
    /// [`GoalEvent::PlannerFailed`].
    PlannerFailed,
    /// [`GoalEvent::BidsOutdated`].
    BidsOutdated,
    /// [`GoalEvent::PlanFound`].
    PlanFound,
    /// [`GoalEvent::PlanMissing`].
    PlanMissing,
    /// [`GoalEvent::Explained`].
    Explained,
    /// [`GoalEvent::ExecutorRestarted`].
    ExecutorRestarted,
    /// [`GoalEvent::OtherPlanRuns`].
    OtherPlanRuns,
    /// [`GoalEvent::ExecutionEnded`].
    ExecutionEnded,
    /// [`GoalEvent::Verified`].
    Verified,
    /// [`GoalEvent::Cancelled`].
    Cancelled,
    /// [`GoalEvent::Yielded`].
    Yielded,
    /// [`GoalEvent::AgentsReleased`].
    AgentsReleased,
    /// [`GoalEvent::WorldChanged`].
    WorldChanged,
    /// [`GoalEvent::EndedElsewhere`].
    EndedElsewhere,
    /// [`GoalEvent::TakenOver`].
    TakenOver,
}

/// Whether a goal may be planned for now.
#[derive(Clone, Debug, Default)]
pub struct Turn {
    /// Reason why this partition must not plan for the goal; `None` if it may.
    pub missing_quorum: Option<String>,
    /// Whether another goal is being planned for.
    pub is_planning_busy: bool,
    /// Agents that other goals use and that the goal's planning mode leaves to them.
    pub agents_in_use: BTreeSet<AgentId>,
}

/// The goals that a goal must wait for.
#[derive(Clone, Debug, Default)]
pub struct Blockers {
    /// The conditions of these goals, as text.
    pub goals: Vec<String>,
    /// The agents that planning left to these goals; empty if the wait is not for agents.
    pub agents: BTreeSet<AgentId>,
}

/// Decision about what is done with a plan that was found.
#[derive(Clone, Debug)]
pub enum PlanDecision {
    /// Execute the plan at once.
    Run,
    /// Execute the plan after the goals listed here have yielded.
    Preempt(Vec<ConversationId>, Blockers),
    /// Do not execute the plan yet: wait for other goals.
    WaitFor(Blockers),
    /// Do not execute the plan: it would undo the kept goals named in this text.
    Conflict(String),
}

/// Why there is no plan for a goal, and what might help.
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
    /// Whether other goals that must not be undone hold now.
    pub has_kept_goals: bool,
}

/// How the execution of a plan ended.
#[derive(Clone, Debug)]
pub enum ExecutionEnd {
    /// Every step is done.
    Done,
    /// The Plan Executor has cancelled the plan. The text is its reason.
    Cancelled(String),
    /// The plan has failed. The pair names the action that failed, if one did.
    Failed(Report, Option<(AgentId, String)>),
    /// The Plan Executor does not answer or has declined the plan. The text is the reason; planning is
    /// tried again after the time.
    Unknown(String, Duration),
}

/// Result of comparing the known state with a goal after its plan was carried out.
#[derive(Clone, Debug)]
pub enum GoalVerdict {
    /// The goal holds.
    Holds,
    /// A part of the goal does not hold. The text says which.
    Unmet(String),
    /// The goal cannot be compared with the state. The text is the reason.
    Unusable(String),
    /// No Domain Maintainer has answered.
    Unanswered,
}

/// Something that the owner of a goal must do.
#[derive(Clone, Debug)]
pub enum GoalCommand {
    /// Consider the goal again at once.
    Consider,
    /// Consider the goal after this time; a former timer of the goal no longer counts.
    ConsiderAfter(Duration),
    /// Stop the goal's timer.
    StopTimer,
    /// Fetch the domain and the state.
    FetchDomain(Attempt),
    /// Look for a plan.
    Plan(Attempt),
    /// Find out why there is no plan.
    Explain(Attempt),
    /// Reject all proposals, with this reason.
    RejectProposals(&'static str),
    /// Execute the plan that was found.
    Execute(Attempt),
    /// Ask the Plan Executor for the goal's plan again.
    RequestExecution(Attempt),
    /// Replace the goal's plan by the one that the Plan Executor runs.
    AdoptRunningPlan,
    /// Ask the Plan Executor to cancel the goal's plan.
    CancelExecution,
    /// Ask the Planning Agent to stop planning.
    CancelPlanning,
    /// Compare the known state with the goal, after this time.
    Verify(Attempt, Duration),
    /// Forget the goal's plan: the goal holds.
    ForgetPlan,
    /// Free the agents that the goal's plan used.
    ReleaseAgents,
    /// Ask these goals to yield.
    Preempt(Vec<ConversationId>),
    /// Plan for the next goal in the queue.
    ScheduleNext,
    /// Report to the initiator.
    Report(Report),
    /// End the goal with this outcome and reason.
    End(Outcome, String),
    /// Drop all work for the goal; another replica pursues it.
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

    /// Returns the work that this event ends or tells of; `None` if it is about none.
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
