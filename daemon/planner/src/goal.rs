//! Splits goals into conjuncts, and finds conjuncts that are unreachable.

use pddl::{Atom, Condition, Derived, Domain, Problem};

use crate::ground::ground;
use crate::heuristic::{Evaluator, MaxHeuristic};
use crate::limits::Cancel;
use crate::normalize::normalize;
use crate::options::Options;
use crate::outcome::PlanError;
use crate::plan::refuse_mistakes;
use crate::progression::Progression;
use crate::validate::World;
use crate::validate::bindings::Bindings;
use crate::validate::model::Model;

/// Splits a goal into the conjuncts that must all hold, without duplicates.
///
/// - `forall` is expanded over the objects of the problem, nested conjunctions are flattened, and a
///   disjunction stays one conjunct.
/// - A derived fact stays one conjunct if any one of several conditions is enough to make it true.
///   Otherwise it is replaced by the conjuncts that it is derived from: “no lamp in the room is on”
///   becomes one conjunct per lamp, so that different agents can each achieve one.
/// - Of the state in `world`, only the objects and the static facts (which no action changes) are read.
pub fn conjuncts(world: &World, goal: &Condition) -> Vec<Condition> {
    conjuncts_but(world, goal, &|_| false)
}

/// Splits a goal as [`conjuncts`] does, except that a derived fact stays one conjunct if `stays`
/// returns `true` for it. Callers use this for facts about which they know more than the axioms say.
pub fn conjuncts_but(
    world: &World,
    goal: &Condition,
    stays: &dyn Fn(&Atom) -> bool,
) -> Vec<Condition> {
    let mut parts = Vec::new();
    split((world, stays), goal, true, &mut Bindings::default(), &mut parts);
    let mut seen = std::collections::HashSet::new();
    parts.retain(|part| seen.insert(part.clone()));
    parts
}

/// Returns the positions of the conditions that no reachable state satisfies.
///
/// Each result is proved by the delete relaxation. A condition may be unreachable although its position
/// is not returned.
///
/// # Errors
///
/// Returns [`PlanError::BadInput`] if the texts or a condition contain errors, and
/// [`PlanError::Unsupported`] if they use a feature that this planner does not support.
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
        // A limit ended grounding, so that nothing is proved.
        Err(_) => return Ok(false),
    };
    let Some(task) = task else { return Ok(true) };
    let initial = Progression::new(&task).initial();
    let mut evaluator = MaxHeuristic::new(&task);
    Ok(evaluator.evaluate(&initial).is_none())
}

/// A state, and the function that returns `true` for derived facts that stay one conjunct.
type SplitContext<'w> = (&'w World, &'w dyn Fn(&Atom) -> bool);

/// Adds the conjuncts of `condition`, or those of its negation if `positive` is false, to `parts`.
fn split(
    (world, stays): SplitContext<'_>,
    condition: &Condition,
    positive: bool,
    bindings: &mut Bindings,
    parts: &mut Vec<Condition>,
) {
    match (condition, positive) {
        (Condition::And(all), true) | (Condition::Or(all), false) => {
            all.iter().for_each(|part| split((world, stays), part, positive, bindings, parts));
        }
        (Condition::Or(all), true) if all.len() == 1 => {
            split((world, stays), &all[0], true, bindings, parts);
        }
        (Condition::Not(inner), _) => split((world, stays), inner, !positive, bindings, parts),
        (Condition::Imply(left, right), false) => {
            split((world, stays), left, true, bindings, parts);
            split((world, stays), right, false, bindings, parts);
        }
        (Condition::Forall(variables, inner), true)
        | (Condition::Exists(variables, inner), false) => {
            expand((world, stays), variables, inner, positive, bindings, parts);
        }
        (Condition::Atom(atom), _)
            if let Some(derived) = derive((world, stays), atom, positive, bindings) =>
        {
            parts.extend(derived);
        }
        (other, true) => parts.push(bindings.substitute(other)),
        (other, false) => parts.push(Condition::Not(Box::new(bindings.substitute(other)))),
    }
}

