//! From liveliness tokens to [`Presence`]: who is here *and can be reached*.
//!
//! Each Zenoh router recomputes its routes at most every 100 ms, and until then drops what it is
//! given and answers every question with nothing. So the first token of a daemon starts a probe,
//! and nobody joins before it is answered; what it means is said in `roster`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use acl::DaemonId;
use substrate::{Breach, Presence, Rejected, Resident};
use tokio::runtime::Handle;
use tokio::sync::{Notify, oneshot};
use tracing::Instrument as _;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::config::OpenError;
use crate::inbound::undeclared;
use crate::questions::Asking;
use crate::roll_call::{Call, Roll, digest};
use crate::roster::{Follows, Hosts, Roster};

/// How long a daemon is probed after its first token; from then on it is called together with all
/// others, once a second. The routes are there after 100 ms on an idle machine, and were seen to take
/// three times as long on a busy one.
const REACHED_WITHIN: Duration = Duration::from_secs(1);

/// How long the answer to a probe is awaited before the next: it may have been lost on its way. One
/// that comes later counts as well.
const ANSWERED_WITHIN: Duration = Duration::from_millis(100);

/// Pause between two probes. A probe without a route costs a fifth of a millisecond.
const PROBE_PERIOD: Duration = Duration::from_millis(5);
const _: () = assert!(PROBE_PERIOD.as_millis() < ANSWERED_WITHIN.as_millis());

/// Passes presence on, in the order in which it was heard.
pub(crate) struct Watch {
    asking: Asking,
    /// Weak: the session owns the callback that owns this.
    session: Weak<Session>,
    runtime: Handle,
    state: Mutex<State>,
    /// Told whenever somebody else's token comes or goes.
    pub(crate) unrest: Notify,
}

struct State {
    roster: Roster,
    /// What is still to be passed on, and whether somebody is at it.
    outbox: VecDeque<Presence>,
    is_passing: bool,
}

/// Declares the liveliness subscriber, with the history of who was here before.
///
/// # Panics
///
/// Outside a Tokio runtime.
pub(crate) fn declare(
    session: &Arc<Session>,
    asking: &Asking,
    lease: Duration,
) -> Result<Arc<Watch>, OpenError> {
    let roster = Roster::new(asking.keys.daemon().clone(), lease);
    let watch = Arc::new(Watch {
        asking: asking.clone(),
        session: Arc::downgrade(session),
        runtime: Handle::current(),
        state: Mutex::new(State { roster, outbox: VecDeque::new(), is_passing: false }),
        unrest: Notify::new(),
    });
    let (key_expr, hearing) = (asking.keys.everyone_alive(), Arc::clone(&watch));
    let hear = move |sample: Sample| Watch::hear(&hearing, &sample);
    let liveliness = session.liveliness();
    let subscriber = liveliness.declare_subscriber(&key_expr).history(true).callback(hear);
    let subscriber = subscriber.background().wait();
    subscriber.map_err(|source| undeclared("liveliness", &key_expr, source))?;
    Ok(watch)
}

// === impl Watch ===

impl Watch {
    fn hear(watch: &Arc<Watch>, sample: &Sample) {
        let key = sample.key_expr().as_str();
        let Some((resident, telling)) = watch.asking.keys.resident(key) else {
            return tracing::debug!(key, "ignored a liveliness token that names nobody");
        };
        let daemon = resident.daemon.clone();
        let mut is_unknown = false;
        let take = |roster: &mut Roster| {
            let Follows { passed_on, probe } = match sample.kind() {
                SampleKind::Put => roster.put(resident, telling),
                SampleKind::Delete => roster.delete(&resident, telling),
            };
            is_unknown = probe;
            passed_on
        };
        if daemon == *watch.asking.keys.daemon() {
            // At once: whoever announces an agent has heard of it when that call returns.
            let passed_on = take(&mut watch.lock().roster);
            return passed_on
                .into_iter()
                .for_each(|presence| watch.asking.inbound.presence(presence));
        }
        watch.with(take);
        watch.unrest.notify_one();
        if is_unknown {
            let span = tracing::debug_span!("probe", %daemon);
            let probe = Watch::probe(Arc::clone(watch), daemon);
            watch.runtime.spawn(probe.instrument(span));
        }
    }

