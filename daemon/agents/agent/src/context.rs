//! Operations of a callback: open an exchange, answer, set a timer, run work in the background.
//!
//! No operation blocks. A callback changes the state of its agent and returns. The result of an
//! operation (an answer, a timeout, finished work) arrives in another callback on the same task, so
//! no other code can touch the agent's state in between.

mod exchanges;

use std::collections::{BTreeMap, HashMap};
use std::future::Future;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use acl::content::{Discovered, Heartbeat, Inform, Reason, Refusal, value};
use acl::{
    AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Message, Performative, ReplyToken,
};
use bytes::Bytes;
use substrate::{BoxFuture, Resident, Resource, ResourceQuery, SendError};
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

use crate::activity_counters::ActivityCounters;
use crate::communication_agent::CommunicationAgent;
use crate::context::exchanges::OpenExchange;
use crate::directory::Directory;
use crate::exchange::{DeliveryError, Participation};
use crate::failure_counters::FailureCounters;
use crate::host::Host;
use crate::host_services::WorkError;
use crate::launch::{LaunchContext, LaunchError, LaunchableAgent};
use crate::overheard::{OverheardBatch, OverheardQueue};
use crate::router::MessageRouter;
use crate::settings::AgentSettings;
use crate::shared_domain::SharedDomain;

pub(crate) type DeferredCallback<A> = Box<dyn FnOnce(&mut A, &mut Context<A>) + Send>;

/// Operations that are available to a callback of agent `A`.
pub struct Context<A> {
    pub(crate) communication: CommunicationAgent,
    exchanges: HashMap<ReplyToken, OpenExchange<A>>,
    timers: BTreeMap<TimerId, DeferredCallback<A>>,
    timers_count: u64,
    /// Background work that is under way, or has finished and waits for its callback.
    work: JoinSet<DeferredCallback<A>>,
}

/// Identifier of a timer: the time at which the timer is due, and a running number that
/// distinguishes timers that are due at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TimerId(Instant, u64);

/// Handle of background work. Dropping the handle aborts the work. The callback of the work then
/// never runs, even if the work has finished already.
#[derive(Debug)]
pub struct WorkHandle {
    task: AbortHandle,
    _awaited: Arc<()>,
}

/// Handle of a child, an agent that another agent has started. Dropping the handle stops the child.
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

