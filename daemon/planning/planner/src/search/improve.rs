//! Action elimination: removes steps that a plan does not need (Nakhost and Müller, 2010).

use crate::limits::Cancel;
use crate::progression::Progression;
use crate::state::all_hold;
use crate::task::{OperatorId, Task};

/// Maximum number of steps of a plan that is checked for superfluous steps. A longer plan is
/// returned unchanged, because the check takes quadratic time.
const STEPS_MAX: usize = 1_000;

/// Returns the plan without superfluous steps. The result never costs more than the given plan.
pub(crate) fn eliminate(
    task: &Task,
    mut plan: Vec<OperatorId>,
    cancel: &Cancel,
) -> Vec<OperatorId> {
    if plan.len() > STEPS_MAX {
        return plan;
    }
    let mut progression = Progression::new(task);
    let mut position = 0;
    while position < plan.len() && !cancel.is_set() {
        match without(task, &mut progression, &plan, position) {
            Some(shorter) => plan = shorter,
            None => position += 1,
        }
    }
    plan
}

/// Returns the plan without one step and without all later steps that become inapplicable. Returns
/// `None` if the remaining steps do not reach the goal.
fn without(
    task: &Task,
    progression: &mut Progression<'_>,
    plan: &[OperatorId],
    left_out: usize,
) -> Option<Vec<OperatorId>> {
    let mut state = progression.initial();
    let mut next = Vec::new();
    let mut kept = Vec::with_capacity(plan.len());
    for (position, &id) in plan.iter().enumerate() {
        let operator = task.operator(id);
        let applies = position != left_out
            && all_hold(&state, operator.preconditions)
            && progression.apply(operator, &state, &mut next);
        if applies {
            std::mem::swap(&mut state, &mut next);
            kept.push(id);
        }
    }
    all_hold(&state, &task.goal).then_some(kept)
}
