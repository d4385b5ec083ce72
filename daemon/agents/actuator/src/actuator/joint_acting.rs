//! Joint actions: an actuator that is ready waits for the other agents, and begins when they do.
//!
//! - *Preparing*: people are asked, if they have to allow the action. A refusal ends it.
//! - *Ready*: the actuator has agreed, and waits. Nothing has begun: no token is on disk, the device
//!   does nothing, and an action that is cancelled leaves nothing behind.
//! - *Acting*: the requester has said that all are ready, and the device acts. If a partner leaves, the
//!   actuator ends the action, even without a requester.
//! - *Done*: the device has done its part. What it has changed holds when the requester says that all
//!   have; until then the actuator takes no other work, and may still be cancelled.

use std::time::Duration;

use acl::content::{ActionToken, Agreement, Outcome, Reason, Refusal, Report};
use acl::{AgentId, Millis, Performative, ReplyToken};
use agent::{Context, Participation, Presence};
use tokio::sync::oneshot;

use super::{Actuator, RunningCommand, on_disk};
use crate::device::{MethodCall, MethodFailure};
use crate::erased_device::ErasedYield;

/// Longest time for which an actuator waits for the other agents, whatever is asked of it. Meanwhile it
/// does nothing else.
const READY_MAX: Duration = Duration::from_secs(3600);

/// How far an actuator is with its part of a joint action.
pub(super) struct JointProgress {
    phase: JointActionPhase,
    /// The other agents that act.
    partners: Vec<AgentId>,
    /// Time limit of the method.
    timeout: Duration,
    /// How long the actuator waits for the other agents.
    ready_for: Duration,
}

enum JointActionPhase {
    Preparing,
    /// Ends the wait; `None` if the actuator was told to begin.
    Ready(Option<oneshot::Sender<()>>),
    Acting,
    /// The sender ends the wait.
    Done(ErasedYield, Option<oneshot::Sender<()>>),
    /// All agents have done their parts.
    Completed,
}

// === impl JointProgress ===

impl JointProgress {
    /// Returns the beginning of a part, or a refusal if the request for `action` does not say how long
    /// the actuator waits for the others.
    pub(super) fn new(
        action: &str,
        partners: Vec<AgentId>,
        timeout: Duration,
        ready_for: Option<Millis>,
    ) -> Result<JointProgress, Refusal> {
        let Some(ready_for) = ready_for else {
            let detail = format!("{action} needs `ready_for`: several agents begin it together");
            return Err(Refusal::new(Reason::BadContent, detail));
        };
        let (phase, ready_for) = (JointActionPhase::Preparing, ready_for.0.min(READY_MAX));
        Ok(JointProgress { phase, partners, timeout, ready_for })
    }

    /// Whether the actuator has not agreed yet.
    pub(super) fn is_preparing(&self) -> bool {
        matches!(self.phase, JointActionPhase::Preparing)
    }

    /// Whether the actuator was told to begin.
    pub(super) fn was_told(&self) -> bool {
        !matches!(self.phase, JointActionPhase::Preparing | JointActionPhase::Ready(Some(_)))
    }

    /// Whether the device has done its part, and the others are awaited.
    pub(super) fn is_part_done(&self) -> bool {
        matches!(self.phase, JointActionPhase::Done(..))
    }
}

// === impl RunningCommand ===

impl RunningCommand {
    /// Whether the action waits for its agents, and nothing of it has begun.
    pub(super) fn waits_for_partners(&self) -> bool {
        self.joint.as_ref().is_some_and(|joint| !joint.was_told())
    }

    /// Returns the report that the device has done its part.
    pub(super) fn part_report(&self) -> Report {
        let report = Report::new(Outcome::Progress, "has done its part");
        Report { is_part_done: true, action: Some(self.action.clone()), ..report }
    }
}

// === impl Actuator ===

impl Actuator {
    /// Prepares a part of a joint action.
    pub(super) fn prepare(
        &mut self,
        participation: &Participation,
        token: ActionToken,
        call: MethodCall,
        joint: JointProgress,
        ctx: &mut Context<Self>,
    ) {
        let consent = self.ask_leave(&call.action, ctx);
        let work = ctx.run(consent, |actuator: &mut Self, consent, ctx| match consent {
            Ok(()) => actuator.wait_for_partners(ctx),
            Err(failure) => actuator.refuse_to_begin(&failure, ctx),
        });
        self.running_command = Some(RunningCommand {
            token,
            action: call.action.clone(),
            subscribers: vec![participation.clone()],
            call: Some(call),
            private: None,
            joint: Some(joint),
            _work: work,
        });
    }

