//! Explanations: which parts of a goal are unreachable, and which capabilities are missing.
//!
//! A missing capability is *supposed*: a present agent is assumed to offer an additional action, or
//! a new agent of the right type is assumed to offer the action, at a place that the precondition
//! of the action requires. Every such supposition is an operator of a relaxed task (`suppose`). One
//! pass computes the smallest sets of suppositions that make a part of the goal reachable
//! (`support`).
//!
//! For plain PDDL without agents, [`why_unsolvable`] explains which facts no action makes true.
//!
//! - The results are hints for people. Plans never use them, because they are only sufficient in
//!   the relaxation.
//! - A part of the goal that is listed as an obstacle is proved to be unreachable. A part that is
//!   not listed may still be unreachable.
//! - Work is limited. If a limit ends it, [`Explanation::is_complete`] is `false`.
//! - Suppositions ignore numbers: a supposed action is assumed to be applicable whatever its
//!   numeric conditions are.

mod achievers;
mod hindrances;
mod places;
mod plain;
mod sentences;
mod support;
mod suppose;

use std::collections::BTreeMap;

use pddl::{ActionModel, Atom, Condition, Domain, Name, Problem, TypeExpr};

use self::hindrances::hindrances;
use self::places::places;
pub use self::plain::{Unsolvability, why_unsolvable};
use self::support::{Support, SuppositionRules};
use self::suppose::SupposedTask;
use crate::goal::unreachable;
use crate::ground::ground;
use crate::limits::Cancel;
use crate::normalize::normalize;
use crate::options::Options;
use crate::outcome::PlanError;

/// Maximum number of alternatives that are listed for one part of the goal, the smallest ones
/// first, and of parts whose hindrances are searched for. More would not help a person.
const ALTERNATIVES_MAX: usize = 3;

/// Inputs of an explanation.
#[derive(Clone, Copy, Debug)]
pub struct ExplanationInput<'a> {
    /// Composite domain of all agents that are present.
    pub domain: &'a Domain,
    /// Problem with the objects and the present state.
    pub problem: &'a Problem,
    /// Guard of each guarded action, by the name of the action in `domain`.
    pub guards: &'a BTreeMap<Name, ActionGuard>,
    /// Action models with actions that agents offered earlier and no present agent offers.
    pub former: &'a [ActionModel],
}

/// Guard of an action: a fact that allows an agent to use the action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionGuard {
    /// Name of the guarded action in the agents' own models.
    pub outside: Name,
    /// Guard predicate, which is true for the agents that offer the action.
    pub predicate: Name,
}

/// Reasons why a goal is unreachable, and the missing capabilities.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// Unreachable parts of the goal, in the given order. If the list is empty, each part alone is
    /// reachable in the relaxation.
    pub obstacles: Vec<Obstacle>,
    /// Number of parts of the goal that the explanation covers.
    pub parts: usize,
    /// Whether the explanation is complete: the computation finished before it reached a limit.
    pub is_complete: bool,
}

/// An unreachable part of a goal.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// The part of the goal that is unreachable.
    pub conjunct: Condition,
    /// Unreachable facts in the part; empty if the reason is a number or a negated fact.
    pub unreachable: Vec<Atom>,
    /// Actions that could make the unreachable facts true, under the agents' own names for them.
    pub actions: Vec<Name>,
    /// Number of agents that act in such an action together.
    pub agents: usize,
    /// Facts that hold, that no action ends, and without which the part would be reachable.
    pub hindrances: Vec<Atom>,
    /// Sets of missing capabilities, the smallest set first. Each set alone would suffice to reach
    /// the part.
    pub alternatives: Vec<Alternative>,
    /// Whether the part would be reachable without numeric conditions.
    pub is_numeric: bool,
}

/// A set of missing capabilities that together would suffice.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    /// The missing capabilities of this set, one or two.
    pub missing: Vec<MissingCapability>,
}

/// A capability that no agent offers.
#[derive(Clone, Debug, PartialEq)]
pub struct MissingCapability {
    /// Name of the missing action in the agents' own models.
    pub action: Name,
    /// The agent that would have to offer the action.
    pub agent: SupposedObject,
    /// Required places of the agent if it is new, one entry for each relevant fact about it.
    pub places: Vec<Placement>,
}

/// A present agent or object, or a new agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SupposedObject {
    /// An agent or object that is present, with this name.
    Here(Name),
    /// An agent that does not exist yet, of this type.
    New(TypeExpr),
}

