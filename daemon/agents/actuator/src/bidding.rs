//! An actuator's bid in answer to a call for proposals: the plans for those conjuncts that the
//! actuator can reach alone or with the agents that it carries, made in the actuator's own local
//! domain.
//!
//! A bid has one alternative per conjunct, and one for all reachable conjuncts together. No two
//! alternatives can be accepted at once, because each of them starts from the present state.

use acl::content::{Bid, CallForProposals, Proposal};
use capability::{DomainSnapshot, problem_digest};
use pddl::{Atom, Condition, InitElement, Plan, Problem};
use planner::{Budget, Cancel, Options, Replanner};

use crate::unchangeable::ChangeableSymbols;

const NOTHING: &str = "it reaches no part of the goal";

/// Plans for a call for proposals and returns the bid. Reuses the data that `replanner` keeps from
/// the last call.
///
/// # Errors
///
/// Returns an error with the reason, as text for a person, if there is nothing to propose.
pub(crate) fn bid(
    mut snapshot: DomainSnapshot,
    call: &CallForProposals,
    replanner: &mut Replanner,
    cancel: &Cancel,
) -> Result<Bid, String> {
    let mut conjuncts = readable(call)?;
    // A single conjunct is planned for without a reachability proof, which would only repeat work
    // of the planner.
    if conjuncts.len() > 1 {
        let changes = ChangeableSymbols::of(&snapshot.domain, &snapshot.problem);
        conjuncts.retain(|(_, condition)| changes.can_change(&snapshot.known_to_hold(condition)));
        conjuncts = drop_unreachable(&snapshot, conjuncts, replanner, cancel);
    }
    if conjuncts.is_empty() {
        return Err(NOTHING.to_owned());
    }
    if let [conjunct] = conjuncts.as_slice() {
        // No other conjunct is planned for, so the problem need not be copied.
        let mut problem = take_contents(&mut snapshot.problem);
        let proposal = propose(&snapshot, &mut problem, &[conjunct], replanner, cancel);
        let proposals = vec![proposal.ok_or_else(|| NOTHING.to_owned())?];
        let domain_digest = problem_digest(snapshot.digest(), &problem);
        return Ok(Bid { proposals, domain_digest, agreed: None });
    }
    let mut propose = |conjuncts: &[&(String, Condition)]| {
        propose(&snapshot, &mut snapshot.problem.clone(), conjuncts, replanner, cancel)
    };
    let mut proposals = Vec::new();
    if !call.together {
        for conjunct in &conjuncts {
            proposals.extend(propose(&[conjunct]));
        }
    }
    let reachable: Vec<_> = conjuncts
        .iter()
        .filter(|(text, _)| {
            call.together || proposals.iter().any(|proposal| proposal.covers.contains(text))
        })
        .collect();
    if call.together || reachable.len() > 1 {
        proposals.extend(propose(&reachable));
    }
    if proposals.is_empty() {
        return Err(NOTHING.to_owned());
    }
    let domain_digest = problem_digest(snapshot.digest(), &snapshot.problem);
    Ok(Bid { proposals, domain_digest, agreed: None })
}

/// Returns a problem with the objects and facts of `problem`, which are moved out of it.
fn take_contents(problem: &mut Problem) -> Problem {
    let (objects, init) = (std::mem::take(&mut problem.objects), std::mem::take(&mut problem.init));
    Problem { objects, init, ..problem.clone() }
}

fn readable(call: &CallForProposals) -> Result<Vec<(String, Condition)>, String> {
    let read = |text: &String| {
        let parsed = pddl::parse_condition(text).into_result();
        let condition = parsed.map_err(|diagnostics| {
            let first = diagnostics.first().map(ToString::to_string).unwrap_or_default();
            format!("`{text}`: {first}")
        })?;
        Ok((text.clone(), condition))
    };
    call.conjuncts.iter().map(read).collect()
}

/// Removes the conjuncts that are proved unreachable for this actuator, so that no plan is searched
/// for each of them. Each conjunct is given as its text and its parsed form. For example, a sensor
/// on a wall can reach one conjunct of a goal about a large building.
fn drop_unreachable(
    snapshot: &DomainSnapshot,
    conjuncts: Vec<(String, Condition)>,
    replanner: &mut Replanner,
    cancel: &Cancel,
) -> Vec<(String, Condition)> {
    let sure: Vec<_> =
        conjuncts.iter().map(|(_, condition)| snapshot.known_to_hold(condition)).collect();
    let conditions: Vec<_> = sure.iter().collect();
    let mut problem = snapshot.with_goal(&Condition::always(), None);
    remove_called_for(&mut problem, &conjuncts);
    let options = bounded();
    let proven =
        replanner.facts_out_of_reach(&snapshot.domain, &problem, &conditions, &options, cancel);
    // If a conjunct cannot be analysed, there is no proof, and each conjunct is planned for.
    let proven = proven.unwrap_or_default();
    let kept = conjuncts.into_iter().enumerate();
    kept.filter(|(position, _)| !proven.contains(position)).map(|(_, kept)| kept).collect()
}

/// Returns planner options that keep the planner within its share of this machine's memory.
pub(crate) fn bounded() -> Options {
    let memory_max_bytes = agent::computation_bytes_max();
    Options { budget: Budget { memory_max_bytes, ..Budget::default() }, ..Options::default() }
}

/// Returns a proposal that reaches these conjuncts together; `None` if there is no plan for them or
/// the plan is empty.
fn propose(
    snapshot: &DomainSnapshot,
    problem: &mut Problem,
    conjuncts: &[&(String, Condition)],
    replanner: &mut Replanner,
    cancel: &Cancel,
) -> Option<Proposal> {
    let conditions = conjuncts.iter().map(|(_, condition)| snapshot.known_to_hold(condition));
    problem.goal = Condition::And(conditions.collect());
    remove_called_for(problem, conjuncts.iter().copied());
    let planned = replanner.plan(&snapshot.domain, problem, &[], &bounded(), cancel);
    let plan = match planned {
        Ok(planned) => planned.outcome.plan?,
        Err(error) => {
            tracing::warn!(%error, "the local planner declines");
            return None;
        }
    };
    // The requester calls only for conjuncts that do not hold. An empty plan means that the local
    // state of this agent lacks the facts that make them false.
    if plan.steps.is_empty() {
        return None;
    }
    // The steps get the action names that the agents use, because the caller's composite domain has
    // other names.
    let outside =
        Plan { steps: plan.steps.iter().map(|step| snapshot.outside(step)).collect(), cost: None };
    Some(Proposal {
        covers: conjuncts.iter().map(|(text, _)| text.clone()).collect(),
        plan: outside.to_string(),
        cost: plan.cost.map_or(0.0, |cost| cost.0),
    })
}

/// Removes the conjuncts of a call for proposals from the facts of the problem. The sender of the
/// call has found that these conjuncts do not hold, so a fact to the contrary is out of date: it
/// may come from an agent that has just left.
fn remove_called_for<'c>(
    problem: &mut Problem,
    conjuncts: impl IntoIterator<Item = &'c (String, Condition)>,
) {
    let called_for: Vec<&Atom> = { conjuncts.into_iter() }
        .filter_map(|(_, condition)| match condition {
            Condition::Atom(atom) => Some(atom),
            _ => None,
        })
        .collect();
    let is_called_for = |element: &InitElement| matches!(element, InitElement::Atom(fact) if called_for.contains(&fact));
    problem.init.retain(|element| !is_called_for(element));
}
