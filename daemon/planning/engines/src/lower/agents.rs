//! Translation of MA-PDDL. The acting agents become the first parameters of an action, because they
//! are the first arguments of a plan's step. Privacy is removed, because engines do not have it.

use std::sync::Arc;

use pddl::{Domain, Privacy, Problem};

/// Removes acting agents and privacy from a task.
pub(super) fn lower(domain: &mut Domain, problem: &mut Problem) {
    for action in &mut domain.actions {
        let agents = action.agent.take().into_iter().chain(std::mem::take(&mut action.partners));
        action.parameters.splice(0..0, agents).for_each(drop);
    }
    domain.predicates.iter_mut().for_each(|it| it.privacy = Privacy::Public);
    domain.functions.iter_mut().for_each(|it| it.privacy = Privacy::Public);
    Arc::make_mut(&mut problem.objects).iter_mut().for_each(|it| it.privacy = Privacy::Public);
}
