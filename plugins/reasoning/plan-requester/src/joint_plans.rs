//! Joint plans: plans in which several agents act, made with the actions of all agents. Splits a
//! joint plan by agent, says what each agent does for another, and explains why there is no joint
//! plan. All functions in this module are pure.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use acl::content::{JointPlanPart, PartStep};
use acl::fnv::Fnv64;
use pddl::{Condition, InitElement, Name, Plan};
use planner::{Cancel, StopReason, World};

use crate::explanations::listed;
use crate::planning_snapshot::PlanningSnapshot;

/// Maximum number of conjuncts of a goal in which pairs of conjuncts that exclude each other are
/// searched for. For a goal with more conjuncts, no pair is tested.
const PARTS_MAX: usize = 6;

/// Maximum number of steps of a joint plan of which the explanation says which agent acts for which.
/// The work grows with the square of this number; the limit takes some tens of milliseconds.
const EXPLAINED_STEPS_MAX: usize = 200;

/// Maximum number of agents that a reason names as those that were planned with; the others are
/// counted. A building has a hundred agents.
const MEMBERS_NAMED_MAX: usize = 12;

/// A valid plan in which several agents act.
pub(crate) struct JointPlan {
    pub(crate) plan: Plan,
    pub(crate) cost: f64,
    pub(crate) digest: String,
    /// The part of each agent that acts in the plan.
    pub(crate) parts: BTreeMap<AgentId, JointPlanPart>,
    /// Sentences that say which agent acts for which, and which actions take several.
    helps: Vec<String>,
}

// === impl JointPlan ===

impl JointPlan {
    /// Validates a plan, and splits it by agent.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if the plan does not reach the goal.
    pub(crate) fn of(
        known: &PlanningSnapshot,
        plan: Plan,
        wanted: &Condition,
    ) -> Result<JointPlan, String> {
        let cost = known.validate(&plan, wanted)?;
        let text = known.outside(&plan).to_string();
        let digest = format!("{:016x}", Fnv64::default().with(text.as_bytes()).value());
        let parts = parts(known, &plan, &digest)?;
        let mut helps = match plan.steps.len() {
            0..=EXPLAINED_STEPS_MAX => helps(known, &plan)?,
            _ => Vec::new(),
        };
        helps.extend(joint_actions(known, &plan));
        Ok(JointPlan { plan, cost, digest, parts, helps })
    }

    /// Returns, as text for a person, why a joint plan is made, and what each agent does for another.
    /// `why` is the reason why no agent and no set of bids suffices.
    pub(crate) fn describe(&self, why: &str) -> String {
        let agents: Vec<String> = self.parts.keys().map(|agent| format!("`{agent}`")).collect();
        let together = match agents.as_slice() {
            [one] => format!("{one} does it in a plan that it did not propose"),
            several => format!("{} do it together", several.join(" and ")),
        };
        match self.helps.is_empty() {
            true => format!("{why}; {together}"),
            false => format!("{why}; {together}: {}", listed(self.helps.clone(), "; ")),
        }
    }
}

/// Splits a plan by agent: its own steps, and in between what the steps of others change.
fn parts(
    known: &PlanningSnapshot,
    plan: &Plan,
    digest: &str,
) -> Result<BTreeMap<AgentId, JointPlanPart>, String> {
    let mut now = fresh(known)?;
    let start = now.clone();
    let public = known.public_predicates();
    let outside = known.outside(plan);
    // For each agent: its part so far, and the state after its last step.
    let mut parts: BTreeMap<AgentId, (Vec<PartStep>, World)> = BTreeMap::new();
    for (step, told) in plan.steps.iter().zip(&outside.steps) {
        let agents = known.actors(step);
        if agents.is_empty() {
            return Err(format!("no agent acts in `{told}`"));
        }
        let before = now.clone();
        now.apply(step).map_err(|fault| fault.to_string())?;
        for agent in agents {
            let (part, since) = parts.entry(agent).or_insert_with(|| (Vec::new(), start.clone()));
            let changes = describe_changes(since, &before, &public);
            part.extend(changes.map(PartStep::Others));
            part.push(PartStep::Own(told.to_string()));
            since.clone_from(&now);
        }
    }
    let part = |(agent, (steps, _))| (agent, JointPlanPart { digest: digest.to_owned(), steps });
    Ok(parts.into_iter().map(part).collect())
}

/// Returns the public changes from one state to another as PDDL; `None` if there are none.
fn describe_changes(from: &World, to: &World, public: &BTreeSet<&Name>) -> Option<String> {
    let is_public = |change: &InitElement| match change {
        InitElement::Atom(atom) | InitElement::Not(atom) => public.contains(&atom.predicate),
        _ => true,
    };
    let changes = from.changes_to(to).into_iter().filter(is_public);
    let texts: Vec<String> = changes.map(|change| change.to_string()).collect();
    (!texts.is_empty()).then(|| texts.join(" "))
}

/// Returns the state in which plans begin, with a renewed limit of work.
fn fresh(known: &PlanningSnapshot) -> Result<World, String> {
    let world = known.world()?;
    world.renew_work();
    Ok(world.clone())
}

// === which agent acts for which ===

