//! Operations of a callback: open an exchange, answer, set a timer, run work in the background.
//!
//! No operation blocks. A callback changes the state of its agent and returns. The results of
//! operations that it began (an answer, a timeout, finished work) arrive as other callbacks on the same
//! task, so no other code can touch the agent's state in between.

use std::collections::{BTreeMap, HashMap};
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Heartbeat, Inform, Reason, Refusal, value};
use acl::{AgentId, ConversationId, Incarnation, Message, MessageId, Performative, ReplyToken};
use bytes::Bytes;
use conversation::Exchange;
use serde_json::Value;
use substrate::{BoxFuture, Rejected, Resident, Resource, ResourceQuery, ViolationKind};
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

use crate::base_agent::{Agent, LaunchContext, LaunchError, LaunchableAgent};
use crate::communication_agent::{
    CommunicationAgent, DeliveryError, ExchangeEvent, ExchangeOpening, Participation,
};
use crate::directory::Directory;
use crate::router::MessageRouter;
use crate::settings::AgentSettings;

/// Most turns of one exchange that are kept because the turn before them has not arrived yet. A
/// protocol has few turns, and each comes once.
const EARLY_TURNS_MAX: usize = 32;

/// Wait before a request that a standby has declined is sent again, to the leader. The daemons agree on
/// which replica is the leader within a few milliseconds, or as soon as they are connected.
const ASK_WHO_ACTS: Duration = Duration::from_millis(25);

/// Most times that a request declined by standbys is sent again before the initiator gets the refusal.
const ASKED_WHO_ACTS_MAX: u32 = 40;

pub(crate) type DeferredCallback<A> = Box<dyn FnOnce(&mut A, &mut Context<A>) + Send>;
type ExchangeCallback<A> = Box<dyn FnMut(&mut A, ExchangeEvent, &mut Context<A>) + Send>;

/// Operations that are available to a callback of agent `A`.
pub struct Context<A: Agent> {
    pub(crate) communication: CommunicationAgent,
    exchanges: HashMap<ReplyToken, OpenExchange<A>>,
    timers: BTreeMap<TimerId, DeferredCallback<A>>,
    timers_count: u64,
    /// Background work that is under way, or has finished and waits for its callback.
    work: JoinSet<DeferredCallback<A>>,
}

/// The exchanges that an agent has opened and not closed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExchangeSummary {
    /// Number of open exchanges.
    pub open_count: usize,
    /// Earliest deadline among the open exchanges; `None` if no exchange is open.
    pub due: Option<Instant>,
}

struct OpenExchange<A: Agent> {
    protocol: acl::Protocol,
    conversation: ConversationId,
    /// Participant that the exchange was opened with; `None` for a broadcast.
    to: Option<AgentId>,
    /// Message that opened the exchange.
    opening: Box<Message>,
    /// Number of times that a standby has declined the opening.
    declined: u32,
    /// State of the exchange after the opening, with which each participant that answers begins.
    begun: Exchange,
    participants: BTreeMap<AgentId, Exchange>,
    /// Turns that arrived before the turn that they follow, which is being sent again.
    early: Vec<Message>,
    timer: TimerId,
    on_answer: Option<ExchangeCallback<A>>,
}

/// Identifies a timer, by the time when it is due and its number among the timers of that instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TimerId(Instant, u64);

/// Handle of background work. Dropping the handle aborts the work. The callback of the work does not
/// run then, even if the work had finished before.
#[derive(Debug)]
pub struct WorkHandle {
    task: AbortHandle,
    _awaited: Arc<()>,
}

/// Handle of an agent that another agent has started; dropping it stops that agent.
#[derive(Debug)]
pub struct ChildHandle {
    stopping: CancellationToken,
    _work: WorkHandle,
}

impl Drop for ChildHandle {
    fn drop(&mut self) {
        self.stopping.cancel();
    }
}

impl Drop for WorkHandle {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl<A: Agent> Context<A> {
    pub(crate) fn new(communication: CommunicationAgent) -> Context<A> {
        Context {
            communication,
            exchanges: HashMap::new(),
            timers: BTreeMap::new(),
            timers_count: 0,
            work: JoinSet::new(),
        }
    }

