//! The Communication Agent (the paper, “The Communication Agent”): one agent's interface to the
//! substrate.
//!
//! - Decodes, answers what cannot be read, drops duplicates, sends receipts.
//! - Retries commitments until a receipt or an answer comes; gives up with a reason.
//! - Follows, as participant, the exchanges that others opened, so that a turn the protocol does
//!   not have is answered and not acted on.
//!
//! Exchanges this agent opened, with their callbacks, are in `context`.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use acl::codec::Sketch;
use acl::content::{Reason, Refusal, value};
use acl::{
    AgentId, ConversationId, Deadline, DecodeError, EcosystemId, Incarnation, Message, MessageId,
    Performative, Protocol, ReplyToken, SCHEMA_VERSION,
};
use conversation::{Exchange, Phase};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use substrate::{Address, Presence, Resident, Subject};
use tokio::time::Instant;

use crate::mailbox::{Door, Passed};
use crate::outbox::{Due, Life, Outbox, Parcel};
use crate::receipts::{Receipts, Until};
use crate::switchboard::Switchboard;

/// Exchanges of others that are followed at a time; beyond it the oldest is forgotten, and a
/// later `cancel` of it is not understood.
const ENGAGEMENTS_MAX: usize = 4_096;

/// Exchanges that are over and are still in the order of those that are followed, beside as many as
/// are followed: more are sorted out.
const OVER_MAX: usize = 64;

/// Turns that came before what opens their exchange: a `cancel` that overtook a lost `request`.
const EARLY_TURNS_MAX: usize = 64;

/// How long an answer is retried that carries no deadline of its own.
const ANSWER_RETRIED: Duration = Duration::from_secs(30);

/// The opening of an exchange.
#[derive(Clone, Debug)]
pub struct Opening {
    /// Who is asked; `None` asks all.
    pub to: Option<AgentId>,
    /// With which act.
    pub performative: Performative,
    /// By which protocol.
    pub protocol: Protocol,
    /// About what.
    pub conversation: ConversationId,
    /// What is said.
    pub content: Value,
}

/// What comes back to the one who opened an exchange.
#[derive(Clone, Debug)]
pub enum Answer {
    /// A turn of the protocol.
    Message(Box<Message>),
    /// The deadline has passed; the exchange is closed.
    Silence,
    /// What this agent said could not be delivered; the exchange is closed.
    Undelivered(Undelivered),
}

/// Why a message could not be delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Undelivered {
    /// Nobody of that name came within the deadline.
    #[error("no agent of that name is here")]
    NotHere,
    /// The receiver left, and the grace has passed.
    #[error("it has left")]
    Left,
    /// The receiver was restarted and knows nothing of it.
    #[error("it was restarted")]
    Restarted,
    /// The receiver is here and did not answer.
    #[error("it gave no receipt in time")]
    NoReceipt,
    /// Too much is under way already.
    #[error("too many messages are under way")]
    OutboxFull,
}

/// The participant's end of an exchange: what it needs to go on answering.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Engagement {
    /// Who asked.
    pub initiator: AgentId,
    /// Which life of it: of several that stand by for each other, the one that asked hears.
    #[serde(default)]
    pub life: Option<Incarnation>,
    /// Which exchange.
    pub exchange: ReplyToken,
    /// About what.
    pub conversation: ConversationId,
    /// By which protocol.
    pub protocol: Option<Protocol>,
}

/// What to do with a letter after it was opened.
#[derive(Debug)]
pub(crate) enum Opened {
    /// It continues an exchange, perhaps one of this agent's.
    Continues(ReplyToken, Box<Message>),
    /// It opens one, or belongs to none.
    Opens(Box<Message>),
    /// It is dealt with.
    Nothing,
}

pub(crate) struct CommunicationAgent {
    pub(crate) id: AgentId,
    pub(crate) incarnation: Incarnation,
    pub(crate) switchboard: Arc<Switchboard>,
    ontology: Arc<str>,
    via: Arc<[EcosystemId]>,
    outbox: Outbox,
    /// The messages that it has heard.
    door: Arc<Door>,
    engagements: BTreeMap<(ReplyToken, AgentId), Exchange>,
    engagements_order: VecDeque<(ReplyToken, AgentId)>,
    early: VecDeque<Message>,
    receipts: Receipts,
    messages_sent: u64,
}

