//! The event loop of an agent: waits for an event, and calls the callbacks of the agent for it.
//!
//! Only waiting is asynchronous. Every event that can wake an agent is an [`AgentEvent`], and one
//! synchronous function handles it.

use std::pin::Pin;
use std::sync::Arc;

use acl::content::Reason;
use acl::{AgentId, Message};
use substrate::{Presence, PresenceToken, ReceivedQuery, Resident};
use tokio::sync::broadcast::{self, error::TryRecvError};
use tokio::task::JoinHandle;
use tokio::time::{Instant, Sleep};
use tokio_util::sync::WaitForCancellationFutureOwned;
use tracing::Instrument;

use crate::base_agent::Agent;
use crate::callbacks::Callbacks;
use crate::communication_agent::{CommunicationAgent, IncomingMessage};
use crate::context::{Context, DeferredCallback};
use crate::directory::Directory;
use crate::exchange::{ExchangeSummary, Participation};
use crate::launch::{LaunchContext, LaunchError, LaunchableAgent};
use crate::leadership::Leadership;
use crate::mailbox::{Mailbox, MailboxItem};
use crate::router::MessageRouter;

impl<A: Agent> LaunchableAgent for A {
    fn model(&self) -> Option<String> {
        Agent::model(self)
    }

    fn launch(self: Box<Self>, context: LaunchContext) -> JoinHandle<Result<(), LaunchError>> {
        let span = tracing::info_span!("agent", id = %context.id);
        tokio::spawn(run_agent(self, context).instrument(span))
    }
}

/// Event that can wake an agent. The list is complete.
enum AgentEvent<A: Agent> {
    Letter(MailboxItem),
    Presence(Presence),
    /// More presence changes arrived than the channel holds. The agent compares directories
    /// instead.
    PresenceMissed,
    /// Background work of the agent has finished; the callback handles its result.
    Finished(DeferredCallback<A>),
    /// A timer or a retry is due.
    Due,
    /// The agent must stop.
    Stopping,
}

struct AgentTask<A: Agent> {
    /// The agent's state. Boxed, because the future of the task would otherwise contain the state
    /// three times, once for each of several steps.
    agent: Box<A>,
    callbacks: Callbacks<A>,
    ctx: Context<A>,
    mailbox: Mailbox,
    presence: broadcast::Receiver<Presence>,
    /// Directory of the present agents, with the presence changes of which the agent was notified
    /// so far. Shares the memory of the daemon's directory if the agent was notified of all
    /// changes. `None` while the agent ignores presence changes, so that idle agents do not keep
    /// outdated directories.
    told: Option<Arc<Directory>>,
    /// Completes when the agent must stop, because its daemon shuts down or its owner stops it.
    /// This future and `alarm` are created once, not for each event. Otherwise a thousand agents
    /// that wake at once would each register both futures with the runtime, and remove them again.
    stopping: Pin<Box<WaitForCancellationFutureOwned>>,
    alarm: Pin<Box<Sleep>>,
    /// Whether the agent is the leader or a standby; `None` for an agent without replicas.
    standing: Option<Leadership>,
    /// Presence token: keeps the agent present until the task ends.
    _token: PresenceToken,
}

async fn run_agent<A: Agent>(agent: Box<A>, context: LaunchContext) -> Result<(), LaunchError> {
    let LaunchContext { id, incarnation, router, ontology, stopping, has_replicas, via } = context;
    if !has_replicas {
        await_name(&id, &router).await?;
    }
    let callbacks = agent.callbacks();
    let mailbox = router.register(&id, incarnation, callbacks.interests());
    if has_replicas {
        router.record_replicas(&id);
    }
    let (told, presence) = router.presence_changes();
    let announced = router.announce(&id, incarnation);
    let _token = announced.map_err(|source| LaunchError::Announce { agent: id.clone(), source })?;
    let communication = CommunicationAgent::new(
        id.clone(),
        incarnation,
        Arc::clone(&router),
        ontology,
        via,
        mailbox.door(),
    );
    let ctx = Context::new(communication);
    let standing = has_replicas.then(|| Leadership::new(Instant::now()));
    let stopping = Box::pin(stopping.cancelled_owned());
    let alarm = Box::pin(tokio::time::sleep_until(Instant::now()));
    let told = Some(told);
    let mut task = AgentTask {
        agent,
        callbacks,
        ctx,
        mailbox,
        presence,
        told,
        stopping,
        alarm,
        standing,
        _token,
    };
    let end = task.run().await;
    router.host_services().tell_waits(&id, incarnation, ExchangeSummary::default);
    task.ctx.communication.send_receipts();
    router.unregister(&id, incarnation);
    end
}

