//! The state that all requests of a server share.

use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use accounts::{Accounts, LoggedRequest, PersonName, RequestLog};
use phrases::{Language, OwnWords, Phrasebook};
use tokio::sync::Semaphore;

use crate::act_limits::ActLimits;
use crate::assets::Assets;
use crate::caller_key::CallerKey;
use crate::cookies::CookieNames;
use crate::host::PageHost;
use crate::options::PageOptions;
use crate::tls::PageTls;
use crate::topic_store::TopicStore;

/// Maximum number of acts at a time, of all people: each waits for an agent, some for a planner.
const ACTS_MAX: usize = 64;

/// How long before its end people are told of the certificate of the page: a month, in which somebody
/// is there.
const CERTIFICATE_TOLD_BEFORE: Duration = Duration::from_secs(30 * 24 * 3_600);

/// Maximum number of event streams of one session: the pages that a person has open.
const STREAMS_PER_SESSION_MAX: usize = 128;

/// A kind of refused requests of which there may be many.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum FloodKind {
    /// Too many attempts to sign in.
    SignIn,
    /// Too many acts.
    Acts,
    /// Requests that no page of this server has made.
    Forged,
}

/// Interval between two requests of one [`FloodKind`] in the log.
const FLOOD_LOGGED_EVERY: Duration = Duration::from_secs(10);

/// The state of a server.
pub(crate) struct ServerState {
    pub(crate) host: Arc<dyn PageHost>,
    pub(crate) accounts: Arc<Accounts>,
    log: Option<Arc<RequestLog>>,
    pub(crate) names: Vec<String>,
    pub(crate) is_encrypted: bool,
    pub(crate) cookies: CookieNames,
    tls: Option<PageTls>,
    pub(crate) assets: Assets,
    /// The words of goals and facts, by language.
    pub(crate) books: Vec<Phrasebook>,
    pub(crate) topics: Arc<TopicStore>,
    pub(crate) limits: ActLimits,
    pub(crate) acts: Arc<Semaphore>,
    streams: Mutex<HashMap<CallerKey, usize>>,
    /// The moments of the last requests in the log of each kind of flood.
    flooded_at: Mutex<HashMap<FloodKind, Instant>>,
    /// Name of the daemon, for the log.
    daemon: String,
}

impl ServerState {
    pub(crate) fn new(
        host: Arc<dyn PageHost>,
        accounts: Arc<Accounts>,
        log: Option<Arc<RequestLog>>,
        options: PageOptions,
        tls: Option<PageTls>,
    ) -> ServerState {
        let is_encrypted = tls.is_some();
        let setup = host.describe();
        let daemon = setup.daemon.to_string();
        let cookies = CookieNames::new(setup.ecosystem.as_str(), &daemon, is_encrypted);
        let started = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let run = u64::try_from(started.as_micros()).unwrap_or_default();
        ServerState {
            host,
            accounts,
            log,
            names: options.names,
            is_encrypted,
            cookies,
            tls,
            assets: Assets::new(options.assets),
            books: books(&options.words),
            topics: Arc::new(TopicStore::new(run)),
            limits: ActLimits::default(),
            acts: Arc::new(Semaphore::new(ACTS_MAX)),
            streams: Mutex::default(),
            flooded_at: Mutex::default(),
            daemon,
        }
    }

    /// Returns the time at which the certificate of the page ends, if that is soon.
    pub(crate) fn certificate_ends_at(&self) -> Option<SystemTime> {
        let ends_at = self.tls.as_ref().and_then(PageTls::ends_at)?;
        (ends_at <= SystemTime::now() + CERTIFICATE_TOLD_BEFORE).then_some(ends_at)
    }

    /// Writes a request into the log.
    pub(crate) fn record(
        &self,
        person: Option<PersonName>,
        from: IpAddr,
        what: String,
        outcome: String,
    ) {
        if let Some(log) = &self.log {
            let (at, through) = (SystemTime::now(), self.daemon.clone());
            log.record(LoggedRequest { at, person, from, through, what, outcome });
        }
    }

    /// Writes a refused request into the log that may be one of many: not each of them, or they would
    /// push all others out of it.
    pub(crate) fn record_flood(
        &self,
        kind: FloodKind,
        person: Option<PersonName>,
        from: IpAddr,
        what: String,
        outcome: String,
    ) {
        let mut flooded_at = self.flooded_at.lock().unwrap_or_else(PoisonError::into_inner);
        if flooded_at.get(&kind).is_some_and(|at| at.elapsed() < FLOOD_LOGGED_EVERY) {
            return;
        }
        flooded_at.insert(kind, Instant::now());
        drop(flooded_at);
        self.record(person, from, what, outcome);
    }

    /// Returns the newest requests, oldest first; `None` if there is no log.
    pub(crate) fn recent_requests(&self, count: usize) -> Option<Vec<LoggedRequest>> {
        self.log.as_ref().map(|log| log.recent(count))
    }

    /// Counts one more event stream of a session; `None` if it has too many.
    pub(crate) fn stream_place(self: &Arc<ServerState>, caller: CallerKey) -> Option<StreamPlace> {
        let mut streams = self.streams.lock().unwrap_or_else(PoisonError::into_inner);
        let count = streams.entry(caller.clone()).or_default();
        if *count >= STREAMS_PER_SESSION_MAX {
            return None;
        }
        *count += 1;
        Some(StreamPlace { state: Arc::clone(self), caller })
    }
}

/// Returns the words of all languages. Wrong words of the ecosystem are left out; reading its file
/// reports them.
fn books(own: &BTreeMap<Language, OwnWords>) -> Vec<Phrasebook> {
    let book = |language| {
        let standard = Phrasebook::standard(language);
        let with_own = own.get(&language).and_then(|own| standard.clone().with_own(own).ok());
        with_own.unwrap_or(standard)
    };
    Language::ALL.into_iter().map(book).collect()
}

/// The place of one event stream among those of its session, until it is dropped.
pub(crate) struct StreamPlace {
    state: Arc<ServerState>,
    caller: CallerKey,
}

impl Drop for StreamPlace {
    fn drop(&mut self) {
        let mut streams = self.state.streams.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = streams.get_mut(&self.caller) {
            *count = count.saturating_sub(1);
            if *count == 0 {
                streams.remove(&self.caller);
            }
        }
    }
}
