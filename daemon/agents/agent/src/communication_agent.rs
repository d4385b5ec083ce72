//! The Communication Agent (the paper, “The Communication Agent”): one agent's interface to the
//! substrate.
//!
//! - Decodes messages, answers those that cannot be read, drops duplicates, sends receipts.
//! - Retries the agent's messages until a receipt or an answer comes; gives up with a reason.
//! - Tracks the exchanges that other agents opened with this agent. Answers a turn that the
//!   protocol does not allow with `not-understood`, and does not pass the turn to the agent.
//!
//! The module `context` has the exchanges that this agent opened, with their callbacks.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use acl::codec::Sketch;
use acl::content::{Reason, Refusal, value};
use acl::{
    AgentId, ConversationId, DecodeError, EcosystemId, Incarnation, Message, MessageId, Millis,
    Performative, Protocol, ReplyToken, SCHEMA_VERSION,
};
use conversation::{Exchange, ExchangePhase};
use serde_json::{Map, Value};
use substrate::{AgentAddress, Presence, Resident, Subject};
use tokio::time::Instant;

use crate::exchange::{DeliveryError, ExchangeOpening, Participation};
use crate::mailbox::{DuplicateFilter, MessageState};
use crate::outbox::{DueAction, OutboundMessage, Outbox, ReceiverIncarnation};
use crate::receipts::{ImplicitReceipt, Receipts};
use crate::refusal::refusal;
use crate::router::MessageRouter;

/// Maximum number of exchanges opened by other agents that are tracked at a time. If there are
/// more, the oldest is dropped, and a later `cancel` of that exchange has no effect.
const ENGAGEMENTS_MAX: usize = 4_096;

/// Number of closed exchanges that may remain in `engagements_order`, in addition to as many as are
/// open. If there are more, the closed ones are removed from the list.
const OVER_MAX: usize = 64;

/// Maximum number of messages that are kept because they arrived before the opening of their
/// exchange. If there are more, the oldest is dropped. For example, a `cancel` arrives first if the
/// `request` before it was lost; the `request` is then sent again.
const EARLY_TURNS_MAX: usize = 64;

/// How long an answer is retried; an answer has no deadline of its own.
const ANSWER_RETRIED: Duration = Duration::from_secs(30);

/// A received message after it was decoded, with its place among the exchanges.
#[derive(Debug)]
pub(crate) enum IncomingMessage {
    /// The message continues an exchange, which this agent or another may have opened.
    Continues(ReplyToken, Box<Message>),
    /// The message opens an exchange, or belongs to no exchange.
    Opens(Box<Message>),
    /// The message has been handled already; nothing is left to do.
    Nothing,
}

pub(crate) struct CommunicationAgent {
    pub(crate) id: AgentId,
    pub(crate) incarnation: Incarnation,
    router: Arc<MessageRouter>,
    ontology: Arc<str>,
    via: Arc<[EcosystemId]>,
    outbox: Outbox,
    /// Duplicate window of the agent.
    door: Arc<DuplicateFilter>,
    participations: BTreeMap<(ReplyToken, AgentId), Exchange>,
    engagements_order: VecDeque<(ReplyToken, AgentId)>,
    early: VecDeque<Message>,
    receipts: Receipts,
    messages_sent: u64,
}

impl CommunicationAgent {
    pub(crate) fn new(
        id: AgentId,
        incarnation: Incarnation,
        router: Arc<MessageRouter>,
        ontology: Arc<str>,
        via: Arc<[EcosystemId]>,
        door: Arc<DuplicateFilter>,
    ) -> CommunicationAgent {
        let outbox = Outbox::new(router.settings());
        let receipts = Receipts::new(router.settings().retry_first);
        CommunicationAgent {
            id,
            incarnation,
            router,
            ontology,
            via,
            outbox,
            door,
            participations: BTreeMap::new(),
            engagements_order: VecDeque::new(),
            early: VecDeque::new(),
            receipts,
            messages_sent: 0,
        }
    }

    /// Returns the router of the daemon.
    pub(crate) fn router(&self) -> &Arc<MessageRouter> {
        &self.router
    }

    // === sending ===

