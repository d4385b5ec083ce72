//! Topics of a robot: the latest message of each.
//!
//! - A topic keeps the latest message. It is decoded when it is read, so a robot that floods a topic
//!   costs no more than the copies of Zenoh's.
//! - Topics with the durability “transient local”, such as the pose of a localization, are published
//!   once, when something changes. Their last message is requested at the beginning, and again
//!   whenever a publisher appears: it may have published while the link was broken, or before it
//!   knew of the subscription.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ros_messages::Interfaces;
use serde_json::Value;
use tokio::sync::{mpsc, watch};
use tokio_util::task::AbortOnDropHandle;
use zenoh::Session;
use zenoh::pubsub::Subscriber;
use zenoh::query::{ConsolidationMode, QueryTarget, ReplyKeyExpr};
use zenoh::sample::{Sample, SampleKind};
use zenoh::time::Timestamp;

use crate::error::RosError;

/// How long the answer with the last message of a topic is awaited. If no publisher keeps messages,
/// Zenoh ends the request within the round trip.
const HISTORY_TIMEOUT: Duration = Duration::from_secs(2);

/// Number of publishers that appear at once and are asked for their last message. A topic has one
/// or two; further ones are not asked.
const PUBLISHERS_MAX: usize = 16;

/// Name and type of a topic.
#[derive(Clone)]
pub(crate) struct Topic {
    /// Full name, for messages to people.
    pub(crate) name: String,
    pub(crate) type_name: String,
    pub(crate) interfaces: Arc<Interfaces>,
}

/// The latest message of a topic. Clones share the subscription, which ends with the last of them.
#[derive(Clone)]
pub struct TopicReader {
    topic: Topic,
    latest: watch::Receiver<Option<TopicMessage>>,
    _subscription: Arc<FollowedTopic>,
}

struct FollowedTopic {
    _messages: Subscriber<()>,
    _publishers: Subscriber<()>,
    _history: AbortOnDropHandle<()>,
}

#[derive(Clone)]
struct TopicMessage {
    bytes: Vec<u8>,
    published_at: Option<Timestamp>,
}

/// Takes the messages of a topic in, and keeps the latest.
struct MessageIntake {
    latest: watch::Sender<Option<TopicMessage>>,
    /// Number of messages that were received as they were published.
    received: AtomicU64,
}

// === impl TopicReader ===

impl TopicReader {
    pub(crate) async fn subscribe(
        session: Session,
        key: String,
        topic: Topic,
    ) -> Result<TopicReader, RosError> {
        let (sender, latest) = watch::channel(None);
        let inbox = Arc::new(MessageIntake { latest: sender, received: AtomicU64::new(0) });
        let receiving = Arc::clone(&inbox);
        let messages = session
            .declare_subscriber(key.clone())
            .callback(move |sample| receiving.receive(&sample))
            .await
            .map_err(RosError::zenoh)?;
        let (appeared, mut publishers) = mpsc::channel(PUBLISHERS_MAX);
        let forgetting = Arc::clone(&inbox);
        let tokens = session
            .liveliness()
            .declare_subscriber(format!("{key}/@adv/pub/**"))
            .callback(move |token| {
                match token.kind() {
                    SampleKind::Put => drop(appeared.try_send(token.key_expr().to_string())),
                    // The last message of a node that has ended says nothing about the present.
                    SampleKind::Delete => {
                        forgetting.latest.send_replace(None);
                    }
                }
            })
            .await
            .map_err(RosError::zenoh)?;
        inbox.recall(&session, &format!("{key}/@adv/**")).await?;
        let history = tokio::spawn(async move {
            while let Some(publisher) = publishers.recv().await {
                if let Err(error) = inbox.recall(&session, &publisher).await {
                    tracing::debug!(publisher, %error, "its last message is not known");
                }
            }
        });
        let subscription = FollowedTopic {
            _messages: messages,
            _publishers: tokens,
            _history: AbortOnDropHandle::new(history),
        };
        Ok(TopicReader { topic, latest, _subscription: Arc::new(subscription) })
    }

    /// Returns the name of the topic.
    pub fn name(&self) -> &str {
        &self.topic.name
    }

    /// Returns the latest message; `None` if none was received yet.
    ///
    /// # Errors
    ///
    /// Returns an error if the message cannot be read.
    pub fn latest(&mut self) -> Result<Option<Value>, RosError> {
        let message = self.latest.borrow_and_update().clone();
        message.map(|message| self.topic.decode(&message.bytes)).transpose()
    }

    /// Waits for a message that was not read before, and returns it. If several were received, the
    /// earlier ones are skipped.
    ///
    /// # Errors
    ///
    /// Returns an error if the message cannot be read, or if the link is closed.
    pub async fn next(&mut self) -> Result<Value, RosError> {
        loop {
            let changed = self.latest.changed().await;
            changed.map_err(|_| RosError::Zenoh("the link is closed".to_owned()))?;
            if let Some(message) = self.latest()? {
                return Ok(message);
            }
        }
    }
}

impl Topic {
    fn decode(&self, bytes: &[u8]) -> Result<Value, RosError> {
        let decoded = self.interfaces.decode(&self.type_name, bytes);
        let decoded =
            decoded.map_err(|source| RosError::Decode { name: self.name.clone(), source })?;
        Ok(decoded.value)
    }
}

// === impl MessageIntake ===

impl MessageIntake {
    fn receive(&self, sample: &Sample) {
        self.received.fetch_add(1, Ordering::SeqCst);
        self.latest.send_replace(Some(TopicMessage::of(sample)));
    }

    /// Requests the last message of the publishers with the key `publishers`.
    async fn recall(self: &Arc<Self>, session: &Session, publishers: &str) -> Result<(), RosError> {
        let (inbox, received) = (Arc::clone(self), self.received.load(Ordering::SeqCst));
        let history = session
            .get(format!("{publishers}?_max=1"))
            .accept_replies(ReplyKeyExpr::Any)
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            .timeout(HISTORY_TIMEOUT)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    inbox.remember(TopicMessage::of(sample), received);
                }
            });
        history.await.map_err(RosError::zenoh)
    }

    /// Takes a message that was published before, unless it is older than the latest one. Where
    /// times are missing, a message that came after the first `received` ones is newer.
    fn remember(&self, message: TopicMessage, received: u64) {
        self.latest.send_if_modified(|latest| {
            let known = latest.as_ref().and_then(|latest| latest.published_at);
            let is_newer = match (known, message.published_at) {
                (Some(known), Some(published_at)) => published_at > known,
                _ => self.received.load(Ordering::SeqCst) == received,
            };
            if is_newer {
                *latest = Some(message);
            }
            is_newer
        });
    }
}

impl TopicMessage {
    fn of(sample: &Sample) -> TopicMessage {
        let bytes = sample.payload().to_bytes().into_owned();
        TopicMessage { bytes, published_at: sample.timestamp().copied() }
    }
}