    /// Agrees, and waits until all agents are ready.
    fn wait_for_partners(&mut self, ctx: &mut Context<Self>) {
        let Some(running) = &mut self.running_command else { return };
        let Some(joint) = &mut running.joint else { return };
        let (begin, begun) = oneshot::channel();
        joint.phase = JointActionPhase::Ready(Some(begin));
        let (token, ready_for) = (running.token.clone(), joint.ready_for);
        let partners = partners_in_words(&joint.partners);
        let agreement = Agreement { token: token.clone(), has_begun: false };
        for asker in &running.subscribers {
            ctx.answer(asker, Performative::Agree, &agreement);
        }
        self.renew_commitment(&token.conversation);
        let ready = async move {
            match tokio::time::timeout(ready_for, begun).await {
                Ok(Ok(())) => Ok(()),
                Ok(Err(_)) => Err(MethodFailure::GivenUp),
                Err(_) => {
                    let why =
                        format!("begin with {partners}: it was not told to within {ready_for:?}");
                    Err(MethodFailure::Hindered(why))
                }
            }
        };
        let work = ctx.run(ready, |actuator: &mut Self, ready, ctx| match ready {
            Ok(()) => actuator.begin_together(ctx),
            Err(failure) => actuator.command_ended(Err(failure), ctx),
        });
        if let Some(running) = &mut self.running_command {
            running._work = work;
        }
    }

    /// Takes an `accept-proposal`: all agents of the joint action are ready, or have done their parts.
    /// Returns `false` if the exchange is about something else.
    pub(super) fn take_acceptance(&mut self, exchange: &ReplyToken, are_parts_done: bool) -> bool {
        let Some(running) = &mut self.running_command else { return false };
        if !running.subscribers.iter().any(|asker| asker.exchange == *exchange) {
            return false;
        }
        let wait = match running.joint.as_mut().map(|joint| &mut joint.phase) {
            Some(JointActionPhase::Ready(begin)) if !are_parts_done => begin.take(),
            Some(JointActionPhase::Done(_, end)) if are_parts_done => end.take(),
            _ => None,
        };
        if let Some(wait) = wait {
            // Without its receiver the wait is over, and the action ends.
            let _ = wait.send(());
        }
        true
    }

    /// Records that the device begins.
    pub(super) fn joint_action_begins(&mut self) {
        let joint = self.running_command.as_mut().and_then(|running| running.joint.as_mut());
        if let Some(joint) = joint {
            joint.phase = JointActionPhase::Acting;
        }
    }

    fn begin_together(&mut self, ctx: &mut Context<Self>) {
        let Some(running) = &self.running_command else { return };
        let (Some(joint), Some(call)) = (&running.joint, running.call.clone()) else { return };
        let (timeout, token) = (joint.timeout, running.token.clone());
        let recorded = on_disk("the token", self.ledger.begin_token(token), ctx);
        let work = self.start_call(&call, timeout, recorded, ctx);
        if let Some(running) = &mut self.running_command {
            running._work = work;
        }
    }

    /// Whether the running action is a joint one that the device carries out.
    pub(super) fn acts_jointly(&self) -> bool {
        let joint = self.running_command.as_ref().and_then(|running| running.joint.as_ref());
        joint.is_some_and(|joint| matches!(joint.phase, JointActionPhase::Acting))
    }

    /// Tells that the device has done its part, and waits until all have.
    pub(super) fn wait_for_the_end(&mut self, yielded: ErasedYield, ctx: &mut Context<Self>) {
        let Some(running) = &mut self.running_command else { return };
        let report = running.part_report();
        let Some(joint) = &mut running.joint else { return };
        let (complete, completed) = oneshot::channel();
        joint.phase = JointActionPhase::Done(yielded, Some(complete));
        let (partners, limit) = (partners_in_words(&joint.partners), joint.ready_for);
        for asker in &running.subscribers {
            ctx.answer(asker, Performative::Confirm, &report);
        }
        let over = async move {
            tokio::time::timeout(limit, completed).await.map_err(|_| {
                let why = "end its part: it was not told of the end of that of";
                MethodFailure::Hindered(format!("{why} {partners} within {limit:?}"))
            })
        };
        let work = ctx.run(over, |actuator: &mut Self, over, ctx| match over {
            Ok(_) => actuator.all_are_done(ctx),
            Err(failure) => actuator.command_ended(Err(failure), ctx),
        });
        if let Some(running) = &mut self.running_command {
            running._work = work;
        }
    }

