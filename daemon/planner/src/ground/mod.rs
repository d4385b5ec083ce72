//! Grounding: from the lifted task to facts and operators.
//!
//! 1. [`rules`] says what follows from what; [`reach`] finds every tuple that relaxed reachability
//!    allows, by joins.
//! 2. [`drawn`] holds what the tuples of actions become, each by [`instantiate`]: operators.
//! 3. [`finish`] drops what never changes and what cannot matter.
//!
//! Work is counted in join steps, so the same task stops at the same place everywhere.

mod condition;
mod draft;
mod drawn;
mod finish;
mod instantiate;
mod join;
mod node;
mod possible;
mod reach;
mod relation;
mod rules;
mod sets;
mod standing;
mod tree;
mod triggers;
mod values;
mod wanted;
mod work;

use pddl::Diagnostic;

use self::finish::Start;
pub(crate) use self::standing::{Now, Outgrown, Present, Standing};
use self::values::Values;
use self::work::Work;
use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::Lifted;
use crate::outcome::StopReason;
use crate::task::Task;

/// A ground task and what its author may not have meant.
pub(crate) struct Grounded {
    /// `None` where the goal cannot hold, whatever happens: a proof that there is no plan.
    pub(crate) task: Option<Task>,
    pub(crate) warnings: Vec<Diagnostic>,
}

/// Grounds a lifted task, unless a cap is reached or the caller cancels; `join_steps` tells how much work it was, however it ends.
pub(crate) fn ground(
    lifted: &Lifted,
    budget: Budget,
    cancel: &Cancel,
    join_steps: &mut u64,
) -> Result<Grounded, StopReason> {
    let mut work = Work::new(budget, cancel);
    let result = grounded(lifted, &mut work);
    *join_steps = work.steps;
    result
}

fn grounded(lifted: &Lifted, work: &mut Work<'_>) -> Result<Grounded, StopReason> {
    let mut values = Values::new(lifted);
    let mut reached = reach::reach(lifted, &values, work)?;
    let mut raw = drawn::draw(lifted, &mut reached, &mut values, work)?;
    let warnings = std::mem::take(&mut raw.warnings);
    let start = Start::initial(lifted, &reached.relations, &values, &raw);
    Ok(Grounded { task: finish::finish(lifted, &reached.relations, start, raw, work)?, warnings })
}

/// The relation of a schema's applicable bindings.
fn action_relation(lifted: &Lifted, schema: usize) -> usize {
    lifted.predicates.len() + schema
}
