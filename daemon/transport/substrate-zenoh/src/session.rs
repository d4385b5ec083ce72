//! A Zenoh session in the form of a [`Substrate`].

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative};
use bytes::Bytes;
use credentials::SealChannel;
use substrate::{
    AgentAddress, BoxFuture, Inbound, OverhearCallback, OverhearToken, PresenceToken,
    ResourceQuery, SendError, Subject, Substrate,
};
use tracing::Instrument as _;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

use crate::anti_entropy::AntiEntropy;
use crate::batch::{self, HeartbeatMessage};
use crate::config::{Config, MESSAGE_BYTES_MAX, MESSAGE_PRIORITY, SessionMode, SessionSettings};
use crate::declarations::{Declarations, announced_agents};
use crate::key_expr::KeySpace;
use crate::known_sessions::KnownSessions;
use crate::open_error::{OpenError, not_opened};
use crate::overhear::{Eavesdropper, OverhearListeners, OverheardInbound};
use crate::oversize::{self, OversizeListener};
use crate::presence::{self, LivelinessSubscriber};
use crate::publishers::{GenerationCache, PUBLISHERS_MAX};
use crate::queries::{self, QuerySender};
use crate::sealing::Security;
use crate::{revocations, scouting};

/// Maximum length of the seal, the key and Zenoh's own headers of a message, in bytes. The longest
/// payload is shorter than the longest message by this much.
const SEAL_BYTES_MAX: usize = 16 << 10;

/// A daemon's connection to its ecosystem. Dropping the last handle closes the connection.
///
/// A message from a daemon to its own agents arrives on the sender's thread before `send` returns,
/// as it does in the substrate in memory. So a caller of `send` must hold no lock that its
/// [`Inbound`] takes.
pub struct ZenohSubstrate {
    keys: KeySpace,
    declarations: Arc<Declarations>,
    /// Listeners to the messages of others.
    listeners: OverhearListeners,
    queries: QuerySender,
    known_sessions: KnownSessions,
    liveliness: Arc<LivelinessSubscriber>,
    /// Keys that seal messages to links; `None` if the ecosystem is not secured.
    security: Option<Security>,
    /// Publishers by destination. The field comes before `session`, so that the publishers are
    /// undeclared while the session is still open.
    publishers: GenerationCache<Route, Publisher<'static>>,
    session: Arc<Session>,
    /// Detector of received messages that are too long; `None` after `close`.
    too_long: Mutex<Option<Arc<OversizeListener>>>,
}

/// Destination of a message; for each destination there is one declared publisher.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Route {
    To(AgentAddress, Subject),
    All(AgentId, Performative),
    /// All daemons: a batch with the heartbeats of several agents of this daemon.
    HeartbeatBatch,
}

// === impl Config ===

impl Config {
    /// Opens the session and makes the declarations of a daemon. `inbound` may receive messages
    /// before this function returns. A router does not wait until it is connected to other daemons.
    ///
    /// # Errors
    ///
    /// Returns an error if the settings are refused, if the daemon cannot listen on an endpoint, or
    /// if a client reaches no daemon.
    pub async fn open(self, inbound: Arc<dyn Inbound>) -> Result<Arc<ZenohSubstrate>, OpenError> {
        let settings = self.settings()?.without_self().await;
        ZenohSubstrate::open(&self.ecosystem, self.daemon, settings, inbound).await
    }
}

// === impl ZenohSubstrate ===