    /// Creates a message of this agent, without a receiver.
    pub(crate) fn message(
        &mut self,
        performative: Performative,
        conversation: ConversationId,
        content: Value,
    ) -> Message {
        self.messages_sent += 1;
        let id = format!("{}.{}.{}", self.id, self.incarnation, self.messages_sent);
        Message {
            version: SCHEMA_VERSION,
            id: MessageId::new(&id),
            performative,
            sender: self.id.clone(),
            incarnation: self.incarnation,
            receiver: Vec::new(),
            content,
            language: Some("pddl".to_owned()),
            ontology: Some(self.ontology.as_ref().to_owned()),
            protocol: None,
            conversation_id: conversation,
            reply_with: None,
            in_reply_to: None,
            reply_within: None,
            via: self.via.to_vec(),
            unknown: Map::new(),
        }
    }

    /// Returns the name of the ontology, which all messages of this agent carry.
    pub(crate) fn ontology(&self) -> Arc<str> {
        Arc::clone(&self.ontology)
    }

    /// Creates a token for a new exchange.
    pub(crate) fn token(&mut self) -> ReplyToken {
        self.messages_sent += 1;
        ReplyToken::new(&format!("{}.{}.{}", self.id, self.incarnation, self.messages_sent))
    }

    /// Sends the first message of an exchange. Returns the message, and the result of sending: an
    /// error if the outbox is full.
    pub(crate) fn open(
        &mut self,
        opening: ExchangeOpening,
        token: &ReplyToken,
        patience: Duration,
    ) -> (Message, Result<(), DeliveryError>) {
        let ExchangeOpening { to, performative, protocol, conversation, content } = opening;
        let mut message = self.message(performative, conversation, content);
        message.protocol = Some(protocol);
        message.reply_with = Some(token.clone());
        message.reply_within = Some(Millis(patience));
        message.receiver.extend(to);
        let sent = self.post(&message, patience);
        (message, sent)
    }

    /// Sends an answer as the participant of an exchange. If the answer cannot be sent, logs a
    /// warning.
    pub(crate) fn answer(
        &mut self,
        participation: &Participation,
        performative: Performative,
        content: Value,
    ) {
        if let Err(why) = self.try_answer(participation, performative, content) {
            tracing::warn!(agent = %self.id, conversation = %participation.conversation, %why,
                "an answer could not be sent");
        }
    }

    /// Sends an answer as the participant of an exchange. If the outbox is full, returns an error,
    /// and the exchange does not advance.
    pub(crate) fn try_answer(
        &mut self,
        participation: &Participation,
        performative: Performative,
        content: Value,
    ) -> Result<(), DeliveryError> {
        let Participation { initiator, incarnation, exchange, conversation, protocol } =
            participation.clone();
        let mut message = self.message(performative, conversation, content);
        message.protocol = protocol;
        message.in_reply_to = Some(exchange.clone());
        message.receiver.push(initiator.clone());
        self.post_to(incarnation, &message, ANSWER_RETRIED)?;
        self.advance_engagement(&(exchange, initiator), &message);
        Ok(())
    }

    /// Sends a message to its receiver, or to all agents if it has no receiver.
    pub(crate) fn post(
        &mut self,
        message: &Message,
        patience: Duration,
    ) -> Result<(), DeliveryError> {
        self.post_to(None, message, patience)
    }

    /// Sends a message to its receiver, or to all agents if it has no receiver. If `incarnation` is
    /// given, only that incarnation of the receiver gets the message.
    fn post_to(
        &mut self,
        incarnation: Option<Incarnation>,
        message: &Message,
        patience: Duration,
    ) -> Result<(), DeliveryError> {
        let payload = acl::encode(message);
        tracing::debug!(agent = %self.id, conversation = %message.conversation_id,
            performative = %message.performative, to = ?message.receiver, id = %message.id, "says");
        let Some(to) = message.receiver.first() else {
            self.router.broadcast(&self.id, message.performative, payload);
            return Ok(());
        };
        let directory = self.router.directory();
        // A foreign tool may state no incarnation. Then any holder of the tool's name gets the
        // message.
        let incarnation = incarnation.filter(|incarnation| *incarnation != Incarnation::default());
        let resident = match incarnation {
            Some(incarnation) => directory.find_incarnation(to, incarnation),
            None => directory.find(to),
        };
        if message.performative.is_retried() {
            let parcel = OutboundMessage {
                to: to.clone(),
                incarnation,
                performative: message.performative,
                exchange: message.exchange().cloned(),
                opens: message.opens_exchange(),
                payload: payload.clone(),
                give_up: Instant::now() + patience,
            };
            let incarnation = resident.map(ReceiverIncarnation::from);
            if !self.outbox.put(message.id.clone(), parcel, incarnation, Instant::now()) {
                return Err(DeliveryError::OutboxFull);
            }
        }
        if let Some(exchange) = &message.in_reply_to {
            self.receipts.replied(to, exchange, message.performative);
        }
        if let Some(resident) = resident {
            let subject = Subject::Message(message.performative);
            self.router.send_to(&address(resident), subject, payload);
        }
        Ok(())
    }

