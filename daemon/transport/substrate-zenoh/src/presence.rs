//! Conversion of liveliness tokens to [`Presence`]: an agent counts as present only if it can be
//! reached.
//!
//! Each Zenoh router computes its routes anew at most every 100 ms. Until then it drops messages,
//! and queries end without an answer. So the first token of a daemon starts a probe of the daemon,
//! and its agents join only when the probe is answered; the rules are in `membership`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use acl::DaemonId;
use substrate::{Presence, Rejected, Resident, ViolationKind};
use tokio::runtime::Handle;
use tokio::sync::{Notify, oneshot};
use tracing::Instrument as _;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::known_sessions::{SyncReply, SyncRequest, digest};
use crate::membership::{HostedAgents, Membership, TokenEffects};
use crate::open_error::{OpenError, undeclared};
use crate::queries::{AnnouncedAgents, QuerySender};

/// How long a daemon is probed after its first token. After that, only the roll calls query the
/// daemon, once a second. The routes exist after 100 ms on an idle machine, and took three times as
/// long on a busy one.
const REACHED_WITHIN: Duration = Duration::from_secs(1);

/// How long the answer to a probe is awaited before the next probe is sent, because the answer may
/// have been lost. An answer that comes later counts as well.
const ANSWERED_WITHIN: Duration = Duration::from_millis(100);

/// Pause between two probes of a daemon. A probe without a route costs a fifth of a millisecond.
const PROBE_PERIOD: Duration = Duration::from_millis(5);
const _: () = assert!(PROBE_PERIOD.as_millis() < ANSWERED_WITHIN.as_millis());

/// Number of daemons that are probed in this period. If there are more, each is probed less often:
/// tokens in invented names must not cost this daemon more than two thirds of a core.
const PROBED_AT_ONCE: u32 = 16;

/// The subscriber for liveliness tokens. It passes on changes of presence in the order in which
/// they arise.
pub(crate) struct LivelinessSubscriber {
    queries: QuerySender,
    /// The agents that this daemon has announced itself.
    announced: Weak<dyn AnnouncedAgents>,
    /// Weak reference, because the session owns the callback that owns this subscriber.
    session: Weak<Session>,
    runtime: Handle,
    /// Number of daemons that are being probed.
    probed: AtomicU32,
    state: Mutex<PresenceState>,
    /// Notified whenever a token of another daemon comes or goes.
    pub(crate) churn: Notify,
}

struct PresenceState {
    membership: Membership,
    /// Changes of presence that are still to be passed on. `is_passing` is `true` while a thread
    /// passes them on.
    outbox: VecDeque<Presence>,
    is_passing: bool,
}

/// Declares the subscriber for liveliness tokens. Tokens that were declared before are delivered
/// too.
///
/// # Panics
///
/// Panics outside a Tokio runtime.
pub(crate) fn declare(
    session: &Arc<Session>,
    asking: &QuerySender,
    announced: Weak<dyn AnnouncedAgents>,
    lease: Duration,
) -> Result<Arc<LivelinessSubscriber>, OpenError> {
    let roster = Membership::new(asking.keys.daemon().clone(), lease);
    let watch = Arc::new(LivelinessSubscriber {
        queries: asking.clone(),
        announced,
        session: Arc::downgrade(session),
        runtime: Handle::current(),
        probed: AtomicU32::new(0),
        state: Mutex::new(PresenceState {
            membership: roster,
            outbox: VecDeque::new(),
            is_passing: false,
        }),
        churn: Notify::new(),
    });
    let (key_expr, hearing) = (asking.keys.everyone_alive(), Arc::clone(&watch));
    let hear = move |sample: Sample| LivelinessSubscriber::receive_token(&hearing, &sample);
    let liveliness = session.liveliness();
    let subscriber = liveliness.declare_subscriber(&key_expr).history(true).callback(hear);
    let subscriber = subscriber.background().wait();
    subscriber.map_err(|source| undeclared("liveliness", &key_expr, source))?;
    Ok(watch)
}

// === impl LivelinessSubscriber ===

