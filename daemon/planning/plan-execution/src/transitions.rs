//! The phases of an execution, and which event leads from which phase to which.

use self::ExecutionPhase::{AwaitingEffects, Ended, GivingUp, Running};

/// The phase of an execution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ExecutionPhase {
    /// Steps are being carried out.
    Running,
    /// Every step is confirmed, and heartbeats that verify the effects are still missing.
    AwaitingEffects,
    /// The outcome is decided; the steps that still run are being cancelled.
    GivingUp,
    /// The outcome was reported.
    Ended,
}

/// Kind of an [`ExecutionEvent`](crate::ExecutionEvent).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ExecutionEventKind {
    /// The plan begins, or continues after a take-over.
    Started,
    /// An agent has agreed to its part of a step.
    StepAgreed,
    /// An agent was restarted, and has received the request for its part again.
    StepRepeated,
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
    /// The heartbeats that should verify effects have not arrived in time.
    EffectsOverdue,
    /// The known state or the action models have changed.
    WorldChanged,
    /// A scheduled check of the remaining steps is due.
    CheckDue,
    /// The known state has arrived, for a check.
    StateReceived,
    /// The Domain Maintainer has answered a sent effect.
    ChangeAnswered,
    /// The plan must be cancelled.
    CancelRequested,
}

/// Row of the table of transitions between the phases of an execution.
#[derive(Clone, Copy, Debug)]
pub struct ExecutionTransition {
    /// Kind of the event.
    pub event: ExecutionEventKind,
    /// Phase in which the event has an effect.
    pub from: ExecutionPhase,
    /// Phases that the event may lead to.
    pub to: &'static [ExecutionPhase],
}

const fn leads(
    event: ExecutionEventKind,
    from: ExecutionPhase,
    to: &'static [ExecutionPhase],
) -> ExecutionTransition {
    ExecutionTransition { event, from, to }
}

/// All valid transitions of an execution. An event that is not listed for a phase changes nothing
/// in that phase.
pub const TRANSITIONS: &[ExecutionTransition] = &[
    leads(ExecutionEventKind::Started, Running, &[Running, GivingUp, Ended]),
    leads(ExecutionEventKind::StepAgreed, Running, &[Running, GivingUp, Ended]),
    leads(ExecutionEventKind::StepRepeated, Running, &[Running, GivingUp, Ended]),
    leads(ExecutionEventKind::StepReported, Running, &[Running, AwaitingEffects, GivingUp, Ended]),
    leads(ExecutionEventKind::StepReported, GivingUp, &[GivingUp, Ended]),
    leads(ExecutionEventKind::StepRefused, Running, &[Running, GivingUp, Ended]),
    leads(ExecutionEventKind::StepRefused, GivingUp, &[GivingUp, Ended]),
    leads(ExecutionEventKind::StepLost, Running, &[Running, GivingUp, Ended]),
    leads(ExecutionEventKind::StepLost, GivingUp, &[GivingUp, Ended]),
    leads(ExecutionEventKind::StepAbandoned, GivingUp, &[GivingUp, Ended]),
    leads(ExecutionEventKind::HeartbeatReceived, Running, &[Running, GivingUp, Ended]),
    leads(ExecutionEventKind::HeartbeatReceived, AwaitingEffects, &[AwaitingEffects, Ended]),
    leads(ExecutionEventKind::EffectsOverdue, AwaitingEffects, &[Ended]),
    leads(ExecutionEventKind::WorldChanged, Running, &[Running]),
    leads(ExecutionEventKind::WorldChanged, AwaitingEffects, &[AwaitingEffects]),
    leads(ExecutionEventKind::CheckDue, Running, &[Running]),
    leads(ExecutionEventKind::CheckDue, AwaitingEffects, &[AwaitingEffects]),
    leads(ExecutionEventKind::StateReceived, Running, &[Running, GivingUp, Ended]),
    leads(ExecutionEventKind::StateReceived, AwaitingEffects, &[AwaitingEffects, Ended]),
    leads(ExecutionEventKind::ChangeAnswered, Running, &[Running]),
    leads(ExecutionEventKind::ChangeAnswered, AwaitingEffects, &[AwaitingEffects]),
    leads(ExecutionEventKind::ChangeAnswered, GivingUp, &[GivingUp]),
    leads(ExecutionEventKind::CancelRequested, Running, &[GivingUp, Ended]),
    leads(ExecutionEventKind::CancelRequested, AwaitingEffects, &[Ended]),
    leads(ExecutionEventKind::CancelRequested, GivingUp, &[GivingUp]),
];

/// Whether the table has a row for the event in this phase.
pub(crate) fn is_expected(event: ExecutionEventKind, phase: ExecutionPhase) -> bool {
    TRANSITIONS.iter().any(|row| row.event == event && row.from == phase)
}

/// Whether the event may lead from the phase `from` to the phase `to`.
pub fn is_lawful(event: ExecutionEventKind, from: ExecutionPhase, to: ExecutionPhase) -> bool {
    TRANSITIONS.iter().any(|row| row.event == event && row.from == from && row.to.contains(&to))
}
