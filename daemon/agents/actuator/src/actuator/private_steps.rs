//! How an actuator with private parts (`privacy = "agents"`) does what it is asked for: others ask for
//! actions that it has announced, and it plans and carries out its private steps between them.
//!
//! - The private steps of an action are planned when the action is requested, from the state of the
//!   device at that moment. If the agent is committed to a part of a joint plan, they are planned for
//!   the rest of the part.
//! - A proposal or an agreement is given only if there are private steps for it now. If it is proved
//!   that there are none, the agent announces more of its model, so that the next plan is better.
//! - Requesters are told whether an action is done, not how; the daemon's own log has the rest.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use acl::content::{
    ActionToken, Bid, CallForProposals, JointPlanPart, Outcome, PartStep, Proposal, Reason, Report,
};
use agent::{Context, Participation};
use capability::DomainSnapshot;
use pddl::{InitElement, PlanStep};
use planner::{Cancel, Replanner};
use skeleton::{ConfidentialModel, FillRefusal, FilledPart, KnownWorld};

use super::{Actuator, RunningCommand};
use crate::agreeing::{DeclinedPart, agree};
use crate::bidding::{bid, bounded};
use crate::device::{Description, MethodCall, MethodFailure, MethodResult, OwnFact};

/// Time limit of planning the private steps of a requested action. The searches take milliseconds; the
/// requester waits for the whole action much longer.
const PLANNED_WITHIN: Duration = Duration::from_secs(5);

/// A call for proposals that an actuator declines.
pub(super) struct DeclinedCall {
    /// The reason, as text for a person. It names nothing private.
    pub(super) why: String,
    pub(super) reason: Reason,
    /// The refusal of a part or a proposal that there are no private steps for.
    pub(super) refusal: Option<FillRefusal>,
}