/// A relevant fact about the place of a new agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placement {
    /// Predicate of the fact.
    pub predicate: Name,
    /// Whether the new agent is the last argument of the fact. If so, another agent is on the new
    /// agent; otherwise the new agent is on another one.
    pub is_reversed: bool,
    /// Required place of the new agent in this fact.
    pub place: RequiredPlace,
}

/// Required place of a new agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RequiredPlace {
    /// Any place suffices.
    Anywhere,
    /// Each of these places suffices. A place is a list of the arguments of the fact other than the
    /// new agent.
    At(Vec<Vec<SupposedObject>>),
}

/// Explains which of `parts`, the ground conjuncts of a goal, are unreachable, and which
/// capabilities are missing.
///
/// # Errors
///
/// Returns an error if the texts contain mistakes or use a feature that this planner does not
/// support.
pub fn explain(
    known: ExplanationInput<'_>,
    parts: &[Condition],
    options: &Options,
    cancel: &Cancel,
) -> Result<Explanation, PlanError> {
    let supposed = SupposedTask::new(known, parts);
    let lifted = normalize(&supposed.domain, &supposed.problem)?;
    let task = match ground(&lifted, options.budget, cancel, &mut 0) {
        Ok(grounded) => grounded.task,
        // A limit ended grounding, so there is no proof and no explanation.
        Err(_) => {
            return Ok(Explanation {
                obstacles: Vec::new(),
                parts: parts.len(),
                is_complete: false,
            });
        }
    };
    let rules = task.map(|task| SuppositionRules::new(&task, &supposed)).unwrap_or_default();
    let support = Support::compute(&rules);
    let numeric = reached_but_for_numbers(known, parts, &support, options, cancel)?;
    let mut explanation =
        Explanation { obstacles: Vec::new(), parts: parts.len(), is_complete: support.is_complete };
    for (part, conjunct) in parts.iter().enumerate() {
        if support.is_reached(part) && !numeric.contains(&part) {
            continue;
        }
        let unreachable = supposed.atoms[part].iter().enumerate();
        let unreachable = unreachable.filter(|(atom, _)| !support.is_fact_reached(part, *atom));
        let unreachable: Vec<Atom> = unreachable.map(|(_, atom)| atom.clone()).collect();
        let actions = supposed.adding(&unreachable);
        explanation.obstacles.push(Obstacle {
            conjunct: conjunct.clone(),
            agents: supposed.agents_of(&actions),
            actions,
            unreachable,
            hindrances: Vec::new(),
            alternatives: Vec::new(),
            is_numeric: numeric.contains(&part),
        });
    }
    for obstacle in explanation.obstacles.iter_mut().take(ALTERNATIVES_MAX) {
        obstacle.hindrances = hindrances(known, &obstacle.conjunct, options, cancel)?;
    }
    let asked = parts.iter().enumerate().filter(|(part, _)| !support.is_reached(*part));
    let asked: Vec<usize> = asked.map(|(part, _)| part).collect();
    let mut found = places(&rules, &support, &supposed, &asked);
    explanation.is_complete &= found.is_complete;
    for obstacle in &mut explanation.obstacles {
        let part = parts.iter().position(|part| *part == obstacle.conjunct);
        obstacle.alternatives = part.and_then(|part| found.of.remove(&part)).unwrap_or_default();
    }
    Ok(explanation)
}

/// Returns the parts of the goal that are unreachable, but would be reachable without numeric
/// conditions.
fn reached_but_for_numbers(
    known: ExplanationInput<'_>,
    parts: &[Condition],
    support: &Support,
    options: &Options,
    cancel: &Cancel,
) -> Result<Vec<usize>, PlanError> {
    let conditions = known.domain.actions.iter().map(|action| &action.precondition);
    let axioms = known.domain.derived.iter().map(|derived| &derived.condition);
    if !conditions.chain(axioms).chain(parts).any(suppose::has_comparison) {
        return Ok(Vec::new());
    }
    let reached: Vec<usize> = (0..parts.len()).filter(|part| support.is_reached(*part)).collect();
    let conditions: Vec<Condition> = reached.iter().map(|part| parts[*part].clone()).collect();
    let missing = unreachable(known.domain, known.problem, &conditions, options, cancel)?;
    Ok(missing.into_iter().map(|position| reached[position]).collect())
}
