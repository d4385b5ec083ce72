//! Goals taken apart: what they ask for one by one, and which of it cannot be had.

use pddl::{Condition, Domain, Problem};

use crate::ground::ground;
use crate::heuristic::{Evaluator, Max};
use crate::limits::{Cancel, Options};
use crate::normalize::normalize;
use crate::outcome::PlanError;
use crate::plan::refuse_mistakes;
use crate::state::Progression;
use crate::validate::World;
use crate::validate::bindings::Bindings;
use crate::validate::model::Model;

/// The parts of a goal that must all hold, each once: `forall` is expanded over the problem's
/// objects, nested conjunctions are flattened, a disjunction stays one part. Of a state of the problem
/// only its objects matter.
pub fn conjuncts(world: &World, goal: &Condition) -> Vec<Condition> {
    let mut parts = Vec::new();
    split(world.model(), goal, true, &mut Bindings::default(), &mut parts);
    let mut seen = std::collections::HashSet::new();
    parts.retain(|part| seen.insert(part.clone()));
    parts
}

/// Which of the conditions cannot hold at any time, whatever is done: their positions.
///
/// A proof, by the delete relaxation. That a condition is not listed proves nothing.
pub fn unreachable(
    domain: &Domain,
    problem: &Problem,
    conditions: &[Condition],
    options: &Options,
    cancel: &Cancel,
) -> Result<Vec<usize>, PlanError> {
    let mut found = Vec::new();
    for (position, condition) in conditions.iter().enumerate() {
        let alone = Problem { goal: condition.clone(), metric: None, ..problem.clone() };
        refuse_mistakes(domain, &alone)?;
        if is_unreachable(domain, &alone, options, cancel)? {
            found.push(position);
        }
    }
    Ok(found)
}

fn is_unreachable(
    domain: &Domain,
    problem: &Problem,
    options: &Options,
    cancel: &Cancel,
) -> Result<bool, PlanError> {
    let lifted = normalize(domain, problem)?;
    let task = match ground(&lifted, options.budget, cancel, &mut 0) {
        Ok(grounded) => grounded.task,
        // Without an end there is no proof.
        Err(_) => return Ok(false),
    };
    let Some(task) = task else { return Ok(true) };
    let initial = Progression::new(&task).initial();
    let mut evaluator = Max::new(&task);
    Ok(evaluator.evaluate(&initial).is_none())
}

/// Adds the conjuncts of a condition, or of its negation where `positive` is false.
fn split(
    model: &Model,
    condition: &Condition,
    positive: bool,
    bindings: &mut Bindings,
    parts: &mut Vec<Condition>,
) {
    match (condition, positive) {
        (Condition::And(all), true) | (Condition::Or(all), false) => {
            all.iter().for_each(|part| split(model, part, positive, bindings, parts));
        }
        (Condition::Or(all), true) if all.len() == 1 => {
            split(model, &all[0], true, bindings, parts);
        }
        (Condition::Not(inner), _) => split(model, inner, !positive, bindings, parts),
        (Condition::Imply(left, right), false) => {
            split(model, left, true, bindings, parts);
            split(model, right, false, bindings, parts);
        }
        (Condition::Forall(variables, inner), true)
        | (Condition::Exists(variables, inner), false) => {
            expand(model, variables, inner, positive, bindings, parts);
        }
        (other, true) => parts.push(bindings.substitute(other)),
        (other, false) => parts.push(Condition::Not(Box::new(bindings.substitute(other)))),
    }
}

/// Adds the conjuncts of every instance.
fn expand(
    model: &Model,
    variables: &[pddl::Typed],
    inner: &Condition,
    positive: bool,
    bindings: &mut Bindings,
    parts: &mut Vec<Condition>,
) {
    let Some((first, rest)) = variables.split_first() else {
        return split(model, inner, positive, bindings, parts);
    };
    for object in model.members(&first.ty) {
        bindings.bind(&first.name, object);
        expand(model, rest, inner, positive, bindings, parts);
        bindings.unbind();
    }
}
