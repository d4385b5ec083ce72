//! What a callback can do: open an exchange, answer, wait, work aside.
//!
//! Nothing here waits. A callback changes its agent's state and returns; whatever comes of what
//! it began (an answer, silence, a finished piece of work) comes back as another callback, on the
//! same task, so nothing else can touch the agent's state in between.

use std::collections::{BTreeMap, HashMap};
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Heartbeat, Inform, Reason, Refusal, value};
use acl::{AgentId, ConversationId, Incarnation, Message, MessageId, Performative, ReplyToken};
use bytes::Bytes;
use conversation::Exchange;
use serde_json::Value;
use substrate::{Ask, BoxFuture, Breach, Rejected, Resident, Resource};
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

use crate::base_agent::{Agent, Berth, Launch, LaunchError};
use crate::communication_agent::{Answer, CommunicationAgent, Engagement, Opening, Undelivered};
use crate::directory::Directory;
use crate::settings::Settings;
use crate::switchboard::Switchboard;

/// Turns of one exchange that wait for what they follow: a protocol has few, and each comes once.
const EARLY_TURNS_MAX: usize = 32;

/// How long before who stands by is asked again, or who acts: the daemons' views of who that is
/// agree within a few milliseconds, or as soon as they are linked.
const ASK_WHO_ACTS: Duration = Duration::from_millis(25);

/// How often, before it is told to who asked.
const ASKED_WHO_ACTS_MAX: u32 = 40;

pub(crate) type Deferred<A> = Box<dyn FnOnce(&mut A, &mut Context<A>) + Send>;
type OnAnswer<A> = Box<dyn FnMut(&mut A, Answer, &mut Context<A>) + Send>;

/// What a callback of `A` can do.
pub struct Context<A: Agent> {
    pub(crate) communication: CommunicationAgent,
    exchanges: HashMap<ReplyToken, Open<A>>,
    timers: BTreeMap<TimerId, Deferred<A>>,
    timers_count: u64,
    /// Under way aside, or finished and waiting for its callback.
    work: JoinSet<Deferred<A>>,
}

/// The exchanges an agent opened and has not closed: what it waits for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exchanges {
    /// How many.
    pub open_count: usize,
    /// When the first of them is over, if nothing ends it before.
    pub due: Option<Instant>,
}

struct Open<A: Agent> {
    protocol: acl::Protocol,
    conversation: ConversationId,
    /// Whom it was opened with; `None`: all.
    to: Option<AgentId>,
    /// What was said.
    opening: Box<Message>,
    /// How often it was asked of one who stands by.
    declined: u32,
    /// One per participant that has answered, begun from this.
    begun: Exchange,
    participants: BTreeMap<AgentId, Exchange>,
    /// Turns that have overtaken what their senders said before them: that was lost on its way,
    /// and is being sent again.
    early: Vec<Message>,
    timer: TimerId,
    on_answer: Option<OnAnswer<A>>,
}

/// Names a timer: when it is due, and a number that keeps two of one instant apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TimerId(Instant, u64);

/// A piece of work aside; ends when it is dropped, and nothing comes of it then: also where it was
/// done already, and its agent had not been told.
#[derive(Debug)]
pub struct Work {
    task: AbortHandle,
    _awaited: Arc<()>,
}

/// An agent that another has brought; it leaves when this is dropped.
#[derive(Debug)]
pub struct Brought {
    stopping: CancellationToken,
    _work: Work,
}

impl Drop for Brought {
    fn drop(&mut self) {
        self.stopping.cancel();
    }
}

impl Drop for Work {
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

    // === who and where ===

    /// This agent.
    pub fn id(&self) -> &AgentId {
        &self.communication.id
    }

    /// Which life of it.
    pub fn incarnation(&self) -> Incarnation {
        self.communication.incarnation
    }

    /// Times and bounds.
    pub fn settings(&self) -> &Settings {
        self.switchboard().settings()
    }

    /// The daemon's own end of the substrate.
    pub fn switchboard(&self) -> &Arc<Switchboard> {
        &self.communication.switchboard
    }

    /// Who is here.
    pub fn directory(&self) -> Arc<Directory> {
        self.switchboard().directory()
    }