impl LivelinessSubscriber {
    fn receive_token(watch: &Arc<LivelinessSubscriber>, sample: &Sample) {
        let key = sample.key_expr().as_str();
        let Some((resident, telling)) = watch.queries.keys.resident(key) else {
            return tracing::debug!(key, "ignored a liveliness token that names no agent");
        };
        let daemon = resident.daemon.clone();
        if daemon == *watch.queries.keys.daemon() {
            return watch.receive_own(resident, telling, sample.kind());
        }
        let mut is_unknown = false;
        let take = |roster: &mut Membership| {
            let TokenEffects { passed_on, probe } = match sample.kind() {
                SampleKind::Put => roster.add_token(resident, telling),
                SampleKind::Delete => roster.remove_token(&resident, telling),
            };
            is_unknown = probe;
            passed_on
        };
        watch.with(take);
        watch.churn.notify_one();
        if is_unknown {
            let span = tracing::debug_span!("probe", %daemon);
            let probe = LivelinessSubscriber::probe(Arc::clone(watch), daemon);
            watch.runtime.spawn(probe.instrument(span));
        }
    }

    /// Handles a token in this daemon's own name, which any session can declare: agents are present
    /// from their announcement by this daemon until it withdraws them. Presence is passed on at
    /// once: when `announce` returns, its caller has received the agent's presence.
    fn receive_own(&self, resident: Resident, telling: u64, kind: SampleKind) {
        let is_announced = self
            .announced
            .upgrade()
            .is_some_and(|each| each.has_announced(&resident.agent, resident.incarnation));
        let passed_on = match (kind, is_announced) {
            (SampleKind::Put, true) => {
                self.lock().membership.add_token(resident, telling).passed_on
            }
            (SampleKind::Delete, false) => self.lock().membership.withdraw_own(&resident),
            // A guest hears of its own agents through a daemon: without one, nothing is present.
            (SampleKind::Delete, true) if self.queries.keys.is_guest() => {
                self.lock().membership.remove_token(&resident, telling).passed_on
            }
            // A token of an earlier round, or a second one of the same agent.
            (SampleKind::Delete, true) => return,
            (SampleKind::Put, false) => {
                let Resident { agent, daemon, .. } = &resident;
                let detail = format!("is a token of `{agent}`, which this daemon does not host");
                let (violation, claimed) = (ViolationKind::Forged, Some(daemon.as_str()));
                let key = agent.as_str();
                return self.queries.inbound.rejected(&Rejected {
                    violation,
                    detail: &detail,
                    claimed,
                    key,
                });
            }
        };
        passed_on.into_iter().for_each(|presence| self.queries.inbound.presence(presence));
    }

    /// Applies `change` to the membership and passes on the changes of presence that it returns.
    /// The lock is not held meanwhile, because the receiver may announce an agent, which calls this
    /// subscriber again. If another thread is already passing on changes, that thread passes on
    /// these changes too, so that the order is kept.
    fn with(&self, change: impl FnOnce(&mut Membership) -> Vec<Presence>) {
        let surplus = {
            let mut state = self.lock();
            let follows = change(&mut state.membership);
            state.outbox.extend(follows);
            state.membership.take_rejected()
        };
        self.reject(&surplus);
        let mut state = self.lock();
        if std::mem::replace(&mut state.is_passing, true) {
            return;
        }
        while let Some(presence) = state.outbox.pop_front() {
            drop(state);
            self.queries.inbound.presence(presence);
            state = self.lock();
        }
        state.is_passing = false;
    }

    /// Reports tokens that were rejected because there is no room for them.
    fn reject(&self, surplus: &[Resident]) {
        for Resident { agent, daemon, .. } in surplus {
            let detail = format!("is a token of `{agent}`, for which there is no room");
            let (violation, claimed, key) =
                (ViolationKind::Flooded, Some(daemon.as_str()), agent.as_str());
            self.queries.inbound.rejected(&Rejected { violation, detail: &detail, claimed, key });
        }
    }

