//! How an actuator keeps its commitment to a joint plan: what it refuses meanwhile, and what ends the
//! commitment.

use acl::content::{ActionToken, Bid, CallForProposals, Choice, Refusal, Report};
use acl::{ConversationId, Message, Performative};
use agent::{Context, Participation};
use tokio::time::Instant;

use super::Actuator;
use crate::commitment::Commitment;

impl Actuator {
    /// Returns the refusal of what the goal of `conversation` asks for; `None` if the agent is free,
    /// or is committed to this very goal.
    pub(super) fn commitment_objection(&self, conversation: &ConversationId) -> Option<Refusal> {
        let now = Instant::now();
        let held = self.commitment.as_ref().filter(|held| !held.is_for(conversation))?;
        // A step may take longer than a lease.
        let is_acting = self.running_command.as_ref();
        let is_acting = is_acting.is_some_and(|running| held.is_for(&running.token.conversation));
        (is_acting || !held.is_over(now)).then(|| held.refusal(now))
    }

    /// Answers a call for proposals with `bid`. If it agrees to a part of a joint plan, the agent is
    /// committed to that plan from now on, unless it has become committed to another one meanwhile.
    pub(super) fn answer_call(
        &mut self,
        participation: &Participation,
        (conversation, call): (ConversationId, &CallForProposals),
        bid: &Bid,
        ctx: &mut Context<Self>,
    ) {
        if let Some(part) = &call.part {
            if let Some(refusal) = self.commitment_objection(&conversation) {
                return ctx.answer(participation, Performative::Refuse, &refusal);
            }
            let asked = (participation.initiator.clone(), participation.exchange.clone());
            self.commitment = Some(Commitment::new(conversation, asked, part, Instant::now()));
        }
        ctx.answer(participation, Performative::Agree, bid);
    }

    /// Renews the lease if a step for the goal of the commitment begins.
    pub(super) fn renew_commitment(&mut self, conversation: &ConversationId) {
        if let Some(held) = self.commitment.as_mut().filter(|held| held.is_for(conversation)) {
            held.renew(Instant::now());
        }
    }

    /// Ends or renews the commitment after a step for its goal.
    pub(super) fn commitment_step_ended(&mut self, token: &ActionToken, report: &Report) {
        let now = Instant::now();
        let step = report.action.as_deref().unwrap_or_default();
        self.commitment.take_if(|held| {
            held.is_for(&token.conversation) && !held.step_ended(step, report.outcome, now)
        });
    }

    pub(super) fn judged(&mut self, message: Message, _ctx: &mut Context<Self>) {
        if message.performative == Performative::AcceptProposal {
            let choice = message.content_as::<Choice>();
            let are_parts_done = choice.is_ok_and(|choice| choice.are_parts_done);
            let exchange = message.exchange();
            if exchange.is_some_and(|exchange| self.take_acceptance(exchange, are_parts_done)) {
                return;
            }
        }
        tracing::debug!(conversation = %message.conversation_id, verdict = %message.performative,
            "the proposal was accepted or rejected");
        if message.performative == Performative::RejectProposal
            && let Some(exchange) = message.exchange()
        {
            self.commitment.take_if(|held| held.is_of_exchange(exchange));
        }
    }
}