    // === identity and directory ===

    /// Returns the name of this agent.
    pub fn id(&self) -> &AgentId {
        &self.communication.id
    }

    /// Returns the incarnation of this agent.
    pub fn incarnation(&self) -> Incarnation {
        self.communication.incarnation
    }

    /// Returns the settings of all agents of the ecosystem.
    pub fn settings(&self) -> &AgentSettings {
        self.router().settings()
    }

    /// Returns the router of the daemon.
    pub fn router(&self) -> &Arc<MessageRouter> {
        &self.communication.switchboard
    }

    /// Returns the directory of the present agents, as this daemon sees them.
    pub fn directory(&self) -> Arc<Directory> {
        self.router().directory()
    }

    /// Returns the agent that holds a name; `None` if no agent of that name is present.
    pub fn find(&self, agent: &AgentId) -> Option<Resident> {
        self.router().find(agent)
    }

    /// Returns the present time, on the clock that all deadlines use.
    pub fn now(&self) -> Instant {
        Instant::now()
    }

    /// Returns a summary of the exchanges that this agent has open.
    pub fn exchanges(&self) -> ExchangeSummary {
        let due = self.exchanges.values().map(|open| open.timer.0).min();
        ExchangeSummary { open_count: self.exchanges.len(), due }
    }

    /// Queries `resource` of the agent that holds the name `of`, at the daemon of that agent only;
    /// waiting for other daemons would make the answer old. Returns an empty list if no agent holds the
    /// name, or if no answer comes in time.
    pub fn ask(&self, resource: Resource, of: &AgentId) -> BoxFuture<Vec<Bytes>> {
        let Some(resident) = self.find(of) else {
            return Box::pin(std::future::ready(Vec::new()));
        };
        let ask =
            ResourceQuery { daemon: Some(resident.daemon), resource, agent: Some(of.clone()) };
        self.router().ask(ask, self.settings().answer_deadline)
    }

    // === sending ===