/// The private model of a device, and its state at one moment.
pub(super) struct PrivatePart {
    model: Arc<ConfidentialModel>,
    facts: Vec<InitElement>,
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

impl From<FillRefusal> for DeclinedCall {
    fn from(refusal: FillRefusal) -> DeclinedCall {
        let (why, reason) = (refusal.why.clone(), Reason::Incapable);
        DeclinedCall { why, reason, refusal: Some(refusal) }
    }
}

/// Answers a call for proposals to `agent` in its local domain.
///
/// # Errors
///
/// Returns the reason if there is nothing to propose or to agree to.
pub(super) fn answer(
    (call, agent): (&CallForProposals, &AgentId),
    local: DomainSnapshot,
    private: Option<PrivatePart>,
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

/// Returns what a requester is told of the end of `action`, which has private steps. What a device says
/// of it can name what is private.
pub(super) fn public_detail(action: &str, outcome: &Result<MethodResult, MethodFailure>) -> String {
    match outcome {
        Ok(_) => format!("has done `{action}`"),
        Err(
            failure @ (MethodFailure::Forbidden(_)
            | MethodFailure::Unanswered(_)
            | MethodFailure::TimedOut(_)),
        ) => format!("failed to {failure}"),
        Err(_) => {
            format!("failed to do `{action}`; the reason is private, and in the log of its daemon")
        }
    }
}

// === impl PrivatePart ===

impl PrivatePart {
    fn fill(
        &self,
        part: &[PartStep],
        local: &DomainSnapshot,
        cancel: &Cancel,
    ) -> Result<FilledPart, FillRefusal> {
        let (domain, problem) = (&local.domain, &local.problem);
        let known = KnownWorld { domain, problem, own_facts: &self.facts };
        self.model.fill(part, &known, &bounded(), cancel)
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

    /// Returns the private steps of the first step of `part`, and that step. If there are none for the
    /// whole part, because the state is not as it was when the agent agreed, then for the step alone.
    fn first_group(
        &self,
        part: &[PartStep],
        local: &DomainSnapshot,
        cancel: &Cancel,
    ) -> Result<Vec<PlanStep>, FillRefusal> {
        let filled = match self.fill(part, local, cancel) {
            Err(_) if part.len() > 1 => self.fill(&part[..1], local, cancel)?,
            filled => filled?,
        };
        Ok(filled.steps.into_iter().take(2).flatten().collect())
    }
}

/// Returns the steps of a plan as a part; `None` if other agents act in it.
fn own_part(plan: &str, agent: &AgentId) -> Option<Vec<PartStep>> {
    let plan = pddl::parse_plan(plan).into_result().ok()?;
    let is_own = |step: &PlanStep| step.arguments.first().is_some_and(|it| *it == *agent.as_str());
    let own = |step: &PlanStep| is_own(step).then(|| PartStep::Own(step.to_string()));
    plan.steps.iter().map(own).collect()
}

/// Returns the call that carries out a step of the device's own model, and its time limit.
///
/// # Errors
///
/// Returns the reason, as text for a person, if the device has no method for it.
fn call_of(step: &PlanStep, described: &Description) -> Result<(MethodCall, Duration), String> {
    let Description { model, methods } = described;
    let schema = model.actions.iter().find(|schema| schema.name == step.action);
    let method = methods.get(step.action.as_str());
    let (Some(schema), Some(method)) = (schema, method) else {
        return Err(format!("do `{}`, which the device does not offer now", step.action));
    };
    let values: BTreeMap<&str, &str> = schema
        .all_parameters()
        .map(|parameter| parameter.name.as_str())
        .zip(step.arguments.iter().map(|argument| argument.as_str()))
        .collect();
    let arguments = method.bind(&values)?;
    let call = MethodCall { action: step.to_string(), method: method.method.clone(), arguments };
    Ok((call, method.timeout.0))
}

impl Actuator {
    /// Returns the model of the device if it has private parts.
    pub(super) fn private_model(&self) -> Option<Arc<ConfidentialModel>> {
        self.confidentiality.as_ref()?.private_model(&self.device.describe().model)
    }

    pub(super) fn private_part(&self) -> Option<PrivatePart> {
        let model = self.private_model()?;
        let facts = self.device.facts().into_iter().map(|fact| fact.fact).collect();
        Some(PrivatePart { model, facts })
    }

    /// Returns the facts of the device that the actuator announces.
    pub(super) fn announced_facts(&self) -> Vec<OwnFact> {
        let facts = self.device.facts();
        match &self.confidentiality {
            Some(confidentiality) => confidentiality.announced_facts(facts),
            None => facts,
        }
    }

    pub(super) fn announced_observations(&self, observed: Vec<InitElement>) -> Vec<InitElement> {
        match &self.confidentiality {
            Some(confidentiality) => confidentiality.announced_observations(observed),
            None => observed,
        }
    }

    /// Announces more of the model if the refusal is proved. Returns whether it does.
    pub(super) fn announce_more(&mut self, refusal: &FillRefusal, ctx: &mut Context<Self>) -> bool {
        let confidentiality = self.confidentiality.as_ref();
        let is_sharper = confidentiality.is_some_and(|it| it.sharpen(refusal));
        if is_sharper {
            tracing::info!(agent = %ctx.id(), why = refusal.why, "announces more of its model");
            self.send_heartbeat(ctx);
        }
        is_sharper
    }

    /// Agrees to carry out an announced action, and begins to plan its private steps.
    pub(super) fn begin_with_private_steps(
        &mut self,
        participation: &Participation,
        action: String,
        token: ActionToken,
        ctx: &mut Context<Self>,
    ) {
        let recorded = self.agree_to_act(participation, &token, ctx);
        let work = ctx.run(recorded, |actuator: &mut Self, recorded, ctx| match recorded {
            Ok(()) => actuator.plan_private_steps(ctx),
            Err(failure) => actuator.command_ended(Err(failure), ctx),
        });
        self.running_command = Some(RunningCommand {
            token,
            action,
            subscribers: vec![participation.clone()],
            call: None,
            further_calls: VecDeque::new(),
            _work: work,
        });
    }

    fn plan_private_steps(&mut self, ctx: &mut Context<Self>) {
        let Some(private) = self.private_part() else {
            let changed = "do it: what the device offers has changed".to_owned();
            return self.command_ended(Err(MethodFailure::Driver(changed)), ctx);
        };
        let Some(running) = &self.running_command else { return };
        let conversation = &running.token.conversation;
        let held = self.commitment.as_ref().filter(|held| held.is_for(conversation));
        let mut part =
            held.map(|held| held.part_from(&running.action).to_vec()).unwrap_or_default();
        if part.is_empty() {
            part.push(PartStep::Own(running.action.clone()));
        }
        let cancel = Cancel::new();
        let deadline = cancel.clone();
        ctx.after(PLANNED_WITHIN, move |_: &mut Self, _| deadline.set());
        let (local, cache) = (self.local_domain(ctx), Arc::clone(&self.bid_cache));
        let work = ctx.compute(
            move || {
                let mut kept = cache.try_lock().ok();
                let mut afresh = Default::default();
                let composition = kept.as_mut().map_or(&mut afresh, |kept| &mut kept.composition);
                private.first_group(&part, &local(composition), &cancel)
            },
            |actuator: &mut Self, planned, ctx| actuator.private_steps_planned(planned, ctx),
        );
        if let Some(running) = &mut self.running_command {
            running._work = work;
        }
    }

    fn private_steps_planned(
        &mut self,
        planned: Result<Vec<PlanStep>, FillRefusal>,
        ctx: &mut Context<Self>,
    ) {
        let steps = match planned {
            Ok(steps) => steps,
            Err(refusal) => {
                self.announce_more(&refusal, ctx);
                let detail = refusal.private_detail.as_deref().unwrap_or_default();
                tracing::warn!(agent = %ctx.id(), why = refusal.why, detail, "no private steps");
                let Some(running) = self.running_command.take() else { return };
                let RunningCommand { token, action, subscribers, .. } = running;
                // The state is not as the plan assumed, or the announced model was not sharp enough.
                let mut report = Report::new(Outcome::Failed, refusal.why);
                (report.declined, report.action) = (Some(Reason::Conflict), Some(action));
                return self.conclude(token, subscribers, report, ctx);
            }
        };
        let described = self.device.describe();
        let calls: Result<_, String> = steps.iter().map(|step| call_of(step, &described)).collect();
        match (calls, &mut self.running_command) {
            (Ok(calls), Some(running)) => {
                running.further_calls = calls;
                self.next_call(ctx);
            }
            (Err(why), _) => self.command_ended(Err(MethodFailure::Driver(why)), ctx),
            (Ok(_), None) => (),
        }
    }

    /// Starts the next call of the running action.
    pub(super) fn next_call(&mut self, ctx: &mut Context<Self>) {
        let next = self.running_command.as_mut().and_then(|it| it.further_calls.pop_front());
        let Some((call, timeout)) = next else { return };
        if let Some(stop) = self.stop_against(&call.action, ctx.id()) {
            let why = format!("go on: {}", super::stopping::described(&stop));
            return self.command_ended(Err(MethodFailure::Driver(why)), ctx);
        }
        if let Some(refusal) = self.device.check_call(&call) {
            let why = format!("do `{}`: {}", call.action, refusal.detail);
            return self.command_ended(Err(MethodFailure::Driver(why)), ctx);
        }
        tracing::debug!(agent = %ctx.id(), step = call.action, "a step of a private part");
        let work = self.start_call(&call, timeout, Box::pin(std::future::ready(Ok(()))), ctx);
        if let Some(running) = &mut self.running_command {
            (running.call, running._work) = (Some(call), work);
        }
    }
}