/// Adds the conjuncts of every instance of a quantified condition to `parts`.
fn expand(
    (world, stays): SplitContext<'_>,
    variables: &[pddl::Typed],
    inner: &Condition,
    positive: bool,
    bindings: &mut Bindings,
    parts: &mut Vec<Condition>,
) {
    let Some((first, rest)) = variables.split_first() else {
        return split((world, stays), inner, positive, bindings, parts);
    };
    for object in world.model().members(&first.ty) {
        bindings.bind(&first.name, object);
        expand((world, stays), rest, inner, positive, bindings, parts);
        bindings.unbind();
    }
}

/// Returns the conjuncts that make a derived atom true, or those that make it false if `positive` is
/// false. Returns `None` if the atom itself stays one conjunct.
fn derive(
    (world, stays): SplitContext<'_>,
    atom: &Atom,
    positive: bool,
    bindings: &Bindings,
) -> Option<Vec<Condition>> {
    if stays(&bindings.atom(atom)) {
        return None;
    }
    let model: &Model = world.model();
    let definitions = model.definitions(&atom.predicate);
    let splits = |axiom: &Derived| {
        matches!(axiom.condition, Condition::And(_) | Condition::Forall(..) | Condition::Not(_))
    };
    match definitions.as_slice() {
        [] => return None,
        [one] if positive && splits(one) => (),
        _ if positive => return None,
        _ => (),
    }
    let arguments = bindings.objects(&atom.arguments);
    let mut parts = Vec::new();
    for axiom in definitions {
        let mut inner = Bindings::default();
        for (parameter, object) in axiom.parameters.iter().zip(&arguments) {
            inner.bind(&parameter.name, object.clone());
        }
        split((world, stays), &axiom.condition, positive, &mut inner, &mut parts);
    }
    let open = parts.into_iter().map(|part| fold(world, part)).filter(|part| !part.is_always());
    let open: Vec<Condition> = open.collect();
    // With exactly one conjunct left, the atom itself is kept, because its name is the one that the
    // author of the domain chose.
    (open.len() != 1).then_some(open)
}

/// Simplifies a closed condition by evaluating its static parts. The empty conjunction stands for true,
/// the empty disjunction for false.
fn fold(world: &World, condition: Condition) -> Condition {
    match condition {
        Condition::Atom(atom) if world.model().is_static(&atom.predicate) => {
            truth(world.holds(&Condition::Atom(atom)))
        }
        Condition::Not(inner) => match fold(world, *inner) {
            Condition::And(all) if all.is_empty() => truth(false),
            Condition::Or(all) if all.is_empty() => truth(true),
            inner => Condition::Not(Box::new(inner)),
        },
        Condition::And(all) => joined(all.into_iter().map(|part| fold(world, part)), true),
        Condition::Or(all) => joined(all.into_iter().map(|part| fold(world, part)), false),
        Condition::Exists(..) | Condition::Forall(..) if is_static(world.model(), &condition) => {
            truth(world.holds(&condition))
        }
        Condition::Imply(left, right) => {
            let not = fold(world, Condition::Not(left));
            joined([not, fold(world, *right)].into_iter(), false)
        }
        other => other,
    }
}

/// Whether a condition mentions only static predicates, which no action changes.
fn is_static(model: &Model, condition: &Condition) -> bool {
    condition.parts().all(|part| match part {
        Condition::Atom(atom) => model.is_static(&atom.predicate),
        Condition::Compare(_) => false,
        _ => true,
    })
}

fn truth(is_true: bool) -> Condition {
    if is_true { Condition::And(Vec::new()) } else { Condition::Or(Vec::new()) }
}

/// Builds a conjunction or disjunction of `parts`, and leaves out the parts that do not affect its
/// truth.
fn joined(parts: impl Iterator<Item = Condition>, is_and: bool) -> Condition {
    let mut kept = Vec::new();
    for part in parts {
        match part {
            Condition::And(all) if all.is_empty() && is_and => (),
            Condition::Or(any) if any.is_empty() && !is_and => (),
            Condition::And(all) if all.is_empty() => return truth(true),
            Condition::Or(any) if any.is_empty() => return truth(false),
            part => kept.push(part),
        }
    }
    match kept.len() {
        1 => kept.remove(0),
        _ if is_and => Condition::And(kept),
        _ => Condition::Or(kept),
    }
}
