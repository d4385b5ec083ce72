//! From liveliness tokens to [`Presence`]: who is here *and can be reached*.
//!
//! A token may come before the route to its daemon: each Zenoh router recomputes its routes at
//! most every 100 ms, and until then drops what it is given and answers every question with
//! nothing. So the first `Joined` of a daemon, and with it what follows from that daemon, waits
//! until the daemon has answered a probe.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use acl::DaemonId;
use substrate::{Inbound, Presence};
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tracing::Instrument as _;
use zenoh::key_expr::KeyExpr;
use zenoh::qos::CongestionControl;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::config::OpenError;
use crate::inbound::undeclared;
use crate::key_expr::Keys;

/// How long a `Joined` waits for its daemon's answer; then it is passed on regardless, since a
/// stranger with a token need not know our probe. Three times the 100 ms after which the routes
/// are there on an idle machine.
const REACHED_WITHIN: Duration = Duration::from_millis(300);

/// Pause between two probes. A probe without a route costs a fifth of a millisecond.
const PROBE_PERIOD: Duration = Duration::from_millis(5);
const _: () = assert!(PROBE_PERIOD.as_millis() < REACHED_WITHIN.as_millis());

/// Passes presence on, in order per daemon.
struct Watch {
    keys: Keys,
    inbound: Arc<dyn Inbound>,
    /// Weak: the session owns the callback that owns this.
    session: Weak<Session>,
    runtime: Handle,
    /// Daemons with a token, except this one. No entry: nothing is known about its routes.
    daemons: Mutex<BTreeMap<DaemonId, Route>>,
}

/// Whether a daemon can be reached.
enum Route {
    /// It answered, and none of its agents has left since.
    Known,
    /// It is being probed; this is to be passed on then.
    Probed(Vec<Presence>),
}

/// Declares the liveliness subscriber, with the history of who was here before.
///
/// # Panics
///
/// Outside a Tokio runtime.
pub(crate) fn declare(
    session: &Arc<Session>,
    keys: &Keys,
    inbound: &Arc<dyn Inbound>,
) -> Result<(), OpenError> {
    let watch = Arc::new(Watch {
        keys: keys.clone(),
        inbound: Arc::clone(inbound),
        session: Arc::downgrade(session),
        runtime: Handle::current(),
        daemons: Mutex::default(),
    });
    let key_expr = keys.everyone_alive();
    let hear = move |sample: Sample| Watch::hear(&watch, &sample);
    let liveliness = session.liveliness();
    let subscriber = liveliness.declare_subscriber(&key_expr).history(true).callback(hear);
    subscriber.background().wait().map_err(|source| undeclared("liveliness", &key_expr, source))
}

// === impl Watch ===

impl Watch {
    fn hear(watch: &Arc<Watch>, sample: &Sample) {
        let key = sample.key_expr().as_str();
        let Some(resident) = watch.keys.resident(key) else {
            return tracing::debug!(key, "ignored a liveliness token that names nobody");
        };
        let daemon = resident.daemon.clone();
        match sample.kind() {
            SampleKind::Put => Watch::joined(watch, daemon, Presence::Joined(resident)),
            SampleKind::Delete => watch.left(&daemon, Presence::Left(resident)),
        }
    }

    fn joined(watch: &Arc<Watch>, daemon: DaemonId, joined: Presence) {
        if daemon == *watch.keys.daemon() {
            return watch.inbound.presence(joined);
        }
        let is_unknown = {
            let mut daemons = watch.lock();
            match daemons.get_mut(&daemon) {
                Some(Route::Known) => {
                    drop(daemons);
                    return watch.inbound.presence(joined);
                }
                Some(Route::Probed(waiting)) => {
                    waiting.push(joined);
                    false
                }
                None => {
                    daemons.insert(daemon.clone(), Route::Probed(vec![joined]));
                    true
                }
            }
        };
        if is_unknown {
            let span = tracing::debug_span!("probe", %daemon);
            let probe = Watch::probe(Arc::clone(watch), daemon);
            watch.runtime.spawn(probe.instrument(span));
        }
    }

    /// Passes on that an agent left. Its daemon's route is unknown from then on: whether the
    /// daemon went with it shows at the next token.
    fn left(&self, daemon: &DaemonId, left: Presence) {
        {
            let mut daemons = self.lock();
            if let Some(Route::Probed(waiting)) = daemons.get_mut(daemon) {
                waiting.push(left);
                return;
            }
            daemons.remove(daemon);
        }
        self.inbound.presence(left);
    }

    /// Probes a daemon until it answers or [`REACHED_WITHIN`] has passed, then lets pass what
    /// waited.
    async fn probe(watch: Arc<Watch>, daemon: DaemonId) {
        let key_expr = watch.keys.reach(&daemon);
        let answered = async {
            while !watch.is_reached(&key_expr).await {
                tokio::time::sleep(PROBE_PERIOD).await;
            }
        };
        if tokio::time::timeout(REACHED_WITHIN, answered).await.is_err() {
            tracing::debug!("no answer; its agents are taken for present all the same");
        }
        while !watch.is_closed() {
            // Not under the lock: who hears it may announce an agent, which leads back to here.
            let waiting = watch.take_waiting(&daemon);
            if waiting.is_empty() {
                return;
            }
            waiting.into_iter().for_each(|presence| watch.inbound.presence(presence));
        }
    }

    /// Takes what waits for a daemon; the route is known once nothing does.
    fn take_waiting(&self, daemon: &DaemonId) -> Vec<Presence> {
        let mut daemons = self.lock();
        match daemons.get_mut(daemon) {
            Some(Route::Probed(waiting)) if !waiting.is_empty() => std::mem::take(waiting),
            Some(route) => {
                *route = Route::Known;
                Vec::new()
            }
            None => Vec::new(),
        }
    }

    /// Whether a daemon answers. Without a route the question ends at once; a closed session
    /// reaches everyone, so that the probe ends.
    async fn is_reached(&self, key_expr: &KeyExpr<'static>) -> bool {
        let (answers, mut heard) = mpsc::channel(1);
        {
            let Some(session) = self.session.upgrade() else { return true };
            let get = session.get(key_expr).congestion_control(CongestionControl::Drop);
            let get = get.express(true).timeout(REACHED_WITHIN);
            let asked = get.callback(move |reply| {
                // There is room for one, and one is enough.
                let _ = answers.try_send(reply.result().is_ok());
            });
            if asked.wait().is_err() {
                return true;
            }
        }
        heard.recv().await.unwrap_or(false)
    }

    fn is_closed(&self) -> bool {
        self.session.upgrade().is_none_or(|session| session.is_closed())
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<DaemonId, Route>> {
        self.daemons.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
