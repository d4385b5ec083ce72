//! Anti-entropy of membership: a daemon periodically sends a query (a *call*) to all daemons, and makes
//! all its declarations again if an answer shows that some daemon has missed them.
//!
//! Zenoh's routers send each declaration (of a subscription, a queryable or a token) to each other once,
//! and never again. Between a change of the mesh and the moment at which the routes are computed anew, a
//! tenth of a second later, a router can miss a new declaration, drop a valid one, or receive one of a
//! dead session. This error then remains. (`pubsub_tree_change` compares indices in the graph, which are
//! reused; declarations of a router that is not in the graph are kept, and those of a router that was cut
//! off for a moment are not.) So declarations that were missed have to be made again:
//!
//! - Each session has a liveliness token of its own, with its Zenoh id. `told` is the set of sessions
//!   from which a session has received such a token.
//! - Each session answers a call with three things: the agents that it hosts, its `told` sessions, and
//!   the daemons that do not answer its own calls. The agents are usually left out: the call carries, for
//!   each daemon, a digest of the agents that the caller knows, and a daemon lists its agents only if its
//!   own digest is different.
//! - In a secured ecosystem the answer also carries the sequence numbers that the daemon has signed so
//!   far. A session that has just begun to listen can then reject recordings of messages sent earlier.
//! - A session makes all its declarations again in three cases: if an answer does not list it or calls
//!   its daemon silent, if an answer lists a session that it does not know, or if it has a link to a
//!   router that it does not know.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation};
use bytes::Bytes;
use credentials::SequenceState;
use serde::{Deserialize, Serialize};
use substrate::{Inbound, Rejected, ViolationKind};
use tokio::sync::{Notify, oneshot};
use tokio::time::Instant;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::config::OpenError;
use crate::declarations::Declarations;
use crate::inbound::undeclared;
use crate::key_expr::KeySpace;
use crate::presence::LivelinessSubscriber;
use crate::queries::QuerySender;

/// Pause between two calls while the membership changes or is in doubt, and the time within which a call
/// must be answered. It is far longer than the tenth of a second after which Zenoh's routes are computed
/// anew. If there are no changes, one call is made per lease.
const UNREST_PERIOD: Duration = Duration::from_secs(1);

/// How long after the last change of the membership the pause between calls remains `UNREST_PERIOD`.
const UNREST: Duration = Duration::from_secs(3);

/// Longest pause between two repetitions of all declarations.
const PAUSE_MAX: Duration = Duration::from_secs(60);

/// Maximum number of repetitions of all declarations that one unknown session causes. Such a session may
/// be a plain router, a foreign program, or a dead session that another router still advertises.
const TOLD_MAX: u32 = 3;

/// Maximum number of calling daemons that are remembered: as many daemons as an ecosystem may have.
const CALLERS_MAX: usize = 1_024;

/// Maximum number of sessions that are known: twice the number of daemons, because guests (short-lived
/// sessions) come and go. Every answer names all of them.
const SESSIONS_MAX: usize = 2 * CALLERS_MAX;

/// Maximum number of declarations of one session's token that are recorded: normally there is one, or two
/// for a moment when it is declared again.
const TELLINGS_MAX: usize = 8;

/// Maximum length of an answer that is read, in bytes.
const ANSWER_BYTES_MAX: usize = 1 << 20;

/// Answer of a daemon to a call (the periodic query to all daemons).
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SyncReply {
    /// Agents that the daemon hosts; `None` if the call contained the right digest of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) hosts: Option<Vec<(AgentId, Incarnation)>>,
    /// Sessions from which the answering session has received a token, by their Zenoh ids.
    told: BTreeSet<String>,
    /// Daemons that have a token and do not answer the calls of the answering daemon.
    #[serde(default)]
    silent: BTreeSet<DaemonId>,
    /// The sequence numbers that the daemon has signed so far; `None` if the ecosystem is not secured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) said: Option<SequenceState>,
}

/// Content of a call (the periodic query to all daemons).
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct SyncRequest {
    /// For each daemon, a [`digest`] of the agents that the caller knows it to host.
    #[serde(default)]
    known: BTreeMap<DaemonId, u64>,
    /// Name of the calling daemon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    by: Option<DaemonId>,
}

/// The sessions from which this session has received a token, and the daemons that are silent or have
/// called. This is the part of an answer that concerns other daemons.
#[derive(Clone, Default)]
pub(crate) struct KnownSessions {
    table: Arc<Mutex<SessionTable>>,
    /// Notified whenever a call of another daemon arrives.
    called: Arc<Notify>,
}