    /// Who holds a name.
    pub fn find(&self, agent: &AgentId) -> Option<Resident> {
        self.switchboard().find(agent)
    }

    /// Now, on the clock that all deadlines are told by.
    pub fn now(&self) -> Instant {
        Instant::now()
    }

    /// The exchanges this agent waits in.
    pub fn exchanges(&self) -> Exchanges {
        let due = self.exchanges.values().map(|open| open.timer.0).min();
        Exchanges { open_count: self.exchanges.len(), due }
    }

    /// Asks who holds a name for what it has to give. Only that one is waited for: an answer that waits
    /// for others is old when it is read.
    pub fn ask(&self, resource: Resource, of: &AgentId) -> BoxFuture<Vec<Bytes>> {
        let Some(resident) = self.find(of) else {
            return Box::pin(std::future::ready(Vec::new()));
        };
        let ask = Ask { daemon: Some(resident.daemon), resource, agent: Some(of.clone()) };
        self.switchboard().ask(ask, self.settings().answer_deadline)
    }

    // === saying ===

    /// A name for a new conversation.
    pub fn new_conversation(&mut self) -> ConversationId {
        ConversationId::new(self.communication.token().as_str())
    }

    /// Opens an exchange. Every answer goes to `on_answer`, until the protocol ends it,
    /// [`Context::close`] is called, or `patience` has passed ([`Answer::Silence`]).
    pub fn open(
        &mut self,
        opening: Opening,
        patience: Duration,
        on_answer: impl FnMut(&mut A, Answer, &mut Context<A>) + Send + 'static,
    ) -> ReplyToken {
        let token = self.communication.token();
        let mut begun = Exchange::new(opening.protocol, self.id().clone(), self.incarnation());
        let expired = token.clone();
        let timer = self.after(patience, move |agent, ctx| {
            ctx.end(agent, &expired, Answer::Silence);
        });
        let (protocol, conversation) = (opening.protocol, opening.conversation.clone());
        let (opening, sent) = self.communication.open(opening, &token, patience);
        if let Err(violation) = begun.advance(&opening) {
            tracing::error!(agent = %self.id(), %violation, "this agent breaks its protocol");
        }
        let (participants, early) = (BTreeMap::new(), Vec::new());
        let on_answer: OnAnswer<A> = Box::new(on_answer);
        let on_answer = Some(on_answer);
        let open = Open {
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
                ctx.end(agent, &failed, Answer::Undelivered(why));
            });
        }
        token
    }

    /// Repeats the `cfp` that opened an exchange to `agent`, who has not answered: a call has no
    /// receipts, and whoever has just come may not have heard it. Those who did hear it hear
    /// nothing new.
    pub fn remind(&mut self, token: &ReplyToken, agent: &AgentId) {
        let opening = self.exchanges.get(token).map(|open| &*open.opening);
        let is_call = |opening: &&Message| !opening.performative.is_retried();
        let Some(mut message) = opening.filter(is_call).cloned() else { return };
        message.receiver = vec![agent.clone()];
        self.communication.repeat(agent, &message);
    }

    /// Goes on as the initiator of an exchange: `cancel`, `accept-proposal`, `reject-proposal`.
    pub fn go_on(
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

    /// Goes on with several participants of an exchange in one message to all, which costs a daemon
    /// as much as one to a single agent. Nobody gives a receipt for it, and it is not said again:
    /// only for what changes nothing where it is not heard.
    pub fn go_on_with(
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

    /// The initiator's next turn in an exchange, to those of whom the protocol allows it; `None` if
    /// that is nobody.
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

    /// Stops waiting in an exchange, and tells those whom it was opened with that they need not
    /// answer any more.
    pub fn withdraw(&mut self, token: &ReplyToken, why: &impl serde::Serialize) {
        let Some(open) = self.exchanges.get(token) else { return };
        match open.to.clone() {
            Some(to) => self.go_on(token, &to, Performative::Cancel, value(why)),
            None => {
                let (protocol, conversation) = (open.protocol, open.conversation.clone());
                let cancel = Performative::Cancel;
                let mut message = self.communication.message(cancel, conversation, value(why));
                message.protocol = Some(protocol);
                message.in_reply_to = Some(token.clone());
                // Whom it does not reach goes on until the deadline.
                let _ = self.communication.post(&message, Duration::ZERO);
            }
        }
        self.close(token);
    }

    /// Gives an exchange more time, from now.
    pub fn extend(&mut self, token: &ReplyToken, patience: Duration) {
        let expired = token.clone();
        let Some(open) = self.exchanges.get(token) else { return };
        let old = open.timer;
        self.timers.remove(&old);
        let timer = self.after(patience, move |agent, ctx| {
            ctx.end(agent, &expired, Answer::Silence);
        });
        if let Some(open) = self.exchanges.get_mut(token) {
            open.timer = timer;
        }
    }

    /// Stops waiting in an exchange. What this agent said in it goes on being delivered.
    pub fn close(&mut self, token: &ReplyToken) {
        let Some(open) = self.exchanges.remove(token) else { return };
        self.timers.remove(&open.timer);
        for message in open.early {
            let detail = "the message before it has not come".to_owned();
            self.communication.not_understood(&message, Reason::OutOfTurn, detail);
        }
    }

    /// Answers as the participant of an exchange.
    pub fn answer(
        &mut self,
        engagement: &Engagement,
        performative: Performative,
        content: &impl serde::Serialize,
    ) {
        self.communication.answer(engagement, performative, value(content));
    }

    /// Answers as the participant of an exchange, or says why that cannot be said now: for what has to
    /// be said later then.
    pub fn try_answer(
        &mut self,
        engagement: &Engagement,
        performative: Performative,
        content: &impl serde::Serialize,
    ) -> Result<(), Undelivered> {
        self.communication.try_answer(engagement, performative, value(content))
    }

    /// Declines, as the participant of an exchange.
    pub fn refuse(&mut self, engagement: &Engagement, reason: Reason, detail: impl Into<String>) {
        self.answer(engagement, Performative::Refuse, &Refusal::new(reason, detail));
    }

    /// Says that a message's content could not be understood.
    pub fn not_understood(&mut self, message: &Message, detail: impl Into<String>) {
        self.communication.not_understood(message, Reason::BadContent, detail.into());
    }

    /// Tells one agent something outside any exchange, once.
    pub fn tell(
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

    /// Tells all.
    pub fn inform_all(&mut self, inform: &Inform) {
        let conversation = ConversationId::new(self.id().as_str());
        let message = self.communication.message(Performative::Inform, conversation, value(inform));
        let _ = self.communication.post(&message, Duration::ZERO);
    }

    /// Tells all this agent's model or heartbeat, as an `inform`.
    pub fn beat(&mut self, inform: &Inform) {
        let message = self.beating(inform);
        let is_model = matches!(inform, Inform::Model(_));
        self.switchboard().beat(&message.sender, acl::encode(&message), is_model);
    }

    /// Tells all this agent's heartbeat a few milliseconds later, together with those of other
    /// agents of its daemon: for what nobody waits for.
    pub fn beat_together(&mut self, heartbeat: Heartbeat) {
        let message = self.beating(&Inform::Heartbeat(heartbeat));
        self.switchboard().beat_together(&message.sender, acl::encode(&message));
    }

    fn beating(&mut self, inform: &Inform) -> Message {
        let conversation = ConversationId::new(self.id().as_str());
        self.communication.message(Performative::Inform, conversation, value(inform))
    }

    // === waiting and working ===

    /// Calls back after `wait`.
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

    /// Forgets a timer.
    pub fn forget(&mut self, timer: TimerId) {
        self.timers.remove(&timer);
    }

    /// Runs `work` aside and calls back with what came of it. It ends when the handle is dropped.
    pub fn run<T: Send + 'static>(
        &mut self,
        work: impl Future<Output = T> + Send + 'static,
        then: impl FnOnce(&mut A, T, &mut Context<A>) + Send + 'static,
    ) -> Work {
        let awaited = Arc::new(());
        let is_awaited = Arc::downgrade(&awaited);
        let deferred = async move {
            let outcome = work.await;
            let deferred: Deferred<A> = Box::new(move |agent, ctx| {
                if is_awaited.strong_count() > 0 {
                    then(agent, outcome, ctx);
                }
            });
            deferred
        };
        let task = self.work.spawn(deferred.instrument(tracing::Span::current()));
        Work { task, _awaited: awaited }
    }

    /// Lets another agent live beside this one, on its daemon; when it ends by itself, calls back with
    /// why. It leaves when the handle is dropped, and with this agent.
    pub fn bring(
        &mut self,
        id: AgentId,
        agent: Box<dyn Launch>,
        then: impl FnOnce(&mut A, Option<LaunchError>, &mut Context<A>) + Send + 'static,
    ) -> Brought {
        let stopping = CancellationToken::new();
        let berth = Berth {
            id,
            incarnation: self.switchboard().machine().next_life(),
            switchboard: Arc::clone(self.switchboard()),
            ontology: self.communication.ontology(),
            stopping: stopping.clone(),
            stands_by: false,
            via: [].into(),
        };
        let life = agent.launch(berth);
        let work = self.run(life, |agent: &mut A, ended, ctx| {
            // A panic is on stderr already, with its place.
            then(agent, ended.ok().and_then(Result::err), ctx);
        });
        Brought { stopping, _work: work }
    }

    /// Computes aside, on a thread that may be busy for long, when its turn has come, and calls
    /// back with what came of it. A computation cannot be ended from outside: give it a flag of its own.
    pub fn compute<T: Send + 'static>(
        &mut self,
        compute: impl FnOnce() -> T + Send + 'static,
        then: impl FnOnce(&mut A, T, &mut Context<A>) + Send + 'static,
    ) -> Work {
        let computed = self.switchboard().machine().compute(compute);
        self.run(computed, |agent, outcome, ctx| match outcome {
            Ok(outcome) => then(agent, outcome, ctx),
            Err(error) => tracing::error!(agent = %ctx.id(), %error, "a computation was lost"),
        })
    }

    // === for the Base Agent ===

    /// Takes an answer to an exchange this agent opened; gives it back if it is none.
    ///
    /// One that comes too early waits for what it follows, until the exchange ends.
    pub(crate) fn take_answer(
        &mut self,
        agent: &mut A,
        token: &ReplyToken,
        message: Box<Message>,
    ) -> Option<Box<Message>> {
        let Some(open) = self.exchanges.get_mut(token) else { return Some(message) };
        if let Some(to) = open.to.clone().filter(|to| *to != message.sender) {
            self.overheard(&message, &to);
            return None;
        }
        if open.to.is_some() && stands_by(&message) && open.declined < ASKED_WHO_ACTS_MAX {
            open.declined += 1;
            let asked = token.clone();
            self.after(ASK_WHO_ACTS, move |_, ctx| ctx.ask_again(&asked));
            return None;
        }
        let begun = &open.begun;
        let exchange =
            open.participants.entry(message.sender.clone()).or_insert_with(|| begun.clone());
        if let Err(violation) = exchange.advance(&message) {
            if exchange.may_come_to(&message) && open.early.len() < EARLY_TURNS_MAX {
                tracing::debug!(agent = %self.communication.id, id = %message.id, %violation, "waits");
                open.early.push(*message);
            } else {
                let detail = violation.to_string();
                self.communication.not_understood(&message, Reason::OutOfTurn, detail);
            }
            return None;
        }
        let is_closed = exchange.is_closed() && open.to.is_some();
        self.call_back(agent, token, Answer::Message(message));
        if is_closed {
            self.communication.forget_exchange(token);
            self.close(token);
        } else if let Some(next) = self.take_early(token) {
            self.take_answer(agent, token, next);
        }
        None
    }

    /// Turns down an answer of one who was not asked: tokens are read by whoever listens, and what
    /// another says of a robot's deed is nothing.
    fn overheard(&mut self, message: &Message, asked: &AgentId) {
        let detail = format!("answers a question to `{asked}`");
        self.switchboard().rejections.note(&Rejected {
            breach: Breach::Overstepped,
            detail: &detail,
            claimed: Some(message.sender.as_str()),
            key: message.exchange().map_or("", ReplyToken::as_str),
        });
        let detail = format!("only `{asked}` was asked");
        self.communication.not_understood(message, Reason::OutOfTurn, detail);
    }

    /// Says once more what opened an exchange, to who acts now under the name it was opened with:
    /// whoever answered is gone, and may have told nobody.
    pub fn open_again(&mut self, token: &ReplyToken) {
        if let Some(open) = self.exchanges.get_mut(token) {
            (open.participants, open.declined) = (BTreeMap::new(), 0);
            self.ask_again(token);
        }
    }

    /// Says once more what opened an exchange, to who acts now under the name.
    fn ask_again(&mut self, token: &ReplyToken) {
        // Who acts may have been asked, and have answered, as soon as it was seen.
        let unanswered = |open: &&Open<A>| open.participants.is_empty();
        let Some(open) = self.exchanges.get(token).filter(unanswered) else { return };
        let opening = (*open.opening).clone();
        // Under a new id: who stood by has heard the other.
        let id = MessageId::new(self.communication.token().as_str());
        let again = Message { id, ..opening };
        let patience = self.settings().answer_deadline;
        if let Err(why) = self.communication.post(&again, patience) {
            tracing::warn!(agent = %self.id(), %why, "could not be asked again");
        }
    }

    /// A turn that came early and follows now.
    fn take_early(&mut self, token: &ReplyToken) -> Option<Box<Message>> {
        let open = self.exchanges.get_mut(token)?;
        let follows = |early: &Message| {
            let exchange = open.participants.get(&early.sender).unwrap_or(&open.begun);
            exchange.clone().advance(early).is_ok()
        };
        let index = open.early.iter().position(follows)?;
        Some(Box::new(open.early.remove(index)))
    }

    /// Ends an exchange with `answer`.
    pub(crate) fn end(&mut self, agent: &mut A, token: &ReplyToken, answer: Answer) {
        self.call_back(agent, token, answer);
        self.close(token);
    }

    fn call_back(&mut self, agent: &mut A, token: &ReplyToken, answer: Answer) {
        let on_answer = self.exchanges.get_mut(token).and_then(|open| open.on_answer.take());
        let Some(mut on_answer) = on_answer else { return };
        on_answer(agent, answer, self);
        if let Some(open) = self.exchanges.get_mut(token) {
            open.on_answer = Some(on_answer);
        }
    }

    /// What nobody will receive closes the exchange with its receiver.
    pub(crate) fn undelivered(&mut self, agent: &mut A, lost: Vec<(ReplyToken, Undelivered)>) {
        for (token, why) in lost {
            self.end(agent, &token, Answer::Undelivered(why));
        }
    }

    /// The callback of the next work that finishes; `None` if none is under way.
    pub(crate) async fn finished(&mut self) -> Option<Deferred<A>> {
        loop {
            match self.work.join_next().await? {
                Ok(deferred) => return Some(deferred),
                // Nobody waits for it any more.
                Err(error) if error.is_cancelled() => (),
                // The panic itself is on stderr already, with its place.
                Err(error) => tracing::error!(agent = %self.id(), %error, "work was lost"),
            }
        }
    }

    /// Says what it waits for, where that is looked at: on a simulated machine.
    pub(crate) fn tell_waits(&self) {
        let waits = || self.exchanges();
        self.switchboard().machine().tell_waits(self.id(), self.incarnation(), waits);
    }

    pub(crate) fn next_due(&self) -> Option<Instant> {
        let timer = self.timers.keys().next().map(|TimerId(due, _)| *due);
        timer.into_iter().chain(self.communication.next_due()).min()
    }

    pub(crate) fn due_timer(&mut self) -> Option<Deferred<A>> {
        let first = self.timers.first_entry()?;
        (first.key().0 <= Instant::now()).then(|| first.remove())
    }
}

/// Whether it says that another agent of the sender's name acts.
fn stands_by(message: &Message) -> bool {
    let is_refusal = message.performative == Performative::Refuse;
    let reason = || message.content_as::<Refusal>().map(|refusal| refusal.reason);
    is_refusal && reason().is_ok_and(|reason| reason == Reason::StandingBy)
}
