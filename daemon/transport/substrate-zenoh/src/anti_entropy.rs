//! Anti-entropy of membership: a daemon periodically sends a *roll call*, a query to all daemons.
//! The daemon makes all its declarations again if an answer shows that some daemon has missed them.
//!
//! Zenoh's routers send each declaration (of a subscription, a queryable or a token) to each other
//! once, and never again. After a change of the mesh, the routes are computed anew a tenth of a
//! second later. In between, a router can miss a new declaration, drop a valid one, or receive one
//! of a dead session. This error then remains. (`pubsub_tree_change` compares indices in the graph,
//! which are reused; declarations of a router that is not in the graph are kept, and those of a
//! router that was cut off for a moment are not.) So declarations that were missed have to be made
//! again:
//!
//! - Each session has a liveliness token of its own, with its Zenoh id. The `known_sessions` of a
//!   session are those from which it has received such a token.
//! - Each session answers a roll call with three things: the agents that it hosts, its
//!   `known_sessions`, and the daemons that do not answer its own roll calls. The agents are
//!   usually left out: the roll call carries, for each daemon, a digest of the agents that the
//!   caller knows, and a daemon lists its agents only if its own digest is different.
//! - In a secured ecosystem the answer also carries the sequence numbers that the daemon has signed
//!   so far. A session that has just begun to listen can then reject recordings of messages sent
//!   earlier.
//! - A session makes all its declarations again in three cases: if an answer does not list the
//!   session or calls its daemon silent, if an answer lists a session that this session does not
//!   know, or if this session has a link to a router that it does not know.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use acl::DaemonId;
use tokio::sync::oneshot;
use tokio::time::Instant;
use zenoh::{Session, Wait};

use crate::declarations::Declarations;
use crate::known_sessions::{KnownSessions, SyncReply, SyncRequest};
use crate::presence::LivelinessSubscriber;
use crate::queries::QuerySender;

/// Pause between two roll calls while the membership changes or is in doubt, and the time within
/// which a roll call must be answered. Both are far longer than the tenth of a second after which
/// Zenoh's routes are computed anew. If there are no changes, one roll call is sent per lease.
const UNREST_PERIOD: Duration = Duration::from_secs(1);

/// How long after the last change of the membership the pause between roll calls remains
/// `UNREST_PERIOD`.
const UNREST: Duration = Duration::from_secs(3);

/// Longest pause after which a session makes all its declarations once more (those of its
/// subscribers, its queryables and its agents' tokens), while others still miss some of them. The
/// pause doubles each time, up to this value.
const PAUSE_MAX: Duration = Duration::from_secs(60);

/// How often one unknown session can cause this session to make all its declarations again. An
/// unknown session may be a plain router, a foreign program, or a dead session that another router
/// still advertises.
const TOLD_MAX: u32 = 3;

/// Task that sends roll calls until the session is closed.
pub(crate) struct AntiEntropy {
    pub(crate) session: Weak<Session>,
    pub(crate) queries: QuerySender,
    pub(crate) known_sessions: KnownSessions,
    pub(crate) liveliness: Arc<LivelinessSubscriber>,
    pub(crate) declarations: Arc<Declarations>,
    pub(crate) lease: Duration,
}

/// Result of one roll call: the daemons that answered, and the sessions and daemons that have
/// missed a declaration.
#[derive(Debug, Default)]
struct SyncRound {
    answered: BTreeSet<DaemonId>,
    /// Daemons that have no token of this session, or do not receive its answers to their roll
    /// calls.
    unaware: BTreeSet<DaemonId>,
    /// Sessions from which this session has received no token, although other sessions name them or
    /// this session has a link to them.
    unknown_sessions: BTreeSet<String>,
}

/// State that is kept between roll calls, to decide whether all declarations have to be made again.
#[derive(Debug)]
struct RedeclarePolicy {
    /// Whether the last roll call found that a declaration is missing. Declarations are made again
    /// only if two roll calls in a row find this, because the first one may have come too early.
    is_suspicious: bool,
    /// How often each unknown session has caused all declarations to be made again.
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

// === impl AntiEntropy ===

impl AntiEntropy {
    /// Sends roll calls until the session is closed.
    pub(crate) async fn run(self) {
        let mut policy = RedeclarePolicy::new(Instant::now());
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
            self.known_sessions.set_silent(silent);
            let verdict = policy.judge(&answers, Instant::now());
            if !is_beyond_doubt || verdict != SyncDecision::InSync {
                unrest_until = Instant::now() + UNREST;
            }
            if verdict == SyncDecision::Redeclare {
                let SyncRound { unaware, unknown_sessions: unknown, .. } = &answers;
                tracing::info!(
                    ?unaware,
                    ?unknown,
                    "announces agents again: some daemons miss them"
                );
                self.declarations.redeclare_all();
            }
        }
    }

