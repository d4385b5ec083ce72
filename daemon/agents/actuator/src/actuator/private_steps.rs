//! How an actuator with private parts (`privacy = "agents"`) does what it is asked for: others ask for
//! actions that it has announced, and it plans and carries out its private steps between them.
//!
//! - The private steps of an action are planned when the action is requested, and again after each of
//!   them until the action itself is done, from the state of the device and of the world at that
//!   moment. If the agent is committed to a part of a joint plan, they are planned for the rest of the
//!   part.
//! - People who have to allow the action are asked before its first private step.
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
use pddl::{InitElement, Name, PlanStep};
use planner::{Cancel, Replanner, World};
use skeleton::{ConfidentialModel, FillRefusal, FilledPart, KnownWorld};

use super::{Actuator, RunningCommand};
use crate::agreeing::{CHECK_STEPS_MAX, DeclinedPart, agree, is_of_state};
use crate::bidding::{bid, bounded};
use crate::device::{Description, MethodCall, MethodFailure, MethodResult, OwnFact};

/// Time limit of planning the private steps of a requested action. The searches take milliseconds; the
/// requester waits for the whole action much longer.
const PLANNED_WITHIN: Duration = Duration::from_secs(5);

/// Maximum number of calls of the device for one requested action. The longest plans of one agent have
/// some hundred steps; more calls mean that the steps do not bring the action nearer.
const CALLS_MAX: u32 = 500;

/// How long an action waits for the news of what another agent has done for it. A requester asks for the
/// next step of a plan at the moment at which the former one is confirmed; the heartbeat with its effect
/// may take another way, of some milliseconds on a network of a building.
const KNOWN_WITHIN: Duration = Duration::from_millis(250);

/// How far a requested action with private steps is.
#[derive(Default)]
pub(super) struct PrivateProgress {
    /// Number of the planned calls up to the action itself; 0 when that is done.
    calls_to_action: usize,
    /// Number of calls that have begun.
    begun: u32,
    /// Whether the action has waited for news of other agents.
    has_waited: bool,
    /// The search for private steps that is running, if any.
    planning: Option<CancelledOnDrop>,
}

/// Cancels a computation when it is dropped.
struct CancelledOnDrop(Cancel);

impl Drop for CancelledOnDrop {
    fn drop(&mut self) {
        self.0.set();
    }
}

/// A refusal of private steps, with the model for which it is proved.
pub(super) type ProvedFor = (FillRefusal, Arc<ConfidentialModel>);

/// A reason why a requested action is not begun or not continued.
enum NoSteps {
    /// The action itself is not possible in the state that is known to all.
    NotNow(String),
    /// It is possible in no state.
    Impossible(String),
    Refused(ProvedFor),
}

/// The private steps up to an action and after it.
struct PrivateSteps {
    steps: Vec<PlanStep>,
    /// Position of the action itself.
    position: usize,
}

/// A call for proposals that an actuator declines.
pub(super) struct DeclinedCall {
    /// The reason, as text for a person. It names nothing private.
    pub(super) why: String,
    pub(super) reason: Reason,
    /// The refusal of a part or a proposal that there are no private steps for.
    pub(super) refusal: Option<ProvedFor>,
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
        Err(failure @ (MethodFailure::Forbidden(_) | MethodFailure::Unanswered(_))) => {
            format!("failed to {failure}")
        }
        Err(MethodFailure::TimedOut(_)) => format!("failed to finish `{action}` in time"),
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
    fn first_steps(
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
            possible(action, local, cancel)?;
        }
        let filled = match self.fill(part, local, cancel) {
            Err(_) if part.len() > action.len() => self.fill(action, local, cancel),
            filled => filled,
        };
        let FilledPart { steps, positions, .. } = filled.map_err(|refusal| match has_begun {
            true => NoSteps::NotNow(refusal.0.why),
            false => NoSteps::Refused(refusal),
        })?;
        let before = steps.first().map_or(0, Vec::len);
        let position = before + positions.first().copied().unwrap_or_default();
        Ok(PrivateSteps { steps: steps.into_iter().take(2).flatten().collect(), position })
    }
}

