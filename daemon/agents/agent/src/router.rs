//! The router of one daemon: connects all agents of that daemon to the substrate.
//!
//! - Puts incoming messages into mailboxes. If a mailbox is full, answers the message with
//!   `refuse`.
//! - Maintains the [`Directory`] and notifies agents when others join or leave.
//! - Passes broadcasts to the [`SharedDomain`] before it puts them into mailboxes.
//! - Decodes a broadcast once for the whole daemon, and does not decode a heartbeat that repeats
//!   the previous one; caches the last broadcasts of each sender for agents that start later.
//! - Answers queries of other daemons, or passes them to the agents that are asked.
//!
//! The router holds the parts together; each part is a module: membership, hosted agents, broadcast
//! cache, authorization, the link to the substrate, the feed of the shared domain, reports.
//!
//! The substrate calls this module from its own threads, so no function here blocks.

mod inbound;

use std::collections::BTreeSet;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::Duration;

use acl::content::{AbsentAgent, Discovered};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Message, Performative};
use bytes::Bytes;
use capability::Announcement;
use substrate::memory::{ANSWERS_MAX, collect_answers};
use substrate::{
    AgentAddress, BoxFuture, Inbound, Origin, OverhearCallback, OverhearToken, Presence,
    PresenceToken, ReceivedQuery, Resident, ResourceQuery, SendError, Subject, Substrate,
};
use tokio::sync::{broadcast, mpsc};

use crate::activity_counters::ActivityCounters;
use crate::authorization::Authorizer;
use crate::broadcast_cache::BroadcastCaches;
use crate::daemon_figures::DaemonFigures;
use crate::daemon_reports::DaemonReports;
use crate::directory::Directory;
use crate::domain_feed::DomainFeed;
use crate::failure_counters::FailureCounters;
use crate::host::Host;
use crate::host_services::HostServices;
use crate::local_agents::LocalAgents;
use crate::mailbox::{Mailbox, MailboxItem, mailbox};
use crate::membership::AgentMembership;
use crate::rejections::Rejections;
use crate::rights::Rights;
use crate::settings::AgentSettings;
use crate::shared_domain::SharedDomain;
use crate::substrate_link::SubstrateLink;

/// The router of one daemon; see the module documentation.
pub struct MessageRouter {
    ecosystem: EcosystemId,
    daemon: DaemonId,
    settings: AgentSettings,
    host_services: HostServices,
    state: RwLock<RouterState>,
    link: SubstrateLink,
    authorizer: Authorizer,
    domain_feed: DomainFeed,
    reports: DaemonReports,
    counters: Arc<FailureCounters>,
    activity: Arc<ActivityCounters>,
    /// Counters and log of the messages that this daemon has rejected.
    rejections: Arc<Rejections>,
}

/// State under one lock, so that a broadcast is in the cache only as long as its sender is present.
#[derive(Default)]
struct RouterState {
    membership: AgentMembership,
    hosted: LocalAgents,
    /// The last broadcasts of each present agent.
    cache: BroadcastCaches,
}

impl MessageRouter {
    /// Creates a router without agents and without a substrate, on the machine of this process.
    pub fn new(
        ecosystem: EcosystemId,
        daemon: DaemonId,
        settings: AgentSettings,
    ) -> Arc<MessageRouter> {
        MessageRouter::on(HostServices::default(), ecosystem, daemon, settings)
    }

    /// Creates a router without agents and without a substrate, on the given machine.
    pub fn on(
        machine: HostServices,
        ecosystem: EcosystemId,
        daemon: DaemonId,
        settings: AgentSettings,
    ) -> Arc<MessageRouter> {
        let (counters, rejections) = (Arc::default(), Arc::<Rejections>::default());
        let link =
            SubstrateLink::new(daemon.clone(), Arc::clone(&counters), Arc::clone(&rejections));
        Arc::new(MessageRouter {
            ecosystem,
            settings,
            host_services: machine,
            state: RwLock::default(),
            link,
            authorizer: Authorizer::new(daemon.clone(), Arc::clone(&rejections)),
            domain_feed: DomainFeed::new(Arc::clone(&rejections)),
            reports: DaemonReports::default(),
            counters,
            activity: Arc::default(),
            rejections,
            daemon,
        })
    }