impl ZenohSubstrate {
    pub(crate) async fn open(
        ecosystem: &EcosystemId,
        daemon: DaemonId,
        settings: SessionSettings,
        inbound: Arc<dyn Inbound>,
    ) -> Result<Arc<ZenohSubstrate>, OpenError> {
        let SessionSettings { zenoh, listen, connect, scouts_at, lease, security, mode, .. } =
            settings;
        let listeners = OverhearListeners::default();
        let inbound: Arc<dyn Inbound> = Arc::new(OverheardInbound::new(inbound, listeners.clone()));
        let too_long = oversize::listen(security.as_ref(), &inbound);
        let admission = security.as_ref().map(|each| revocations::admission(each, &inbound));
        let opened = match scouts_at {
            Some(at) => scouting::open(zenoh, &at).await,
            None => zenoh::open(zenoh).await,
        };
        let session = opened.map_err(|source| not_opened(listen, connect, source))?;
        let session = Arc::new(session);
        let keys = KeySpace::new(ecosystem, daemon);
        let keys = if mode == SessionMode::Client { keys.of_guest() } else { keys };
        let known_sessions = KnownSessions::declare(&session, &keys, &inbound)?;
        let declarations =
            Declarations::declare(&session, &keys, &inbound, security.as_ref(), &known_sessions)?;
        let asking = QuerySender { keys: keys.clone(), inbound, security: security.clone() };
        let watch = presence::declare(&session, &asking, announced_agents(&declarations), lease)?;
        if let (Some(security), Some(admission)) = (&security, admission) {
            revocations::spread(&session, &keys, security, admission);
        }
        let roll_call = AntiEntropy {
            session: Arc::downgrade(&session),
            queries: asking.clone(),
            known_sessions: known_sessions.clone(),
            liveliness: Arc::clone(&watch),
            declarations: Arc::clone(&declarations),
            lease,
        };
        tokio::spawn(roll_call.run().instrument(tracing::debug_span!("roll_call")));
        let publishers = GenerationCache::new(PUBLISHERS_MAX);
        let substrate = ZenohSubstrate {
            keys,
            declarations,
            listeners,
            queries: asking,
            known_sessions,
            liveliness: watch,
            security,
            publishers,
            session,
            too_long: Mutex::new(Some(too_long)),
        };
        Ok(Arc::new(substrate))
    }

    /// Returns the endpoints at which this daemon listens, with the ports that the kernel chose.
    pub fn locators(&self) -> Vec<String> {
        let locators = self.session.info().locators().wait();
        locators.into_iter().map(|locator| locator.to_string()).collect()
    }

    /// Returns the Zenoh id of this session, in the form that [`crate::Config::zid`] accepts.
    pub fn zid(&self) -> String {
        self.session.zid().to_string()
    }

    fn put(&self, route: Route, payload: Bytes) -> Result<(), SendError> {
        self.check_open()?;
        check_length(&payload)?;
        let publisher = self.publishers.get_or_make(&route, || self.declare_publisher(&route));
        let publisher = publisher.map_err(declined)?;
        let seal = self.security.as_ref().map(|security| {
            let key_expr = publisher.key_expr().as_str();
            match &route {
                // For those who overhear it; this daemon does not verify its own messages.
                Route::To(to, _) if to.daemon == *self.keys.daemon() => {
                    security.seal(SealChannel::Internal, key_expr, &payload)
                }
                Route::To(to, _) => security.seal_to(&to.daemon, key_expr, &payload),
                Route::All(..) => security.seal(SealChannel::Message, key_expr, &payload),
                Route::HeartbeatBatch => security.seal(SealChannel::AgentState, key_expr, &payload),
            }
        });
        publisher.put(payload).attachment(seal).wait().map_err(declined)
    }

    fn check_open(&self) -> Result<(), SendError> {
        if self.session.is_closed() { Err(SendError::Closed) } else { Ok(()) }
    }

    /// Declares the publisher for a destination.
    ///
    /// Congestion control is `Drop` for all publishers. `Block` would hold the sender, which is a
    /// Tokio worker, for up to 5 s. Then it would close the link and lose all queued messages, and
    /// every agent behind the link would seem to have left. A message that must arrive is retried
    /// until its receipt comes, and a burst has a megabyte of queue per link (`BATCHES_MAX`).
    ///
    /// Action models, which are long and repeated, have a lower priority than messages.
    fn declare_publisher(&self, route: &Route) -> zenoh::Result<Publisher<'static>> {
        let key_expr = match route {
            Route::To(to, subject) => self.keys.to_one(to, *subject),
            Route::All(sender, performative) => self.keys.to_all(sender, *performative),
            Route::HeartbeatBatch => self.keys.models_together(),
        };
        let priority = match route {
            Route::To(..) | Route::All(..) => MESSAGE_PRIORITY,
            Route::HeartbeatBatch => Priority::DataLow,
        };
        // Receipts, which are delayed on purpose, and heartbeats are not urgent: they may travel in
        // the batch of the next message.
        let is_urgent = !matches!(route, Route::To(_, Subject::Receipt) | Route::HeartbeatBatch);
        let publisher = self.session.declare_publisher(key_expr);
        let publisher = publisher.congestion_control(CongestionControl::Drop);
        publisher.priority(priority).express(is_urgent).wait()
    }
}