/// Returns a sentence for each agent without which another agent could not do its steps: the step of
/// the first agent that makes the difference, and the step of the other agent.
fn helps(known: &PlanningSnapshot, plan: &Plan) -> Result<Vec<String>, String> {
    let start = fresh(known)?;
    let outside = known.outside(plan);
    let mut agents: Vec<AgentId> = Vec::new();
    for agent in plan.steps.iter().flat_map(|step| known.actors(step)) {
        if !agents.contains(&agent) {
            agents.push(agent);
        }
    }
    let mut sentences = Vec::new();
    for agent in agents {
        start.renew_work();
        let is_own = |step: usize| known.actors(&plan.steps[step]).contains(&agent);
        // The first step of another agent that fails if this agent does nothing.
        let Some(helped) = failing_without(&start, plan, |step| !is_own(step)) else { continue };
        let others = known.actors(&plan.steps[helped]);
        let others: Vec<String> = others.iter().map(|other| format!("`{other}`")).collect();
        let own = (0..helped).filter(|step| is_own(*step)).rev();
        let is_needed = |from: &usize| {
            let failing = failing_without(&start, plan, |step| !is_own(step) || step < *from);
            failing.is_some_and(|failing| failing <= helped)
        };
        if let Some(help) = { own }.find(is_needed) {
            let (help, helped) = (&outside.steps[help], &outside.steps[helped]);
            let others = others.join(" and ");
            sentences.push(format!("`{agent}` does `{help}` so that {others} can `{helped}`"));
        }
    }
    Ok(sentences)
}

/// Returns a sentence for each action of a plan in which several agents act at the same time.
fn joint_actions(known: &PlanningSnapshot, plan: &Plan) -> Vec<String> {
    let mut named: BTreeSet<&Name> = BTreeSet::new();
    let mut sentences = Vec::new();
    for (step, told) in plan.steps.iter().zip(&known.outside(plan).steps) {
        let agents = known.actors(step).len();
        if agents > 1 && named.insert(&step.action) {
            let all = if agents == 2 { "both" } else { "all of them" };
            sentences.push(format!("`{told}` takes {all} at the same time"));
        }
    }
    sentences
}

/// Returns the first step that cannot be applied if only some steps of a plan are carried out; `None`
/// if all of these can.
fn failing_without(start: &World, plan: &Plan, is_done: impl Fn(usize) -> bool) -> Option<usize> {
    let mut world = start.clone();
    (0..plan.steps.len())
        .filter(|step| is_done(*step))
        .find(|step| world.apply(&plan.steps[*step]).is_err())
}

// === why there is no joint plan ===

/// Result of planning with the actions of all agents.
enum JointPlanning {
    /// A plan in which several agents act.
    Plan(Plan),
    /// Planning has proved that no plan exists.
    NoPlan,
    /// Planning reached its limits without a plan and without a proof that no plan exists.
    Undecided,
}

impl JointPlanning {
    fn of(known: &PlanningSnapshot, parts: &[Condition], cancel: &Cancel) -> JointPlanning {
        match known.plan_for(parts, cancel) {
            Some((Some(plan), _)) => JointPlanning::Plan(plan),
            Some((None, StopReason::Unsolvable { .. })) => JointPlanning::NoPlan,
            _ => JointPlanning::Undecided,
        }
    }
}

/// Returns the reason, as text for a person, why no joint plan was made for the conjuncts in
/// `names`, although each conjunct can be reached in the delete relaxation (planning as if no
/// action undid another). `parts` are all conjuncts of the goal, and `declined` says which agents
/// have declined their parts.
pub(crate) fn reason(
    known: &PlanningSnapshot,
    parts: &[Condition],
    (names, declined): (&str, &[String]),
    cancel: &Cancel,
) -> String {
    match JointPlanning::of(known, parts, cancel) {
        JointPlanning::Plan(plan) => {
            let actors: BTreeSet<AgentId> =
                plan.steps.iter().flat_map(|step| known.actors(step)).collect();
            let steps = plan.steps.len();
            let actors: Vec<String> = actors.iter().map(|agent| format!("`{agent}`")).collect();
            let how = match actors.as_slice() {
                [one] => format!("{one} reaches it in {steps} steps"),
                several => format!(
                    "no agent reaches {names} by itself; {} do together, in {steps} steps",
                    several.join(" and ")
                ),
            };
            format!("{how}, and not now: {}", hindrance(known, declined))
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

/// Returns why a joint plan that exists cannot be carried out now.
fn hindrance(known: &PlanningSnapshot, declined: &[String]) -> String {
    let spared: Vec<String> = known.spared.iter().map(|agent| format!("`{agent}`")).collect();
    if !declined.is_empty() {
        listed(declined.to_vec(), "; ")
    } else if !spared.is_empty() {
        format!("other goals use {}", listed(spared, ", "))
    } else {
        "it was not found in time, or it would undo what is kept".to_owned()
    }
}

/// Returns the agents with the actions that were planned with, in parentheses; an empty string if
/// there are none.
pub(crate) fn members(known: &PlanningSnapshot) -> String {
    let mut agents: Vec<String> =
        known.all_offers.keys().map(|agent| format!("`{agent}`")).collect();
    let rest = agents.len().saturating_sub(MEMBERS_NAMED_MAX);
    agents.truncate(MEMBERS_NAMED_MAX);
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    match agents.is_empty() {
        true => String::new(),
        false => format!(" (planned with the actions of {}{more})", agents.join(", ")),
    }
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