    /// Creates a name for a new conversation.
    pub fn new_conversation(&mut self) -> ConversationId {
        ConversationId::new(self.communication.token().as_str())
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

    /// Sends the `cfp` that opened an exchange again, to `agent`, which has not answered. A `cfp` has
    /// no receipt, and an agent that has just joined may have missed it. An agent that has received the
    /// `cfp` drops the copy as a duplicate. Does nothing if the opening is retried anyway.
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

    /// Sends the initiator's next turn of an exchange to several participants in one broadcast, which
    /// costs a daemon as much as a message to one agent. The broadcast has no receipt and is not
    /// retried: use this method only if no harm comes from a participant that misses the turn.
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

    /// Builds the initiator's next turn of an exchange, addressed to those participants for which the
    /// protocol allows the turn now. Returns `None` if there are no such participants.
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

    /// Closes an exchange, and sends `cancel` to its participants so that they need not answer any more.
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
                // A participant that misses it goes on until its deadline.
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

    /// Closes an exchange without a message. Messages that this agent has sent in it are still delivered.
    pub fn close(&mut self, token: &ReplyToken) {
        let Some(open) = self.exchanges.remove(token) else { return };
        self.timers.remove(&open.timer);
        for message in open.early {
            let detail = "the message before it has not come".to_owned();
            self.communication.not_understood(&message, Reason::OutOfTurn, detail);
        }
    }

    /// Sends an answer as the participant of an exchange; logs it if the answer cannot be sent.
    pub fn answer(
        &mut self,
        engagement: &Participation,
        performative: Performative,
        content: &impl serde::Serialize,
    ) {
        self.communication.answer(engagement, performative, value(content));
    }

    /// Sends an answer as the participant of an exchange; if that fails, the caller can try it later.
    ///
    /// # Errors
    ///
    /// Returns the reason if the answer cannot be sent now, such as a full outbox.
    pub fn try_answer(
        &mut self,
        engagement: &Participation,
        performative: Performative,
        content: &impl serde::Serialize,
    ) -> Result<(), DeliveryError> {
        self.communication.try_answer(engagement, performative, value(content))
    }

    /// Refuses, as the participant of an exchange, what the initiator asked for.
    pub fn refuse(
        &mut self,
        engagement: &Participation,
        reason: Reason,
        detail: impl Into<String>,
    ) {
        self.answer(engagement, Performative::Refuse, &Refusal::new(reason, detail));
    }

    /// Answers that a message's content could not be understood.
    pub fn not_understood(&mut self, message: &Message, detail: impl Into<String>) {
        self.communication.not_understood(message, Reason::BadContent, detail.into());
    }

    /// Sends a message to one agent outside any exchange, once.
    pub fn send_once(
        &mut self,
        to: &AgentId,
        performative: Performative,
        content: &impl serde::Serialize,
    ) {
        let conversation = ConversationId::new(self.id().as_str());
        let mut message = self.communication.message(performative, conversation, value(content));
        message.receiver.push(to.clone());
        let patience = self.settings().answer_deadline;
        if let Err(why) = self.communication.post(&message, patience) {
            tracing::warn!(agent = %self.id(), %to, %why, "a message could not be sent");
        }
    }

    /// Sends an `inform` to all agents.
    pub fn inform_all(&mut self, inform: &Inform) {
        let conversation = ConversationId::new(self.id().as_str());
        let message = self.communication.message(Performative::Inform, conversation, value(inform));
        let _ = self.communication.post(&message, Duration::ZERO);
    }

    /// Broadcasts the action model or a heartbeat of this agent, as an `inform`.
    pub fn broadcast_state(&mut self, inform: &Inform) {
        let message = self.beating(inform);
        let is_model = matches!(inform, Inform::Model(_));
        self.router().beat(&message.sender, acl::encode(&message), is_model);
    }

    /// Broadcasts a heartbeat of this agent a few milliseconds later, in one batch with heartbeats of
    /// other agents of the same daemon. For heartbeats that are not urgent.
    pub fn batch_heartbeat(&mut self, heartbeat: Heartbeat) {
        let message = self.beating(&Inform::Heartbeat(heartbeat));
        self.router().beat_together(&message.sender, acl::encode(&message));
    }

    fn beating(&mut self, inform: &Inform) -> Message {
        let conversation = ConversationId::new(self.id().as_str());
        self.communication.message(Performative::Inform, conversation, value(inform))
    }

    // === waiting and working ===

    /// Calls `then` once, after the time `wait`. Returns the timer.
    pub fn after(
        &mut self,
        wait: Duration,
        then: impl FnOnce(&mut A, &mut Context<A>) + Send + 'static,
    ) -> TimerId {
        self.timers_count += 1;
        let id = TimerId(Instant::now() + wait, self.timers_count);
        self.timers.insert(id, Box::new(then));
        id
    }

    /// Cancels a timer.
    pub fn cancel_timer(&mut self, timer: TimerId) {
        self.timers.remove(&timer);
    }

    /// Runs `work` in the background and calls `then` with its result. Dropping the returned handle
    /// aborts the work.
    pub fn run<T: Send + 'static>(
        &mut self,
        work: impl Future<Output = T> + Send + 'static,
        then: impl FnOnce(&mut A, T, &mut Context<A>) + Send + 'static,
    ) -> WorkHandle {
        let awaited = Arc::new(());
        let is_awaited = Arc::downgrade(&awaited);
        let deferred = async move {
            let outcome = work.await;
            let deferred: DeferredCallback<A> = Box::new(move |agent, ctx| {
                if is_awaited.strong_count() > 0 {
                    then(agent, outcome, ctx);
                }
            });
            deferred
        };
        let task = self.work.spawn(deferred.instrument(tracing::Span::current()));
        WorkHandle { task, _awaited: awaited }
    }

    /// Starts another agent, a child, on this daemon. If the child ends by itself, calls `then` with
    /// the error of the child, if there is one. The child stops when the returned handle is dropped, or
    /// when this agent stops.
    pub fn spawn_child(
        &mut self,
        id: AgentId,
        agent: Box<dyn LaunchableAgent>,
        then: impl FnOnce(&mut A, Option<LaunchError>, &mut Context<A>) + Send + 'static,
    ) -> ChildHandle {
        let stopping = CancellationToken::new();
        let berth = LaunchContext {
            id,
            incarnation: self.router().host_services().next_incarnation(),
            router: Arc::clone(self.router()),
            ontology: self.communication.ontology(),
            stopping: stopping.clone(),
            has_replicas: false,
            via: [].into(),
        };
        let life = agent.launch(berth);
        let work = self.run(life, |agent: &mut A, ended, ctx| {
            // A panic is on stderr already, with its place.
            then(agent, ended.ok().and_then(Result::err), ctx);
        });
        ChildHandle { stopping, _work: work }
    }

