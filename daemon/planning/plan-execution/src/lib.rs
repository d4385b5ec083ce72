//! The execution of a plan as a state machine: events in, commands out. No clock and no I/O.
//!
//! A [`PlanState`] has the steps of one plan, their order, and the state of the world that follows
//! from the confirmed steps. [`PlanState::handle`] takes an [`ExecutionEvent`] and returns
//! [`ExecutionCommand`]s. The owner of the state, the Plan Executor, carries the commands out in
//! their order. [`TRANSITIONS`] lists the valid transitions between the phases; `docs/goals.md`
//! has the same table, and tests check the state machine against it.
//!
//! - A step is requested once, when all steps that it depends on are confirmed.
//! - A plan ends exactly once ([`ExecutionCommand::End`]), after the last agent has stopped acting
//!   for it.
//!
//! Start reading at [`TRANSITIONS`], then `plan_state.rs`.

mod effect_check;
mod execution;
mod plan_state;
mod transitions;
mod translate;

pub use effect_check::LastHeartbeats;
pub use plan_state::{CheckDelay, ExecutionCommand, ExecutionEvent, PlanState};
pub use transitions::{
    ExecutionEventKind, ExecutionPhase, ExecutionTransition, TRANSITIONS, is_lawful,
};
pub use translate::{ActionRequest, StepPart};
