//! Private planning of an actuator (`privacy = "agents"`): which proposals, agreements and requested
//! actions its private steps allow now.
//!
//! - A proposal or an agreement is given only if there are private steps for it now.
//! - If it is proved that there are none, the agent can announce more of its model, so that the next plan
//!   is better.

use std::sync::Arc;

use acl::AgentId;
use acl::content::{Bid, CallForProposals, JointPlanPart, PartStep, Proposal, Reason};
use capability::DomainSnapshot;
use pddl::{InitElement, PlanStep};
use planner::{Cancel, Replanner};
use skeleton::{ConfidentialModel, FillRefusal, FilledPart, KnownWorld};

use crate::agreeing::{DeclinedPart, agree, follow};
use crate::bidding::{bid, bounded};

/// A refusal of private steps, with the model for which it is proved.
pub(crate) type ProvedFor = (FillRefusal, Arc<ConfidentialModel>);

/// A reason why a requested action is not begun or not continued.
pub(crate) enum NoSteps {
    /// The action itself is not possible in the state that is known to all.
    Declined(DeclinedPart),
    Refused(ProvedFor),
}

/// The private steps up to an action and after it.
pub(crate) struct PrivateSteps {
    pub(crate) steps: Vec<PlanStep>,
    /// Position of the action itself.
    pub(crate) position: usize,
}

/// A call for proposals that an actuator declines.
pub(crate) struct DeclinedCall {
    /// The reason, as text for a person. It names nothing private.
    pub(crate) why: String,
    pub(crate) reason: Reason,
    /// The refusal of a part or a proposal that there are no private steps for.
    pub(crate) refusal: Option<ProvedFor>,
}

/// Plans private steps with the model of a device and its state at one moment.
pub(crate) struct PrivatePlanner {
    pub(crate) model: Arc<ConfidentialModel>,
    pub(crate) facts: Vec<InitElement>,
}

impl From<String> for DeclinedCall {
    fn from(why: String) -> DeclinedCall {
        DeclinedCall { why, reason: Reason::Incapable, refusal: None }
    }
}

impl From<DeclinedPart> for DeclinedCall {
    fn from(declined: DeclinedPart) -> DeclinedCall {
        match declined {
            DeclinedPart::NotNow(why) => {
                DeclinedCall { why, reason: Reason::Conflict, refusal: None }
            }
            DeclinedPart::Unusable(why) => why.into(),
        }
    }
}

impl From<ProvedFor> for DeclinedCall {
    fn from(refusal: ProvedFor) -> DeclinedCall {
        let (why, reason) = (refusal.0.why.clone(), Reason::Incapable);
        DeclinedCall { why, reason, refusal: Some(refusal) }
    }
}

/// Answers a call for proposals to `agent` in its local domain.
///
/// # Errors
///
/// Returns the reason if there is nothing to propose or to agree to.
pub(crate) fn answer(
    (call, agent): (&CallForProposals, &AgentId),
    local: DomainSnapshot,
    private: Option<PrivatePlanner>,
    replanner: &mut Replanner,
    cancel: &Cancel,
) -> Result<Bid, DeclinedCall> {
    let Some(private) = private else {
        return Ok(match &call.part {
            Some(part) => agree(&local, call, part, agent, cancel)?,
            None => bid(local, call, replanner, cancel)?,
        });
    };
    match &call.part {
        Some(part) => {
            let agreement = agree(&local, call, part, agent, cancel)?;
            private.agree(agreement, part, &local, cancel)
        }
        None => {
            let bid = bid(local.clone(), call, replanner, cancel)?;
            private.propose(bid, &local, agent, cancel)
        }
    }
}

// === impl PrivatePlanner ===

