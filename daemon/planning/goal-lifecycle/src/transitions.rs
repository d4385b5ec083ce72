//! The lawful transitions of a goal: which event leads from which phase to which.

use acl::content::GoalPhase::{
    self, Cancelling, CollectingProposals, Ended, Executing, Explaining, FetchingDomain, Holding,
    Planning, Preempted, Queued, Verifying, WaitingForAgents, WaitingForChange,
};

use crate::event::GoalEventKind;

/// A row of the table: an event, the phases in which it counts, and the phases that it may lead to. An
/// event that is not listed for a phase changes nothing in that phase.
#[derive(Clone, Copy, Debug)]
pub struct GoalTransition {
    /// The event.
    pub event: GoalEventKind,
    /// The phases in which the event counts.
    pub from: &'static [GoalPhase],
    /// The phases that the event leads to.
    pub to: &'static [GoalPhase],
    /// Whether the goal may also stay in its phase.
    pub may_stay: bool,
}

const fn leads(
    event: GoalEventKind,
    from: &'static [GoalPhase],
    to: &'static [GoalPhase],
) -> GoalTransition {
    GoalTransition { event, from, to, may_stay: false }
}

const fn may_lead(
    event: GoalEventKind,
    from: &'static [GoalPhase],
    to: &'static [GoalPhase],
) -> GoalTransition {
    GoalTransition { event, from, to, may_stay: true }
}

const IDLE: &[GoalPhase] = &[Queued, WaitingForAgents, WaitingForChange, Holding];
const LOOKING_FOR_A_PLAN: &[GoalPhase] = &[Planning, CollectingProposals];
const WITH_THE_EXECUTOR: &[GoalPhase] = &[Executing, Preempted, Cancelling];
const ALIVE: &[GoalPhase] = &[
    Queued,
    WaitingForAgents,
    WaitingForChange,
    FetchingDomain,
    Planning,
    CollectingProposals,
    Explaining,
    Executing,
    Preempted,
    Cancelling,
    Verifying,
    Holding,
];
const WITHOUT_THE_EXECUTOR: &[GoalPhase] = &[
    Queued,
    WaitingForAgents,
    WaitingForChange,
    FetchingDomain,
    Planning,
    CollectingProposals,
    Explaining,
    Verifying,
    Holding,
];

/// All lawful transitions of a goal.
pub const TRANSITIONS: &[GoalTransition] = &[
    may_lead(
        GoalEventKind::Considered,
        IDLE,
        &[Queued, WaitingForAgents, WaitingForChange, FetchingDomain],
    ),
    leads(GoalEventKind::DomainMissing, &[FetchingDomain], &[WaitingForChange]),
    leads(GoalEventKind::DomainUnusable, &[FetchingDomain], &[Ended]),
    leads(GoalEventKind::GoalInvalid, &[FetchingDomain], &[WaitingForChange, Ended]),
    leads(GoalEventKind::GoalHolds, &[FetchingDomain], &[Holding, Ended]),
    leads(GoalEventKind::GoalLost, &[FetchingDomain], &[WaitingForChange, Ended]),
    leads(GoalEventKind::AgentsBusy, &[FetchingDomain], &[WaitingForAgents, Ended]),
    leads(GoalEventKind::GoalOpen, &[FetchingDomain], &[Planning, CollectingProposals, Ended]),
    leads(GoalEventKind::PlannerFailed, &[Planning], &[WaitingForChange, Ended]),
    may_lead(GoalEventKind::BidsOutdated, &[CollectingProposals], &[WaitingForChange]),
    leads(
        GoalEventKind::PlanFound,
        LOOKING_FOR_A_PLAN,
        &[Executing, WaitingForAgents, WaitingForChange, Ended],
    ),
    leads(GoalEventKind::PlanMissing, LOOKING_FOR_A_PLAN, &[Explaining]),
    leads(
        GoalEventKind::Explained,
        &[Explaining],
        &[Queued, WaitingForAgents, WaitingForChange, Ended],
    ),
    may_lead(GoalEventKind::ExecutorRestarted, &[Executing], &[]),
    may_lead(GoalEventKind::OtherPlanRuns, WITH_THE_EXECUTOR, &[]),
    leads(
        GoalEventKind::ExecutionEnded,
        &[Executing],
        &[Verifying, Holding, WaitingForChange, Ended],
    ),
    leads(GoalEventKind::ExecutionEnded, &[Preempted], &[Verifying, Holding, Queued]),
    leads(GoalEventKind::ExecutionEnded, &[Cancelling], &[Ended]),
    may_lead(GoalEventKind::Verified, &[Verifying], &[WaitingForChange, Ended]),
    leads(GoalEventKind::Yielded, &[Executing], &[Preempted]),
    leads(GoalEventKind::AgentsReleased, &[WaitingForAgents], &[Queued]),
    may_lead(GoalEventKind::WorldChanged, ALIVE, &[]),
    leads(GoalEventKind::Cancelled, &[Executing, Preempted], &[Cancelling]),
    may_lead(GoalEventKind::Cancelled, &[Cancelling], &[]),
    leads(GoalEventKind::Cancelled, WITHOUT_THE_EXECUTOR, &[Ended]),
    leads(GoalEventKind::EndedElsewhere, ALIVE, &[Ended]),
    leads(GoalEventKind::TakenOver, ALIVE, &[Ended]),
];

/// Whether the event counts in the phase.
pub(crate) fn is_expected(event: GoalEventKind, phase: GoalPhase) -> bool {
    TRANSITIONS.iter().any(|row| row.event == event && row.from.contains(&phase))
}

/// Whether the event may lead from one phase to the other.
pub fn is_lawful(event: GoalEventKind, from: GoalPhase, to: GoalPhase) -> bool {
    TRANSITIONS.iter().any(|row| {
        let is_target = row.to.contains(&to) || (row.may_stay && from == to);
        row.event == event && row.from.contains(&from) && is_target
    })
}
