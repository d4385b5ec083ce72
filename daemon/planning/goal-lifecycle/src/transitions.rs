//! The lawful transitions of a goal: which event leads from which phase to which.

use acl::content::GoalPhase::{
    self, Cancelling, CollectingProposals, Ended, Executing, Explaining, FetchingDomain, Holding,
    Planning, Preempted, Queued, Verifying, WaitingForAgents, WaitingForChange,
};

use crate::event::EventKind;

/// A row of the table: an event, the phases in which it counts, and the phases that it may lead to. An
/// event that is not listed for a phase changes nothing in that phase.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// The event.
    pub event: EventKind,
    /// The phases in which the event counts.
    pub from: &'static [GoalPhase],
    /// The phases that the event leads to.
    pub to: &'static [GoalPhase],
    /// Whether the goal may also stay in its phase.
    pub may_stay: bool,
}

const fn leads(
    event: EventKind,
    from: &'static [GoalPhase],
    to: &'static [GoalPhase],
) -> Transition {
    Transition { event, from, to, may_stay: false }
}

const fn may_lead(
    event: EventKind,
    from: &'static [GoalPhase],
    to: &'static [GoalPhase],
) -> Transition {
    Transition { event, from, to, may_stay: true }
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
pub const TRANSITIONS: &[Transition] = &[
    may_lead(
        EventKind::Considered,
        IDLE,
        &[Queued, WaitingForAgents, WaitingForChange, FetchingDomain],
    ),
    leads(EventKind::DomainMissing, &[FetchingDomain], &[WaitingForChange]),
    leads(EventKind::DomainUnusable, &[FetchingDomain], &[Ended]),
    leads(EventKind::GoalInvalid, &[FetchingDomain], &[WaitingForChange, Ended]),
    leads(EventKind::GoalHolds, &[FetchingDomain], &[Holding, Ended]),
    leads(EventKind::GoalLost, &[FetchingDomain], &[WaitingForChange, Ended]),
    leads(EventKind::AgentsBusy, &[FetchingDomain], &[WaitingForAgents, Ended]),
    leads(EventKind::GoalOpen, &[FetchingDomain], &[Planning, CollectingProposals, Ended]),
    leads(EventKind::PlannerFailed, &[Planning], &[WaitingForChange, Ended]),
    may_lead(EventKind::BidsOutdated, &[CollectingProposals], &[WaitingForChange]),
    leads(
        EventKind::PlanFound,
        LOOKING_FOR_A_PLAN,
        &[Executing, WaitingForAgents, WaitingForChange, Ended],
    ),
    leads(EventKind::PlanMissing, LOOKING_FOR_A_PLAN, &[Explaining]),
    leads(
        EventKind::Explained,
        &[Explaining],
        &[Queued, WaitingForAgents, WaitingForChange, Ended],
    ),
    may_lead(EventKind::ExecutorRestarted, &[Executing], &[]),
    may_lead(EventKind::OtherPlanRuns, WITH_THE_EXECUTOR, &[]),
    leads(EventKind::ExecutionEnded, &[Executing], &[Verifying, Holding, WaitingForChange, Ended]),
    leads(EventKind::ExecutionEnded, &[Preempted], &[Verifying, Holding, Queued]),
    leads(EventKind::ExecutionEnded, &[Cancelling], &[Ended]),
    may_lead(EventKind::Verified, &[Verifying], &[WaitingForChange, Ended]),
    leads(EventKind::Yielded, &[Executing], &[Preempted]),
    leads(EventKind::AgentsReleased, &[WaitingForAgents], &[Queued]),
    may_lead(EventKind::WorldChanged, ALIVE, &[]),
    leads(EventKind::Cancelled, &[Executing, Preempted], &[Cancelling]),
    may_lead(EventKind::Cancelled, &[Cancelling], &[]),
    leads(EventKind::Cancelled, WITHOUT_THE_EXECUTOR, &[Ended]),
    leads(EventKind::EndedElsewhere, ALIVE, &[Ended]),
    leads(EventKind::TakenOver, ALIVE, &[Ended]),
];

/// Whether the event counts in the phase.
pub(crate) fn is_expected(event: EventKind, phase: GoalPhase) -> bool {
    TRANSITIONS.iter().any(|row| row.event == event && row.from.contains(&phase))
}

/// Whether the event may lead from one phase to the other.
pub fn is_lawful(event: EventKind, from: GoalPhase, to: GoalPhase) -> bool {
    TRANSITIONS.iter().any(|row| {
        let is_target = row.to.contains(&to) || (row.may_stay && from == to);
        row.event == event && row.from.contains(&from) && is_target
    })
}