impl PrivatePlanner {
    fn fill(
        &self,
        part: &[PartStep],
        local: &DomainSnapshot,
        cancel: &Cancel,
    ) -> Result<FilledPart, ProvedFor> {
        let (domain, problem, knowledge) = (&local.domain, &local.problem, local.knowledge());
        let known = KnownWorld { domain, problem, knowledge, own_facts: &self.facts };
        let filled = self.model.fill(part, &known, &bounded(), cancel);
        filled.map_err(|refusal| (refusal, Arc::clone(&self.model)))
    }

    /// Returns the agreement to a part if there are private steps for it. Its cost is that of all
    /// steps.
    fn agree(
        &self,
        mut agreement: Bid,
        part: &JointPlanPart,
        local: &DomainSnapshot,
        cancel: &Cancel,
    ) -> Result<Bid, DeclinedCall> {
        let filled = self.fill(&part.steps, local, cancel)?;
        agreement.proposals.iter_mut().for_each(|proposal| proposal.cost = filled.cost);
        Ok(agreement)
    }

    /// Returns a bid with those proposals that there are private steps for. Proposals in which carried
    /// agents act, too, are checked when their steps are requested.
    fn propose(
        &self,
        mut bid: Bid,
        local: &DomainSnapshot,
        agent: &AgentId,
        cancel: &Cancel,
    ) -> Result<Bid, DeclinedCall> {
        let mut refused = None;
        let mut is_possible = |proposal: &mut Proposal| {
            let Some(part) = own_part(&proposal.plan, agent) else { return true };
            match self.fill(&part, local, cancel) {
                Ok(filled) => {
                    proposal.cost = filled.cost;
                    true
                }
                Err(refusal) => {
                    refused = Some(refusal);
                    false
                }
            }
        };
        bid.proposals.retain_mut(&mut is_possible);
        match refused {
            Some(refusal) if bid.proposals.is_empty() => Err(refusal.into()),
            _ => Ok(bid),
        }
    }

    /// Returns the private steps for the first step of `part`, and that step. If there are none for the
    /// whole part, because the state is not as it was when the agent agreed, then for the step alone.
    /// `has_begun` says whether private steps have been carried out for it: then the facts of the
    /// announced model are those in the midst of them, and prove nothing, and what others change for
    /// the step has happened.
    pub(crate) fn first_steps(
        &self,
        part: &[PartStep],
        has_begun: bool,
        local: &DomainSnapshot,
        cancel: &Cancel,
    ) -> Result<PrivateSteps, NoSteps> {
        let is_own = |element: &PartStep| matches!(element, PartStep::Own(_));
        let position = part.iter().position(is_own).unwrap_or_default();
        let (before, rest) = part.split_at(position);
        let (part, action) = match has_begun {
            true => (rest, &rest[..1]),
            false => (part, &part[..=before.len()]),
        };
        if !has_begun {
            let agent = self.model.own().agent.as_str();
            follow(local, action, agent, cancel).map_err(NoSteps::Declined)?;
        }
        let filled = match self.fill(part, local, cancel) {
            Err(_) if part.len() > action.len() => self.fill(action, local, cancel),
            filled => filled,
        };
        let FilledPart { steps, positions, .. } = filled.map_err(|refusal| match has_begun {
            true => NoSteps::Declined(DeclinedPart::NotNow(refusal.0.why)),
            false => NoSteps::Refused(refusal),
        })?;
        let before = steps.first().map_or(0, Vec::len);
        let position = before + positions.first().copied().unwrap_or_default();
        Ok(PrivateSteps { steps: steps.into_iter().take(2).flatten().collect(), position })
    }
}

/// Returns the steps of a plan as a part; `None` if other agents act in it.
fn own_part(plan: &str, agent: &AgentId) -> Option<Vec<PartStep>> {
    let plan = pddl::parse_plan(plan).into_result().ok()?;
    let is_own = |step: &PlanStep| step.arguments.first().is_some_and(|it| *it == *agent.as_str());
    let own = |step: &PlanStep| is_own(step).then(|| PartStep::Own(step.to_string()));
    plan.steps.iter().map(own).collect()
}
