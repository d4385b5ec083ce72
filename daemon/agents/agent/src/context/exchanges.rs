//! The exchanges that an agent has opened: their turns, their deadlines, and the callbacks of their
//! initiator.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Reason, Refusal, value};
use acl::{AgentId, ConversationId, Message, MessageId, Performative, ReplyToken};
use conversation::Exchange;
use serde_json::Value;
use substrate::{Rejected, ViolationKind};

use super::{Context, TimerId};
use crate::exchange::{DeliveryError, ExchangeEvent, ExchangeOpening, ExchangeSummary};

/// Maximum number of messages per exchange that are kept because they arrived before the message
/// that they follow. A further one is answered as out of turn. A protocol has few messages, and
/// each comes once.
const EARLY_TURNS_MAX: usize = 32;

/// Delay before a request that a standby has declined is sent again to the leader. The daemons
/// agree on which replica is the leader within a few milliseconds, or as soon as they are
/// connected.
const ASK_WHO_ACTS: Duration = Duration::from_millis(25);

/// Maximum number of times that a request declined by standbys is sent again. After that the
/// initiator gets the refusal.
const ASKED_WHO_ACTS_MAX: u32 = 40;

type ExchangeCallback<A> = Box<dyn FnMut(&mut A, ExchangeEvent, &mut Context<A>) + Send>;

/// An exchange that the agent has opened and not closed.
pub(super) struct OpenExchange<A> {
    protocol: acl::Protocol,
    conversation: ConversationId,
    /// Participant that the exchange was opened with; `None` for a broadcast.
    to: Option<AgentId>,
    /// Message that opened the exchange.
    opening: Box<Message>,
    /// Number of times that a standby has declined the opening.
    declined: u32,
    /// State of the exchange after the opening. The state of each participant that answers begins
    /// as a copy of this one.
    begun: Exchange,
    participants: BTreeMap<AgentId, Exchange>,
    /// Messages that arrived too early: the message that each of them follows was lost, and its
    /// sender retries it.
    early: Vec<Message>,
    timer: TimerId,
    on_answer: Option<ExchangeCallback<A>>,
}