    /// Sends a roll call, and checks whether this session has a token of each router that it is
    /// linked with. Returns `None` if the session is closed.
    async fn call(&self, mark: u64, call: &SyncRequest) -> Option<SyncRound> {
        let answers = Arc::<Mutex<SyncRound>>::default();
        let (ends, ended) = oneshot::channel::<()>();
        {
            let session = self.session.upgrade().filter(|session| !session.is_closed())?;
            let own = session.zid().to_string();
            let (known_sessions, watch) =
                (self.known_sessions.clone(), Arc::clone(&self.liveliness));
            let (me, heard) = (self.queries.keys.daemon().clone(), Arc::clone(&answers));
            let hear = move |daemon, reply: Option<SyncReply>| {
                // Dropped with this callback, when no more answers come.
                let _ends = &ends;
                if daemon != me {
                    watch.receive_reply(&daemon, reply.as_ref(), mark);
                    lock(&heard).record(daemon, reply.as_ref(), (&own, &me), &known_sessions);
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
        reply: Option<&SyncReply>,
        (own, me): (&str, &DaemonId),
        known_sessions: &KnownSessions,
    ) {
        if let Some(reply) = reply {
            if !reply.known_sessions.contains(own) || reply.silent.contains(me) {
                self.unaware.insert(daemon.clone());
            }
            self.unknown_sessions.extend(
                reply.known_sessions.iter().filter(|zid| !known_sessions.has(zid)).cloned(),
            );
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

    /// Decides after a roll call whether all declarations are made again. As long as another daemon
    /// has no token of this session, this is repeated, at growing intervals. An unknown session may
    /// be one that declares nothing, so it causes only [`TOLD_MAX`] repetitions.
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
    use zenoh::sample::SampleKind;

    use super::*;

    fn amiss(unaware: &[&str], unknown: &[&str]) -> SyncRound {
        let unaware = unaware.iter().map(|name| DaemonId::new(name).expect("a name")).collect();
        let unknown = unknown.iter().map(|&zid| zid.to_owned()).collect();
        SyncRound { answered: BTreeSet::new(), unaware, unknown_sessions: unknown }
    }

    #[test]
    fn declarations_are_repeated_at_growing_intervals() {
        let start = Instant::now();
        let mut policy = RedeclarePolicy::new(start);
        let unaware = amiss(&["pi"], &[]);
        let at = |seconds| start + Duration::from_secs(seconds);
        let known_sessions: Vec<_> = (0..40)
            .filter(|&second| policy.judge(&unaware, at(second)) == SyncDecision::Redeclare)
            .collect();
        assert_eq!(known_sessions, [1, 3, 5, 9, 17, 33], "one call may have come too early");
        assert_eq!(policy.judge(&amiss(&[], &[]), at(40)), SyncDecision::InSync);
        assert_eq!(policy.judge(&unaware, at(65)), SyncDecision::CheckAgain);
        assert_eq!(policy.judge(&unaware, at(66)), SyncDecision::Redeclare);
    }

    #[test]
    fn an_unknown_session_causes_a_bounded_number_of_repetitions() {
        let start = Instant::now();
        let mut policy = RedeclarePolicy::new(start);
        let at = |seconds| start + Duration::from_secs(seconds);
        let mut known_sessions = |link: &SyncRound, from: u64| {
            let tells = |&second: &u64| policy.judge(link, at(second)) == SyncDecision::Redeclare;
            (from..from + 100).filter(tells).count()
        };
        let router = amiss(&[], &["a1"]);
        assert_eq!(known_sessions(&router, 0), 3);
        assert_eq!(known_sessions(&router, 100), 0);
        assert_eq!(known_sessions(&amiss(&[], &[]), 200), 0);
        assert_eq!(known_sessions(&router, 300), 3);
    }

    #[test]
    fn an_answer_shows_unaware_daemons_and_unknown_sessions() {
        let known = KnownSessions::default();
        known.receive_token("a1", 0, SampleKind::Put);
        let (pi, me) = (DaemonId::new("pi").expect("a name"), DaemonId::new("me").expect("a name"));
        let nothing = SyncRequest::read(b"");
        let answer =
            || SyncReply::read(&SyncReply::answer(Vec::new(), &known, None, (&pi, &nothing)));
        let mut answers = SyncRound::default();
        answers.record(pi.clone(), answer().as_ref(), ("b2", &me), &KnownSessions::default());
        assert_eq!(answers.unaware.len(), 1, "it was not told of b2");
        assert_eq!(answers.unknown_sessions.first().map(String::as_str), Some("a1"));
        let mut answers = SyncRound::default();
        answers.record(pi.clone(), answer().as_ref(), ("a1", &me), &known);
        assert!(answers.unaware.is_empty() && answers.unknown_sessions.is_empty());
        known.set_silent([me.clone()].into());
        answers.record(pi.clone(), answer().as_ref(), ("a1", &me), &known);
        assert_eq!(answers.unaware.len(), 1, "it is not answered");
    }
}