    /// Lets a change be made, and passes on what follows from it. Not under the lock: who hears it
    /// may announce an agent, which leads back to here. Whoever comes meanwhile leaves what is to
    /// be passed on to who is at it, so that the order is kept.
    fn with(&self, change: impl FnOnce(&mut Roster) -> Vec<Presence>) {
        let surplus = {
            let mut state = self.lock();
            let follows = change(&mut state.roster);
            state.outbox.extend(follows);
            state.roster.surplus()
        };
        self.reject(&surplus);
        let mut state = self.lock();
        if std::mem::replace(&mut state.is_passing, true) {
            return;
        }
        while let Some(presence) = state.outbox.pop_front() {
            drop(state);
            self.asking.inbound.presence(presence);
            state = self.lock();
        }
        state.is_passing = false;
    }

    /// Tells of tokens that were one too many.
    fn reject(&self, surplus: &[Resident]) {
        for Resident { agent, daemon, .. } in surplus {
            let detail = format!("is a token of `{agent}`, for which there is no room");
            let (breach, claimed, key) = (Breach::Flooded, Some(daemon.as_str()), agent.as_str());
            self.asking.inbound.rejected(&Rejected { breach, detail: &detail, claimed, key });
        }
    }

    /// The daemons of which there is a token, but for this one.
    pub(crate) fn others(&self) -> BTreeSet<DaemonId> {
        let (_, known) = self.known();
        known.into_keys().filter(|daemon| daemon != self.asking.keys.daemon()).collect()
    }

    /// How many tokens have come, to be asked for when a call goes out; and the agents that are known of
    /// each daemon, as digests.
    pub(crate) fn known(&self) -> (u64, BTreeMap<DaemonId, u64>) {
        self.known_of(None)
    }

    /// The same of one daemon only.
    fn known_of(&self, one: Option<&DaemonId>) -> (u64, BTreeMap<DaemonId, u64>) {
        let state = self.lock();
        let known = state.roster.known(one);
        (state.roster.mark(), known.map(|(daemon, agents)| (daemon, digest(&agents))).collect())
    }

    /// A daemon has answered a call that went out at `mark`.
    pub(crate) fn answered(&self, daemon: &DaemonId, roll: Option<&Roll>, mark: u64) {
        let hosts = roll.map_or(Hosts::Unsaid, |roll| match &roll.hosts {
            Some(hosts) => Hosts::Named(hosts),
            None => Hosts::AsKnown,
        });
        self.with(|roster| roster.answered(daemon, hosts, mark));
    }

    /// A call to all has ended; who has a token and does not answer.
    pub(crate) fn called(&self, answered: &BTreeSet<DaemonId>, mark: u64) -> BTreeSet<DaemonId> {
        self.with(|roster| roster.called(answered, mark, Instant::now()));
        self.lock().roster.silent()
    }

    /// Probes a daemon until it answers, all its tokens are gone, or [`REACHED_WITHIN`] has passed.
    async fn probe(watch: Arc<Watch>, daemon: DaemonId) {
        let answered = async {
            while watch.lock().roster.awaits(&daemon) {
                let Some(ended) = Watch::call(&watch, &daemon) else { return };
                // Without a route the question ends at once.
                if tokio::time::timeout(ANSWERED_WITHIN, ended).await.is_ok() {
                    tokio::time::sleep(PROBE_PERIOD).await;
                }
            }
        };
        if tokio::time::timeout(REACHED_WITHIN, answered).await.is_err() {
            tracing::debug!("no answer yet; it will be called again");
            watch.lock().roster.unreached(&daemon);
        }
    }

    /// Calls one daemon. What is returned ends with the first answer, or when no more will come; there
    /// is nothing to wait for where the session is closed.
    fn call(watch: &Arc<Watch>, daemon: &DaemonId) -> Option<impl Future + use<>> {
        let (ends, ended) = oneshot::channel::<()>();
        let mut ends = Some(ends);
        let (mark, known) = watch.known_of(Some(daemon));
        let Asking { keys, .. } = &watch.asking;
        let call = Call::new(known, keys.daemon());
        let hearing = Arc::downgrade(watch);
        let hear = move |daemon, roll: Option<Roll>| {
            if let Some(watch) = hearing.upgrade() {
                watch.answered(&daemon, roll.as_ref(), mark);
            }
            // Who waits for it learns of it when this is dropped.
            ends.take();
        };
        let session = watch.session.upgrade()?;
        watch.asking.call(&session, keys.reach(daemon), &call, REACHED_WITHIN, hear)?;
        Some(ended)
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
