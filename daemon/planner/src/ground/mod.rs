//! Grounding: from the lifted task to facts and operators.
//!
//! 1. [`rules`] says what follows from what; [`reach`] finds every tuple that relaxed reachability
//!    allows, by joins.
//! 2. [`instantiate`] turns the tuples of actions into operators.
//! 3. [`finish`] drops what never changes and what cannot matter.
//!
//! Work is counted in join steps, so the same task stops at the same place everywhere.

mod condition;
mod draft;
mod finish;
mod instantiate;
mod join;
mod node;
mod reach;
mod relation;
mod rules;
mod sets;
mod tree;
mod triggers;
mod values;
mod work;

use pddl::Diagnostic;

use self::values::Values;
use self::work::Work;
use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::{Lifted, PredicateIndex};
use crate::outcome::{StopReason, Unsupported};
use crate::task::{ObjectId, Task};

/// A ground task and what its author may not have meant.
pub(crate) struct Grounded {
    /// `None` where the goal cannot hold, whatever happens: a proof that there is no plan.
    pub(crate) task: Option<Task>,
    pub(crate) warnings: Vec<Diagnostic>,
}

/// Why grounding ended without a task.
#[derive(Debug)]
pub(crate) enum GroundError {
    /// A cap was reached, or the caller cancelled.
    Stopped(StopReason),
    /// Something only seen on ground level is not supported.
    Unsupported(Unsupported),
}

/// Grounds a lifted task; `join_steps` tells how much work it was, however it ends.
pub(crate) fn ground(
    lifted: &Lifted,
    budget: Budget,
    cancel: &Cancel,
    join_steps: &mut u64,
) -> Result<Grounded, GroundError> {
    let mut work = Work::new(budget, cancel);
    let result = grounded(lifted, &mut work);
    *join_steps = work.steps;
    result
}

fn grounded(lifted: &Lifted, work: &mut Work<'_>) -> Result<Grounded, GroundError> {
    let mut values = Values::new(lifted);
    let mut reached = reach::reach(lifted, &values, work)?;
    let mut raw = instantiate::instantiate(lifted, &mut reached, &mut values, work)?;
    let warnings = std::mem::take(&mut raw.warnings);
    Ok(Grounded { task: finish::finish(lifted, &reached.relations, &values, raw, work)?, warnings })
}

/// Which of these facts the delete relaxation reaches, in their order: the others cannot hold,
/// whatever is done. One pass for all of them, and no operators are made.
pub(crate) fn reachable(
    lifted: &Lifted,
    facts: &[(PredicateIndex, Vec<ObjectId>)],
    budget: Budget,
    cancel: &Cancel,
) -> Result<Vec<bool>, StopReason> {
    let values = Values::new(lifted);
    let reached = reach::reach(lifted, &values, &mut Work::new(budget, cancel))?;
    let is_found = |(predicate, objects): &(PredicateIndex, Vec<ObjectId>)| {
        reached.relations[*predicate].find(objects).is_some()
    };
    Ok(facts.iter().map(is_found).collect())
}

/// The relation of a schema's applicable bindings.
fn action_relation(lifted: &Lifted, schema: usize) -> usize {
    lifted.predicates.len() + schema
}

impl From<StopReason> for GroundError {
    fn from(reason: StopReason) -> GroundError {
        GroundError::Stopped(reason)
    }
}

impl From<Unsupported> for GroundError {
    fn from(unsupported: Unsupported) -> GroundError {
        GroundError::Unsupported(unsupported)
    }
}