/// Checks that an announced action, the end of `action`, is possible in the state that is known to all,
/// after what others have changed for it.
///
/// # Errors
///
/// Returns the reason, as text for a person.
fn possible(action: &[PartStep], local: &DomainSnapshot, cancel: &Cancel) -> Result<(), NoSteps> {
    let unreadable = || NoSteps::Impossible("the action or the state cannot be read".to_owned());
    let world = World::initial(&local.domain, &local.problem).map_err(|_| unreadable())?;
    let mut world = world.limit_work(CHECK_STEPS_MAX, Some(cancel));
    for element in action {
        match element {
            PartStep::Own(step) => {
                let parsed = pddl::parse_step(step).into_result().map_err(|_| unreadable())?;
                let applied = world.apply(&local.inside(&parsed));
                applied.map_err(|fault| {
                    let why = format!("it cannot do `{step}`: {fault}");
                    match is_of_state(&fault) {
                        true => NoSteps::NotNow(why),
                        false => NoSteps::Impossible(why),
                    }
                })?;
            }
            PartStep::Others(changes) => {
                let changes = pddl::parse_init_elements(changes).into_result();
                world.take_changes(&changes.map_err(|_| unreadable())?);
            }
        }
    }
    Ok(())
}

impl RunningCommand {
    /// Whether the device has to do more for the action after the call that has ended.
    pub(super) fn has_further_steps(&self) -> bool {
        let is_on_the_way = self.private.as_ref().is_some_and(|it| it.calls_to_action > 1);
        is_on_the_way || !self.further_calls.is_empty()
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
    pub(super) fn announced_facts(&self, ctx: &Context<Self>) -> Vec<OwnFact> {
        let facts = self.device.facts();
        match &self.confidentiality {
            Some(confidentiality) => {
                let shared_domain = ctx.shared_domain(&self.host);
                let knows = |name: &Name| shared_domain.current().0.declares_object(name);
                confidentiality.announced_facts(facts, &knows)
            }
            None => facts,
        }
    }

    /// Returns the observations that the actuator reports. `hides` says whether the action has begun as
    /// one with private steps.
    pub(super) fn announced_observations(
        &self,
        observed: Vec<InitElement>,
        hides: bool,
        ctx: &Context<Self>,
    ) -> Vec<InitElement> {
        match &self.confidentiality {
            // The model has changed meanwhile: what was private is not known any more.
            Some(confidentiality) if hides && !confidentiality.hides_something() => Vec::new(),
            Some(confidentiality) => {
                let shared_domain = ctx.shared_domain(&self.host);
                let knows = |name: &Name| shared_domain.current().0.declares_object(name);
                confidentiality.announced_observations(observed, &knows)
            }
            None => observed,
        }
    }

    /// Sends a heartbeat after a change of the device. If this agent keeps something from others, and
    /// they are told nothing new, it sends none: the mere heartbeat would tell them of the change.
    pub(super) fn send_news(&mut self, ctx: &mut Context<Self>) {
        let confidentiality = self.confidentiality.as_ref();
        let hides = confidentiality.is_some_and(|it| it.hides_something());
        // A press of a button stops at once, whatever others are told of it.
        self.apply_buttons(ctx);
        if !hides || self.announced_facts(ctx) != self.announced.told_facts {
            self.send_heartbeat(ctx);
        } else {
            self.announce_changed_model(ctx);
        }
    }

    /// Announces more of the model if the refusal is proved. Returns whether others can plan with another
    /// model than that of the refusal.
    pub(super) fn announce_more(
        &mut self,
        (refusal, model): &ProvedFor,
        ctx: &mut Context<Self>,
    ) -> bool {
        let confidentiality = self.confidentiality.as_ref();
        let is_other = confidentiality.is_some_and(|it| it.sharpen(refusal, model));
        if is_other {
            tracing::info!(agent = %ctx.id(), why = refusal.why, "announces more of its model");
            self.send_heartbeat(ctx);
        }
        is_other
    }

    /// Agrees to carry out an announced action, and begins to plan its private steps when people have
    /// allowed it, if they have to.
    pub(super) fn begin_with_private_steps(
        &mut self,
        participation: &Participation,
        action: String,
        token: ActionToken,
        ctx: &mut Context<Self>,
    ) {
        let recorded = self.agree_to_act(participation, &token, ctx);
        let consent = self.ask_leave(&action, ctx);
        let ready = async move {
            recorded.await?;
            consent.await
        };
        let work = ctx.run(ready, |actuator: &mut Self, ready, ctx| match ready {
            Ok(()) => actuator.plan_private_steps(ctx),
            Err(failure) => actuator.command_ended(Err(failure), ctx),
        });
        self.running_command = Some(RunningCommand {
            token,
            action,
            subscribers: vec![participation.clone()],
            call: None,
            further_calls: VecDeque::new(),
            private: Some(PrivateProgress::default()),
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
        let mut part = held.map(|held| held.part_from(&running.action)).unwrap_or_default();
        if part.is_empty() {
            part.push(PartStep::Own(running.action.clone()));
        }
        let cancel = Cancel::new();
        let (deadline, dropped) = (cancel.clone(), CancelledOnDrop(cancel.clone()));
        ctx.after(PLANNED_WITHIN, move |_: &mut Self, _| deadline.set());
        let has_begun = running.private.as_ref().is_some_and(|progress| progress.begun > 0);
        let (local, cache) = (self.local_domain(ctx), Arc::clone(&self.bid_cache));
        self.keep_bid_cache(ctx);
        let work = ctx.compute(
            move || {
                let mut afresh = Default::default();
                let local = match cache.try_lock() {
                    Ok(mut kept) => local(&mut kept.composition),
                    Err(_) => local(&mut afresh),
                };
                private.first_steps(&part, has_begun, &local, &cancel)
            },
            |actuator: &mut Self, planned, ctx| actuator.private_steps_planned(planned, ctx),
        );
        if let Some(running) = &mut self.running_command {
            running._work = work;
            running.further_calls.clear();
            running.private.get_or_insert_default().planning = Some(dropped);
        }
    }

    fn private_steps_planned(
        &mut self,
        planned: Result<PrivateSteps, NoSteps>,
        ctx: &mut Context<Self>,
    ) {
        let PrivateSteps { steps, position } = match planned {
            Ok(steps) => steps,
            Err(NoSteps::NotNow(why)) => return self.not_now(why, ctx),
            Err(NoSteps::Impossible(why)) => return self.private_end(why, None, ctx),
            Err(NoSteps::Refused(refusal)) => {
                // With a sharper model the next plan is another one. Otherwise the action has failed.
                let is_sharper = self.announce_more(&refusal, ctx);
                let FillRefusal { why, private_detail, .. } = refusal.0;
                let detail = private_detail.unwrap_or_default();
                tracing::warn!(agent = %ctx.id(), why, detail, "no private steps");
                return self.private_end(why, is_sharper.then_some(Reason::Conflict), ctx);
            }
        };
        let described = self.device.describe();
        let calls: Result<VecDeque<_>, String> =
            steps.iter().map(|step| call_of(step, &described)).collect();
        let calls = match calls {
            Ok(calls) => calls,
            Err(why) => return self.command_ended(Err(MethodFailure::Driver(why)), ctx),
        };
        let mut stops =
            calls.iter().filter_map(|(call, _)| self.stop_against(&call.action, ctx.id()));
        if let Some(stop) = stops.next() {
            let why = format!("a step of it is {}", super::stopping::described(&stop));
            return self.private_end(why, Some(Reason::Stopped), ctx);
        }
        let Some(running) = &mut self.running_command else { return };
        running.further_calls = calls;
        let progress = running.private.get_or_insert_default();
        (progress.calls_to_action, progress.planning) = (position + 1, None);
        self.next_call(ctx);
    }

    /// Handles an action that is not possible in the state that is known to all. What another agent has
    /// done for it may be known a moment later.
    fn not_now(&mut self, why: String, ctx: &mut Context<Self>) {
        let Some(running) = &mut self.running_command else { return };
        let progress = running.private.get_or_insert_default();
        if std::mem::replace(&mut progress.has_waited, true) {
            return self.private_end(why, Some(Reason::Conflict), ctx);
        }
        let wait = Box::pin(tokio::time::sleep(KNOWN_WITHIN));
        running._work = ctx.run(wait, |actuator: &mut Self, (), ctx| {
            actuator.plan_private_steps(ctx);
        });
    }

    /// Ends the running action before a further call, for a reason that names nothing private.
    fn private_end(&mut self, why: String, reason: Option<Reason>, ctx: &mut Context<Self>) {
        let Some(running) = self.running_command.take() else { return };
        let RunningCommand { token, action, subscribers, .. } = running;
        let mut report = Report::new(Outcome::Failed, why);
        (report.declined, report.action) = (reason, Some(action));
        self.conclude(token, subscribers, report, ctx);
    }

    /// Goes on with the running action after a call that has succeeded. As long as the action itself is
    /// not done, its private steps are planned again: the world may have changed.
    pub(super) fn continue_action(&mut self, ctx: &mut Context<Self>) {
        let Some(running) = &mut self.running_command else { return };
        let progress = running.private.get_or_insert_default();
        progress.calls_to_action = progress.calls_to_action.saturating_sub(1);
        if progress.calls_to_action > 0 {
            return self.plan_private_steps(ctx);
        }
        self.next_call(ctx);
    }

    /// Starts the next call of the running action.
    fn next_call(&mut self, ctx: &mut Context<Self>) {
        let Some(running) = &mut self.running_command else { return };
        let Some((call, timeout)) = running.further_calls.pop_front() else { return };
        let progress = running.private.get_or_insert_default();
        progress.begun += 1;
        let is_over = progress.begun > CALLS_MAX;
        if let Err((why, reason)) = self.may_call(&call, is_over) {
            tracing::warn!(agent = %ctx.id(), step = call.action, why, "a step is not begun");
            let is_done = self.is_action_done();
            let why = "a step of it cannot be begun; the log of its daemon has the reason, which is private";
            match is_done {
                true => return self.command_ended(Err(MethodFailure::GivenUp), ctx),
                false => return self.private_end(why.to_owned(), reason, ctx),
            }
        }
        tracing::debug!(agent = %ctx.id(), step = call.action, "a step of a private part");
        let work = self.start_call(&call, timeout, Box::pin(std::future::ready(Ok(()))), ctx);
        if let Some(running) = &mut self.running_command {
            (running.call, running._work) = (Some(call), work);
        }
    }

    /// Whether the running action is done, and only private steps after it are left.
    pub(super) fn is_action_done(&self) -> bool {
        let progress = self.running_command.as_ref().and_then(|running| running.private.as_ref());
        progress.is_some_and(|progress| progress.calls_to_action == 0 && progress.begun > 0)
    }

    /// Checks a call of the running action.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text and as a code.
    fn may_call(
        &mut self,
        call: &MethodCall,
        is_over: bool,
    ) -> Result<(), (String, Option<Reason>)> {
        if is_over {
            return Err((format!("it was not reached in {CALLS_MAX} steps"), None));
        }
        let requested = self.running_command.as_ref().map(|running| running.action.as_str());
        // People were asked about the action under its announced name, and cannot be asked about
        // another one, which would name it.
        if self.needs_other_leave(call, requested.unwrap_or_default()) {
            return Err(("people have to allow it, and cannot be asked".to_owned(), None));
        }
        let objection = self.rate_objection(&call.action).or_else(|| self.device.check_call(call));
        objection.map_or(Ok(()), |refusal| Err((refusal.detail, Some(refusal.reason))))
    }
}