#[derive(Default)]
struct SessionTable {
    sessions: BTreeMap<String, BTreeSet<u64>>,
    silent: BTreeSet<DaemonId>,
    /// Daemons that have called, by the name in the call. The name is not verified.
    callers: BTreeSet<DaemonId>,
}

/// Task that sends calls to all daemons until the session is closed.
pub(crate) struct AntiEntropy {
    pub(crate) session: Weak<Session>,
    pub(crate) queries: QuerySender,
    pub(crate) known_sessions: KnownSessions,
    pub(crate) liveliness: Arc<LivelinessSubscriber>,
    pub(crate) declarations: Arc<Declarations>,
    pub(crate) lease: Duration,
}

/// Result of one call to all daemons.
#[derive(Debug, Default)]
struct SyncRound {
    answered: BTreeSet<DaemonId>,
    /// Daemons that do not know this session, or do not receive its answers to their calls.
    unaware: BTreeSet<DaemonId>,
    /// Sessions from which this session has received no token, although other sessions name them or this
    /// session has a link to them.
    unknown_sessions: BTreeSet<String>,
}

/// State that is kept between calls, to decide whether all declarations have to be made again.
#[derive(Debug)]
struct RedeclarePolicy {
    /// Whether the last call found that a declaration is missing. One such call alone does not count,
    /// because it may have come too early.
    is_suspicious: bool,
    /// Number of repetitions of all declarations that each unknown session has caused.
    tries: BTreeMap<String, u32>,
    not_before: Instant,
    pause: Duration,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SyncDecision {
    InSync,
    CheckAgain,
    Redeclare,
}

// === impl SyncReply ===

impl SyncReply {
    /// Builds the answer of this session to a call. The hosted agents are left out if the call contains
    /// their digest.
    pub(crate) fn answer(
        hosts: Vec<(AgentId, Incarnation)>,
        told: &KnownSessions,
        said: Option<SequenceState>,
        (me, call): (&DaemonId, &SyncRequest),
    ) -> Bytes {
        let is_known = call.known.get(me) == Some(&digest(&hosts));
        let hosts = (!is_known).then_some(hosts);
        let known = lock(&told.table);
        let (told, silent) = (known.sessions.keys().cloned().collect(), known.silent.clone());
        drop(known);
        let roll = SyncReply { hosts, told, silent, said };
        serde_json::to_vec(&roll).map_or_else(|_| Bytes::new(), Bytes::from)
    }

    /// Parses an answer. Returns `None` if it is too long or malformed. The daemon then still counts as
    /// having answered.
    pub(crate) fn read(answer: &[u8]) -> Option<SyncReply> {
        let is_read = answer.len() <= ANSWER_BYTES_MAX;
        is_read.then(|| serde_json::from_slice(answer).ok()).flatten()
    }
}

// === impl SyncRequest ===

impl SyncRequest {
    pub(crate) fn new(known: BTreeMap<DaemonId, u64>, by: &DaemonId) -> SyncRequest {
        SyncRequest { known, by: Some(by.clone()) }
    }

    /// Parses a call. A call that is too long or malformed is treated as one without digests and without
    /// a name.
    pub(crate) fn read(call: &[u8]) -> SyncRequest {
        let is_read = call.len() <= ANSWER_BYTES_MAX;
        is_read.then(|| serde_json::from_slice(call).ok()).flatten().unwrap_or_default()
    }

    pub(crate) fn write(&self) -> Vec<u8> {
        serde_json::to_vec(self).unwrap_or_default()
    }
}

/// Returns a digest of agents, which must be sorted by name. It has 53 bits, which every JSON parser can
/// hold. Another version or build may compute another digest; then the agents are listed in the answer.
pub(crate) fn digest<'a>(agents: impl IntoIterator<Item = &'a (AgentId, Incarnation)>) -> u64 {
    let mut hasher = DefaultHasher::new();
    agents.into_iter().for_each(|agent| agent.hash(&mut hasher));
    hasher.finish() >> 11
}

// === impl KnownSessions ===

