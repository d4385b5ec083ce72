//! The router of one daemon: connects all agents of that daemon to the substrate.
//!
//! - Puts incoming messages into mailboxes. If a mailbox is full, answers the message with `refuse`.
//! - Maintains the [`Directory`] and notifies agents when others join or leave.
//! - Passes broadcasts to the [`SharedDomain`] before it puts them into mailboxes.
//! - Decodes a broadcast once for the whole daemon, and does not decode a heartbeat that repeats
//!   the previous one; caches the last broadcasts of each sender ([`BroadcastCache`]) for agents that
//!   start later.
//!
//! The substrate calls this module on its own threads: no function here blocks.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::{Duration, Instant};

use acl::content::{Appeared, Discovered, Inform, Mailboxes, Reason, Refusal, value};
use acl::{
    AgentId, DaemonId, EcosystemId, Incarnation, Message, MessageId, Performative, SCHEMA_VERSION,
};
use bytes::Bytes;
use capability::Announcement;
use serde_json::Map;
use substrate::memory::{ANSWERS_MAX, collect_answers};
use substrate::{
    AgentAddress, Answer, BoxFuture, Delivery, Destination, Inbound, Origin, Presence,
    PresenceToken, ReceivedQuery, Rejected, Resident, Resource, ResourceQuery, SendError, Subject,
    Substrate, ViolationKind,
};
use tokio::runtime::Handle;
use tokio::sync::{broadcast, mpsc};

use crate::broadcast_cache::{self, BroadcastCache};
use crate::directory::Directory;
use crate::domain_tracker::answered_models;
use crate::heartbeat_batcher::{GATHERED_WITHIN, HeartbeatBatcher};
use crate::host::Host;
use crate::host_services::HostServices;
use crate::latest_announcement::LatestAnnouncement;
use crate::mailbox::{Mailbox, MailboxItem, MailboxSender, mailbox};
use crate::model_fetcher::ModelFetcher;
use crate::receipts;
use crate::rejections::Rejections;
use crate::rights::Rights;
use crate::settings::AgentSettings;
use crate::shared_domain::SharedDomain;

/// Capacity of the channel of presence changes. An agent that misses changes because it lags further
/// behind compares directories instead.
const PRESENCE_CHANGES_MAX: usize = 1_024;

/// The router of one daemon; see the module documentation.
pub struct MessageRouter {
    ecosystem: EcosystemId,
    daemon: DaemonId,
    settings: AgentSettings,
    state: RwLock<RouterState>,
    presence: broadcast::Sender<Presence>,
    substrate: OnceLock<Arc<dyn Substrate>>,
    shared_domain: OnceLock<SharedDomainHandle>,
    /// Heartbeats of this daemon's agents that wait to be sent in one batch.
    gathering: HeartbeatBatcher,
    /// Requests for models of agents that this daemon has missed.
    fetching: ModelFetcher,
    counters: FailureCounters,
    host_services: HostServices,
    /// Function that returns the answer to [`Resource::Plugins`]: the state of the plugins that run as
    /// processes. Set only if this daemon hosts such plugins.
    plugins: OnceLock<Box<dyn Fn() -> String + Send + Sync>>,
    /// Answer to [`Resource::Files`]: digests of the ecosystem's domain and map as this daemon has read
    /// them.
    files: OnceLock<String>,
    /// Discovered agents, which the ecosystem file does not name, by the finder that reported them.
    discovered: Mutex<BTreeMap<String, Vec<Discovered>>>,
    /// Counters and log of rejected messages.
    pub(crate) rejections: Arc<Rejections>,
    /// Rights of the ecosystem, which the module `authorization` checks; unset if the ecosystem limits
    /// no rights.
    pub(crate) rights: OnceLock<Arc<Rights>>,
}