/// Waits until no other agent of the name `id` is present. An earlier incarnation that has ended
/// may still appear present until its lease has expired. Returns an error if the name is still
/// taken at the deadline.
async fn await_name(id: &AgentId, router: &MessageRouter) -> Result<(), LaunchError> {
    let (mut directory, mut changes) = router.presence_changes();
    let deadline = Instant::now() + router.settings().name_awaited();
    while let Some(holder) = directory.find(id).cloned() {
        match tokio::time::timeout_at(deadline, changes.recv()).await {
            Ok(_) => directory = router.directory(),
            Err(_) => return Err(LaunchError::NameTaken { holder }),
        }
    }
    Ok(())
}

impl<A: Agent> AgentTask<A> {
    async fn run(&mut self) -> Result<(), LaunchError> {
        let already: Vec<_> = self.told().iter().cloned().map(Presence::Joined).collect();
        self.agent.activated(&mut self.ctx);
        if self.standing.is_none() {
            self.agent.leadership_changed(true, &mut self.ctx);
        }
        for presence in already {
            self.agent.presence(&presence, &mut self.ctx);
        }
        let mut draining = false;
        loop {
            self.ctx.tell_waits();
            let event = self.next_event(draining).await;
            draining |= matches!(event, AgentEvent::Stopping);
            if !self.heeds_presence() {
                self.catch_up();
            }
            self.handle(event);
            if let Some(holder) = self.usurped() {
                return Err(LaunchError::NameTaken { holder });
            }
            if let Some(holder) = self.twin() {
                return Err(LaunchError::IncarnationTaken { holder });
            }
            if draining && self.agent.drain(&mut self.ctx) {
                return Ok(());
            }
        }
    }

    async fn next_event(&mut self, draining: bool) -> AgentEvent<A> {
        let standing = self.standing.as_ref().and_then(Leadership::due);
        let heeds = self.heeds_presence();
        self.told = if heeds { Some(self.told()) } else { None };
        let due = self.ctx.next_due().into_iter().chain(standing).min();
        if let Some(due) = due.filter(|due| *due != self.alarm.deadline()) {
            self.alarm.as_mut().reset(due);
        }
        tokio::select! {
            biased;
            () = &mut self.stopping, if !draining => AgentEvent::Stopping,
            presence = self.presence.recv(), if heeds => match presence {
                Ok(presence) => AgentEvent::Presence(presence),
                Err(_) => AgentEvent::PresenceMissed,
            },
            Some(deferred) = self.ctx.finished() => AgentEvent::Finished(deferred),
            () = &mut self.alarm, if due.is_some() => AgentEvent::Due,
            letter = self.mailbox.next() => match letter {
                Some(letter) => AgentEvent::Letter(letter),
                None => AgentEvent::Stopping,
            },
        }
    }

    /// Whether this agent must be notified of presence changes now: because the agent wants them,
    /// because it awaits the receipts of messages, or because it has replicas.
    fn heeds_presence(&self) -> bool {
        self.standing.is_some()
            || self.ctx.communication.awaits_receipts()
            || self.agent.wants_presence()
    }

    /// Discards the presence changes that have arrived and were not handled.
    fn catch_up(&mut self) {
        while let Ok(_) | Err(TryRecvError::Lagged(_)) = self.presence.try_recv() {}
    }

    /// Returns the directory of the present agents, with the presence changes of which the agent
    /// was notified so far. An agent that has ignored presence changes begins with the daemon's
    /// present directory.
    fn told(&mut self) -> Arc<Directory> {
        let ctx = &self.ctx;
        Arc::clone(self.told.get_or_insert_with(|| ctx.directory()))
    }