impl KnownSessions {
    /// Declares the subscriber for the tokens of sessions. Tokens that were declared before are delivered
    /// too.
    pub(crate) fn declare(
        session: &Session,
        keys: &KeySpace,
        inbound: &Arc<dyn Inbound>,
    ) -> Result<KnownSessions, OpenError> {
        let (told, key_expr) = (KnownSessions::default(), keys.every_session());
        let (hearing, reading, inbound) = (told.clone(), keys.clone(), Arc::clone(inbound));
        let hear = move |sample: Sample| {
            let key = sample.key_expr().as_str();
            let Some((zid, telling)) = reading.session(key) else {
                return tracing::debug!(key, "ignored a liveliness token that names no session");
            };
            if !hearing.receive_token(zid, telling, sample.kind()) {
                let detail = "is a token of one more session than there is room for";
                let (breach, claimed) = (ViolationKind::Flooded, None);
                inbound.rejected(&Rejected { violation: breach, detail, claimed, key });
            }
        };
        let liveliness = session.liveliness();
        let subscriber = liveliness.declare_subscriber(&key_expr).history(true).callback(hear);
        let subscriber = subscriber.background().wait();
        subscriber.map_err(|source| undeclared("liveliness", &key_expr, source))?;
        Ok(told)
    }

    /// Handles that the token of a session has come or gone; returns `false` if there is no room to
    /// record it.
    fn receive_token(&self, zid: &str, telling: u64, kind: SampleKind) -> bool {
        let told = &mut lock(&self.table).sessions;
        match kind {
            SampleKind::Put if told.len() >= SESSIONS_MAX && !told.contains_key(zid) => {
                return false;
            }
            SampleKind::Put => {
                let tellings = told.entry(zid.to_owned()).or_default();
                tellings.insert(telling);
                if tellings.len() > TELLINGS_MAX {
                    tellings.pop_first();
                }
            }
            SampleKind::Delete => {
                if let Some(tellings) = told.get_mut(zid) {
                    tellings.remove(&telling);
                    if tellings.is_empty() {
                        told.remove(zid);
                    }
                }
            }
        }
        true
    }

    /// Records which daemon has sent a call. It must be called after the answer was sent.
    pub(crate) fn record_caller(&self, call: &SyncRequest) {
        let Some(by) = &call.by else { return };
        let callers = &mut lock(&self.table).callers;
        if callers.len() < CALLERS_MAX && callers.insert(by.clone()) {
            self.called.notify_waiters();
        }
    }

    /// Waits until all of the daemons in `those` have called, for two seconds at most.
    pub(crate) async fn called_by(&self, those: &BTreeSet<DaemonId>) {
        let called = async {
            loop {
                let next = self.called.notified();
                tokio::pin!(next);
                // Registered before the check, so that no notification is missed.
                next.as_mut().enable();
                if those.is_subset(&lock(&self.table).callers) {
                    return;
                }
                next.await;
            }
        };
        // Every daemon calls at least once a second while the membership changes.
        let _ = tokio::time::timeout(UNREST_PERIOD * 2, called).await;
    }

    fn has(&self, zid: &str) -> bool {
        lock(&self.table).sessions.contains_key(zid)
    }
}

// === impl AntiEntropy ===

impl AntiEntropy {
    /// Sends calls until the session is closed.
    pub(crate) async fn run(self) {
        let mut judgement = RedeclarePolicy::new(Instant::now());
        let mut unrest_until = Instant::now() + UNREST;
        loop {
            let is_restless = Instant::now() < unrest_until;
            let pause = if is_restless { UNREST_PERIOD } else { self.lease.max(UNREST_PERIOD) };
            tokio::select! {
                () = tokio::time::sleep(pause) => (),
                () = self.liveliness.churn.notified(), if !is_restless => {
                    unrest_until = Instant::now() + UNREST;
                    continue;
                }
            }
            let (mark, known) = self.liveliness.known_digests();
            let Some(answers) =
                self.call(mark, &SyncRequest::new(known, self.queries.keys.daemon())).await
            else {
                return;
            };
            let silent = self.liveliness.finish_round(&answers.answered, mark);
            let is_beyond_doubt = silent.is_empty();
            lock(&self.known_sessions.table).silent = silent;
            let verdict = judgement.judge(&answers, Instant::now());
            if !is_beyond_doubt || verdict != SyncDecision::InSync {
                unrest_until = Instant::now() + UNREST;
            }
            if verdict == SyncDecision::Redeclare {
                let SyncRound { unaware: untold, unknown_sessions: unknown, .. } = &answers;
                tracing::info!(?untold, ?unknown, "announces agents again: some daemons miss them");
                self.declarations.redeclare_all();
            }
        }
    }

