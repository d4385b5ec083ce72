//! The valid transitions of a goal: which event leads from which phase to which.

use acl::content::GoalPhase::{
    self, Cancelling, CollectingProposals, Ended, Executing, Explaining, FetchingDomain, Holding,
    Planning, Preempted, Queued, Verifying, WaitingForAgents, WaitingForChange,
};

use crate::event::GoalEventKind;

/// Set of phases in which an event has an effect.
#[derive(Clone, Copy, Debug)]
pub enum PhaseSet {
    /// Exactly the listed phases.
    Only(&'static [GoalPhase]),
    /// All phases except the listed ones and `Ended`.
    AllBut(&'static [GoalPhase]),
}

/// Row of the table of transitions. An event that no row lists for a phase changes nothing in that
/// phase.
#[derive(Clone, Copy, Debug)]
pub struct GoalTransition {
    /// Kind of the event.
    pub event: GoalEventKind,
    /// Phases in which the event has an effect.
    pub from: PhaseSet,
    /// Phases that the event may lead to.
    pub to: &'static [GoalPhase],
    /// Whether the event may also leave the goal in its phase.
    pub may_stay: bool,
}

const fn leads(event: GoalEventKind, from: PhaseSet, to: &'static [GoalPhase]) -> GoalTransition {
    GoalTransition { event, from, to, may_stay: false }
}

const fn may_lead(
    event: GoalEventKind,
    from: PhaseSet,
    to: &'static [GoalPhase],
) -> GoalTransition {
    GoalTransition { event, from, to, may_stay: true }
}

const fn only(phases: &'static [GoalPhase]) -> PhaseSet {
    PhaseSet::Only(phases)
}

const IDLE: PhaseSet = only(&[Queued, WaitingForAgents, WaitingForChange, Holding]);
const LOOKING_FOR_A_PLAN: PhaseSet = only(&[Planning, CollectingProposals]);
const WITH_THE_EXECUTOR: PhaseSet = only(&[Executing, Preempted, Cancelling]);
const WITHOUT_THE_EXECUTOR: PhaseSet = PhaseSet::AllBut(&[Executing, Preempted, Cancelling]);
const ALIVE: PhaseSet = PhaseSet::AllBut(&[]);

impl PhaseSet {
    /// Whether the set contains the phase.
    pub fn contains(self, phase: GoalPhase) -> bool {
        match self {
            PhaseSet::Only(phases) => phases.contains(&phase),
            PhaseSet::AllBut(phases) => phase != Ended && !phases.contains(&phase),
        }
    }

    /// Returns the phases of the set, in the order of [`GoalPhase::ALL`].
    pub fn phases(self) -> impl Iterator<Item = GoalPhase> {
        GoalPhase::ALL.into_iter().filter(move |phase| self.contains(*phase))
    }
}

/// All valid transitions of a goal.
pub const TRANSITIONS: &[GoalTransition] = &[
    may_lead(
        GoalEventKind::Considered,
        IDLE,
        &[Queued, WaitingForAgents, WaitingForChange, FetchingDomain],
    ),
    leads(GoalEventKind::DomainMissing, only(&[FetchingDomain]), &[WaitingForChange]),
    leads(GoalEventKind::DomainUnusable, only(&[FetchingDomain]), &[Ended]),
    leads(GoalEventKind::GoalInvalid, only(&[FetchingDomain]), &[WaitingForChange, Ended]),
    leads(GoalEventKind::GoalHolds, only(&[FetchingDomain]), &[Holding, Ended]),
    leads(GoalEventKind::GoalLost, only(&[FetchingDomain]), &[WaitingForChange, Ended]),
    leads(GoalEventKind::AgentsBusy, only(&[FetchingDomain]), &[WaitingForAgents, Ended]),
    leads(
        GoalEventKind::GoalOpen,
        only(&[FetchingDomain]),
        &[Planning, CollectingProposals, Ended],
    ),
    leads(GoalEventKind::PlannerFailed, only(&[Planning]), &[WaitingForChange, Ended]),
    leads(GoalEventKind::PlannerBusy, only(&[Planning]), &[WaitingForChange, Ended]),
    leads(GoalEventKind::MembersBusy, only(&[CollectingProposals]), &[WaitingForChange, Ended]),
    may_lead(GoalEventKind::BidsOutdated, only(&[CollectingProposals]), &[WaitingForChange]),
    leads(
        GoalEventKind::PlanFound,
        LOOKING_FOR_A_PLAN,
        &[Executing, WaitingForAgents, WaitingForChange, Ended],
    ),
    leads(GoalEventKind::PlanMissing, LOOKING_FOR_A_PLAN, &[Explaining]),
    leads(
        GoalEventKind::Explained,
        only(&[Explaining]),
        &[Queued, WaitingForAgents, WaitingForChange, Ended],
    ),
    may_lead(GoalEventKind::ExecutorRestarted, only(&[Executing]), &[]),
    may_lead(GoalEventKind::OtherPlanRuns, WITH_THE_EXECUTOR, &[]),
    leads(
        GoalEventKind::ExecutionEnded,
        only(&[Executing]),
        &[Verifying, Holding, WaitingForChange, Ended],
    ),
    leads(GoalEventKind::ExecutionEnded, only(&[Preempted]), &[Verifying, Holding, Queued]),
    leads(GoalEventKind::ExecutionEnded, only(&[Cancelling]), &[Verifying, Ended]),
    may_lead(GoalEventKind::Verified, only(&[Verifying]), &[WaitingForChange, Ended]),
    leads(GoalEventKind::Yielded, only(&[Executing]), &[Preempted]),
    leads(GoalEventKind::AgentsReleased, only(&[WaitingForAgents]), &[Queued]),
    may_lead(GoalEventKind::WorldChanged, ALIVE, &[]),
    leads(GoalEventKind::Cancelled, only(&[Executing, Preempted]), &[Cancelling]),
    may_lead(GoalEventKind::Cancelled, only(&[Cancelling]), &[]),
    leads(GoalEventKind::Cancelled, WITHOUT_THE_EXECUTOR, &[Ended]),
    leads(GoalEventKind::EndedElsewhere, ALIVE, &[Ended]),
    leads(GoalEventKind::TakenOver, ALIVE, &[Ended]),
];

/// Whether the table has a row for the event in this phase.
pub(crate) fn is_expected(event: GoalEventKind, phase: GoalPhase) -> bool {
    TRANSITIONS.iter().any(|row| row.event == event && row.from.contains(phase))
}

/// Whether the event may lead from the phase `from` to the phase `to`.
pub fn is_lawful(event: GoalEventKind, from: GoalPhase, to: GoalPhase) -> bool {
    TRANSITIONS.iter().any(|row| {
        let is_target = row.to.contains(&to) || (row.may_stay && from == to);
        row.event == event && row.from.contains(from) && is_target
    })
}