impl Engagement {
    /// The participant's end of the exchange that `message` opened.
    ///
    /// A foreign tool may name no exchange; its message's id stands in.
    pub fn of(message: &Message) -> Engagement {
        let own_id = || ReplyToken::new(message.id.as_str());
        Engagement {
            initiator: message.sender.clone(),
            life: Some(message.incarnation),
            exchange: message.exchange().cloned().unwrap_or_else(own_id),
            conversation: message.conversation_id.clone(),
            protocol: message.protocol,
        }
    }
}

impl CommunicationAgent {
    pub(crate) fn new(
        id: AgentId,
        incarnation: Incarnation,
        switchboard: Arc<Switchboard>,
        ontology: Arc<str>,
        via: Arc<[EcosystemId]>,
        door: Arc<Door>,
    ) -> CommunicationAgent {
        let outbox = Outbox::new(switchboard.settings());
        let receipts = Receipts::new(switchboard.settings().retry_first);
        CommunicationAgent {
            id,
            incarnation,
            switchboard,
            ontology,
            via,
            outbox,
            door,
            engagements: BTreeMap::new(),
            engagements_order: VecDeque::new(),
            early: VecDeque::new(),
            receipts,
            messages_sent: 0,
        }
    }

    // === saying ===

    /// A message of this agent, without a receiver.
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
            reply_by: None,
            via: self.via.to_vec(),
            unknown: Map::new(),
        }
    }

    /// The ontology of what it says.
    pub(crate) fn ontology(&self) -> Arc<str> {
        Arc::clone(&self.ontology)
    }

    /// A token that names a new exchange.
    pub(crate) fn token(&mut self) -> ReplyToken {
        self.messages_sent += 1;
        ReplyToken::new(&format!("{}.{}.{}", self.id, self.incarnation, self.messages_sent))
    }

    /// Opens an exchange.
    pub(crate) fn open(
        &mut self,
        opening: Opening,
        token: &ReplyToken,
        patience: Duration,
    ) -> (Message, Result<(), Undelivered>) {
        let Opening { to, performative, protocol, conversation, content } = opening;
        let mut message = self.message(performative, conversation, content);
        message.protocol = Some(protocol);
        message.reply_with = Some(token.clone());
        message.reply_by = Some(Deadline(patience));
        message.receiver.extend(to);
        let sent = self.post(&message, patience);
        (message, sent)
    }

    /// Answers as the participant of an exchange; an answer that could not be sent is logged.
    pub(crate) fn answer(
        &mut self,
        engagement: &Engagement,
        performative: Performative,
        content: Value,
    ) {
        if let Err(why) = self.try_answer(engagement, performative, content) {
            tracing::warn!(agent = %self.id, conversation = %engagement.conversation, %why,
                "an answer could not be sent");
        }
    }

    /// Answers as the participant of an exchange. What could not be sent has not been said.
    pub(crate) fn try_answer(
        &mut self,
        engagement: &Engagement,
        performative: Performative,
        content: Value,
    ) -> Result<(), Undelivered> {
        let Engagement { initiator, life, exchange, conversation, protocol } = engagement.clone();
        let mut message = self.message(performative, conversation, content);
        message.protocol = protocol;
        message.in_reply_to = Some(exchange.clone());
        message.receiver.push(initiator.clone());
        self.post_to(life, &message, ANSWER_RETRIED)?;
        self.advance_engagement(&(exchange, initiator), &message);
        Ok(())
    }

    /// Sends a message to its receiver, or to all.
    pub(crate) fn post(
        &mut self,
        message: &Message,
        patience: Duration,
    ) -> Result<(), Undelivered> {
        self.post_to(None, message, patience)
    }

    /// Sends a message to its receiver, and no other life of it than this one, where it is known.
    fn post_to(
        &mut self,
        life: Option<Incarnation>,
        message: &Message,
        patience: Duration,
    ) -> Result<(), Undelivered> {
        let payload = acl::encode(message);
        tracing::debug!(agent = %self.id, conversation = %message.conversation_id,
            performative = %message.performative, to = ?message.receiver, id = %message.id, "says");
        let Some(to) = message.receiver.first() else {
            self.switchboard.broadcast(&self.id, message.performative, payload);
            return Ok(());
        };
        let directory = self.switchboard.directory();
        // Who names no life of itself is a stranger's tool: whoever holds its name is meant.
        let life = life.filter(|life| *life != Incarnation::default());
        let resident = match life {
            Some(life) => directory.life(to, life),
            None => directory.find(to),
        };
        if message.performative.is_retried() {
            let parcel = Parcel {
                to: to.clone(),
                life,
                performative: message.performative,
                exchange: message.exchange().cloned(),
                opens: message.opens_exchange(),
                payload: payload.clone(),
                give_up: Instant::now() + patience,
            };
            let life = resident.map(Life::from);
            if !self.outbox.put(message.id.clone(), parcel, life, Instant::now()) {
                return Err(Undelivered::OutboxFull);
            }
        }
        if let Some(exchange) = &message.in_reply_to {
            self.receipts.replied(to, exchange, message.performative);
        }
        if let Some(resident) = resident {
            let subject = Subject::Message(message.performative);
            self.switchboard.send_to(&address(resident), subject, payload);
        }
        Ok(())
    }

    /// Says a turn of an exchange to several of its participants at once: to all, who are not
    /// concerned if they are not named. There are no receipts for it.
    pub(crate) fn say_to_several(&mut self, message: &Message) {
        tracing::debug!(agent = %self.id, conversation = %message.conversation_id,
            performative = %message.performative, to = ?message.receiver, id = %message.id, "says");
        if let Some(exchange) = &message.in_reply_to {
            for to in &message.receiver {
                self.receipts.replied(to, exchange, message.performative);
            }
        }
        self.switchboard.broadcast(&self.id, message.performative, acl::encode(message));
    }

    /// Sends a message once more, as it was.
    pub(crate) fn repeat(&self, to: &AgentId, message: &Message) {
        tracing::debug!(agent = %self.id, %to, id = %message.id, "repeats");
        self.switchboard.send(to, Subject::Message(message.performative), acl::encode(message));
    }

    /// Sends the receipts that are owed.
    pub(crate) fn send_receipts(&mut self) {
        let directory = self.switchboard.directory();
        for ((to, life), payload) in self.receipts.take() {
            let resident = directory.life(&to, life).or_else(|| directory.find(&to));
            if let Some(resident) = resident {
                self.switchboard.send_to(&address(resident), Subject::Receipt, payload);
            }
        }
    }

    /// Says that a message could not be understood. Never to a `not-understood`.
    pub(crate) fn not_understood(&mut self, message: &Message, reason: Reason, detail: String) {
        if message.performative == Performative::NotUnderstood {
            return;
        }
        tracing::info!(agent = %self.id, from = %message.sender, performative = %message.performative,
            conversation = %message.conversation_id, detail, "not understood");
        let sketch = Sketch {
            id: Some(message.id.clone()),
            sender: Some(message.sender.clone()),
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

    // === hearing ===

    /// Whether a message to all is new. Only those that open an exchange are sent again, to
    /// whoever did not answer; of the others the newest counts.
    pub(crate) fn is_new(&mut self, message: &Message) -> bool {
        message.reply_with.is_none() || self.door.hear(&message.id) == Passed::New
    }

    /// A turn to several has come, and its receiver is one of them.
    pub(crate) fn concerns_me(&mut self, message: &Message) -> bool {
        let is_concerned = message.receiver.is_empty() || message.receiver.contains(&self.id);
        if let Some(exchange) = message.in_reply_to.as_ref().filter(|_| is_concerned) {
            self.outbox.replied(exchange, &message.sender, message.performative);
        }
        is_concerned
    }

    /// Opens a letter: what is in it is new and readable, or it is dealt with here.
    pub(crate) fn read(&mut self, payload: &[u8]) -> Opened {
        let message = match acl::decode(payload) {
            Ok(message) => message,
            Err(error) => {
                self.unreadable(error);
                return Opened::Nothing;
            }
        };
        let is_full = message.opens_exchange() && !self.outbox.has_room();
        if is_full {
            self.door.refuse(&message.id);
        }
        let passed = self.door.hear(&message.id);
        if passed == Passed::Refused {
            self.turn_away(message);
            return Opened::Nothing;
        }
        if message.performative.is_retried() {
            let sender = (message.sender.clone(), message.incarnation);
            let (id, until) = (message.id.clone(), Until::of(&message));
            self.receipts.owe(sender, id, until, Instant::now());
        }
        if passed == Passed::Before {
            tracing::debug!(agent = %self.id, id = %message.id, "received before");
            return Opened::Nothing;
        }
        tracing::debug!(agent = %self.id, conversation = %message.conversation_id,
            performative = %message.performative, from = %message.sender, id = %message.id,
            "receives");
        match message.in_reply_to.clone() {
            Some(exchange) => {
                self.outbox.replied(&exchange, &message.sender, message.performative);
                Opened::Continues(exchange, Box::new(message))
            }
            None => Opened::Opens(Box::new(message)),
        }
    }

    /// Refuses a question to which no answer could be told now, or a copy of one that was refused.
    /// The refusal does not stay under way: whoever did not hear it asks again and is told anew.
    fn turn_away(&mut self, message: Message) {
        let detail = format!("`{}` is busy: too much is under way; ask again later", self.id);
        tracing::debug!(agent = %self.id, from = %message.sender, id = %message.id, detail, "refuses");
        let to = message.sender.clone();
        let refusal = self.switchboard.refusal(&self.id, message, Reason::Busy, detail);
        self.switchboard.send(&to, Subject::Message(Performative::Refuse), acl::encode(&refusal));
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

    /// Whether a message that opens an exchange may do so; if so, the exchange is followed.
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
            self.engagements.remove(&oldest);
        }
        if self.engagements_order.len() > self.engagements.len() * 2 + OVER_MAX {
            let followed = &self.engagements;
            self.engagements_order.retain(|key| followed.contains_key(key));
        }
        self.engagements_order.push_back(key.clone());
        self.engagements.insert(key, exchange);
        true
    }

    /// Whether a message continues an exchange that its sender opened with this agent.
    pub(crate) fn continues_engagement(&mut self, message: &Message) -> bool {
        let Some(token) = &message.in_reply_to else { return false };
        let key = (token.clone(), message.sender.clone());
        let Some(exchange) = self.engagements.get_mut(&key) else { return false };
        match exchange.advance(message) {
            Ok(phase) => {
                if phase == Phase::Closed {
                    self.engagements.remove(&key);
                }
                true
            }
            Err(violation) => {
                self.not_understood(message, Reason::OutOfTurn, violation.to_string());
                false
            }
        }
    }

    /// Keeps a `cancel` of an exchange that has not been opened yet; of one that is over, it is
    /// pushed out by the next.
    pub(crate) fn keep_early(&mut self, message: Message) {
        if message.performative == Performative::Cancel {
            if self.early.len() >= EARLY_TURNS_MAX {
                self.early.pop_front();
            }
            self.early.push_back(message);
        }
    }

    /// The turn that came before `opening` and follows it.
    pub(crate) fn take_early(&mut self, opening: &Message) -> Option<Message> {
        let token = opening.reply_with.as_ref()?;
        let follows = |early: &Message| {
            early.in_reply_to.as_ref() == Some(token) && early.sender == opening.sender
        };
        let index = self.early.iter().position(follows)?;
        self.early.remove(index)
    }

    fn advance_engagement(&mut self, key: &(ReplyToken, AgentId), message: &Message) {
        let Some(exchange) = self.engagements.get_mut(key) else { return };
        if let Err(violation) = exchange.advance(message) {
            // Our own bug; the other side will say so too.
            tracing::error!(agent = %self.id, %violation, "this agent breaks its protocol");
        }
        if exchange.is_closed() {
            self.engagements.remove(key);
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

    /// Sends what is due, or due again; yields the exchanges whose messages nobody will receive.
    pub(crate) fn retry(&mut self) -> Vec<(ReplyToken, Undelivered)> {
        let now = Instant::now();
        if self.receipts.due().is_some_and(|due| due <= now) {
            self.send_receipts();
        }
        let due = self.outbox.due(&self.switchboard.directory(), now);
        self.carry_out(due)
    }

    /// Whether something it has said may still not have come.
    pub(crate) fn awaits_receipts(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// Queue operations on an agent's activation or death.
    pub(crate) fn presence(&mut self, presence: &Presence) -> Vec<(ReplyToken, Undelivered)> {
        let now = Instant::now();
        match presence {
            Presence::Joined(resident) => {
                let due = self.outbox.joined(resident, now);
                self.carry_out(due)
            }
            Presence::Left(resident) => {
                self.outbox.left(&resident.agent, &self.switchboard.directory(), now);
                Vec::new()
            }
        }
    }

    fn carry_out(&mut self, due: Vec<Due>) -> Vec<(ReplyToken, Undelivered)> {
        let mut undelivered = Vec::new();
        let directory = self.switchboard.directory();
        for due in due {
            match due {
                Due::Send(parcel) => {
                    let subject = Subject::Message(parcel.performative);
                    if let Some(resident) = parcel.receiver(&directory) {
                        self.switchboard.send_to(&address(resident), subject, parcel.payload);
                    }
                }
                Due::GiveUp(id, parcel, why) => {
                    tracing::info!(agent = %self.id, to = %parcel.to, %id, %why, "undelivered");
                    undelivered.extend(parcel.exchange.map(|exchange| (exchange, why)));
                }
            }
        }
        undelivered
    }
}

/// Where this life is reached.
fn address(resident: &Resident) -> Address {
    Address { daemon: resident.daemon.clone(), agent: resident.agent.clone() }
}
