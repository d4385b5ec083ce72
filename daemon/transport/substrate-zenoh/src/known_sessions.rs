//! Sessions of an ecosystem from which a daemon has received tokens, and the messages in which
//! daemons compare them: the roll calls and answers of `anti_entropy`.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation};
use bytes::Bytes;
use credentials::SequenceState;
use serde::{Deserialize, Serialize};
use substrate::{Inbound, Rejected, ViolationKind};
use tokio::sync::Notify;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::key_expr::KeySpace;
use crate::open_error::{OpenError, undeclared};

/// Maximum number of daemons that are remembered as senders of roll calls: as many daemons as an
/// ecosystem may have. Further daemons are not remembered.
const CALLERS_MAX: usize = 1_024;

/// Maximum number of sessions that are recorded: twice the number of daemons, because guests
/// (short-lived sessions) come and go. The tokens of further sessions are ignored. Every answer
/// lists all recorded sessions.
const SESSIONS_MAX: usize = 2 * CALLERS_MAX;

/// Maximum number of declarations of one session's token that are recorded. Normally there is one,
/// or two for a moment while the token is declared again.
const TELLINGS_MAX: usize = 8;

/// Maximum length of an answer or a query that is read, in bytes.
const ANSWER_BYTES_MAX: usize = 1 << 20;

/// Longest wait of [`KnownSessions::called_by`] for the roll calls of other daemons. Every daemon
/// sends one at least once a second while the membership changes. Daemons that have sent none by
/// then are not waited for any longer.
const CALLED_WITHIN: Duration = Duration::from_secs(2);

/// Answer of a daemon to a roll call (the periodic query to all daemons) or a probe.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SyncReply {
    /// Agents that the daemon hosts; `None` if the query contained the right digest of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) hosts: Option<Vec<(AgentId, Incarnation)>>,
    /// Sessions from which the answering session has received a token, by their Zenoh ids.
    pub(crate) known_sessions: BTreeSet<String>,
    /// Daemons that have a token and do not answer the roll calls of the answering daemon.
    #[serde(default)]
    pub(crate) silent: BTreeSet<DaemonId>,
    /// The sequence numbers that the daemon has signed so far; `None` if the ecosystem is not
    /// secured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) signed: Option<SequenceState>,
}

/// Content of a roll call (the periodic query to all daemons) or a probe (the same query to one
/// daemon).
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct SyncRequest {
    /// For each daemon, a [`digest`] of its agents, as the sender of the query has recorded them.
    #[serde(default)]
    known: BTreeMap<DaemonId, u64>,
    /// Name of the daemon that sent the query.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    by: Option<DaemonId>,
}

/// The sessions from which this session has received a token, the daemons that are silent (that do
/// not answer its roll calls), and the daemons that have sent a roll call. The first two are part
/// of each answer to a roll call.
#[derive(Clone, Default)]
pub(crate) struct KnownSessions {
    table: Arc<Mutex<SessionTable>>,
    /// Notified whenever a roll call of another daemon arrives.
    called: Arc<Notify>,
}

#[derive(Default)]
struct SessionTable {
    sessions: BTreeMap<String, BTreeSet<u64>>,
    silent: BTreeSet<DaemonId>,
    /// Daemons that have sent a roll call, by the name in it. The name is not verified.
    callers: BTreeSet<DaemonId>,
}

// === impl SyncReply ===

impl SyncReply {
    /// Builds the answer of this session to a roll call or a probe. The hosted agents are left out
    /// if the query contains the right digest of them.
    pub(crate) fn answer(
        hosts: Vec<(AgentId, Incarnation)>,
        sessions: &KnownSessions,
        signed: Option<SequenceState>,
        (me, call): (&DaemonId, &SyncRequest),
    ) -> Bytes {
        let is_known = call.known.get(me) == Some(&digest(&hosts));
        let hosts = (!is_known).then_some(hosts);
        let known = lock(&sessions.table);
        let (known_sessions, silent) =
            (known.sessions.keys().cloned().collect(), known.silent.clone());
        drop(known);
        let reply = SyncReply { hosts, known_sessions, silent, signed };
        serde_json::to_vec(&reply).map_or_else(|_| Bytes::new(), Bytes::from)
    }

    /// Parses an answer. Returns `None` if the answer is too long or malformed. The daemon then
    /// still counts as having answered.
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

    /// Parses a roll call or a probe. A query that is too long or malformed is treated as one
    /// without digests and without a name.
    pub(crate) fn read(call: &[u8]) -> SyncRequest {
        let is_read = call.len() <= ANSWER_BYTES_MAX;
        is_read.then(|| serde_json::from_slice(call).ok()).flatten().unwrap_or_default()
    }

    pub(crate) fn write(&self) -> Vec<u8> {
        serde_json::to_vec(self).unwrap_or_default()
    }
}