    fn handle(&mut self, event: AgentEvent<A>) {
        match event {
            AgentEvent::Letter(letter) => self.open(letter),
            AgentEvent::Presence(presence) => self.tell(&presence),
            AgentEvent::PresenceMissed => {
                let now = self.ctx.directory();
                for change in self.told().changes_to(&now) {
                    self.tell(&change);
                }
            }
            AgentEvent::Finished(deferred) => deferred(&mut self.agent, &mut self.ctx),
            AgentEvent::Due => self.due(),
            AgentEvent::Stopping => (),
        }
        self.update_leadership();
    }

    /// Checks whether this agent has become the leader or a standby, and notifies the agent of the
    /// change.
    fn update_leadership(&mut self) {
        if self.standing.is_none() {
            return;
        }
        let told = self.told();
        let Some(standing) = &mut self.standing else { return };
        let (id, daemon) = (self.ctx.id(), self.ctx.daemon());
        let is_first = told.find(id).is_some_and(|holder| holder.daemon == *daemon);
        let news = standing.take(is_first, Instant::now());
        let kept = if standing.is_candidate() { Vec::new() } else { standing.kept() };
        if let Some(is_leading) = news {
            tracing::info!(agent = %id, "{}", if is_leading { "is the leader" } else { "is a standby" });
            self.agent.leadership_changed(is_leading, &mut self.ctx);
        }
        kept.into_iter().for_each(|letter| self.open(letter));
    }

    fn open(&mut self, letter: MailboxItem) {
        let Some(letter) = self.meant_for_it(letter) else { return };
        match letter {
            MailboxItem::Direct(payload) => match self.ctx.communication.read(&payload) {
                IncomingMessage::Continues(token, message) => self.continued(&token, message),
                IncomingMessage::Opens(message) => {
                    if self.ctx.communication.engage(&message) {
                        let early = self.ctx.communication.take_early(&message);
                        self.call(*message);
                        if let Some(early) = early {
                            self.turn(early);
                        }
                    }
                }
                IncomingMessage::Nothing => (),
            },
            MailboxItem::Broadcast(message) => self.open_broadcast(Arc::unwrap_or_clone(message)),
            MailboxItem::Replayed(payload) => {
                // The router decoded this payload when it arrived, so it can be decoded again.
                acl::decode(&payload).into_iter().for_each(|message| self.open_broadcast(message));
            }
            MailboxItem::Receipts(ids) => self.ctx.communication.received(&ids),
            MailboxItem::Question(question) => self.asked(&question),
            // Nothing is left to do: the event loop checks for another holder of the name after
            // each event.
            MailboxItem::NameConflict => (),
        }
    }

    /// Returns `letter` if this agent must handle it now. Returns `None` if the agent is a standby
    /// and has declined, kept or dropped `letter`. A standby handles broadcasts, receipts, and
    /// questions that every replica answers. It declines a direct message, or keeps the message
    /// until leadership is decided, and drops a question that only the leader answers.
    fn meant_for_it(&mut self, letter: MailboxItem) -> Option<MailboxItem> {
        let Some(standing) = self.standing.as_mut().filter(|standing| !standing.is_leading())
        else {
            return Some(letter);
        };
        match letter {
            MailboxItem::Question(question) if question.resource.is_answered_by_leader() => None,
            MailboxItem::Direct(payload) if standing.is_candidate() => {
                let overflow = standing.keep(MailboxItem::Direct(payload));
                overflow.into_iter().for_each(|letter| self.decline(letter));
                None
            }
            MailboxItem::Direct(_) => {
                self.decline(letter);
                None
            }
            letter => Some(letter),
        }
    }

    /// Refuses a message because this agent is a standby. The refusal names the daemon of the
    /// leader, if this agent sees one.
    fn decline(&mut self, letter: MailboxItem) {
        let MailboxItem::Direct(payload) = letter else { return };
        let message = match self.ctx.communication.read(&payload) {
            IncomingMessage::Opens(message) if message.opens_exchange() => message,
            IncomingMessage::Continues(token, message) => return self.continued(&token, message),
            _ => return,
        };
        let told = self.told();
        let acts = told.find(self.ctx.id()).map(|holder| holder.daemon.to_string());
        let detail = match acts {
            Some(daemon) => format!("this agent is a standby; the leader is at `{daemon}`"),
            None => "this agent is a standby".to_owned(),
        };
        self.ctx.refuse(&Participation::of(&message), Reason::StandingBy, detail);
    }