impl<A: 'static> Context<A> {
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

    /// Returns the name of the daemon that hosts this agent.
    pub fn daemon(&self) -> &DaemonId {
        self.router().daemon()
    }

    /// Returns the name of the ecosystem.
    pub fn ecosystem(&self) -> &EcosystemId {
        self.router().ecosystem()
    }

    /// Returns the router of the daemon. Plugins use its parts through methods of this type only.
    pub(crate) fn router(&self) -> &Arc<MessageRouter> {
        self.communication.router()
    }

    /// Returns the directory of the present agents, as this daemon sees them.
    pub fn directory(&self) -> Arc<Directory> {
        self.router().directory()
    }

    /// Returns the agent that holds this name: of several agents with the name, the one with the
    /// smallest incarnation; of several replicas, this is the one that leads or will lead. Returns
    /// `None` if no agent of this name is present.
    pub fn find(&self, agent: &AgentId) -> Option<Resident> {
        self.router().find(agent)
    }

    /// Returns the composite domain that the actuators of this daemon share. The first call creates
    /// it.
    pub fn shared_domain(&self, host: &Host) -> Arc<SharedDomain> {
        self.router().shared_domain(host)
    }

    /// Returns the failure counters of the daemon, in which this agent counts the records that it
    /// could not store.
    pub fn failure_counters(&self) -> Arc<FailureCounters> {
        Arc::clone(self.router().counters())
    }

    /// Whether the sender of a message that this agent has received may read what happened to facts
    /// that their agents declare `:private`. No agent may unless the ecosystem is secured,
    /// because the senders of messages are not verified otherwise.
    pub fn may_read_private(&self, sender: &AgentId) -> bool {
        self.router().may_read_private(sender)
    }

    /// Returns the counters of what the daemon's agents do, in which this agent counts what it has
    /// done.
    pub fn activity(&self) -> Arc<ActivityCounters> {
        Arc::clone(self.router().activity())
    }

    /// Replaces the list of agents that this agent has discovered; the daemon reports the list to
    /// operators.
    pub(crate) fn report_discovered(&self, agents: Vec<Discovered>) {
        self.router().discovered(self.id().as_str(), agents);
    }

    /// Returns the time of day. Deadlines never use it, because it may jump.
    pub fn wall_clock(&self) -> SystemTime {
        self.router().host_services().wall_clock()
    }

    /// Returns the present time, on the clock that all deadlines use.
    pub fn now(&self) -> Instant {
        Instant::now()
    }

    /// Queries `resource` of the oldest present agent of the name `of`, at the daemon of that agent
    /// only; waiting for other daemons would make the answer old. Returns an empty list if no agent
    /// of the name is present, or if no answer comes in time.
    pub fn ask(&self, resource: Resource, of: &AgentId) -> BoxFuture<Vec<Bytes>> {
        let Some(resident) = self.find(of) else {
            return Box::pin(std::future::ready(Vec::new()));
        };
        let (daemon, agent) = (Some(resident.daemon), Some(of.clone()));
        self.query(ResourceQuery { daemon, resource, agent })
    }

    /// Queries daemons for a resource. Returns all answers that come within
    /// [`AgentSettings::answer_deadline`].
    pub fn query(&self, query: ResourceQuery) -> BoxFuture<Vec<Bytes>> {
        self.router().ask(query, self.settings().answer_deadline)
    }

    // === sending ===

    /// Creates a name for a new conversation.
    pub fn new_conversation(&mut self) -> ConversationId {
        ConversationId::new(self.communication.token().as_str())
    }

    /// Sends an answer as the participant of an exchange. If the answer cannot be sent, logs a
    /// warning.
    pub fn answer(
        &mut self,
        participation: &Participation,
        performative: Performative,
        content: &impl serde::Serialize,
    ) {
        self.communication.answer(participation, performative, value(content));
    }

    /// Sends an answer as the participant of an exchange. The caller may try again later if sending
    /// fails.
    ///
    /// # Errors
    ///
    /// Returns the reason if the answer cannot be sent now, such as a full outbox.
    pub fn try_answer(
        &mut self,
        participation: &Participation,
        performative: Performative,
        content: &impl serde::Serialize,
    ) -> Result<(), DeliveryError> {
        self.communication.try_answer(participation, performative, value(content))
    }

    /// Sends a refusal as the participant of an exchange, with a reason and an explanation for
    /// people.
    pub fn refuse(
        &mut self,
        participation: &Participation,
        reason: Reason,
        detail: impl Into<String>,
    ) {
        self.answer(participation, Performative::Refuse, &Refusal::new(reason, detail));
    }

    /// Answers `message` with `not-understood`, because its content is not as expected; `detail`
    /// states the mistake.
    pub fn not_understood(&mut self, message: &Message, detail: impl Into<String>) {
        self.communication.not_understood(message, Reason::BadContent, detail.into());
    }

    /// Sends a message to one agent outside any exchange. An `inform` is sent only once, without
    /// retries.
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
        self.router().broadcast_state(&message.sender, acl::encode(&message), is_model);
    }

    /// Broadcasts a heartbeat of this agent a few milliseconds later, in one batch with heartbeats
    /// of other agents of the same daemon. For heartbeats without an urgent change this delay is
    /// acceptable.
    pub fn batch_heartbeat(&mut self, heartbeat: Heartbeat) {
        let message = self.beating(&Inform::Heartbeat(heartbeat));
        self.router().batch_heartbeat(&message.sender, acl::encode(&message));
    }

    fn beating(&mut self, inform: &Inform) -> Message {
        let conversation = ConversationId::new(self.id().as_str());
        self.communication.message(Performative::Inform, conversation, value(inform))
    }

    /// Whether a message of this agent has no receipt yet.
    pub fn awaits_receipts(&self) -> bool {
        self.communication.awaits_receipts()
    }

    // === waiting and working ===

    /// Calls `then` once, after the time `wait`. Returns the identifier of the timer.
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

    /// Cancels a timer; does nothing if the timer has fired or was cancelled.
    pub fn cancel_timer(&mut self, timer: TimerId) {
        self.timers.remove(&timer);
    }

    /// Runs `work` in the background, and calls `then` with its result. Dropping the returned
    /// handle aborts the work.
    pub fn run<T: Send + 'static>(
        &mut self,
        work: impl Future<Output = T> + Send + 'static,
        then: impl FnOnce(&mut A, T, &mut Context<A>) + Send + 'static,
    ) -> WorkHandle {
        let awaited = Arc::new(());
        let is_awaited = Arc::downgrade(&awaited);
        let task = self.run_unattended(work, move |agent, outcome, ctx| {
            if is_awaited.strong_count() > 0 {
                then(agent, outcome, ctx);
            }
        });
        WorkHandle { task, _awaited: awaited }
    }

    /// Runs `work` in the background until it or the agent ends, and calls `then` with its result.
    fn run_unattended<T: Send + 'static>(
        &mut self,
        work: impl Future<Output = T> + Send + 'static,
        then: impl FnOnce(&mut A, T, &mut Context<A>) + Send + 'static,
    ) -> AbortHandle {
        let deferred = async move {
            let outcome = work.await;
            let deferred: DeferredCallback<A> =
                Box::new(move |agent, ctx| then(agent, outcome, ctx));
            deferred
        };
        self.work.spawn(deferred.instrument(tracing::Span::current()))
    }

    /// Overhears every message that agents send in the ecosystem, from now on, until the agent
    /// ends: messages to one agent, broadcasts, models and heartbeats. Calls `heard` with each
    /// batch. At most `waiting_max` messages wait for that; more are lost, and counted in the next
    /// batch. An agent must not act on what it overhears: the message is for others.
    ///
    /// # Errors
    ///
    /// Returns the reason if the substrate is closed.
    pub fn overhear(
        &mut self,
        waiting_max: usize,
        heard: fn(&mut A, OverheardBatch, &mut Context<A>),
    ) -> Result<(), SendError> {
        let queue = OverheardQueue::listen(self.router(), waiting_max)?;
        self.take_batches(queue, heard);
        Ok(())
    }

    fn take_batches(
        &mut self,
        queue: OverheardQueue,
        heard: fn(&mut A, OverheardBatch, &mut Context<A>),
    ) {
        let next = queue.next();
        self.run_unattended(next, move |agent, batch, ctx| {
            if let Some(batch) = batch {
                ctx.take_batches(queue, heard);
                heard(agent, batch, ctx);
            }
        });
    }

    /// Returns a future that runs `work` on a thread that may block, for example to access a disk.
    ///
    /// # Errors
    ///
    /// The future returns an error if the work panicked, or the daemon is ending.
    pub fn run_blocking<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> BoxFuture<Result<T, WorkError>> {
        Box::pin(self.router().host_services().run_blocking(work))
    }

    /// Starts another agent, a child, on this daemon. If the child ends by itself, calls `then`
    /// with its error, or with `None` if the child ended without an error or panicked. The child
    /// stops when the returned handle is dropped, or when this agent stops.
    pub fn spawn_child(
        &mut self,
        id: AgentId,
        agent: Box<dyn LaunchableAgent>,
        then: impl FnOnce(&mut A, Option<LaunchError>, &mut Context<A>) + Send + 'static,
    ) -> ChildHandle {
        let stopping = CancellationToken::new();
        let launch_context = LaunchContext {
            id,
            incarnation: self.router().host_services().next_incarnation(),
            router: Arc::clone(self.router()),
            ontology: self.communication.ontology(),
            stopping: stopping.clone(),
            has_replicas: false,
            via: [].into(),
        };
        let task = agent.launch(launch_context);
        let work = self.run(task, |agent: &mut A, ended, ctx| {
            // The panic itself, with its place, is on stderr already.
            then(agent, ended.ok().and_then(Result::err), ctx);
        });
        ChildHandle { stopping, _work: work }
    }

    /// Runs a computation in the background and calls `then` with the result. The computation may
    /// keep its thread busy for long; it starts once the daemon's compute pool has a free permit. A
    /// computation cannot be aborted from outside: to stop it early, give it a flag that it checks.
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

    // === for the event loop ===

    /// Waits until some background work finishes, and returns the callback of that work; `None` if
    /// no work is under way.
    pub(crate) async fn finished(&mut self) -> Option<DeferredCallback<A>> {
        loop {
            match self.work.join_next().await? {
                Ok(deferred) => return Some(deferred),
                // The handle of the work was dropped.
                Err(error) if error.is_cancelled() => (),
                // The panic itself is on stderr already, with its place.
                Err(error) => tracing::error!(agent = %self.id(), %error, "work was lost"),
            }
        }
    }

    /// Reports the open exchanges of the agent to a simulated machine. Does nothing on a real
    /// machine.
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