impl Substrate for ZenohSubstrate {
    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.put(Route::To(to.clone(), subject), payload)
    }

    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        self.put(Route::All(sender.clone(), performative), payload)
    }

    /// Publishes a heartbeat by its key, without a declared publisher. A declared publisher would
    /// take three or four kilobytes with its routes, and save a few microseconds once a second.
    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        self.check_open()?;
        check_length(&payload)?;
        let key_expr = self.keys.model(sender);
        let security = self.security.as_ref();
        let seal =
            security.map(|each| each.seal(SealChannel::AgentState, key_expr.as_str(), &payload));
        let put = self.session.put(key_expr, payload).attachment(seal);
        let put = put.congestion_control(CongestionControl::Drop).priority(Priority::DataLow);
        put.wait().map_err(declined)
    }

    fn broadcast_heartbeats(&self, beats: Vec<(AgentId, Bytes)>) -> Result<(), SendError> {
        batch::pack(beats).into_iter().try_for_each(|parcel| match parcel {
            HeartbeatMessage::Single(sender, payload) => self.broadcast_state(&sender, payload),
            HeartbeatMessage::Batch(bundle) => self.put(Route::HeartbeatBatch, bundle),
        })
    }

    fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        self.check_open()?;
        self.declarations.announce(&self.session, agent, incarnation).map_err(declined)?;
        let (declarations, agent) = (Arc::clone(&self.declarations), agent.clone());
        Ok(PresenceToken::new(move || declarations.withdraw(&agent, incarnation)))
    }

    fn ask(&self, ask: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        queries::ask(&self.session, &self.queries, &ask, timeout)
    }

    fn broadcast_ready(&self) -> BoxFuture<()> {
        if self.security.is_none() {
            return Box::pin(std::future::ready(()));
        }
        let (known_sessions, others) = (self.known_sessions.clone(), self.liveliness.others());
        Box::pin(async move { known_sessions.called_by(&others).await })
    }

    fn overhear(&self, listener: OverhearCallback) -> Result<OverhearToken, SendError> {
        self.check_open()?;
        let (keys, security) = (self.keys.clone(), self.security.clone());
        let eavesdropper = Eavesdropper { keys, leaves_out_own: true, security };
        let number = self.listeners.add(Arc::clone(&listener));
        let listeners = self.listeners.clone();
        let token = OverhearToken::new(move || listeners.remove(number));
        let hear = move |_: &str, message| listener(message);
        let subscribers = eavesdropper
            .declare(&self.session, hear)
            .map_err(|error| SendError::Declined(error.to_string()))?;
        Ok(OverhearToken::new(move || drop((subscribers, token))))
    }

    fn close(&self) -> BoxFuture<()> {
        self.publishers.clear();
        *self.too_long.lock().unwrap_or_else(PoisonError::into_inner) = None;
        let session = Session::clone(&self.session);
        Box::pin(async move {
            if let Err(error) = session.close().await {
                tracing::debug!(%error, "the session was not closed in order");
            }
        })
    }
}

/// Returns an error if a message is too long: every receiver would drop it without a notice.
fn check_length(payload: &Bytes) -> Result<(), SendError> {
    let bytes = payload.len();
    if bytes <= MESSAGE_BYTES_MAX - SEAL_BYTES_MAX {
        return Ok(());
    }
    Err(SendError::TooLong { bytes, bytes_max: MESSAGE_BYTES_MAX - SEAL_BYTES_MAX })
}

fn declined(error: zenoh::Error) -> SendError {
    SendError::Declined(error.to_string())
}