    /// Runs a computation in the background, on a thread that may be busy for long, once a permit is
    /// free. Calls `then` with the result. A computation cannot be aborted from outside: to stop it
    /// early, give it a flag that it checks.
    pub fn compute<T: Send + 'static>(
        &mut self,
        compute: impl FnOnce() -> T + Send + 'static,
        then: impl FnOnce(&mut A, T, &mut Context<A>) + Send + 'static,
    ) -> WorkHandle {
        let computed = self.router().host_services().compute(compute);
        self.run(computed, |agent, outcome, ctx| match outcome {
            Ok(outcome) => then(agent, outcome, ctx),
            Err(error) => tracing::error!(agent = %ctx.id(), %error, "a computation was lost"),
        })
    }

    // === for the Base Agent ===

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
        self.router().rejections.note(&Rejected {
            violation: ViolationKind::Unauthorized,
            detail: &detail,
            claimed: Some(message.sender.as_str()),
            key: message.exchange().map_or("", ReplyToken::as_str),
        });
        let detail = format!("only `{asked}` was asked");
        self.communication.not_understood(message, Reason::OutOfTurn, detail);
    }

    /// Sends the opening of an exchange again, to the present leader among the replicas of the agent
    /// that the exchange was opened with. Call this method if the replica that answered is gone,
    /// because it may not have notified the other replicas of the exchange.
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
        // Under a new id, because a replica that was a standby has the old one in its duplicate window.
        let id = MessageId::new(self.communication.token().as_str());
        let again = Message { id, ..opening };
        let patience = self.settings().answer_deadline;
        if let Err(why) = self.communication.post(&again, patience) {
            tracing::warn!(agent = %self.id(), %why, "could not be asked again");
        }
    }

    /// Removes and returns a kept turn that arrived too early and can follow now; `None` if there is
    /// none.
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

    /// Closes each exchange of which a message could not be delivered, after calling its callback.
    pub(crate) fn undelivered(&mut self, agent: &mut A, lost: Vec<(ReplyToken, DeliveryError)>) {
        for (token, why) in lost {
            self.end(agent, &token, ExchangeEvent::Undelivered(why));
        }
    }

    /// Waits until some background work finishes, and returns the callback of that work; `None` if no
    /// work is under way.
    pub(crate) async fn finished(&mut self) -> Option<DeferredCallback<A>> {
        loop {
            match self.work.join_next().await? {
                Ok(deferred) => return Some(deferred),
                // Its handle was dropped.
                Err(error) if error.is_cancelled() => (),
                // The panic itself is on stderr already, with its place.
                Err(error) => tracing::error!(agent = %self.id(), %error, "work was lost"),
            }
        }
    }

    /// Reports which exchanges the agent waits in; has an effect on a simulated machine only.
    pub(crate) fn tell_waits(&self) {
        let waits = || self.exchanges();
        self.router().host_services().tell_waits(self.id(), self.incarnation(), waits);
    }

    pub(crate) fn next_due(&self) -> Option<Instant> {
        let timer = self.timers.keys().next().map(|TimerId(due, _)| *due);
        timer.into_iter().chain(self.communication.next_due()).min()
    }

    pub(crate) fn due_timer(&mut self) -> Option<DeferredCallback<A>> {
        let first = self.timers.first_entry()?;
        (first.key().0 <= Instant::now()).then(|| first.remove())
    }
}

/// Whether `message` is a refusal by a standby.
fn stands_by(message: &Message) -> bool {
    let is_refusal = message.performative == Performative::Refuse;
    let reason = || message.content_as::<Refusal>().map(|refusal| refusal.reason);
    is_refusal && reason().is_ok_and(|reason| reason == Reason::StandingBy)
}
