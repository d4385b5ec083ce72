//! The phases of an execution, and which event leads from which phase to which.

use self::ExecutionPhase::{AwaitingEffects, Ended, GivingUp, Running};

/// The phase of an execution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ExecutionPhase {
    /// Steps are being carried out.
    Running,
    /// Every step is confirmed; heartbeats that verify the effects are awaited.
    AwaitingEffects,
    /// The outcome is decided; the steps that still run are being cancelled.
    GivingUp,
    /// The outcome was reported.
    Ended,
}

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum EventKind {
    /// The plan begins, or goes on after a take-over.
    Started,
    /// An agent has reported about a step.
    StepReported,
    /// An agent has refused a step.
    StepRefused,
    /// An agent does not answer about a step.
    StepLost,
    /// The agent of a cancelled step is absent.
    StepAbandoned,
    /// A heartbeat has arrived.
    HeartbeatReceived,
    /// The heartbeats that verify the effects are overdue.
    EffectsOverdue,
    /// The known state or the action models have changed.
    WorldChanged,
    /// A check of the rest of the plan is due.
    CheckDue,
    /// The known state has arrived, for a check.
    StateReceived,
    /// The Domain Maintainer has answered about an effect.
    ChangeAnswered,
    /// The plan is to be cancelled.
    CancelRequested,
}

/// A row of the table: an event, a phase, and the phases that the event may lead to from there.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// The event.
    pub event: EventKind,
    /// The phase in which the event counts.
    pub from: ExecutionPhase,
    /// The phases that the event may lead to.
    pub to: &'static [ExecutionPhase],
}

const fn leads(
    event: EventKind,
    from: ExecutionPhase,
    to: &'static [ExecutionPhase],
) -> Transition {
    Transition { event, from, to }
}

/// All lawful transitions of an execution. An event that is not listed for a phase changes nothing in
/// that phase.
pub const TRANSITIONS: &[Transition] = &[
    leads(EventKind::Started, Running, &[Running, GivingUp, Ended]),
    leads(EventKind::StepReported, Running, &[Running, AwaitingEffects, GivingUp, Ended]),
    leads(EventKind::StepReported, GivingUp, &[GivingUp, Ended]),
    leads(EventKind::StepRefused, Running, &[Running, GivingUp, Ended]),
    leads(EventKind::StepRefused, GivingUp, &[GivingUp, Ended]),
    leads(EventKind::StepLost, Running, &[Running, GivingUp, Ended]),
    leads(EventKind::StepLost, GivingUp, &[GivingUp, Ended]),
    leads(EventKind::StepAbandoned, GivingUp, &[GivingUp, Ended]),
    leads(EventKind::HeartbeatReceived, Running, &[Running, GivingUp, Ended]),
    leads(EventKind::HeartbeatReceived, AwaitingEffects, &[AwaitingEffects, Ended]),
    leads(EventKind::EffectsOverdue, AwaitingEffects, &[Ended]),
    leads(EventKind::WorldChanged, Running, &[Running]),
    leads(EventKind::WorldChanged, AwaitingEffects, &[AwaitingEffects]),
    leads(EventKind::CheckDue, Running, &[Running]),
    leads(EventKind::CheckDue, AwaitingEffects, &[AwaitingEffects]),
    leads(EventKind::StateReceived, Running, &[Running, GivingUp, Ended]),
    leads(EventKind::StateReceived, AwaitingEffects, &[AwaitingEffects, Ended]),
    leads(EventKind::ChangeAnswered, Running, &[Running]),
    leads(EventKind::ChangeAnswered, AwaitingEffects, &[AwaitingEffects]),
    leads(EventKind::ChangeAnswered, GivingUp, &[GivingUp]),
    leads(EventKind::CancelRequested, Running, &[GivingUp, Ended]),
    leads(EventKind::CancelRequested, AwaitingEffects, &[Ended]),
    leads(EventKind::CancelRequested, GivingUp, &[GivingUp]),
];

/// Whether the event counts in the phase.
pub(crate) fn is_expected(event: EventKind, phase: ExecutionPhase) -> bool {
    TRANSITIONS.iter().any(|row| row.event == event && row.from == phase)
}

/// Whether the event may lead from one phase to the other.
pub fn is_lawful(event: EventKind, from: ExecutionPhase, to: ExecutionPhase) -> bool {
    TRANSITIONS.iter().any(|row| row.event == event && row.from == from && row.to.contains(&to))
}