    /// Sets the substrate through which the router sends. Only the first call has an effect.
    pub fn connect(&self, substrate: Arc<dyn Substrate>) {
        self.link.connect(substrate);
    }

    /// Sets the rights of the ecosystem. Only the first call has an effect. Every message is
    /// allowed until the rights are set.
    pub fn set_rights(&self, rights: Rights) {
        self.authorizer.set_rights(rights);
    }

    /// Whether an agent may read what happened to facts that their agents declare private.
    pub(crate) fn may_read_private(&self, agent: &AgentId) -> bool {
        self.authorizer.may_read_private(agent)
    }

    /// Sets the function that answers queries for [`Resource::Plugins`](substrate::Resource). The
    /// function returns the state of the plugins that run as processes. Only the first call has an
    /// effect.
    pub fn tell_plugins(&self, tell: impl Fn() -> String + Send + Sync + 'static) {
        self.reports.set_plugins(Box::new(tell));
    }

    /// Sets the function that answers queries for [`Resource::Files`](substrate::Resource): digests
    /// of the ecosystem's domain and map as this daemon has read them. Only the first call has an
    /// effect.
    pub fn tell_files(&self, tell: impl Fn() -> String + Send + Sync + 'static) {
        self.reports.set_files(Box::new(tell));
    }

    /// Sets the function that returns for how long the daemon's certificate is still valid. Only the
    /// first call has an effect; a daemon without a certificate has no such function.
    pub fn tell_certificate(&self, left: impl Fn() -> Duration + Send + Sync + 'static) {
        self.reports.set_certificate(Box::new(left));
    }

    /// Replaces the list of agents that the ecosystem file names: the daemon reports those that are
    /// absent.
    pub fn expect_agents(&self, agents: Vec<AbsentAgent>) {
        self.reports.set_expected(agents);
    }

    /// Replaces the list of agents that `by` has discovered: the name of a gateway, the name of an
    /// agent that watches a board, or `plugins` for the folder of plugins.
    pub fn discovered(&self, by: &str, agents: Vec<Discovered>) {
        self.reports.set_discovered(by, agents);
    }

    /// Returns the services of the machine that the daemon runs on.
    pub fn host_services(&self) -> HostServices {
        self.host_services.clone()
    }

    /// Returns the name of the ecosystem that the daemon belongs to.
    pub fn ecosystem(&self) -> &EcosystemId {
        &self.ecosystem
    }

    /// Returns the name of this daemon.
    pub fn daemon(&self) -> &DaemonId {
        &self.daemon
    }

    /// Returns the times and bounds that apply to the daemon's agents.
    pub fn settings(&self) -> &AgentSettings {
        &self.settings
    }

    /// Returns the counters of failures.
    pub(crate) fn counters(&self) -> &Arc<FailureCounters> {
        &self.counters
    }

    /// Returns the counters of what the daemon's agents do.
    pub fn activity(&self) -> &Arc<ActivityCounters> {
        &self.activity
    }

    /// Returns the figures of this daemon at this moment.
    pub fn figures(&self) -> DaemonFigures {
        let (directory, agents_hosted, mailboxes) = {
            let state = self.read();
            let directory = Arc::clone(state.membership.directory());
            (directory, state.hosted.count(), state.hosted.mailbox_totals())
        };
        DaemonFigures {
            uptime: self.reports.uptime(),
            certificate_left: self.reports.certificate_left(),
            agents_hosted,
            agents_present: directory.count(),
            daemons_present: directory.daemons().count(),
            mailboxes,
            failures: self.counters.counts(),
            rejected: self.rejections.all_counts(),
            activity: self.activity.counts(),
        }
    }

    /// Returns the counters and the log of rejected messages.
    pub(crate) fn rejections(&self) -> &Rejections {
        &self.rejections
    }

    // === membership ===

    /// Returns the directory of the present agents, as this daemon sees them.
    pub fn directory(&self) -> Arc<Directory> {
        Arc::clone(self.read().membership.directory())
    }

    /// Returns the agent that holds this name: of several agents with the name, the one with the
    /// smallest incarnation; of several replicas, this is the one that leads or will lead. Returns
    /// `None` if no agent of this name is present.
    pub fn find(&self, agent: &AgentId) -> Option<Resident> {
        self.read().membership.directory().find(agent).cloned()
    }

