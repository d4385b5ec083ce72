//! Web push: notices for the browsers that have subscribed, by the push services of their makers
//! (RFC 8030). A push service sees when a notice is sent and how long it is, not what it says.
//!
//! - `encryption`: the content, for one browser (RFC 8291).
//! - `identification`: proves to a push service that the notice is from here (RFC 8292).
//! - `push_store`: the subscriptions and the key, in the state folder.

pub(crate) mod encryption;
pub(crate) mod identification;
pub(crate) mod push_store;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::json;
use tokio::task::JoinSet;

use self::push_store::{PushStore, PushStoreError, PushSubscription};
use crate::address::ReceiverAddress;
use crate::http::{PostRequest, RequestHeaders, post};
use crate::notice::NoticeDelivery;
use crate::send_failure::SendFailure;
use crate::sentences::NoticeForm;
use crate::trust::ReceiverTrust;

/// Maximum number of requests to push services at a time.
const AT_ONCE_MAX: usize = 8;

/// Longest text of a notice, in bytes: with the link and the title, the content stays below the
/// 3,993 bytes that every push service takes.
const TEXT_BYTES_MAX: usize = 2_000;

/// Time for which a push service keeps a notice for a browser that is off, in seconds.
const KEPT_SECONDS: u64 = 24 * 3_600;

/// Least time for which a push service keeps a question, in seconds.
const KEPT_SECONDS_MIN: u64 = 30;

/// Maximum number of attempts while only some browsers cannot be reached: the notices of the others
/// do not wait for them.
const ATTEMPTS_MAX: u32 = 4;

/// The browsers that have subscribed.
pub(crate) struct WebPush {
    /// Folder of the subscriptions.
    folder: PathBuf,
    /// Address of the people that run the ecosystem, for the push services: `mailto:…` or
    /// `https://…`.
    contact: String,
    services: Vec<String>,
    trust: ReceiverTrust,
    progress: Mutex<PushProgress>,
}

/// How far the delivery under way has come.
#[derive(Debug, Default)]
struct PushProgress {
    delivery: String,
    /// The endpoints that have it, or will never have it.
    done: BTreeSet<String>,
    /// Number of attempts after which a browser was still missing.
    attempts: u32,
}

/// Outcome of a notice for one browser.
enum PushOutcome {
    Taken,
    /// The subscription has ended.
    Ended,
    Failed(SendFailure),
}

// === impl WebPush ===

impl WebPush {
    pub(crate) fn new(
        folder: PathBuf,
        contact: String,
        services: Vec<String>,
        trust: ReceiverTrust,
    ) -> WebPush {
        WebPush { folder, contact, services, trust, progress: Mutex::default() }
    }

    /// Prepares the folder, so that browsers can subscribe.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder or the key cannot be written.
    pub(crate) fn prepare(&self) -> Result<(), PushStoreError> {
        PushStore::create(&self.folder, &self.services).map(drop)
    }

    /// Sends a delivery to each browser that does not have it.
    pub(crate) async fn send(
        self: &Arc<Self>,
        delivery: &NoticeDelivery,
        form: &NoticeForm,
    ) -> Result<(), SendFailure> {
        let push = Arc::clone(self);
        let read = tokio::task::spawn_blocking(move || {
            let store = PushStore::create(&push.folder, &push.services)?;
            let subscriptions = store.subscriptions()?;
            Ok::<_, PushStoreError>((Arc::new(store), subscriptions))
        });
        let read = read.await.map_err(|error| SendFailure::later(error.to_string()))?;
        let (store, subscriptions) = read.map_err(|error| SendFailure::later(error.to_string()))?;
        let content: Arc<[u8]> = content(delivery, form).into();
        let mut waiting = self.without_done(&delivery.id, subscriptions).into_iter();
        let (mut running, mut failure) = (JoinSet::new(), None);
        loop {
            while running.len() < AT_ONCE_MAX
                && let Some(subscription) = waiting.next()
            {
                let (push, store) = (Arc::clone(self), Arc::clone(&store));
                let (content, head) = (Arc::clone(&content), PushHead::of(delivery));
                running.spawn(async move {
                    let outcome = push.send_to(&store, &subscription, &content, head).await;
                    (subscription, outcome)
                });
            }
            // A task that panics is told by the panic itself.
            let Some(ended) = running.join_next().await else { break };
            let Ok((subscription, outcome)) = ended else { continue };
            match outcome {
                PushOutcome::Taken => self.note_done(&subscription.endpoint),
                PushOutcome::Ended => {
                    let store = Arc::clone(&store);
                    let endpoint = subscription.endpoint;
                    let dropped =
                        tokio::task::spawn_blocking(move || store.unsubscribe(&endpoint)).await;
                    if let Ok(Err(error)) = dropped {
                        tracing::warn!("failed to drop a subscription that has ended: {error}");
                    }
                }
                PushOutcome::Failed(SendFailure::Never(why)) => {
                    tracing::warn!(person = %subscription.person, "failed to {why}");
                    self.note_done(&subscription.endpoint);
                }
                PushOutcome::Failed(later) => failure = Some(later),
            }
        }
        self.conclude(failure)
    }