    /// Sends a turn of an exchange to several of its participants in one broadcast; agents that the
    /// broadcast does not name ignore it. The broadcast has no receipts.
    pub(crate) fn say_to_several(&mut self, message: &Message) {
        tracing::debug!(agent = %self.id, conversation = %message.conversation_id,
            performative = %message.performative, to = ?message.receiver, id = %message.id, "says");
        if let Some(exchange) = &message.in_reply_to {
            for to in &message.receiver {
                self.receipts.replied(to, exchange, message.performative);
            }
        }
        self.router.broadcast(&self.id, message.performative, acl::encode(message));
    }

    /// Sends a message to the agent `to` again, unchanged.
    pub(crate) fn repeat(&self, to: &AgentId, message: &Message) {
        tracing::debug!(agent = %self.id, %to, id = %message.id, "repeats");
        self.router.send(to, Subject::Message(message.performative), acl::encode(message));
    }

    /// Sends the receipts that this agent owes.
    pub(crate) fn send_receipts(&mut self) {
        let directory = self.router.directory();
        for ((to, incarnation), payload) in self.receipts.take() {
            let resident =
                directory.find_incarnation(&to, incarnation).or_else(|| directory.find(&to));
            if let Some(resident) = resident {
                self.router.send_to(&address(resident), Subject::Receipt, payload);
            }
        }
    }

    /// Answers that a message could not be understood; never answers a `not-understood`.
    pub(crate) fn not_understood(&mut self, message: &Message, reason: Reason, detail: String) {
        if message.performative == Performative::NotUnderstood {
            return;
        }
        tracing::info!(agent = %self.id, from = %message.sender, performative = %message.performative,
            conversation = %message.conversation_id, detail, "not understood");
        let sketch = Sketch {
            id: Some(message.id.clone()),
            sender: Some(message.sender.clone()),
            incarnation: Some(message.incarnation),
            conversation_id: Some(message.conversation_id.clone()),
            exchange: message.exchange().cloned(),
            performative: None,
        };
        self.say_not_understood(sketch, message.protocol, reason, detail);
    }

    fn say_not_understood(
        &mut self,
        sketch: Sketch,
        protocol: Option<Protocol>,
        reason: Reason,
        detail: String,
    ) {
        let Some(sender) = sketch.sender.filter(|sender| *sender != self.id) else { return };
        let conversation = sketch.conversation_id.unwrap_or_else(|| ConversationId::new("unknown"));
        let content = value(&Refusal::new(reason, detail));
        let mut message = self.message(Performative::NotUnderstood, conversation, content);
        message.protocol = protocol;
        message.in_reply_to = sketch.exchange;
        message.receiver.push(sender);
        let _ = self.post(&message, ANSWER_RETRIED);
    }

    // === receiving ===

    /// Whether a broadcast is new. A broadcast that opens an exchange may be sent again to agents
    /// that did not answer, so it is checked for duplicates. Any other broadcast counts as new,
    /// because each one replaces the one before it.
    pub(crate) fn is_new(&mut self, message: &Message) -> bool {
        message.reply_with.is_none()
            || self.door.receive(&message.sender, &message.id) == MessageState::New
    }

    /// Whether this agent is among the receivers of a broadcast. If so, the broadcast also replaces
    /// the receipts for messages that this agent has sent in the same exchange.
    pub(crate) fn concerns_me(&mut self, message: &Message) -> bool {
        let is_concerned = message.receiver.is_empty() || message.receiver.contains(&self.id);
        if let Some(exchange) = message.in_reply_to.as_ref().filter(|_| is_concerned) {
            self.outbox.replied(exchange, &message.sender, message.performative);
        }
        is_concerned
    }