    fn open_broadcast(&mut self, message: Message) {
        let Some(callback) = self.callbacks.broadcast(message.performative) else { return };
        if !self.ctx.communication.concerns_me(&message) {
            return;
        }
        if message.in_reply_to.is_some() {
            return self.turn(message);
        }
        let communication = &mut self.ctx.communication;
        if communication.is_new(&message) && communication.engage(&message) {
            let early = communication.take_early(&message);
            callback(&mut self.agent, message, &mut self.ctx);
            if let Some(early) = early {
                self.turn(early);
            }
        }
    }

    fn continued(&mut self, token: &acl::ReplyToken, message: Box<Message>) {
        if let Some(message) = self.ctx.take_answer(&mut self.agent, token, message) {
            self.turn(*message);
        }
    }

    /// Handles a further message of an exchange with this agent, which the initiator of the
    /// exchange has sent.
    fn turn(&mut self, message: Message) {
        if self.ctx.communication.continues_engagement(&message) {
            let to_all = message.receiver.is_empty();
            match self.callbacks.broadcast(message.performative).filter(|_| to_all) {
                Some(callback) => callback(&mut self.agent, message, &mut self.ctx),
                None => self.call(message),
            }
        } else {
            tracing::debug!(id = %message.id, from = %message.sender, "an early or a late message");
            self.ctx.communication.keep_early(message);
        }
    }

    fn call(&mut self, message: Message) {
        match self.callbacks.direct(message.performative) {
            Some(callback) => callback(&mut self.agent, message, &mut self.ctx),
            None => {
                let (own, performative) = (self.ctx.id(), message.performative);
                let understood = self.callbacks.understood().to_string();
                let detail = match understood.as_str() {
                    "" => format!("`{own}` takes no `{performative}`, nor any other message"),
                    understood => format!("`{own}` takes no `{performative}`, only: {understood}"),
                };
                let reason = Reason::UnexpectedPerformative;
                self.ctx.communication.not_understood(&message, reason, detail);
            }
        }
    }

    fn asked(&mut self, question: &ReceivedQuery) {
        if let Some(answer) = self.agent.answer_query(question.resource, &mut self.ctx) {
            (question.answer)(answer.into());
        }
    }

    fn tell(&mut self, presence: &Presence) {
        match self.ctx.router().directory_if_read(&self.presence) {
            Some(whole) => self.told = Some(whole),
            None => {
                let mut told = self.told();
                self.told = None;
                Arc::make_mut(&mut told).update(presence);
                self.told = Some(told);
            }
        }
        let lost = self.ctx.communication.presence(presence);
        self.ctx.undelivered(&mut self.agent, lost);
        self.agent.presence(presence, &mut self.ctx);
    }

    fn due(&mut self) {
        while let Some(timer) = self.ctx.due_timer() {
            timer(&mut self.agent, &mut self.ctx);
        }
        let lost = self.ctx.communication.retry();
        self.ctx.undelivered(&mut self.agent, lost);
    }

    /// Returns the older agent that holds the same name as this agent, if there is one. Always
    /// `None` for an agent that may have replicas.
    fn usurped(&self) -> Option<Resident> {
        if self.standing.is_some() {
            return None;
        }
        let holder = match &self.told {
            Some(told) => told.find(self.ctx.id()).cloned(),
            None => self.ctx.find(self.ctx.id()),
        };
        holder.filter(|holder| holder.daemon != *self.ctx.daemon())
    }

    /// Returns the replica that keeps the number of this incarnation, if another one has it too. This
    /// agent then ends, and is launched again with another number: the ids of its messages, its
    /// exchanges and its term all come from the number, and would be taken for those of the replica.
    fn twin(&self) -> Option<Resident> {
        self.standing.as_ref()?;
        let (id, incarnation) = (self.ctx.id(), self.ctx.incarnation());
        self.told.as_ref()?.twin_before(id, incarnation, self.ctx.daemon()).cloned()
    }
}