/// Counters of failures since the daemon started, for its operator.
#[derive(Debug, Default)]
pub struct FailureCounters {
    /// Messages refused because a mailbox was full.
    pub mailbox_full: AtomicU64,
    /// Messages to agents that this daemon does not host.
    pub unknown_receiver: AtomicU64,
    /// Broadcasts that could not be decoded, or that name another sender than the address under which
    /// they arrived.
    pub unreadable: AtomicU64,
    /// Messages that the substrate did not accept.
    pub unsent: AtomicU64,
    /// Records that this machine's disk did not keep.
    pub not_persisted: AtomicU64,
}

#[derive(Default)]
struct RouterState {
    agents: BTreeMap<AgentId, HostedAgent>,
    /// Directory of the present agents. Readers share it; a change is made in a copy.
    directory: Arc<Directory>,
    /// The last broadcasts of each sender.
    heard: BTreeMap<AgentId, BroadcastCache>,
    /// Number of this daemon's agents that listen to `inform` broadcasts; the shared domain does not
    /// count.
    listeners: usize,
}

/// The shared domain of this daemon, and the runtime on which its requests for models wait for answers.
struct SharedDomainHandle {
    commons: Arc<SharedDomain>,
    runtime: Handle,
}

struct HostedAgent {
    slot: MailboxSender,
    incarnation: Incarnation,
    interests: BTreeSet<Performative>,
    /// Latest announcement of the agent; it answers the query [`Resource::Model`].
    last_word: LatestAnnouncement,
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
        let (presence, _) = broadcast::channel(PRESENCE_CHANGES_MAX);
        Arc::new(MessageRouter {
            ecosystem,
            daemon,
            settings,
            state: RwLock::default(),
            presence,
            substrate: OnceLock::new(),
            shared_domain: OnceLock::new(),
            gathering: HeartbeatBatcher::default(),
            fetching: ModelFetcher::default(),
            counters: FailureCounters::default(),
            host_services: machine,
            plugins: OnceLock::new(),
            files: OnceLock::new(),
            discovered: Mutex::default(),
            rejections: Arc::default(),
            rights: OnceLock::new(),
        })
    }

    /// Sets the substrate through which the router sends. Only the first call has an effect.
    pub fn connect(&self, substrate: Arc<dyn Substrate>) {
        // A second substrate would split the daemon's agents; the first one stays.
        let _ = self.substrate.set(substrate);
    }

    /// Sets the function that answers [`Resource::Plugins`]: the state of the plugins that run as
    /// processes. Only the first call has an effect.
    pub fn tell_plugins(&self, tell: impl Fn() -> String + Send + Sync + 'static) {
        // If a daemon has two plugin hosts, the first one answers.
        let _ = self.plugins.set(Box::new(tell));
    }

    /// Sets the answer to [`Resource::Files`]: digests of the ecosystem's domain and map as this daemon
    /// has read them. Only the first call has an effect.
    pub fn tell_files(&self, files: String) {
        // The files are read once, at start.
        let _ = self.files.set(files);
    }

    /// Replaces the list of agents that the finder `by` has discovered.
    pub fn discovered(&self, by: &str, agents: Vec<Discovered>) {
        let mut discovered = self.discovered.lock().unwrap_or_else(PoisonError::into_inner);
        match agents.is_empty() {
            true => drop(discovered.remove(by)),
            false => drop(discovered.insert(by.to_owned(), agents)),
        }
    }

    fn answer_discovered(&self, question: &ReceivedQuery) {
        let discovered = self.discovered.lock().unwrap_or_else(PoisonError::into_inner);
        let discovered: Vec<_> = discovered.values().flatten().cloned().collect();
        if discovered.is_empty() {
            return;
        }
        let appeared = Appeared { daemon: self.daemon.clone(), discovered };
        if let Ok(bytes) = serde_json::to_vec(&appeared) {
            (question.answer)(Bytes::from(bytes));
        }
    }

    /// Returns the machine that the daemon runs on.
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
    pub fn counters(&self) -> &FailureCounters {
        &self.counters
    }

    /// Returns the directory of the present agents, as this daemon sees them.
    pub fn directory(&self) -> Arc<Directory> {
        Arc::clone(&self.read().directory)
    }

    /// Returns the agent that holds a name; `None` if no agent of that name is present.
    pub fn find(&self, agent: &AgentId) -> Option<Resident> {
        self.read().directory.find(agent).cloned()
    }

    /// Completes when every daemon that is present now receives this daemon's broadcasts; see
    /// [`Substrate::broadcast_ready`]. Without a substrate, completes at once.
    pub fn broadcast_ready(&self) -> BoxFuture<()> {
        match self.substrate.get() {
            Some(substrate) => substrate.broadcast_ready(),
            None => Box::pin(std::future::ready(())),
        }
    }

    /// Queries daemons for a resource and returns all answers that come within `timeout`.
    pub fn ask(&self, ask: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        if ask.daemon.as_ref() == Some(&self.daemon) {
            return self.ask_itself(ask, timeout);
        }
        match self.substrate.get() {
            Some(substrate) => substrate.ask(ask, timeout),
            None => Box::pin(std::future::ready(Vec::new())),
        }
    }

    /// Queries the agents of this daemon for a resource, without the substrate.
    fn ask_itself(&self, ask: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        let (answers, heard) = mpsc::channel(ANSWERS_MAX);
        let answer = Arc::new(move |payload| drop(answers.try_send(payload)));
        self.receive_query(ReceivedQuery { resource: ask.resource, agent: ask.agent, answer });
        Box::pin(collect_answers(heard, timeout))
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
        let is_informed = interests.contains(&Performative::Inform);
        let missed = state.heard.values().flat_map(BroadcastCache::all).filter(|_| is_informed);
        let missed: Vec<_> = missed.cloned().collect();
        let settings = &self.settings;
        let letters_max = settings.mailbox_messages_max + missed.len();
        let (slot, mailbox) = mailbox(letters_max, settings.heard_messages_max);
        for payload in missed {
            // There is room: the mailbox was made for them.
            let _ = slot.put(MailboxItem::Replayed(payload));
        }
        let last_word = LatestAnnouncement::default();
        state.agents.insert(agent.clone(), HostedAgent { slot, incarnation, interests, last_word });
        state.count_listeners();
        mailbox
    }

    /// Removes the mailbox of an agent, if the mailbox still belongs to this incarnation of the agent.
    pub(crate) fn unregister(&self, agent: &AgentId, incarnation: Incarnation) {
        let mut state = self.write();
        if state.agents.get(agent).is_some_and(|hosted| hosted.incarnation == incarnation) {
            state.agents.remove(agent);
            state.count_listeners();
            self.gathering.withdraw(agent);
        }
    }

    /// Returns the directory, and a receiver of every presence change from now on. A receiver that lags
    /// too far behind misses changes, and must compare directories instead.
    pub fn presence_changes(&self) -> (Arc<Directory>, broadcast::Receiver<Presence>) {
        // Subscribed under the lock, so that no change falls between the two.
        let state = self.read();
        (Arc::clone(&state.directory), self.presence.subscribe())
    }

    /// Returns the directory if the receiver `told` has no unread presence change; otherwise `None`.
    pub(crate) fn told_whole(
        &self,
        told: &broadcast::Receiver<Presence>,
    ) -> Option<Arc<Directory>> {
        let state = self.read();
        told.is_empty().then(|| Arc::clone(&state.directory))
    }

    pub(crate) fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        self.substrate.get().ok_or(SendError::Closed)?.announce(agent, incarnation)
    }

    // === the shared domain ===

    /// Returns the domain model that this daemon's actuators share ([`SharedDomain`]). The first call
    /// creates the model from the cached broadcasts.
    pub fn shared_domain(&self, host: &Host) -> Arc<SharedDomain> {
        let begin = || SharedDomainHandle {
            commons: Arc::new(SharedDomain::new(host)),
            runtime: Handle::current(),
        };
        let is_new = self.shared_domain.get().is_none();
        let commons = Arc::clone(&self.shared_domain.get_or_init(begin).commons);
        if is_new {
            // From here on the shared domain receives broadcasts itself. A broadcast that arrives both
            // ways has no further effect.
            let mut said: BTreeMap<AgentId, Vec<Bytes>> = BTreeMap::new();
            let directory = {
                let state = self.read();
                for (sender, hearsay) in &state.heard {
                    said.insert(sender.clone(), hearsay.all().cloned().collect());
                }
                Arc::clone(&state.directory)
            };
            commons.set_earlier(said);
            let residents = directory.iter().cloned();
            residents.for_each(|resident| self.show_commons(&Presence::Joined(resident)));
        }
        commons
    }

    /// Returns the parsed announcement of an agent, if the shared domain has read it.
    pub(crate) fn announcement(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        digest: &str,
    ) -> Option<Announcement> {
        self.shared_domain.get()?.commons.announcement(agent, incarnation, digest)
    }

    fn tell_commons(&self, message: &Message, inform: Option<Inform>) {
        let (Some(SharedDomainHandle { commons, .. }), Some(inform)) =
            (self.shared_domain.get(), inform)
        else {
            return;
        };
        let heard = commons.receive(message, &inform);
        if let Some(why) = heard.not_taken() {
            self.not_taken(message, why);
        }
        if heard.lacks_model {
            self.fetch(&message.sender, Duration::ZERO);
        }
    }

    /// Whether the shared domain exists. If it does, it checks what agents announce.
    pub(crate) fn has_commons(&self) -> bool {
        self.shared_domain.get().is_some()
    }

    /// Counts and logs that an announcement or heartbeat was not accepted.
    pub(crate) fn not_taken(&self, message: &Message, why: &str) {
        self.rejections.not_taken(message, why);
    }

    fn show_commons(&self, presence: &Presence) {
        if let Some(SharedDomainHandle { commons, .. }) = self.shared_domain.get()
            && let Some(patience) = commons.presence(presence)
        {
            self.fetch(&presence.resident().agent, patience);
        }
    }

    /// Requests the model of the agent `whose` for the shared domain. If the agent is on another daemon
    /// and has announced its model within `patience`, no request is sent. Reasoning agents have no
    /// model and do not answer.
    fn fetch(&self, whose: &AgentId, patience: Duration) {
        let Some(SharedDomainHandle { commons, runtime }) = self.shared_domain.get() else {
            return;
        };
        let Some(resident) = self.find(whose) else { return };
        if !commons.begin_request(whose) {
            return;
        }
        let (commons, whose) = (Arc::clone(commons), whose.clone());
        let is_elsewhere = resident.daemon != self.daemon;
        let model = match self.substrate.get().cloned().filter(|_| is_elsewhere) {
            None => self.model_of(resident),
            Some(substrate) => {
                let (fetching, commons) = (self.fetching.clone(), Arc::clone(&commons));
                let deadline = self.settings.answer_deadline;
                Box::pin(async move {
                    tokio::time::sleep(patience).await;
                    let Resident { agent, daemon, incarnation } = resident;
                    if !patience.is_zero() && commons.has_model(&agent, incarnation) {
                        return Vec::new();
                    }
                    fetching.model_of(agent, daemon, &substrate, deadline).await
                })
            }
        };
        let rejections = Arc::clone(&self.rejections);
        runtime.spawn(async move {
            for message in answered_models(&whose, model.await) {
                if let Some(inform) = inform_of(&message)
                    && let Some(why) = commons.receive(&message, &inform).not_taken()
                {
                    rejections.not_taken(&message, why);
                }
            }
            commons.end_request(&whose);
        });
    }

    /// Requests the model of an agent. Requests to one daemon at about the same moment are combined.
    pub(crate) fn model_of(&self, whose: Resident) -> BoxFuture<Vec<Bytes>> {
        let Resident { agent, daemon, .. } = whose;
        let deadline = self.settings.answer_deadline;
        let Some(substrate) = self.substrate.get().cloned().filter(|_| daemon != self.daemon)
        else {
            let (daemon, agent) = (Some(daemon), Some(agent));
            return self.ask(ResourceQuery { daemon, resource: Resource::Model, agent }, deadline);
        };
        self.fetching.model_of(agent, daemon, &substrate, deadline)
    }

    // === sending ===

    pub(crate) fn send(&self, to: &AgentId, subject: Subject, payload: Bytes) {
        let Some(address) = self.read().directory.address(to) else { return };
        self.send_to(&address, subject, payload);
    }

    /// Sends a payload to the agent and daemon in the address `to`, whichever agent holds the name.
    pub(crate) fn send_to(&self, to: &AgentAddress, subject: Subject, payload: Bytes) {
        self.hand_over(|substrate| substrate.send(to, subject, payload));
    }

    pub(crate) fn broadcast(&self, sender: &AgentId, performative: Performative, payload: Bytes) {
        self.hand_over(|substrate| substrate.broadcast(sender, performative, payload));
    }

    /// Broadcasts a model or heartbeat at once, and keeps it to answer queries for [`Resource::Model`].
    /// If a heartbeat of the same sender waits for a batch, that heartbeat is withdrawn.
    pub(crate) fn beat(&self, sender: &AgentId, payload: Bytes, is_model: bool) {
        self.keep_last_word(sender, &payload, is_model);
        self.gathering.withdraw(sender);
        self.hand_over(|substrate| substrate.broadcast_state(sender, payload));
    }

    /// Broadcasts a heartbeat in one batch with those that other agents of this daemon send at about
    /// the same moment.
    pub(crate) fn beat_together(self: &Arc<Self>, sender: &AgentId, payload: Bytes) {
        self.keep_last_word(sender, &payload, false);
        if !self.gathering.add(sender, payload) {
            return;
        }
        let switchboard = Arc::clone(self);
        tokio::spawn(async move {
            tokio::time::sleep(GATHERED_WITHIN).await;
            let beats = switchboard.gathering.take();
            switchboard.hand_over(|substrate| substrate.broadcast_heartbeats(beats));
        });
    }

    fn keep_last_word(&self, sender: &AgentId, payload: &Bytes, is_model: bool) {
        if let Some(hosted) = self.write().agents.get_mut(sender) {
            hosted.last_word.told(payload, is_model);
        }
    }

    fn hand_over(&self, send: impl FnOnce(&dyn Substrate) -> Result<(), SendError>) {
        let substrate = self.substrate.get().ok_or(SendError::Closed);
        if let Err(error) = substrate.and_then(|substrate| send(&**substrate)) {
            self.counters.unsent.fetch_add(1, Ordering::Relaxed);
            if let SendError::TooLong { .. } = error {
                let (claimed, detail) = (Some(self.daemon.as_str()), error.to_string());
                let (breach, key) = (ViolationKind::Oversized, "its own");
                self.rejections.note(&Rejected {
                    violation: breach,
                    detail: &detail,
                    claimed,
                    key,
                });
            }
            tracing::debug!(%error, "the substrate did not take a message");
        }
    }

    // === receiving ===

    fn deliver_to(&self, agent: &AgentId, letter: MailboxItem) {
        let slot = self.read().agents.get(agent).map(|hosted| hosted.slot.clone());
        let Some(slot) = slot else {
            self.counters.unknown_receiver.fetch_add(1, Ordering::Relaxed);
            tracing::debug!(%agent, "a message to an agent that is not hosted here");
            return;
        };
        match slot.put(letter) {
            Err(MailboxItem::Direct(_)) if slot.is_closed() => {
                tracing::debug!(%agent, "a message to an agent that has ended");
            }
            Err(MailboxItem::Direct(payload)) => self.refuse_overflow(agent, &slot, &payload),
            _ => (),
        }
    }

    /// Refuses a message to an agent with a full mailbox, so that the sender learns of it at once and
    /// does not wait.
    fn refuse_overflow(&self, agent: &AgentId, slot: &MailboxSender, payload: &[u8]) {
        self.counters.mailbox_full.fetch_add(1, Ordering::Relaxed);
        let from = acl::sender_of(payload);
        let from = from.as_ref().map_or("unknown", AgentId::as_str);
        if let Some(unsaid) = self.rejections.is_to_say("mailbox-full", from, Instant::now()) {
            tracing::warn!(%agent, from, unsaid, "mailbox full: a message is refused");
        }
        let Ok(message) = acl::decode(payload) else { return };
        if !message.opens_exchange() {
            // A turn of an open exchange is retried by its sender until there is room.
            return;
        }
        if !slot.door().refuse(&message.id) {
            // A copy of a message that the agent has received before and answers.
            return;
        }
        let detail = format!("the mailbox of `{agent}` is full; ask again later");
        let to = message.sender.clone();
        let refusal = self.refusal(agent, message, Reason::MailboxFull, detail);
        self.send(&to, Subject::Message(Performative::Refuse), acl::encode(&refusal));
    }

    /// Builds a refusal in the name of `agent`, for a message that is not passed on to it.
    pub(crate) fn refusal(
        &self,
        agent: &AgentId,
        message: Message,
        reason: Reason,
        detail: String,
    ) -> Message {
        static REFUSALS: AtomicU64 = AtomicU64::new(0);
        let count = REFUSALS.fetch_add(1, Ordering::Relaxed);
        let incarnation = self.read().agents.get(agent).map(|hosted| hosted.incarnation);
        Message {
            version: SCHEMA_VERSION,
            id: MessageId::new(&format!("{agent}.unheard.{}.{count}", message.id)),
            performative: Performative::Refuse,
            sender: agent.clone(),
            incarnation: incarnation.unwrap_or_default(),
            receiver: vec![message.sender.clone()],
            content: value(&Refusal::new(reason, detail)),
            in_reply_to: message.reply_with.clone(),
            reply_with: None,
            reply_by: None,
            via: Vec::new(),
            unknown: Map::new(),
            ..message
        }
    }

    fn deliver_to_all(&self, payload: Bytes, sender: &AgentId, origin: Option<&Origin>) {
        let is_short_enough = |most| self.is_short_enough(&payload, most, sender, origin);
        if self.take_again(&payload, sender, origin)
            || !is_short_enough(broadcast_cache::EPOCH_BYTES_MAX)
        {
            return;
        }
        let message = match acl::decode(&payload) {
            Ok(message) if message.sender == *sender => Arc::new(message),
            Ok(message) => {
                self.counters.unreadable.fetch_add(1, Ordering::Relaxed);
                tracing::info!(%sender, claims = %message.sender, "a broadcast in another's name");
                return;
            }
            Err(error) => {
                self.counters.unreadable.fetch_add(1, Ordering::Relaxed);
                tracing::info!(%sender, %error, "an unreadable broadcast");
                return;
            }
        };
        let inform = inform_of(&message);
        if inform
            .as_ref()
            .and_then(broadcast_cache::bytes_max)
            .is_some_and(|most| !is_short_enough(most))
            || !self.authorize_message(origin, &message, inform.as_ref())
        {
            return;
        }
        if let Some(inform) = &inform {
            self.keep(payload, &message, inform);
        }
        self.tell_commons(&message, inform);
        let state = self.read();
        for hosted in state.agents.values() {
            if hosted.interests.contains(&message.performative) {
                // A full mailbox loses the broadcast: its sender repeats it, or the agent requests
                // it again.
                let _ = hosted.slot.put(MailboxItem::Broadcast(Arc::clone(&message)));
            }
        }
    }

    /// Whether a broadcast has at most `bytes_max` bytes. If not, that is counted and logged. The bound
    /// is needed because the last broadcasts of every sender are cached.
    fn is_short_enough(
        &self,
        payload: &Bytes,
        bytes_max: usize,
        sender: &AgentId,
        origin: Option<&Origin>,
    ) -> bool {
        let bytes = payload.len();
        if bytes <= bytes_max {
            return true;
        }
        let detail = format!("is a broadcast of {bytes} bytes; at most {bytes_max} are accepted");
        let claimed = origin.map_or(sender.as_str(), |origin| origin.daemon.as_str());
        let (breach, claimed, key) = (ViolationKind::Oversized, Some(claimed), sender.as_str());
        self.rejections.note(&Rejected { violation: breach, detail: &detail, claimed, key });
        false
    }

    /// Handles a heartbeat that repeats the previous one without decoding it. Returns `false` if the
    /// heartbeat must be decoded, because it differs from the previous one or an agent of this daemon
    /// listens to `inform` broadcasts.
    fn take_again(&self, payload: &Bytes, sender: &AgentId, origin: Option<&Origin>) -> bool {
        let again = {
            let state = self.read();
            if state.listeners > 0 {
                return false;
            }
            state.heard.get(sender).and_then(|hearsay| hearsay.is_again(payload))
        };
        let Some(again) = again else { return false };
        if !self.authorize_repetition(origin, sender, again.now.said.incarnation) {
            return true;
        }
        if let Some(SharedDomainHandle { commons, .. }) = self.shared_domain.get()
            && !commons.receive_repetition(sender, &again)
        {
            return false;
        }
        if let Some(hearsay) = self.write().heard.get_mut(sender) {
            hearsay.keep_again(payload.clone(), again);
        }
        true
    }

    fn keep(&self, payload: Bytes, message: &Message, inform: &Inform) {
        let mut state = self.write();
        let sender = &message.sender;
        // Only broadcasts of present agents are cached, so that strangers cannot fill the cache.
        if state.directory.find(sender).is_some() {
            let hearsay = state.heard.entry(sender.clone()).or_default();
            hearsay.keep(payload, message, inform);
        }
    }

    fn answer_directory(&self, question: &ReceivedQuery) {
        let state = self.read();
        let residents: Vec<_> =
            state.directory.iter().filter(|resident| resident.daemon == self.daemon).collect();
        if let Ok(bytes) = serde_json::to_vec(&residents) {
            (question.answer)(Bytes::from(bytes));
        }
    }

    fn answer_model(&self, question: &ReceivedQuery) {
        for model in self.models(question.agent.as_ref()) {
            (question.answer)(model);
        }
    }

    /// Returns the latest model of each agent of this daemon, or only that of the agent `asked`. Each
    /// model contains the latest heartbeat of its agent.
    fn models(&self, asked: Option<&AgentId>) -> Vec<Bytes> {
        let mut state = self.write();
        let asked = |agent: &AgentId| asked.is_none_or(|asked| asked == agent);
        let hosted = state.agents.iter_mut().filter(|(agent, _)| asked(agent));
        hosted.filter_map(|(_, hosted)| hosted.last_word.model()).collect()
    }

    /// Counts a record that the disk of this machine did not keep. The caller logs which record it was,
    /// and the reason.
    pub fn count_not_persisted(&self) {
        self.counters.not_persisted.fetch_add(1, Ordering::Relaxed);
    }

    fn answer_mailbox(&self, question: &ReceivedQuery) {
        let asked = |agent: &AgentId| question.agent.as_ref().is_none_or(|asked| asked == agent);
        let state = self.read();
        let hosted = state.agents.iter().filter(|(agent, _)| asked(agent));
        let mailboxes: Vec<_> =
            hosted.map(|(agent, hosted)| hosted.slot.status(agent.clone())).collect();
        if mailboxes.is_empty() {
            return;
        }
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let answer = Mailboxes {
            daemon: self.daemon.clone(),
            mailboxes,
            unknown_receiver: count(&self.counters.unknown_receiver),
            unreadable: count(&self.counters.unreadable),
            unsent: count(&self.counters.unsent),
            unkept: count(&self.counters.not_persisted),
            rejected: self.rejections.counts(),
        };
        if let Ok(bytes) = serde_json::to_vec(&answer) {
            (question.answer)(Bytes::from(bytes));
        }
    }

    fn read(&self) -> RwLockReadGuard<'_, RouterState> {
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, RouterState> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inbound for MessageRouter {
    fn deliver(&self, delivery: Delivery) {
        let Delivery { destination: addressed, payload, origin } = delivery;
        let origin = origin.as_ref();
        match addressed {
            Destination::To(agent, Subject::Message(_)) => {
                if self.authorize_direct(origin, &agent, &payload) {
                    self.deliver_to(&agent, MailboxItem::Direct(payload));
                }
            }
            Destination::To(agent, Subject::Receipt) => {
                self.deliver_to(&agent, MailboxItem::Receipts(receipts::read(&payload)));
            }
            Destination::All(sender, _) | Destination::AgentState(sender) => {
                self.deliver_to_all(payload, &sender, origin);
            }
        }
    }

    fn presence(&self, presence: Presence) {
        if !self.may_be_present(&presence) {
            return;
        }
        let mut state = self.write();
        let changes = Arc::make_mut(&mut state.directory).update(&presence);
        for change in &changes {
            let resident = change.resident();
            if let Presence::Left(resident) = change {
                state.heard.remove(&resident.agent);
            }
            tracing::debug!(?change, "presence");
            // Fails if no agent runs here: then there is no receiver.
            let _ = self.presence.send(change.clone());
            let namesake = state.agents.get(&resident.agent);
            if let Some(namesake) = namesake.filter(|_| resident.daemon != self.daemon) {
                // If the mailbox is full, the agent has items to handle, and checks for a name
                // conflict after each.
                let _ = namesake.slot.put(MailboxItem::NameConflict);
            }
        }
        drop(state);
        changes.iter().for_each(|change| self.show_commons(change));
    }

    fn rejected(&self, rejected: &Rejected<'_>) {
        self.rejections.note(rejected);
    }

    fn accepts_answer(&self, answer: &Answer<'_>) -> bool {
        self.admits_answer(answer)
    }

    fn receive_query(&self, question: ReceivedQuery) {
        match question.resource {
            Resource::Directory => self.answer_directory(&question),
            Resource::Model => self.answer_model(&question),
            Resource::Mailbox => self.answer_mailbox(&question),
            Resource::Discovered => self.answer_discovered(&question),
            Resource::Plugins => {
                if let Some(tell) = self.plugins.get() {
                    (question.answer)(tell().into());
                }
            }
            Resource::Files => {
                if let Some(files) = self.files.get() {
                    (question.answer)(files.clone().into());
                }
            }
            Resource::Domain
            | Resource::State
            | Resource::Goals
            | Resource::Questions
            | Resource::Journal => {
                // Each agent here (or only the one asked) gets the question; agents that do not
                // serve the resource ignore it.
                let slots: Vec<_> = {
                    let state = self.read();
                    let asked = |agent: &&AgentId| {
                        question.agent.as_ref().is_none_or(|asked| asked == *agent)
                    };
                    let agents = state.agents.iter().filter(|(agent, _)| asked(agent));
                    agents.map(|(_, hosted)| hosted.slot.clone()).collect()
                };
                for slot in slots {
                    let ReceivedQuery { resource, agent, answer } = &question;
                    let question = ReceivedQuery {
                        resource: *resource,
                        agent: agent.clone(),
                        answer: Arc::clone(answer),
                    };
                    let _ = slot.put(MailboxItem::Question(question));
                }
            }
        }
    }
}

impl RouterState {
    fn count_listeners(&mut self) {
        let listens = |hosted: &&HostedAgent| hosted.interests.contains(&Performative::Inform);
        self.listeners = self.agents.values().filter(listens).count();
    }
}

pub(crate) fn inform_of(message: &Message) -> Option<Inform> {
    let is_inform = message.performative == Performative::Inform;
    is_inform.then(|| message.content_as().ok()).flatten()
}
