//! The progress of a goal as a state machine: events in, commands out. No clock and no I/O.
//!
//! A [`GoalState`] has a phase (`acl::content::GoalPhase`), which only [`GoalState::handle`]
//! changes. This function takes a [`GoalEvent`] and returns [`GoalCommand`]s. The owner of the
//! state, the Plan Requester, carries the commands out in their order. [`TRANSITIONS`] lists every
//! valid transition; the diagram in `docs/goals.md` is drawn from this table, and tests check the
//! state machine against it.
//!
//! - Time is a parameter: a `Duration` since an origin that the owner chooses.
//! - Work that a command begins (a question, a search, an execution) has a number, its [`Attempt`].
//!   An event that ends work names the attempt; an event of an earlier attempt changes nothing.
//! - A goal ends exactly once: [`GoalCommand::End`] leads to the phase `Ended`, in which every
//!   event is ignored.
//!
//! Start reading at [`TRANSITIONS`], then `goal_state.rs`.

mod action_backoff;
mod event;
mod goal_state;
mod transitions;

pub use action_backoff::{ActionBackoffs, AvoidedAction, AvoidedActions, FailedAction};
pub use event::{
    Attempt, Blockers, ExecutionEnd, GoalCommand, GoalEvent, GoalEventKind, GoalVerdict,
    MissingPlan, PlanDecision, PlanningFlow, PlanningMode, Turn,
};
pub use goal_state::{FAILURES_MAX, GoalState, Policy, RECHECK_INTERVAL, SETTLE_DELAY, holding};
pub use transitions::{GoalTransition, PhaseSet, TRANSITIONS, is_lawful};
