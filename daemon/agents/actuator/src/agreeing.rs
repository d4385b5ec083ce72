//! The agreement of an actuator to its part of a joint plan (a plan in which several agents act).
//!
//! The actuator checks its own steps in its own local domain, from the state that it knows now. In
//! between it takes over what the call says that other agents change. So every step of a joint plan
//! is validated by the agent that carries it out, with its own facts.

use acl::AgentId;
use acl::content::{Bid, CallForProposals, JointPlanPart, PartStep, Proposal};
use capability::{DomainSnapshot, problem_digest};
use pddl::{Plan, PlanStep};
use planner::{Cancel, Fault, FaultReason, World};

/// Maximum number of elements of a part. The plans of the largest buildings have some hundred
/// steps.
const PART_STEPS_MAX: usize = 10_000;

/// Limit on the work of checking one part, in the validator's steps. Parts in the largest buildings
/// take some thousands; the limit is reached after half a second.
const CHECK_STEPS_MAX: u64 = 3_000_000;

/// A part of a joint plan that an actuator declines, for a reason that is text for a person.
pub(crate) enum DeclinedPart {
    /// A step of it is not possible in the state that the actuator knows.
    NotNow(String),
    /// Any other reason.
    Unusable(String),
}

impl From<String> for DeclinedPart {
    fn from(why: String) -> DeclinedPart {
        DeclinedPart::Unusable(why)
    }
}

/// Checks the part of a joint plan for the actuator `agent`. Returns the bid that agrees to it: its
/// only proposal consists of the actuator's own steps.
///
/// # Errors
///
/// Returns an error with the reason, as text for a person, if the actuator cannot do its part.
pub(crate) fn agree(
    snapshot: &DomainSnapshot,
    call: &CallForProposals,
    part: &JointPlanPart,
    agent: &AgentId,
    cancel: &Cancel,
) -> Result<Bid, DeclinedPart> {
    if part.steps.len() > PART_STEPS_MAX {
        return Err(format!("its part has more than {PART_STEPS_MAX} elements").into());
    }
    let (own, cost) = follow(snapshot, &part.steps, agent.as_str(), cancel)?;
    if own.is_empty() {
        return Err("its part has no step of its own".to_owned().into());
    }
    let plan = Plan { steps: own, cost: None }.to_string();
    let proposals = vec![Proposal { covers: call.conjuncts.clone(), plan, cost }];
    let domain_digest = problem_digest(snapshot.digest(), &snapshot.problem);
    Ok(Bid { proposals, domain_digest, agreed: Some(part.digest.clone()) })
}

/// Follows elements of a part of the actuator `agent` from the state that it knows. Returns its own steps
/// and their cost.
///
/// # Errors
///
/// Returns the reason if an element cannot be read, or a step is not possible.
pub(crate) fn follow(
    snapshot: &DomainSnapshot,
    steps: &[PartStep],
    agent: &str,
    cancel: &Cancel,
) -> Result<(Vec<PlanStep>, f64), DeclinedPart> {
    let world = World::initial(&snapshot.domain, &snapshot.problem).map_err(|diagnostics| {
        let first = diagnostics.first().map(ToString::to_string).unwrap_or_default();
        format!("its own state cannot be made: {first}")
    })?;
    let mut world = world.limit_work(CHECK_STEPS_MAX, Some(cancel));
    let mut own = Vec::new();
    for element in steps {
        match element {
            PartStep::Own(text) => {
                let step = read_own(text, snapshot, agent)?;
                // Each of the other agents of a joint action vouches for itself.
                world.take_changes(&snapshot.guards_of_partners(&step, agent));
                let applied = world.apply(&snapshot.inside(&step));
                applied.map_err(|fault| {
                    let why = format!("it cannot do `{step}`: {fault}");
                    match is_of_state(&fault) {
                        true => DeclinedPart::NotNow(why),
                        false => DeclinedPart::Unusable(why),
                    }
                })?;
                own.push(step);
            }
            PartStep::Others(text) => {
                let changes = pddl::parse_init_elements(text).into_result().map_err(|found| {
                    let first = found.first().map(ToString::to_string).unwrap_or_default();
                    format!("what others change cannot be read: {first}")
                })?;
                world.take_changes(&changes);
            }
        }
    }
    Ok((own, world.cost().unwrap_or(0.0)))
}

/// Whether a step is not possible because of the state, and not because of the step.
fn is_of_state(fault: &Fault) -> bool {
    matches!(fault.reason, FaultReason::Precondition(_) | FaultReason::Undefined(_))
}

/// Parses a step of the actuator `agent`.
///
/// # Errors
///
/// Returns an error, as text for a person, if the step cannot be parsed or another agent acts in
/// it.
fn read_own(text: &str, snapshot: &DomainSnapshot, agent: &str) -> Result<PlanStep, String> {
    let step = pddl::parse_step(text).into_result().map_err(|found| {
        let first = found.first().map(ToString::to_string).unwrap_or_default();
        format!("`{text}` is no step: {first}")
    })?;
    match snapshot.actors(&step, agent).iter().any(|actor| *actor == *agent) {
        true => Ok(step),
        false => Err(format!("`{step}` is no step of its own")),
    }
}