/// Returns a digest of agents, which must be sorted by name. The digest has 53 bits, which every
/// JSON parser can hold. Another version or build may compute another digest; then the agents are
/// listed in the answer.
pub(crate) fn digest<'a>(agents: impl IntoIterator<Item = &'a (AgentId, Incarnation)>) -> u64 {
    let mut hasher = DefaultHasher::new();
    agents.into_iter().for_each(|agent| agent.hash(&mut hasher));
    hasher.finish() >> 11
}

// === impl KnownSessions ===

impl KnownSessions {
    /// Declares the subscriber for the tokens of sessions. Tokens that were declared before are
    /// delivered too.
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
                let (violation, claimed) = (ViolationKind::Flooded, None);
                inbound.rejected(&Rejected { violation, detail, claimed, key });
            }
        };
        let liveliness = session.liveliness();
        let subscriber = liveliness.declare_subscriber(&key_expr).history(true).callback(hear);
        let subscriber = subscriber.background().wait();
        subscriber.map_err(|source| undeclared("liveliness", &key_expr, source))?;
        Ok(told)
    }

    /// Records that the token of a session has come or gone; returns `false` if there is no room to
    /// record it.
    pub(crate) fn receive_token(&self, zid: &str, telling: u64, kind: SampleKind) -> bool {
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

    /// Records which daemon has sent a roll call. Must be called after the answer was sent.
    pub(crate) fn record_caller(&self, call: &SyncRequest) {
        let Some(by) = &call.by else { return };
        let callers = &mut lock(&self.table).callers;
        if callers.len() < CALLERS_MAX && callers.insert(by.clone()) {
            self.called.notify_waiters();
        }
    }

    /// Waits until all daemons in `those` have sent a roll call, for [`CALLED_WITHIN`] at most. In
    /// a secured ecosystem a daemon accepts the broadcasts of this daemon only after this daemon
    /// has answered its roll call.
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
        let _ = tokio::time::timeout(CALLED_WITHIN, called).await;
    }

    /// Records which daemons have a token and do not answer the roll calls of this daemon.
    pub(crate) fn set_silent(&self, silent: BTreeSet<DaemonId>) {
        lock(&self.table).silent = silent;
    }

    /// Whether this session has received a token of the session `zid`.
    pub(crate) fn has(&self, zid: &str) -> bool {
        lock(&self.table).sessions.contains_key(zid)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_are_remembered_within_a_bound() {
        let sessions = KnownSessions::default();
        let hear = |number: usize, kind| sessions.receive_token(&format!("{number:x}"), 0, kind);
        let taken = (0..2 * SESSIONS_MAX).filter(|number| hear(*number, SampleKind::Put));
        assert_eq!(taken.count(), SESSIONS_MAX);
        assert!(hear(0, SampleKind::Put), "a known session is taken again");
        for telling in 0..100 {
            sessions.receive_token("0", telling, SampleKind::Put);
        }
        assert_eq!(lock(&sessions.table).sessions["0"].len(), TELLINGS_MAX);
        hear(1, SampleKind::Delete);
        assert!(hear(SESSIONS_MAX, SampleKind::Put), "there is room again");
    }

    #[test]
    fn an_answer_is_read_as_it_was_given() {
        let sessions = KnownSessions::default();
        sessions.receive_token("a1", 0, SampleKind::Put);
        sessions.receive_token("a1", 1, SampleKind::Put);
        sessions.receive_token("a1", 0, SampleKind::Delete);
        let robot = (AgentId::new("robot").expect("a name"), Incarnation(7));
        let (pi, me) = (DaemonId::new("pi").expect("a name"), DaemonId::new("me").expect("a name"));
        let nothing = SyncRequest::read(b"");
        let answer = SyncReply::answer(vec![robot.clone()], &sessions, None, (&pi, &nothing));
        let read = SyncReply::read(&answer);
        let named = |reply: &Option<SyncReply>| reply.as_ref().expect("a roll").hosts.clone();
        assert_eq!(named(&read), Some(vec![robot.clone()]));
        let later = (robot.0.clone(), Incarnation(8));
        for (known, is_named) in [(vec![robot.clone()], false), (vec![later], true), (vec![], true)]
        {
            let call = SyncRequest::new([(pi.clone(), digest(&known))].into(), &me);
            let call = SyncRequest::read(&call.write());
            let answer = SyncReply::answer(vec![robot.clone()], &sessions, None, (&pi, &call));
            sessions.record_caller(&call);
            assert_eq!(named(&SyncReply::read(&answer)).is_some(), is_named, "{known:?}");
        }
        assert!(lock(&sessions.table).callers.contains(&me), "the caller is known");
        for garbage in [&b""[..], b"{", b"[1]", b"{\"hosts\":[[\"X\",1]],\"known_sessions\":[]}"] {
            assert!(SyncReply::read(garbage).is_none());
        }
    }
}