    fn all_are_done(&mut self, ctx: &mut Context<Self>) {
        let joint = self.running_command.as_mut().and_then(|running| running.joint.as_mut());
        let Some(joint) = joint else { return };
        let phase = std::mem::replace(&mut joint.phase, JointActionPhase::Completed);
        if let JointActionPhase::Done(yielded, _) = phase {
            self.command_ended(Ok(yielded), ctx);
        }
    }

    /// Reports the end of a joint action that has not begun: its token stays unused.
    pub(super) fn conclude_unbegun(
        &mut self,
        running: &RunningCommand,
        report: &Report,
        ctx: &mut Context<Self>,
    ) {
        self.commitment_step_ended(&running.token, report);
        for asker in &running.subscribers {
            ctx.answer(asker, Performative::Confirm, report);
        }
    }

    /// Ends a joint action to which the actuator has not agreed.
    fn refuse_to_begin(&mut self, failure: &MethodFailure, ctx: &mut Context<Self>) {
        let reason = match failure {
            MethodFailure::Unanswered(_) => Reason::Unanswered,
            _ => Reason::Incapable,
        };
        let refusal = Refusal::new(reason, format!("failed to {failure}"));
        self.withdraw_preparation(&refusal, ctx);
    }

    /// If the running action is a joint one to which the actuator has not agreed, refuses it. Returns
    /// whether it is.
    pub(super) fn withdraw_preparation(
        &mut self,
        refusal: &Refusal,
        ctx: &mut Context<Self>,
    ) -> bool {
        let is_preparing = |running: &mut RunningCommand| {
            running.joint.as_ref().is_some_and(JointProgress::is_preparing)
        };
        let Some(running) = self.running_command.take_if(is_preparing) else { return false };
        self.withdraw_consent(ctx);
        self.commitment.take_if(|held| held.is_for(&running.token.conversation));
        for asker in &running.subscribers {
            ctx.answer(asker, Performative::Refuse, refusal);
        }
        true
    }

    /// Whether the actuator has to know which agents leave.
    pub(super) fn has_partners(&self) -> bool {
        self.running_command.as_ref().is_some_and(|running| running.joint.is_some())
    }

    /// Ends the running joint action if one of its agents has left and does not come back soon, or if no
    /// requester is left.
    pub(super) fn partner_left(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let Presence::Left(resident) = presence else { return };
        let Some(running) = &self.running_command else { return };
        let Some(joint) = &running.joint else { return };
        if running.subscribers.iter().any(|asker| asker.initiator == resident.agent) {
            return self.check_orphaned(running.token.clone(), false, ctx);
        }
        if !joint.partners.contains(&resident.agent) {
            return;
        }
        let (token, partner) = (running.token.clone(), resident.agent.clone());
        let (incarnation, was_told) = (resident.incarnation, joint.was_told());
        ctx.after(ctx.settings().grace, move |actuator: &mut Self, ctx| {
            let is_it = |running: &RunningCommand| running.token == token;
            // One that is restarted before the action begins is asked again; later it knows nothing of it.
            let is_back = match was_told {
                true => ctx.directory().find_incarnation(&partner, incarnation).is_some(),
                false => ctx.find(&partner).is_some(),
            };
            if !is_back && actuator.running_command.as_ref().is_some_and(is_it) {
                let why = format!("go on: its partner `{partner}` has left");
                let refusal = Refusal::new(Reason::Conflict, format!("failed to {why}"));
                if !actuator.withdraw_preparation(&refusal, ctx) {
                    actuator.command_ended(Err(MethodFailure::Hindered(why)), ctx);
                }
            }
        });
    }
}

/// Returns the names of agents as text for a person.
fn partners_in_words(partners: &[AgentId]) -> String {
    let names: Vec<String> = partners.iter().map(|partner| format!("`{partner}`")).collect();
    names.join(" or ")
}