    fn progress(&self) -> MutexGuard<'_, PushProgress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the subscriptions that do not have the delivery.
    fn without_done(
        &self,
        delivery: &str,
        subscriptions: Vec<PushSubscription>,
    ) -> Vec<PushSubscription> {
        let mut progress = self.progress();
        if progress.delivery != delivery {
            *progress = PushProgress { delivery: delivery.to_owned(), ..PushProgress::default() };
        }
        let is_open = |it: &PushSubscription| !progress.done.contains(&it.endpoint);
        subscriptions.into_iter().filter(is_open).collect()
    }

    fn note_done(&self, endpoint: &str) {
        self.progress().done.insert(endpoint.to_owned());
    }

    /// Decides after an attempt whether there is another one.
    fn conclude(&self, failure: Option<SendFailure>) -> Result<(), SendFailure> {
        let Some(failure) = failure else { return Ok(()) };
        let mut progress = self.progress();
        progress.attempts += 1;
        if progress.done.is_empty() || progress.attempts < ATTEMPTS_MAX {
            return Err(failure);
        }
        if let SendFailure::Later { why, .. } = failure {
            tracing::warn!("some browsers are not told: failed to {why}");
        }
        Ok(())
    }

    async fn send_to(
        &self,
        store: &PushStore,
        subscription: &PushSubscription,
        content: &[u8],
        head: PushHead,
    ) -> PushOutcome {
        let never = |why: String| PushOutcome::Failed(SendFailure::Never(why));
        let address = match store.address_of(subscription) {
            Ok(address) => address,
            Err(error) => return never(format!("use a subscription: {error}")),
        };
        let (headers, body) = match self.request(store, subscription, &address, content, head) {
            Ok(request) => request,
            Err(why) => return never(why),
        };
        let trust = &self.trust;
        match post(PostRequest { address: &address, trust, headers, body }).await {
            Err(failure) => PushOutcome::Failed(failure),
            Ok(answer) => match answer.status {
                200..=299 => PushOutcome::Taken,
                404 | 410 => PushOutcome::Ended,
                // The subscription is for another key.
                401 | 403 => never(format!("be taken: HTTP {}", answer.status)),
                _ => match answer.judge() {
                    Ok(()) => PushOutcome::Taken,
                    Err(failure) => PushOutcome::Failed(failure),
                },
            },
        }
    }

    fn request(
        &self,
        store: &PushStore,
        subscription: &PushSubscription,
        address: &ReceiverAddress,
        content: &[u8],
        head: PushHead,
    ) -> Result<(RequestHeaders, Vec<u8>), String> {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let audience = address.origin();
        let identity = store.key().authorization(&audience, &self.contact, since.as_secs())?;
        let body = encryption::encrypt(&subscription.keys()?, content)?;
        let headers = vec![
            ("Content-Type", "application/octet-stream".to_owned()),
            ("Content-Encoding", "aes128gcm".to_owned()),
            ("Authorization", identity),
            ("TTL", head.kept_seconds.to_string()),
            ("Urgency", head.urgency.to_owned()),
            ("Topic", head.topic),
        ];
        Ok((headers, body))
    }
}

/// The part of a push message that the push service reads.
#[derive(Clone, Debug, PartialEq, Eq)]
struct PushHead {
    kept_seconds: u64,
    urgency: &'static str,
    /// The service replaces a notice that has waited by one of the same topic: a repetition.
    topic: String,
}

impl PushHead {
    fn of(delivery: &NoticeDelivery) -> PushHead {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let now_ms = u64::try_from(since.as_millis()).unwrap_or(u64::MAX);
        let ends = delivery.notices.iter().filter_map(|notice| notice.ends_ms).max();
        let kept = ends.map_or(KEPT_SECONDS, |end| end.saturating_sub(now_ms) / 1_000);
        let is_pressing = delivery.is_urgent() || delivery.has_question();
        PushHead {
            kept_seconds: kept.clamp(KEPT_SECONDS_MIN, KEPT_SECONDS),
            urgency: if is_pressing { "high" } else { "normal" },
            topic: delivery.id.chars().take(32).collect(),
        }
    }
}

/// Returns the content of a push message, which the page's service worker reads.
fn content(delivery: &NoticeDelivery, form: &NoticeForm) -> Vec<u8> {
    let mut text = form.text(delivery);
    while text.len() > TEXT_BYTES_MAX {
        text.pop();
    }
    let kind = match delivery.notices.as_slice() {
        [notice] => notice.kind.as_str(),
        _ => "summary",
    };
    let at = delivery.notices.last().map(|notice| notice.at_ms);
    let told = json!({
        "id": delivery.id,
        "kind": kind,
        "title": form.title(delivery),
        "text": text,
        "link": form.link(delivery),
        "at": at,
        "urgent": delivery.is_urgent(),
    });
    told.to_string().into_bytes()
}