    /// Decodes a message. If the message is unreadable, is refused, or is a duplicate, handles it
    /// completely and returns [`IncomingMessage::Nothing`].
    pub(crate) fn read(&mut self, payload: &[u8]) -> IncomingMessage {
        let message = match acl::decode(payload) {
            Ok(message) => message,
            Err(error) => match error.to_not_understood() {
                Some(message) => message,
                None => {
                    self.unreadable(error);
                    return IncomingMessage::Nothing;
                }
            },
        };
        let is_full = message.opens_exchange() && !self.outbox.has_room();
        if is_full {
            self.door.refuse(&message.sender, &message.id);
        }
        let passed = self.door.receive(&message.sender, &message.id);
        if passed == MessageState::Refused {
            self.turn_away(message);
            return IncomingMessage::Nothing;
        }
        if message.performative.is_retried() {
            let sender = (message.sender.clone(), message.incarnation);
            let (id, until) = (message.id.clone(), ImplicitReceipt::of(&message));
            self.receipts.owe(sender, id, until, Instant::now());
        }
        if passed == MessageState::Before {
            tracing::debug!(agent = %self.id, id = %message.id, "received before");
            return IncomingMessage::Nothing;
        }
        tracing::debug!(agent = %self.id, conversation = %message.conversation_id,
            performative = %message.performative, from = %message.sender, id = %message.id,
            "receives");
        match message.in_reply_to.clone() {
            Some(exchange) => {
                self.outbox.replied(&exchange, &message.sender, message.performative);
                IncomingMessage::Continues(exchange, Box::new(message))
            }
            None => IncomingMessage::Opens(Box::new(message)),
        }
    }

    /// Refuses a message because no answer could be sent now, or because a copy of the message was
    /// refused. The refusal is not retried: a sender that misses the refusal sends its message
    /// again and gets another refusal.
    fn turn_away(&mut self, message: Message) {
        let detail = format!("`{}` is busy: too much is under way; ask again later", self.id);
        tracing::debug!(agent = %self.id, from = %message.sender, id = %message.id, detail, "refuses");
        let to = message.sender.clone();
        let refusal = refusal(&self.id, self.incarnation, message, Reason::Busy, detail);
        self.router.send(&to, Subject::Message(Performative::Refuse), acl::encode(&refusal));
    }

    fn unreadable(&mut self, error: DecodeError) {
        tracing::info!(agent = %self.id, from = ?error.sketch.sender, %error, "unreadable");
        let is_not_understood =
            error.sketch.performative.as_deref() == Some(Performative::NotUnderstood.as_str());
        if !is_not_understood {
            let detail = error.problem.to_string();
            self.say_not_understood(*error.sketch, None, Reason::Unreadable, detail);
        }
    }

    /// Begins to track the exchange that `message` opens, and returns `true`. If the protocol does
    /// not allow this opening, answers with `not-understood` and returns `false`. A message that
    /// opens no exchange is allowed, and not tracked.
    pub(crate) fn engage(&mut self, message: &Message) -> bool {
        let (Some(token), Some(protocol)) = (&message.reply_with, message.protocol) else {
            return true;
        };
        let mut exchange = Exchange::new(protocol, message.sender.clone(), message.incarnation);
        if let Err(violation) = exchange.advance(message) {
            self.not_understood(message, Reason::OutOfTurn, violation.to_string());
            return false;
        }
        let key = (token.clone(), message.sender.clone());
        if self.engagements_order.len() >= ENGAGEMENTS_MAX
            && let Some(oldest) = self.engagements_order.pop_front()
        {
            self.participations.remove(&oldest);
        }
        if self.engagements_order.len() > self.participations.len() * 2 + OVER_MAX {
            let followed = &self.participations;
            self.engagements_order.retain(|key| followed.contains_key(key));
        }
        self.engagements_order.push_back(key.clone());
        self.participations.insert(key, exchange);
        true
    }

