//! What several agents could do together, where none of them proposes a plan of its own: found out by
//! planning for all of them, so that what the user is told is so.

use pddl::{Condition, Plan};
use planner::{Cancel, StopReason};

use crate::known::Known;

/// Parts of a goal of which pairs are looked at, to name two that exclude each other.
const PARTS_MAX: usize = 6;

/// What came of planning with everybody's actions.
pub(crate) enum Together {
    /// A plan of several agents.
    Plan(Plan),
    /// Proven: no plan reaches it.
    Never,
    /// Neither was found within the bounds.
    Open,
}

impl Together {
    pub(crate) fn of(known: &Known, parts: &[Condition], cancel: &Cancel) -> Together {
        match known.plan_for(parts, cancel) {
            Some((Some(plan), _)) => Together::Plan(plan),
            Some((None, StopReason::Unsolvable { .. })) => Together::Never,
            _ => Together::Open,
        }
    }
}

/// Why nobody proposes a plan for `parts`, each of which could be reached if nothing were undone.
pub(crate) fn reason(known: &Known, parts: &[Condition], names: &str, cancel: &Cancel) -> String {
    match Together::of(known, parts, cancel) {
        Together::Plan(plan) => format!(
            "no agent reaches {names} by itself; {} do together, in {} steps: let one planner plan \
             for all (`mode centralized`)",
            actors(&plan),
            plan.steps.len()
        ),
        Together::Never => {
            format!("proven: no plan reaches {names}{}", exclusion(known, parts, cancel))
        }
        Together::Open => format!(
            "no agent reaches {names} by itself; whether several could together was not found out \
             within the bounds of the search"
        ),
    }
}

/// The agents that act in a plan.
fn actors(plan: &Plan) -> String {
    let mut actors: Vec<String> = Vec::new();
    for actor in plan.steps.iter().filter_map(|step| step.arguments.first()) {
        let actor = format!("`{actor}`");
        if !actors.contains(&actor) {
            actors.push(actor);
        }
    }
    actors.join(" and ")
}

/// Two parts that exclude each other, if there are two.
fn exclusion(known: &Known, parts: &[Condition], cancel: &Cancel) -> String {
    if parts.len() < 2 || parts.len() > PARTS_MAX {
        return String::new();
    }
    for (place, one) in parts.iter().enumerate() {
        for other in &parts[place + 1..] {
            let pair = [one.clone(), other.clone()];
            // Two alone that no plan reaches are such a pair.
            if parts.len() == 2 {
                return ", because they exclude each other".to_owned();
            }
            if matches!(Together::of(known, &pair, cancel), Together::Never) {
                return format!(": `{one}` and `{other}` exclude each other");
            }
        }
    }
    String::new()
}