impl<A: 'static> Context<A> {
    /// Returns a summary of the exchanges that this agent has open.
    pub fn exchanges(&self) -> ExchangeSummary {
        let due = self.exchanges.values().map(|open| open.timer.0).min();
        ExchangeSummary { open_count: self.exchanges.len(), due }
    }

    /// Opens an exchange and returns its token. `on_answer` is called with every answer, until the
    /// protocol ends the exchange, [`Context::close`] is called, or `patience` has passed
    /// ([`ExchangeEvent::TimedOut`]).
    pub fn open(
        &mut self,
        opening: ExchangeOpening,
        patience: Duration,
        on_answer: impl FnMut(&mut A, ExchangeEvent, &mut Context<A>) + Send + 'static,
    ) -> ReplyToken {
        let token = self.communication.token();
        let mut begun = Exchange::new(opening.protocol, self.id().clone(), self.incarnation());
        let expired = token.clone();
        let timer = self.after(patience, move |agent, ctx| {
            ctx.end(agent, &expired, ExchangeEvent::TimedOut);
        });
        let (protocol, conversation) = (opening.protocol, opening.conversation.clone());
        let (opening, sent) = self.communication.open(opening, &token, patience);
        if let Err(violation) = begun.advance(&opening) {
            tracing::error!(agent = %self.id(), %violation, "this agent breaks its protocol");
        }
        let (participants, early) = (BTreeMap::new(), Vec::new());
        let on_answer: ExchangeCallback<A> = Box::new(on_answer);
        let on_answer = Some(on_answer);
        let open = OpenExchange {
            protocol,
            conversation,
            to: opening.receiver.first().cloned(),
            opening: Box::new(opening),
            declined: 0,
            begun,
            participants,
            early,
            timer,
            on_answer,
        };
        self.exchanges.insert(token.clone(), open);
        if let Err(why) = sent {
            let failed = token.clone();
            self.after(Duration::ZERO, move |agent, ctx| {
                ctx.end(agent, &failed, ExchangeEvent::Undelivered(why));
            });
        }
        token
    }

    /// Sends the `cfp` of an open exchange again, to `agent`, which has not answered. A `cfp` has
    /// no receipt, and an agent that has just joined may have missed it. An agent that has received
    /// the `cfp` before drops the copy as a duplicate. Does nothing if the opening is not a `cfp`
    /// but a message that is retried anyway.
    pub fn resend_cfp(&mut self, token: &ReplyToken, agent: &AgentId) {
        let opening = self.exchanges.get(token).map(|open| &*open.opening);
        let is_call = |opening: &&Message| !opening.performative.is_retried();
        let Some(mut message) = opening.filter(is_call).cloned() else { return };
        message.receiver = vec![agent.clone()];
        self.communication.repeat(agent, &message);
    }

    /// Sends the initiator's next turn of an exchange: `cancel`, `accept-proposal`,
    /// `reject-proposal`. Does nothing if the protocol does not allow the turn now.
    pub fn send_turn(
        &mut self,
        token: &ReplyToken,
        to: &AgentId,
        performative: Performative,
        content: Value,
    ) {
        let to = std::iter::once(to.clone());
        let Some(message) = self.turn(token, to, performative, content) else { return };
        let patience = self.settings().answer_deadline;
        if let Err(why) = self.communication.post(&message, patience) {
            tracing::warn!(agent = %self.id(), %why, "a message could not be sent");
        }
    }

    /// Sends the initiator's next turn of an exchange to several participants in one broadcast. The
    /// broadcast has no receipt and is not retried: use this method only if it does no harm that a
    /// participant misses the turn.
    pub fn multicast_turn(
        &mut self,
        token: &ReplyToken,
        to: impl IntoIterator<Item = AgentId>,
        performative: Performative,
        content: Value,
    ) {
        if let Some(message) = self.turn(token, to, performative, content) {
            self.communication.say_to_several(&message);
        }
    }

    /// Builds the initiator's next turn of an exchange, addressed to those participants for which
    /// the protocol allows the turn now. Returns `None` if there are no such participants.
    fn turn(
        &mut self,
        token: &ReplyToken,
        to: impl IntoIterator<Item = AgentId>,
        performative: Performative,
        content: Value,
    ) -> Option<Message> {
        let open = self.exchanges.get_mut(token)?;
        let conversation = open.conversation.clone();
        let mut message = self.communication.message(performative, conversation, content);
        message.protocol = Some(open.protocol);
        message.in_reply_to = Some(token.clone());
        for participant in to {
            let begun = &open.begun;
            let exchange = open.participants.entry(participant.clone());
            match exchange.or_insert_with(|| begun.clone()).advance(&message) {
                Ok(_) => message.receiver.push(participant),
                Err(violation) => {
                    tracing::debug!(agent = %self.communication.id, %violation, "not sent: out of turn");
                }
            }
        }
        (!message.receiver.is_empty()).then_some(message)
    }

    /// Closes an exchange, and sends `cancel` to its participants so that they stop working on an
    /// answer.
    pub fn cancel(&mut self, token: &ReplyToken, why: &impl serde::Serialize) {
        let Some(open) = self.exchanges.get(token) else { return };
        match open.to.clone() {
            Some(to) => self.send_turn(token, &to, Performative::Cancel, value(why)),
            None => {
                let (protocol, conversation) = (open.protocol, open.conversation.clone());
                let cancel = Performative::Cancel;
                let mut message = self.communication.message(cancel, conversation, value(why));
                message.protocol = Some(protocol);
                message.in_reply_to = Some(token.clone());
                // A participant that misses the `cancel` continues until its deadline.
                let _ = self.communication.post(&message, Duration::ZERO);
            }
        }
        self.close(token);
    }

    /// Sets the deadline of an exchange to `patience` from now.
    pub fn extend(&mut self, token: &ReplyToken, patience: Duration) {
        let expired = token.clone();
        let Some(open) = self.exchanges.get(token) else { return };
        let old = open.timer;
        self.timers.remove(&old);
        let timer = self.after(patience, move |agent, ctx| {
            ctx.end(agent, &expired, ExchangeEvent::TimedOut);
        });
        if let Some(open) = self.exchanges.get_mut(token) {
            open.timer = timer;
        }
    }

    /// Closes an exchange without sending a message. Earlier messages of this agent in the exchange
    /// are still delivered.
    pub fn close(&mut self, token: &ReplyToken) {
        let Some(open) = self.exchanges.remove(token) else { return };
        self.timers.remove(&open.timer);
        for message in open.early {
            let detail = "the message before it has not come".to_owned();
            self.communication.not_understood(&message, Reason::OutOfTurn, detail);
        }
    }

    /// Sends the opening of an exchange again, to the replica that is the leader now. Call this
    /// method if the replica that answered is gone, because it may not have passed the exchange on
    /// to the other replicas.
    pub fn reopen_with_leader(&mut self, token: &ReplyToken) {
        if let Some(open) = self.exchanges.get_mut(token) {
            (open.participants, open.declined) = (BTreeMap::new(), 0);
            self.resend_opening(token);
        }
    }

    /// Sends the opening of an exchange again, to the present leader among the replicas of the
    /// receiver. Does nothing if a participant has answered.
    fn resend_opening(&mut self, token: &ReplyToken) {
        // The leader may have received the opening and answered as soon as it was present.
        let unanswered = |open: &&OpenExchange<A>| open.participants.is_empty();
        let Some(open) = self.exchanges.get(token).filter(unanswered) else { return };
        let opening = (*open.opening).clone();
        // The message gets a new id, because a replica that was a standby has the old one in its
        // duplicate window.
        let id = MessageId::new(self.communication.token().as_str());
        let again = Message { id, ..opening };
        let patience = self.settings().answer_deadline;
        if let Err(why) = self.communication.post(&again, patience) {
            tracing::warn!(agent = %self.id(), %why, "could not be asked again");
        }
    }

    // === for the event loop ===

    /// Handles `message` as an answer in an exchange that this agent opened. Returns the message if
    /// this agent has opened no such exchange.
    ///
    /// An answer that arrives before the turn it follows is kept until that turn has come, or the
    /// exchange ends.
    pub(crate) fn take_answer(
        &mut self,
        agent: &mut A,
        token: &ReplyToken,
        message: Box<Message>,
    ) -> Option<Box<Message>> {
        let Some(open) = self.exchanges.get_mut(token) else { return Some(message) };
        if let Some(to) = open.to.clone().filter(|to| *to != message.sender) {
            self.reject_uninvited(&message, &to);
            return None;
        }
        if open.to.is_some() && stands_by(&message) && open.declined < ASKED_WHO_ACTS_MAX {
            open.declined += 1;
            let asked = token.clone();
            self.after(ASK_WHO_ACTS, move |_, ctx| ctx.resend_opening(&asked));
            return None;
        }
        let begun = &open.begun;
        let exchange =
            open.participants.entry(message.sender.clone()).or_insert_with(|| begun.clone());
        if let Err(violation) = exchange.advance(&message) {
            if exchange.may_follow_later(&message) && open.early.len() < EARLY_TURNS_MAX {
                tracing::debug!(agent = %self.communication.id, id = %message.id, %violation, "waits");
                open.early.push(*message);
            } else {
                let detail = violation.to_string();
                self.communication.not_understood(&message, Reason::OutOfTurn, detail);
            }
            return None;
        }
        let is_closed = exchange.is_closed() && open.to.is_some();
        self.call_back(agent, token, ExchangeEvent::Message(message));
        if is_closed {
            self.communication.forget_exchange(token);
            self.close(token);
        } else if let Some(next) = self.take_early(token) {
            self.take_answer(agent, token, next);
        }
        None
    }

    /// Rejects an answer from an agent that was not asked. Every listener can read the token of an
    /// exchange, so such an answer must not count as the answer of the agent `asked`.
    fn reject_uninvited(&mut self, message: &Message, asked: &AgentId) {
        let detail = format!("answers a question to `{asked}`");
        self.router().rejections().note(&Rejected {
            violation: ViolationKind::Unauthorized,
            detail: &detail,
            claimed: Some(message.sender.as_str()),
            key: message.exchange().map_or("", ReplyToken::as_str),
        });
        let detail = format!("only `{asked}` was asked");
        self.communication.not_understood(message, Reason::OutOfTurn, detail);
    }

    /// Removes and returns a turn that arrived too early and is allowed now; `None` if there is no
    /// such turn.
    fn take_early(&mut self, token: &ReplyToken) -> Option<Box<Message>> {
        let open = self.exchanges.get_mut(token)?;
        let follows = |early: &Message| {
            let exchange = open.participants.get(&early.sender).unwrap_or(&open.begun);
            exchange.clone().advance(early).is_ok()
        };
        let index = open.early.iter().position(follows)?;
        Some(Box::new(open.early.remove(index)))
    }

    /// Calls the callback of an exchange with `answer`, and closes the exchange.
    pub(crate) fn end(&mut self, agent: &mut A, token: &ReplyToken, answer: ExchangeEvent) {
        self.call_back(agent, token, answer);
        self.close(token);
    }

    fn call_back(&mut self, agent: &mut A, token: &ReplyToken, answer: ExchangeEvent) {
        let on_answer = self.exchanges.get_mut(token).and_then(|open| open.on_answer.take());
        let Some(mut on_answer) = on_answer else { return };
        on_answer(agent, answer, self);
        if let Some(open) = self.exchanges.get_mut(token) {
            open.on_answer = Some(on_answer);
        }
    }

    /// Calls the callback of each exchange in `lost` with its delivery error, and closes the
    /// exchange.
    pub(crate) fn undelivered(&mut self, agent: &mut A, lost: Vec<(ReplyToken, DeliveryError)>) {
        for (token, why) in lost {
            self.end(agent, &token, ExchangeEvent::Undelivered(why));
        }
    }
}

/// Whether `message` is the refusal of a standby.
fn stands_by(message: &Message) -> bool {
    let is_refusal = message.performative == Performative::Refuse;
    let reason = || message.content_as::<Refusal>().map(|refusal| refusal.reason);
    is_refusal && reason().is_ok_and(|reason| reason == Reason::StandingBy)
}
