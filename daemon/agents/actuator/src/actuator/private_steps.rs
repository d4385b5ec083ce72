//! Private steps (`privacy = "agents"`): other agents request an announced action, and the actuator
//! carries out the private steps that belong to it.
//!
//! - The private steps of an action are planned when the action is requested, and again after each of
//!   them until the action itself is done, from the state of the device and of the world at that
//!   moment. If the agent is committed to a part of a joint plan, they are planned for the rest of the
//!   part.
//! - If people have to allow the action, the actuator asks them before its first private step.
//! - Requesters are told whether an action is done, not how; the daemon's own log has the rest.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use acl::content::{ActionToken, Outcome, PartStep, Reason, Report};
use agent::{Context, Participation};
use pddl::{InitElement, Name, PlanStep};
use planner::Cancel;
use skeleton::{ConfidentialModel, FillRefusal};

use super::{Actuator, RunningCommand};
use crate::agreeing::DeclinedPart;
use crate::device::{Description, MethodCall, MethodFailure, MethodResult, OwnFact};
use crate::private_planning::{NoSteps, PrivatePlanner, PrivateSteps, ProvedFor};

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
    /// The calls that follow, each with its time limit.
    further_calls: VecDeque<(MethodCall, Duration)>,
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

impl RunningCommand {
    /// Whether the device has to do more for the action after the call that has ended.
    pub(super) fn has_further_steps(&self) -> bool {
        let progress = self.private.as_ref();
        progress.is_some_and(|it| it.calls_to_action > 1 || !it.further_calls.is_empty())
    }

    /// Returns the steps that the device carries out for the action: the present one, and those that
    /// follow.
    pub(super) fn steps(&self) -> impl Iterator<Item = &str> {
        let further = self.private.iter().flat_map(|progress| &progress.further_calls);
        let calls = self.call.iter().chain(further.map(|(call, _)| call));
        calls.map(|call| call.action.as_str())
    }
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
    /// Returns the model of the device if it declares something `:private`.
    pub(super) fn private_model(&self) -> Option<Arc<ConfidentialModel>> {
        self.confidentiality.as_ref()?.private_model(&self.device.describe().model)
    }

    pub(super) fn private_planner(&self) -> Option<PrivatePlanner> {
        let model = self.private_model()?;
        let facts = self.device.facts().into_iter().map(|fact| fact.fact).collect();
        Some(PrivatePlanner { model, facts })
    }

    /// Returns the facts of the device that the actuator announces.
    pub(super) fn announced_facts(&self, ctx: &Context<Self>) -> Vec<OwnFact> {
        let facts = self.device.facts();
        match &self.confidentiality {
            Some(confidentiality) => {
                confidentiality.announced_facts(facts, &self.knows_object(ctx))
            }
            None => facts,
        }
    }

    /// Returns a function that says whether an agent or the map declares an object.
    fn knows_object(&self, ctx: &Context<Self>) -> impl Fn(&Name) -> bool + use<> {
        let shared_domain = ctx.shared_domain(&self.host);
        move |name| shared_domain.current().0.declares_object(name)
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
                confidentiality.announced_observations(observed, &self.knows_object(ctx))
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
            joint: None,
            token,
            action,
            subscribers: vec![participation.clone()],
            call: None,
            private: Some(PrivateProgress::default()),
            _work: work,
        });
    }

    /// Returns the progress of the running action; `None` if it is not one with private steps.
    fn progress(&mut self) -> Option<&mut PrivateProgress> {
        self.running_command.as_mut()?.private.as_mut()
    }

    fn plan_private_steps(&mut self, ctx: &mut Context<Self>) {
        let Some(private) = self.private_planner() else {
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
        }
        if let Some(progress) = self.progress() {
            progress.further_calls.clear();
            progress.planning = Some(dropped);
        }
    }

    fn private_steps_planned(
        &mut self,
        planned: Result<PrivateSteps, NoSteps>,
        ctx: &mut Context<Self>,
    ) {
        let PrivateSteps { steps, position } = match planned {
            Ok(steps) => steps,
            Err(NoSteps::Declined(DeclinedPart::NotNow(why))) => return self.not_now(why, ctx),
            Err(NoSteps::Declined(DeclinedPart::Unusable(why))) => {
                return self.private_end(why, None, ctx);
            }
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
        let Some(progress) = self.progress() else { return };
        progress.further_calls = calls;
        (progress.calls_to_action, progress.planning) = (position + 1, None);
        self.next_call(ctx);
    }

    /// Handles an action that is not possible in the state that is known to all. What another agent has
    /// done for it may be known a moment later.
    fn not_now(&mut self, why: String, ctx: &mut Context<Self>) {
        let Some(progress) = self.progress() else { return };
        if std::mem::replace(&mut progress.has_waited, true) {
            return self.private_end(why, Some(Reason::Conflict), ctx);
        }
        let wait = tokio::time::sleep(KNOWN_WITHIN);
        let work = ctx.run(wait, |actuator: &mut Self, (), ctx| actuator.plan_private_steps(ctx));
        if let Some(running) = &mut self.running_command {
            running._work = work;
        }
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
        let Some(progress) = self.progress() else { return };
        progress.calls_to_action = progress.calls_to_action.saturating_sub(1);
        if progress.calls_to_action > 0 {
            return self.plan_private_steps(ctx);
        }
        self.next_call(ctx);
    }

    /// Starts the next call of the running action.
    fn next_call(&mut self, ctx: &mut Context<Self>) {
        let Some(progress) = self.progress() else { return };
        let Some((call, timeout)) = progress.further_calls.pop_front() else { return };
        progress.begun += 1;
        let is_over = progress.begun > CALLS_MAX;
        if let Err((why, reason)) = self.may_call(&call, is_over) {
            tracing::warn!(agent = %ctx.id(), step = call.action, why, "a step is not begun");
            if self.is_action_done() {
                return self.command_ended(Err(MethodFailure::GivenUp), ctx);
            }
            let why =
                "a step of it cannot begin; the reason is private, and in the log of its daemon";
            return self.private_end(why.to_owned(), reason, ctx);
        }
        tracing::debug!(agent = %ctx.id(), step = call.action, "a step of an action");
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
