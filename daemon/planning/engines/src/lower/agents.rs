//! Translation of MA-PDDL. The acting agent becomes the first parameter of an action, because it is
//! the first argument of a plan's step. Privacy is removed, because engines do not have it.

use std::sync::Arc;

use pddl::{Domain, Privacy, Problem};

/// Removes acting agents and privacy from a task.
pub(super) fn lower(domain: &mut Domain, problem: &mut Problem) {
    for action in &mut domain.actions {
        if let Some(agent) = action.agent.take() {
            action.parameters.insert(0, agent);
        }
    }
    domain.predicates.iter_mut().for_each(|it| it.privacy = Privacy::Public);
    domain.functions.iter_mut().for_each(|it| it.privacy = Privacy::Public);
    Arc::make_mut(&mut problem.objects).iter_mut().for_each(|it| it.privacy = Privacy::Public);
}