    /// Returns the directory of the present agents, and a receiver of every presence change from
    /// now on. A receiver that lags too far behind misses changes; its owner must then compare
    /// directories instead.
    pub fn presence_changes(&self) -> (Arc<Directory>, broadcast::Receiver<Presence>) {
        // Both are taken under one lock, so that no change is missed in between.
        self.read().membership.subscribe()
    }

    /// Returns the directory if `receiver` has no unread presence change, so that its agent has
    /// received all changes in the directory; otherwise `None`.
    pub(crate) fn directory_if_read(
        &self,
        receiver: &broadcast::Receiver<Presence>,
    ) -> Option<Arc<Directory>> {
        self.read().membership.directory_if_read(receiver)
    }

    // === agents of this daemon ===

    /// Registers an agent and returns its mailbox. If the agent listens to `inform` broadcasts, the
    /// mailbox starts with the cached ones.
    pub(crate) fn register(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        interests: Vec<Performative>,
    ) -> Mailbox {
        let interests = BTreeSet::from_iter(interests);
        let mut state = self.write();
        let missed: Vec<_> = match interests.contains(&Performative::Inform) {
            true => state.cache.all().collect(),
            false => Vec::new(),
        };
        let settings = &self.settings;
        let items_max = settings.mailbox_messages_max + missed.len();
        let (sender, mailbox) = mailbox(items_max, settings.heard_messages_max);
        for payload in missed {
            // The mailbox was created with room for these messages.
            let _ = sender.put(MailboxItem::Replayed(payload));
        }
        state.hosted.add(agent, incarnation, interests, sender);
        mailbox
    }

    /// Records that other daemons may host replicas of an agent of this daemon.
    pub(crate) fn record_replicas(&self, agent: &AgentId) {
        self.write().hosted.record_replicas(agent);
    }

    /// Removes the mailbox of an agent, if the mailbox still belongs to this incarnation of the
    /// agent.
    pub(crate) fn unregister(&self, agent: &AgentId, incarnation: Incarnation) {
        let mut state = self.write();
        if state.hosted.remove(agent, incarnation) {
            self.link.withdraw_heartbeat(agent);
        }
    }

