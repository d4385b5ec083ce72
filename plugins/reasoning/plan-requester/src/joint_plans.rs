//! Explains whether several agents together could reach a goal for which no single agent proposes a
//! plan. The explanation is taken from a plan made with the actions of all agents, so that it is
//! true.

use pddl::{Condition, Plan};
use planner::{Cancel, StopReason};

use crate::planning_snapshot::PlanningSnapshot;

/// Maximum number of conjuncts of a goal in which pairs of conjuncts that exclude each other are
/// searched for. For a goal with more conjuncts, no pair is tested.
const PARTS_MAX: usize = 6;

/// Result of planning with the actions of all agents.
pub(crate) enum JointPlanning {
    /// A plan in which several agents act.
    Plan(Plan),
    /// Planning has proved that no plan exists.
    NoPlan,
    /// Planning reached its limits without a plan and without a proof that no plan exists.
    Undecided,
}

impl JointPlanning {
    pub(crate) fn of(
        known: &PlanningSnapshot,
        parts: &[Condition],
        cancel: &Cancel,
    ) -> JointPlanning {
        match known.plan_for(parts, cancel) {
            Some((Some(plan), _)) => JointPlanning::Plan(plan),
            Some((None, StopReason::Unsolvable { .. })) => JointPlanning::NoPlan,
            _ => JointPlanning::Undecided,
        }
    }
}

/// Returns the reason, as text for a person, why no agent proposes a plan for the conjuncts in
/// `names`, although each conjunct can be reached in the delete relaxation (planning as if no
/// action undid another). `parts` are all conjuncts of the goal.
pub(crate) fn reason(
    known: &PlanningSnapshot,
    parts: &[Condition],
    names: &str,
    cancel: &Cancel,
) -> String {
    match JointPlanning::of(known, parts, cancel) {
        JointPlanning::Plan(plan) => {
            let centralized = "let one planner plan for all (`mode centralized`)";
            let (actors, steps) = (actors(&plan), plan.steps.len());
            match actors.as_slice() {
                [one] => format!(
                    "{one} reaches it in {steps} steps, and does not propose them: {centralized}"
                ),
                several => format!(
                    "no agent reaches {names} by itself; {} do together, in {steps} steps: \
                     {centralized}",
                    several.join(" and ")
                ),
            }
        }
        JointPlanning::NoPlan => {
            let exclusion = exclusion(known, parts, cancel);
            exclusion.unwrap_or_else(|| format!("proven: no plan reaches {names}"))
        }
        JointPlanning::Undecided => format!(
            "no agent reaches {names} by itself; whether several could together was not found out \
             within the bounds of the search"
        ),
    }
}

/// Returns the agents that act in `plan`.
fn actors(plan: &Plan) -> Vec<String> {
    let mut actors: Vec<String> = Vec::new();
    for actor in plan.steps.iter().filter_map(|step| step.arguments.first()) {
        let actor = format!("`{actor}`");
        if !actors.contains(&actor) {
            actors.push(actor);
        }
    }
    actors
}

/// Returns a sentence about two conjuncts that exclude each other; `None` if no such pair is found,
/// or if there are more than [`PARTS_MAX`] conjuncts.
fn exclusion(known: &PlanningSnapshot, parts: &[Condition], cancel: &Cancel) -> Option<String> {
    if parts.len() > PARTS_MAX {
        return None;
    }
    for (place, one) in parts.iter().enumerate() {
        for other in &parts[place + 1..] {
            let pair = [one.clone(), other.clone()];
            if matches!(JointPlanning::of(known, &pair, cancel), JointPlanning::NoPlan) {
                return Some(format!(
                    "proven: no plan reaches both `{one}` and `{other}`: they exclude each other"
                ));
            }
        }
    }
    None
}
