//! Explanations: which parts of a goal cannot be reached, and which capability is missing.
//!
//! Capabilities are *supposed*: an action of an agent that is here and does not offer it, or of a
//! new agent of the right type, placed as its own preconditions want it. Every supposition is an
//! operator of a relaxed task (`suppose`), and the smallest sets of them under which a part of the
//! goal is reached are found in one pass (`support`).
//!
//! Of plain PDDL, where no agents are, [`why_unsolvable`] says what no action makes true.
//!
//! - Nothing here is acted on: what would do in the relaxation is a hint, for people.
//! - That a part is listed as an obstacle is a proof; that it is not listed proves nothing.
//! - Work is counted; where the count ends it, [`Explanation::is_complete`] says so.
//! - Amounts are left out of the supposing: an action is taken to be possible whatever it costs.

mod places;
mod plain;
mod support;
mod suppose;
mod words;

use std::collections::BTreeMap;

use pddl::{ActionModel, Atom, Condition, Domain, Name, Problem, TypeExpr};

use self::places::places;
pub use self::plain::{Unsolvability, why_unsolvable};
use self::support::{Rules, Support};
use self::suppose::Supposed;
use crate::goal::unreachable;
use crate::ground::ground;
use crate::limits::{Cancel, Options};
use crate::normalize::normalize;
use crate::outcome::PlanError;

/// Alternatives that are worked out and told for one part of a goal: more are no help.
const ALTERNATIVES_MAX: usize = 3;

/// What is known, to explain in.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// The domain of all who are here.
    pub domain: &'a Domain,
    /// Its objects and the state.
    pub problem: &'a Problem,
    /// For each action of the domain that only those may take who offer it: how.
    pub guards: &'a BTreeMap<Name, Guard>,
    /// Models of agents that were here: their actions are offered no longer.
    pub former: &'a [ActionModel],
}

/// What lets an agent act by a schema.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Guard {
    /// The name that agents know the action by.
    pub outside: Name,
    /// The predicate that holds of the agents that offer it.
    pub predicate: Name,
}

/// Why a goal cannot be reached.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// The parts that cannot be reached, in the order of the question. None: each part can be
    /// reached alone, as far as the relaxation shows.
    pub obstacles: Vec<Obstacle>,
    /// How many parts were asked about.
    pub parts: usize,
    /// Whether the bounds on work left nothing out.
    pub is_complete: bool,
}

/// A part of a goal that cannot be reached.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// The part.
    pub conjunct: Condition,
    /// Which facts in it cannot be reached; none, if amounts or falsehoods are the matter.
    pub unreachable: Vec<Atom>,
    /// The actions, under their agents' names, that could bring such facts about.
    pub actions: Vec<Name>,
    /// What would do, the smallest first.
    pub alternatives: Vec<Alternative>,
    /// Whether it could be reached if it were not for numbers.
    pub is_numeric: bool,
}

/// Capabilities that would do together.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    /// One or two.
    pub missing: Vec<Missing>,
}

/// A capability that nobody offers.
#[derive(Clone, Debug, PartialEq)]
pub struct Missing {
    /// The action, under its agents' name for it.
    pub action: Name,
    /// Who would have to offer it.
    pub agent: Who,
    /// Where a new agent would have to be, for each fact about it that matters.
    pub places: Vec<Placement>,
}

/// An agent, or another object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Who {
    /// One that is here.
    Here(Name),
    /// One that is not here, of this type.
    New(TypeExpr),
}

/// A fact about a new agent that matters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placement {
    /// Its predicate.
    pub predicate: Name,
    /// Whether the new agent comes last in the fact: another is on it, and not it on another.
    pub is_reversed: bool,
    /// What it says of the agent.
    pub place: Place,
}

/// Where something would have to be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// Wherever it is put, it will do.
    Anywhere,
    /// Any of these will do: the other arguments of the fact.
    At(Vec<Vec<Who>>),
}

/// Explains which of `parts`, ground conjuncts of a goal, cannot be reached, and what is missing.
///
/// # Errors
///
/// If the texts make no sense, or mean something that this planner does not do.
pub fn explain(
    known: Known<'_>,
    parts: &[Condition],
    options: &Options,
    cancel: &Cancel,
) -> Result<Explanation, PlanError> {
    let supposed = Supposed::new(known, parts);
    let lifted = normalize(&supposed.domain, &supposed.problem)?;
    let task = match ground(&lifted, options.budget, cancel, &mut 0) {
        Ok(grounded) => grounded.task,
        // Without an end nothing is proven, and nothing explained.
        Err(_) => {
            return Ok(Explanation {
                obstacles: Vec::new(),
                parts: parts.len(),
                is_complete: false,
            });
        }
    };
    let rules = task.map(|task| Rules::new(&task, &supposed)).unwrap_or_default();
    let support = Support::compute(&rules);
    let numeric = reached_but_for_numbers(known, parts, &support, options, cancel)?;
    let mut explanation =
        Explanation { obstacles: Vec::new(), parts: parts.len(), is_complete: support.is_complete };
    for (part, conjunct) in parts.iter().enumerate() {
        if support.is_reached(part) && !numeric.contains(&part) {
            continue;
        }
        let unreachable = supposed.atoms[part].iter().enumerate();
        let unreachable = unreachable.filter(|(atom, _)| !support.is_touched(part, *atom));
        let unreachable: Vec<Atom> = unreachable.map(|(_, atom)| atom.clone()).collect();
        explanation.obstacles.push(Obstacle {
            conjunct: conjunct.clone(),
            actions: supposed.adding(&unreachable),
            unreachable,
            alternatives: Vec::new(),
            is_numeric: numeric.contains(&part),
        });
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

/// The parts that are reached where numbers do not count, and are not where they do.
fn reached_but_for_numbers(
    known: Known<'_>,
    parts: &[Condition],
    support: &Support,
    options: &Options,
    cancel: &Cancel,
) -> Result<Vec<usize>, PlanError> {
    let conditions = known.domain.actions.iter().map(|action| &action.precondition);
    let axioms = known.domain.derived.iter().map(|derived| &derived.condition);
    if !conditions.chain(axioms).chain(parts).any(suppose::counts) {
        return Ok(Vec::new());
    }
    let reached: Vec<usize> = (0..parts.len()).filter(|part| support.is_reached(*part)).collect();
    let conditions: Vec<Condition> = reached.iter().map(|part| parts[*part].clone()).collect();
    let missing = unreachable(known.domain, known.problem, &conditions, options, cancel)?;
    Ok(missing.into_iter().map(|position| reached[position]).collect())
}
