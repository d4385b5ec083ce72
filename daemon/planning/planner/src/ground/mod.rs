//! Grounding: converts the lifted task to facts and operators.
//!
//! 1. [`horn_rules`] builds the Horn rules of the delete relaxation. [`reach`] finds all reachable
//!    tuples in the relaxation, by joins.
//! 2. [`instantiate`] converts each tuple of an action to operators; [`raw_instances`] stores them.
//! 3. [`finish`] builds the task from the facts and operators that are relevant to the goal.
//!
//! Work is counted in join steps, so the same task reaches a limit at the same point on every
//! machine.

mod conjunction_template;
mod draft;
mod finish;
mod formula_template;
mod ground_fluents;
mod ground_formula;
mod grounding_meter;
mod horn_rules;
mod incremental;
mod instantiate;
mod join;
mod object_sets;
mod raw_instances;
mod reach;
mod relation;
mod relaxed_reachability;
mod relevant_operators;
mod triggers;

use pddl::Diagnostic;

use self::finish::RawInitialState;
use self::ground_fluents::GroundFluents;
use self::grounding_meter::GroundingMeter;
pub(crate) use self::incremental::{
    IncrementalGrounding, InitialState, NeedsRegrounding, PresenceMask,
};
use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::Lifted;
use crate::outcome::StopReason;
use crate::task::Task;

/// A ground task, and warnings about constructs that the author of the texts probably did not
/// intend.
pub(crate) struct Grounded {
    /// Ground task; `None` if the goal is unreachable in the delete relaxation, which proves that
    /// no plan exists.
    pub(crate) task: Option<Task>,
    pub(crate) warnings: Vec<Diagnostic>,
}

/// Grounds a lifted task. Returns the stop reason if a limit is reached or the caller cancels. Sets
/// `join_steps` to the work that was done, even if grounding fails.
pub(crate) fn ground(
    lifted: &Lifted,
    budget: Budget,
    cancel: &Cancel,
    join_steps: &mut u64,
) -> Result<Grounded, StopReason> {
    let mut work = GroundingMeter::new(budget, cancel);
    let result = grounded(lifted, &mut work);
    *join_steps = work.steps;
    result
}

fn grounded(lifted: &Lifted, work: &mut GroundingMeter<'_>) -> Result<Grounded, StopReason> {
    let mut values = GroundFluents::new(lifted);
    let mut reached = reach::reach(lifted, &values, work)?;
    let mut raw = raw_instances::instantiate_all(lifted, &mut reached, &mut values, work)?;
    let warnings = std::mem::take(&mut raw.warnings);
    let start = RawInitialState::initial(lifted, &reached.relations, &values, &raw);
    Ok(Grounded { task: finish::finish(lifted, &reached.relations, start, raw, work)?, warnings })
}

/// Returns the index of the relation that contains the applicable bindings of a schema.
fn action_relation(lifted: &Lifted, schema: usize) -> usize {
    lifted.predicates.len() + schema
}
