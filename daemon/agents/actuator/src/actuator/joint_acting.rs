//! Joint actions: an actuator that is ready waits for the other agents, and begins when they do.
//!
//! - *Preparing*: people are asked, if they have to allow the action. A refusal ends it.
//! - *Ready*: the actuator has agreed, and waits. Nothing has begun: no token is on disk, the device
//!   does nothing, and an action that is cancelled leaves nothing behind.
//! - *Acting*: the requester has said that all are ready. An agent whose partner leaves stops, also
//!   if the requester is gone.

use std::time::Duration;

use acl::content::{ActionToken, Agreement, Reason, Refusal};
use acl::{AgentId, Millis, Performative, ReplyToken};
use agent::{Context, Participation, Presence};
use tokio::sync::oneshot;

use super::{Actuator, RunningCommand, on_disk};
use crate::device::{MethodCall, MethodFailure};

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
    /// Ends the wait.
    Ready(oneshot::Sender<()>),
    Acting,
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

    /// Whether the device has begun.
    pub(super) fn is_acting(&self) -> bool {
        matches!(self.phase, JointActionPhase::Acting)
    }
}

// === impl RunningCommand ===

impl RunningCommand {
    /// Whether the device has nothing to do with the action yet.
    pub(super) fn waits_for_partners(&self) -> bool {
        self.joint.as_ref().is_some_and(|joint| !joint.is_acting())
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
        joint.phase = JointActionPhase::Ready(begin);
        let (token, ready_for) = (running.token.clone(), joint.ready_for);
        let partners = partners_in_words(&joint.partners);
        let agreement = Agreement { token: token.clone() };
        for asker in &running.subscribers {
            ctx.answer(asker, Performative::Agree, &agreement);
        }
        self.renew_commitment(&token.conversation);
        let ready = async move {
            match tokio::time::timeout(ready_for, begun).await {
                Ok(Ok(())) => Ok(()),
                Ok(Err(_)) => Err(MethodFailure::GivenUp),
                Err(_) => {
                    let why = format!("begin: {partners} was not ready within {ready_for:?}");
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

    /// Takes the word of a requester that all agents of the joint action are ready. Returns `false` if
    /// the exchange is about something else.
    pub(super) fn all_are_ready(&mut self, exchange: &ReplyToken) -> bool {
        let Some(running) = &mut self.running_command else { return false };
        if !running.subscribers.iter().any(|asker| asker.exchange == *exchange) {
            return false;
        }
        if let Some(joint) = &mut running.joint
            && let JointActionPhase::Ready(_) = joint.phase
            && let JointActionPhase::Ready(begin) =
                std::mem::replace(&mut joint.phase, JointActionPhase::Acting)
        {
            // The receiver is dropped only with the running action.
            let _ = begin.send(());
        }
        true
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

    /// Ends a joint action to which the actuator has not agreed.
    fn refuse_to_begin(&mut self, failure: &MethodFailure, ctx: &mut Context<Self>) {
        let Some(running) = self.running_command.take() else { return };
        let reason = match failure {
            MethodFailure::Unanswered(_) => Reason::Unanswered,
            _ => Reason::Incapable,
        };
        let refusal = Refusal::new(reason, format!("failed to {failure}"));
        for asker in &running.subscribers {
            ctx.answer(asker, Performative::Refuse, &refusal);
        }
    }

    /// If the running action is a joint one to which the actuator has not agreed, refuses it. Returns
    /// whether it is.
    pub(super) fn withdraw_preparation(&mut self, why: &str, ctx: &mut Context<Self>) -> bool {
        let is_preparing = |running: &mut RunningCommand| {
            running.joint.as_ref().is_some_and(JointProgress::is_preparing)
        };
        let Some(running) = self.running_command.take_if(is_preparing) else { return false };
        self.withdraw_consent(ctx);
        let refusal = Refusal::new(Reason::Other, why);
        for asker in &running.subscribers {
            ctx.answer(asker, Performative::Refuse, &refusal);
        }
        true
    }

    /// Whether the actuator has to know which agents leave.
    pub(super) fn has_partners(&self) -> bool {
        self.running_command.as_ref().is_some_and(|running| running.joint.is_some())
    }

    /// Ends the running joint action if one of its agents has left and does not come back soon.
    pub(super) fn partner_left(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let Presence::Left(resident) = presence else { return };
        let Some(running) = &self.running_command else { return };
        let Some(joint) = &running.joint else { return };
        if !joint.partners.contains(&resident.agent) {
            return;
        }
        let (token, partner) = (running.token.clone(), resident.agent.clone());
        let incarnation = resident.incarnation;
        ctx.after(ctx.settings().grace, move |actuator: &mut Self, ctx| {
            let is_it = |running: &RunningCommand| running.token == token;
            let is_back = ctx.directory().find_incarnation(&partner, incarnation).is_some();
            if !is_back && actuator.running_command.as_ref().is_some_and(is_it) {
                actuator.cancel_command(&format!("`{partner}` acts with it, and has left"), ctx);
            }
        });
    }
}

/// Returns the names of agents as text for a person.
fn partners_in_words(partners: &[AgentId]) -> String {
    let names: Vec<String> = partners.iter().map(|partner| format!("`{partner}`")).collect();
    names.join(" or ")
}
