//! Action elimination: removes steps that a plan does not need (Nakhost and Müller, 2010).

use crate::limits::Cancel;
use crate::progression::Progression;
use crate::state::{State, all_hold};
use crate::task::{OperatorId, Task};

/// Maximum number of steps of a plan that is checked for superfluous steps. A longer plan is
/// returned unchanged, because the check takes quadratic time.
const STEPS_MAX: usize = 1_000;

/// Limit on the work, in words of the states that are computed. After it, which takes some tenths of
/// a second, the rest of the plan stays as it is.
const WORK_MAX: usize = 20_000_000;

/// Work to evaluate a comparison, in words of a state.
const COMPARISON_WORK: usize = 8;

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
    let (mut position, mut work) = (0, 0);
    let (mut before, mut next) = (progression.initial(), Vec::new());
    let per_step = before.len() + task.comparisons.len() * COMPARISON_WORK;
    while position < plan.len() && work < WORK_MAX && !cancel.is_set() {
        work += (plan.len() - position) * per_step;
        match without(task, &mut progression, &before, &plan[position + 1..]) {
            Some(rest) => {
                plan.truncate(position);
                plan.extend(rest);
            }
            None => {
                if !progression.apply(task.operator(plan[position]), &before, &mut next) {
                    return plan;
                }
                std::mem::swap(&mut before, &mut next);
                position += 1;
            }
        }
    }
    plan
}

/// Returns the steps of `later` that are applicable in `state`, one after the other. Returns `None`
/// if they do not reach the goal.
fn without(
    task: &Task,
    progression: &mut Progression<'_>,
    state: &State,
    later: &[OperatorId],
) -> Option<Vec<OperatorId>> {
    let (mut state, mut next) = (state.to_vec(), Vec::new());
    let mut kept = Vec::with_capacity(later.len());
    for &id in later {
        let operator = task.operator(id);
        let applies = all_hold(&state, operator.preconditions)
            && progression.apply(operator, &state, &mut next);
        if applies {
            std::mem::swap(&mut state, &mut next);
            kept.push(id);
        }
    }
    all_hold(&state, &task.goal).then_some(kept)
}