    /// Whether a message continues an exchange that its sender opened with this agent. If so, the
    /// tracked exchange advances. A turn that the protocol does not allow is answered with
    /// `not-understood`.
    pub(crate) fn continues_engagement(&mut self, message: &Message) -> bool {
        let Some(token) = &message.in_reply_to else { return false };
        let key = (token.clone(), message.sender.clone());
        let Some(exchange) = self.participations.get_mut(&key) else { return false };
        match exchange.advance(message) {
            Ok(phase) => {
                if phase == ExchangePhase::Closed {
                    self.participations.remove(&key);
                }
                true
            }
            Err(violation) => {
                self.not_understood(message, Reason::OutOfTurn, violation.to_string());
                false
            }
        }
    }

    /// Keeps a `cancel` that arrived before the opening of its exchange, and drops any other
    /// message. If the exchange is over already, the `cancel` stays until later ones displace it.
    pub(crate) fn keep_early(&mut self, message: Message) {
        if message.performative == Performative::Cancel {
            if self.early.len() >= EARLY_TURNS_MAX {
                self.early.pop_front();
            }
            self.early.push_back(message);
        }
    }

    /// Removes and returns the kept `cancel` that arrived before `opening`; `None` if there is
    /// none.
    pub(crate) fn take_early(&mut self, opening: &Message) -> Option<Message> {
        let token = opening.reply_with.as_ref()?;
        let follows = |early: &Message| {
            early.in_reply_to.as_ref() == Some(token) && early.sender == opening.sender
        };
        let index = self.early.iter().position(follows)?;
        self.early.remove(index)
    }

    fn advance_engagement(&mut self, key: &(ReplyToken, AgentId), message: &Message) {
        let Some(exchange) = self.participations.get_mut(key) else { return };
        if let Err(violation) = exchange.advance(message) {
            // A bug of this agent; the other side will report it too.
            tracing::error!(agent = %self.id, %violation, "this agent breaks its protocol");
        }
        if exchange.is_closed() {
            self.participations.remove(key);
        }
    }

    // === time and presence ===

    pub(crate) fn received(&mut self, ids: &[MessageId]) {
        for id in ids {
            self.outbox.received(id);
        }
    }

    pub(crate) fn forget_exchange(&mut self, exchange: &ReplyToken) {
        self.outbox.forget(exchange);
    }

    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.outbox.next_due().into_iter().chain(self.receipts.due()).min()
    }

    /// Sends the receipts and the retries that are due. Returns each exchange of which a message
    /// could not be delivered, with the reason.
    pub(crate) fn retry(&mut self) -> Vec<(ReplyToken, DeliveryError)> {
        let now = Instant::now();
        if self.receipts.due().is_some_and(|due| due <= now) {
            self.send_receipts();
        }
        let due = self.outbox.due(&self.router.directory(), now);
        self.carry_out(due)
    }

    /// Whether a message of this agent has no receipt yet.
    pub(crate) fn awaits_receipts(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// Updates the outbox when another agent joins or leaves. Returns each exchange of which a
    /// message could not be delivered, with the reason.
    pub(crate) fn presence(&mut self, presence: &Presence) -> Vec<(ReplyToken, DeliveryError)> {
        let now = Instant::now();
        match presence {
            Presence::Joined(resident) => {
                let due = self.outbox.joined(resident, now);
                self.carry_out(due)
            }
            Presence::Left(resident) => {
                self.outbox.left(&resident.agent, &self.router.directory(), now);
                Vec::new()
            }
        }
    }

    fn carry_out(&mut self, due: Vec<DueAction>) -> Vec<(ReplyToken, DeliveryError)> {
        let mut undelivered = Vec::new();
        let directory = self.router.directory();
        for due in due {
            match due {
                DueAction::Send(parcel) => {
                    let subject = Subject::Message(parcel.performative);
                    if let Some(resident) = parcel.receiver(&directory) {
                        self.router.send_to(&address(resident), subject, parcel.payload);
                    }
                }
                DueAction::GiveUp(id, parcel, why) => {
                    tracing::info!(agent = %self.id, to = %parcel.to, %id, %why, "undelivered");
                    undelivered.extend(parcel.exchange.map(|exchange| (exchange, why)));
                }
            }
        }
        undelivered
    }
}

/// Returns the address at which an agent is reached: its daemon and its name.
fn address(resident: &Resident) -> AgentAddress {
    AgentAddress { daemon: resident.daemon.clone(), agent: resident.agent.clone() }
}