    /// Returns the daemons other than this one that have a token.
    pub(crate) fn others(&self) -> BTreeSet<DaemonId> {
        let (_, known) = self.known_digests();
        known.into_keys().filter(|daemon| daemon != self.queries.keys.daemon()).collect()
    }

    /// Returns the number of tokens received so far, which must be stored when a query is sent, and
    /// for each daemon the digest of its agents that have a token.
    pub(crate) fn known_digests(&self) -> (u64, BTreeMap<DaemonId, u64>) {
        self.known_of(None)
    }

    /// Returns the same as [`LivelinessSubscriber::known_digests`]; if `one` is given, for the
    /// daemon `one` only.
    fn known_of(&self, one: Option<&DaemonId>) -> (u64, BTreeMap<DaemonId, u64>) {
        let state = self.lock();
        let known = state.membership.known_agents(one);
        (
            state.membership.watermark(),
            known.map(|(daemon, agents)| (daemon, digest(&agents))).collect(),
        )
    }

    /// Handles the answer of `daemon` to a roll call or probe. `mark` is the number of tokens that
    /// had been received when the query was sent.
    pub(crate) fn receive_reply(&self, daemon: &DaemonId, reply: Option<&SyncReply>, mark: u64) {
        let hosts = reply.map_or(HostedAgents::Unstated, |reply| match &reply.hosts {
            Some(hosts) => HostedAgents::Listed(hosts),
            None => HostedAgents::AsKnown,
        });
        self.with(|roster| roster.receive_reply(daemon, hosts, mark));
    }

    /// Handles the end of a roll call. Returns the daemons that have a token and did not answer.
    pub(crate) fn finish_round(
        &self,
        answered: &BTreeSet<DaemonId>,
        mark: u64,
    ) -> BTreeSet<DaemonId> {
        self.with(|roster| roster.finish_round(answered, mark, Instant::now()));
        self.lock().membership.silent()
    }

    /// Probes a daemon until it answers, until all its tokens are gone, or until [`REACHED_WITHIN`]
    /// has passed.
    async fn probe(watch: Arc<LivelinessSubscriber>, daemon: DaemonId) {
        let answered = async {
            while watch.lock().membership.awaits(&daemon) {
                let Some(ended) = LivelinessSubscriber::call(&watch, &daemon) else { return };
                // Without a route the query ends at once.
                if tokio::time::timeout(ANSWERED_WITHIN, ended).await.is_ok() {
                    let others = watch.probed.load(Ordering::Relaxed) / PROBED_AT_ONCE;
                    tokio::time::sleep(PROBE_PERIOD * (others + 1)).await;
                }
            }
        };
        watch.probed.fetch_add(1, Ordering::Relaxed);
        let in_time = tokio::time::timeout(REACHED_WITHIN, answered).await;
        watch.probed.fetch_sub(1, Ordering::Relaxed);
        if in_time.is_err() {
            tracing::debug!("no answer yet; it will be called again");
            watch.lock().membership.unreached(&daemon);
        }
    }

    /// Sends a probe to one daemon. The returned future ends with the first answer, or when no more
    /// answers will come. Returns `None` if the session is closed.
    fn call(watch: &Arc<LivelinessSubscriber>, daemon: &DaemonId) -> Option<impl Future + use<>> {
        let (ends, ended) = oneshot::channel::<()>();
        let mut ends = Some(ends);
        let (mark, known) = watch.known_of(Some(daemon));
        let QuerySender { keys, .. } = &watch.queries;
        let call = SyncRequest::new(known, keys.daemon());
        let hearing = Arc::downgrade(watch);
        let hear = move |daemon, reply: Option<SyncReply>| {
            if let Some(watch) = hearing.upgrade() {
                watch.receive_reply(&daemon, reply.as_ref(), mark);
            }
            // Dropping the sender ends the returned future.
            ends.take();
        };
        let session = watch.session.upgrade()?;
        watch.queries.call(&session, keys.reach(daemon), &call, REACHED_WITHIN, hear)?;
        Some(ended)
    }

    fn lock(&self) -> MutexGuard<'_, PresenceState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