    /// Sends a call to all daemons, and compares the routers that this session is linked with to the
    /// sessions that it knows. Returns `None` if the session is closed.
    async fn call(&self, mark: u64, call: &SyncRequest) -> Option<SyncRound> {
        let answers = Arc::<Mutex<SyncRound>>::default();
        let (ends, ended) = oneshot::channel::<()>();
        {
            let session = self.session.upgrade().filter(|session| !session.is_closed())?;
            let own = session.zid().to_string();
            let (told, watch) = (self.known_sessions.clone(), Arc::clone(&self.liveliness));
            let (me, heard) = (self.queries.keys.daemon().clone(), Arc::clone(&answers));
            let hear = move |daemon, roll: Option<SyncReply>| {
                // Dropped with this callback, when no more answers come.
                let _ends = &ends;
                if daemon != me {
                    watch.receive_reply(&daemon, roll.as_ref(), mark);
                    lock(&heard).record(daemon, roll.as_ref(), (&own, &me), &told);
                }
            };
            let everyone = self.queries.keys.everyone_reached();
            self.queries.call(&session, everyone, call, UNREST_PERIOD, hear)?;
        }
        // The result is always an error, because the callback drops the sender.
        let _ = ended.await;
        let session = self.session.upgrade()?;
        let mut answers = std::mem::take(&mut *lock(&answers));
        let routers = session.info().routers_zid().wait().map(|zid| zid.to_string());
        answers.unknown_sessions.extend(routers.filter(|zid| !self.known_sessions.has(zid)));
        Some(answers)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

// === impl SyncRound ===

impl SyncRound {
    fn record(
        &mut self,
        daemon: DaemonId,
        roll: Option<&SyncReply>,
        (own, me): (&str, &DaemonId),
        told: &KnownSessions,
    ) {
        if let Some(roll) = roll {
            if !roll.told.contains(own) || roll.silent.contains(me) {
                self.unaware.insert(daemon.clone());
            }
            self.unknown_sessions.extend(roll.told.iter().filter(|zid| !told.has(zid)).cloned());
        }
        self.answered.insert(daemon);
    }
}

// === impl RedeclarePolicy ===

impl RedeclarePolicy {
    fn new(now: Instant) -> RedeclarePolicy {
        RedeclarePolicy {
            is_suspicious: false,
            tries: BTreeMap::new(),
            not_before: now,
            pause: UNREST_PERIOD,
        }
    }

    /// Decides what to do after a call. All declarations are repeated, at growing intervals, for as long
    /// as another daemon does not know this session. An unknown session may be one that declares nothing,
    /// so it causes only [`TOLD_MAX`] repetitions.
    fn judge(&mut self, answers: &SyncRound, now: Instant) -> SyncDecision {
        self.tries.retain(|zid, _| answers.unknown_sessions.contains(zid));
        let tries = |zid: &String| self.tries.get(zid).copied().unwrap_or_default();
        let is_amiss = !answers.unaware.is_empty()
            || answers.unknown_sessions.iter().any(|zid| tries(zid) < TOLD_MAX);
        let was_suspicious = std::mem::replace(&mut self.is_suspicious, is_amiss);
        if !is_amiss {
            self.pause = UNREST_PERIOD;
            return SyncDecision::InSync;
        }
        if !was_suspicious || now < self.not_before {
            return SyncDecision::CheckAgain;
        }
        self.is_suspicious = false;
        self.not_before = now + self.pause;
        self.pause = (self.pause * 2).min(PAUSE_MAX);
        for zid in &answers.unknown_sessions {
            *self.tries.entry(zid.clone()).or_default() += 1;
        }
        SyncDecision::Redeclare
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn amiss(untold: &[&str], unknown: &[&str]) -> SyncRound {
        let untold = untold.iter().map(|name| DaemonId::new(name).expect("a name")).collect();
        let unknown = unknown.iter().map(|&zid| zid.to_owned()).collect();
        SyncRound { answered: BTreeSet::new(), unaware: untold, unknown_sessions: unknown }
    }

    #[test]
    fn who_was_not_told_is_told_again_ever_more_rarely() {
        let start = Instant::now();
        let mut judgement = RedeclarePolicy::new(start);
        let untold = amiss(&["pi"], &[]);
        let at = |seconds| start + Duration::from_secs(seconds);
        let told: Vec<_> = (0..40)
            .filter(|&second| judgement.judge(&untold, at(second)) == SyncDecision::Redeclare)
            .collect();
        assert_eq!(told, [1, 3, 5, 9, 17, 33], "one call may have come too early");
        assert_eq!(judgement.judge(&amiss(&[], &[]), at(40)), SyncDecision::InSync);
        assert_eq!(judgement.judge(&untold, at(65)), SyncDecision::CheckAgain);
        assert_eq!(judgement.judge(&untold, at(66)), SyncDecision::Redeclare);
    }

    #[test]
    fn who_is_not_heard_of_is_given_up_until_it_was_gone() {
        let start = Instant::now();
        let mut judgement = RedeclarePolicy::new(start);
        let at = |seconds| start + Duration::from_secs(seconds);
        let mut told = |link: &SyncRound, from: u64| {
            let tells =
                |&second: &u64| judgement.judge(link, at(second)) == SyncDecision::Redeclare;
            (from..from + 100).filter(tells).count()
        };
        let router = amiss(&[], &["a1"]);
        assert_eq!(told(&router, 0), 3);
        assert_eq!(told(&router, 100), 0);
        assert_eq!(told(&amiss(&[], &[]), 200), 0);
        assert_eq!(told(&router, 300), 3);
    }

    #[test]
    fn sessions_are_remembered_within_a_bound() {
        let told = KnownSessions::default();
        let hear = |number: usize, kind| told.receive_token(&format!("{number:x}"), 0, kind);
        let taken = (0..2 * SESSIONS_MAX).filter(|number| hear(*number, SampleKind::Put));
        assert_eq!(taken.count(), SESSIONS_MAX);
        assert!(hear(0, SampleKind::Put), "a known session is taken again");
        for telling in 0..100 {
            told.receive_token("0", telling, SampleKind::Put);
        }
        assert_eq!(lock(&told.table).sessions["0"].len(), TELLINGS_MAX);
        hear(1, SampleKind::Delete);
        assert!(hear(SESSIONS_MAX, SampleKind::Put), "there is room again");
    }

    #[test]
    fn an_answer_is_read_as_it_was_given() {
        let told = KnownSessions::default();
        told.receive_token("a1", 0, SampleKind::Put);
        told.receive_token("a1", 1, SampleKind::Put);
        told.receive_token("a1", 0, SampleKind::Delete);
        let robot = (AgentId::new("robot").expect("a name"), Incarnation(7));
        let (pi, me) = (DaemonId::new("pi").expect("a name"), DaemonId::new("me").expect("a name"));
        let nothing = SyncRequest::read(b"");
        let answer = SyncReply::answer(vec![robot.clone()], &told, None, (&pi, &nothing));
        let read = SyncReply::read(&answer);
        let named = |roll: &Option<SyncReply>| roll.as_ref().expect("a roll").hosts.clone();
        assert_eq!(named(&read), Some(vec![robot.clone()]));
        let later = (robot.0.clone(), Incarnation(8));
        for (known, is_named) in [(vec![robot.clone()], false), (vec![later], true), (vec![], true)]
        {
            let call = SyncRequest::new([(pi.clone(), digest(&known))].into(), &me);
            let call = SyncRequest::read(&call.write());
            let answer = SyncReply::answer(vec![robot.clone()], &told, None, (&pi, &call));
            told.record_caller(&call);
            assert_eq!(named(&SyncReply::read(&answer)).is_some(), is_named, "{known:?}");
        }
        let mut answers = SyncRound::default();
        answers.record(pi.clone(), read.as_ref(), ("b2", &me), &KnownSessions::default());
        assert_eq!(answers.unaware.len(), 1, "it was not told of b2");
        assert_eq!(answers.unknown_sessions.first().map(String::as_str), Some("a1"));
        let mut answers = SyncRound::default();
        answers.record(pi.clone(), read.as_ref(), ("a1", &me), &told);
        assert!(answers.unaware.is_empty() && answers.unknown_sessions.is_empty());
        assert!(lock(&told.table).callers.contains(&me), "the caller is known");
        lock(&told.table).silent.insert(me.clone());
        let read = SyncReply::read(&SyncReply::answer(Vec::new(), &told, None, (&pi, &nothing)));
        answers.record(pi, read.as_ref(), ("a1", &me), &told);
        assert_eq!(answers.unaware.len(), 1, "it is not answered");
        for garbage in [&b""[..], b"{", b"[1]", b"{\"hosts\":[[\"X\",1]],\"told\":[]}"] {
            assert!(SyncReply::read(garbage).is_none());
        }
    }
}