    /// Announces that an agent of this daemon is present. The agent stays present until the
    /// returned token is dropped.
    pub(crate) fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        self.link.announce(agent, incarnation)
    }

    // === the shared domain ===

    /// Returns the domain model that this daemon's actuators share ([`SharedDomain`]). The first
    /// call creates the model from the cached broadcasts.
    pub fn shared_domain(&self, host: &Host) -> Arc<SharedDomain> {
        let (domain, is_new) = self.domain_feed.create_domain(host);
        if is_new {
            // From now on the shared domain receives broadcasts itself. A broadcast that it also
            // gets from the cache has no further effect.
            let (earlier, directory) = {
                let state = self.read();
                (state.cache.by_sender(), Arc::clone(state.membership.directory()))
            };
            domain.set_earlier(earlier);
            let residents = directory.iter().cloned();
            residents.for_each(|resident| self.feed_presence(&Presence::Joined(resident)));
        }
        domain
    }

    /// Returns the parsed announcement of an agent; `None` if there is no [`SharedDomain`], or if
    /// that domain has not accepted such an announcement.
    pub(crate) fn announcement(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        digest: &str,
    ) -> Option<Announcement> {
        self.domain_feed.domain()?.announcement(agent, incarnation, digest)
    }

    /// Counts and logs an announcement or heartbeat that a Domain Maintainer of this daemon has not
    /// accepted, for the reason `why`. Does nothing if the actuators of this daemon share a domain:
    /// the feed of the shared domain receives the same message, and counts and logs it there.
    pub(crate) fn not_taken(&self, message: &Message, why: &str) {
        if self.domain_feed.domain().is_none() {
            self.rejections.not_taken(message, why);
        }
    }

    fn feed_presence(&self, presence: &Presence) {
        if let Some(wait) = self.domain_feed.presence(presence) {
            self.request_model(&presence.resident().agent, wait);
        }
    }

    /// Requests the model of an agent for the [`SharedDomain`]. If the agent is on another daemon
    /// and has announced its model within `wait`, no request is sent.
    fn request_model(&self, agent: &AgentId, wait: Duration) {
        let Some(resident) = self.find(agent) else { return };
        if resident.daemon == self.daemon {
            let model = self.model_of(resident.clone());
            return self.domain_feed.request_model(&resident, Duration::ZERO, move || model);
        }
        let (link, deadline) = (self.link.clone(), self.settings.answer_deadline);
        let Resident { agent, daemon, .. } = resident.clone();
        let fetch = move || link.fetch_model(agent, daemon, deadline);
        self.domain_feed.request_model(&resident, wait, fetch);
    }

    /// Requests the model of an agent. Requests to one daemon at about the same moment are
    /// combined.
    pub(crate) fn model_of(&self, resident: Resident) -> BoxFuture<Vec<Bytes>> {
        let Resident { agent, daemon, .. } = resident;
        if daemon == self.daemon {
            let models = self.write().hosted.models(Some(&agent));
            return Box::pin(std::future::ready(models));
        }
        self.link.fetch_model(agent, daemon, self.settings.answer_deadline)
    }

    /// Passes every message of the ecosystem to `listener`; see
    /// [`Substrate::overhear`](substrate::Substrate::overhear).
    pub(crate) fn overhear(&self, listener: OverhearCallback) -> Result<OverhearToken, SendError> {
        self.link.overhear(listener)
    }

    /// Whether the origin of an overheard message may send in the name of the message's sender.
    pub(crate) fn is_from_sender(&self, origin: Option<&Origin>, message: &Message) -> bool {
        self.authorizer.is_from_sender(origin, message, &self.directory())
    }

    // === sending ===

    /// Completes when every daemon that is present now receives this daemon's broadcasts; see
    /// [`Substrate::broadcast_ready`]. Without a substrate, completes at once.
    pub fn broadcast_ready(&self) -> BoxFuture<()> {
        self.link.broadcast_ready()
    }

    /// Queries daemons for a resource and returns all answers that come within `timeout`.
    pub fn ask(&self, query: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        match query.daemon.as_ref() == Some(&self.daemon) {
            true => self.ask_itself(query, timeout),
            false => self.link.ask(query, timeout),
        }
    }

    /// Queries the agents of this daemon for a resource, without the substrate.
    fn ask_itself(&self, query: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        let (sender, answers) = mpsc::channel(ANSWERS_MAX);
        let answer = Arc::new(move |payload| drop(sender.try_send(payload)));
        self.receive_query(ReceivedQuery { resource: query.resource, agent: query.agent, answer });
        Box::pin(collect_answers(answers, timeout))
    }

    /// Sends a payload to the oldest present agent of the name `to`, if there is one.
    pub(crate) fn send(&self, to: &AgentId, subject: Subject, payload: Bytes) {
        let Some(address) = self.read().membership.directory().address(to) else { return };
        self.send_to(&address, subject, payload);
    }

    /// Sends a payload to the agent and daemon in the address `to`, also if an older agent of the
    /// name is on another daemon.
    pub(crate) fn send_to(&self, to: &AgentAddress, subject: Subject, payload: Bytes) {
        if let Subject::Message(performative) = subject {
            self.activity.count_sent(performative);
        }
        self.link.send(to, subject, payload);
    }

    /// Sends a payload to all agents.
    pub(crate) fn broadcast(&self, sender: &AgentId, performative: Performative, payload: Bytes) {
        self.activity.count_sent(performative);
        self.link.broadcast(sender, performative, payload);
    }

    /// Broadcasts a model or heartbeat at once, and keeps it to answer queries for
    /// [`Resource::Model`](substrate::Resource). If a heartbeat of the same sender waits for a
    /// batch, that heartbeat is withdrawn.
    pub(crate) fn broadcast_state(&self, sender: &AgentId, payload: Bytes, is_model: bool) {
        self.activity.count_sent(Performative::Inform);
        self.write().hosted.record_announcement(sender, &payload, is_model);
        self.link.broadcast_state(sender, payload);
    }

    /// Broadcasts a heartbeat in one batch with those that other agents of this daemon send at
    /// about the same moment.
    pub(crate) fn batch_heartbeat(&self, sender: &AgentId, payload: Bytes) {
        self.activity.count_sent(Performative::Inform);
        self.write().hosted.record_announcement(sender, &payload, false);
        self.link.batch_heartbeat(sender, payload);
    }

    fn read(&self) -> RwLockReadGuard<'_, RouterState> {
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, RouterState> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }
}
