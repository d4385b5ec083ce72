//! Topics of a robot: the latest message of each.
//!
//! - A topic keeps the latest message. It is decoded when it is read, so a robot that floods a topic
//!   costs no more than the copies of Zenoh's.
//! - Topics with the durability “transient local”, such as the pose of a localization, are published
//!   once, when something changes. Their last message is requested at the beginning, and again
//!   whenever a publisher appears: it may have published while the link was broken, or before it
//!   knew of the subscription. When a publisher ends, the message is forgotten, because it may be of
//!   that publisher, and those that are still there are asked again.

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
    /// Number of publishers that have ended. Changes only while `latest` is locked.
    ended: AtomicU64,
}

/// What had happened when last messages were requested.
#[derive(Clone, Copy)]
struct RecallStart {
    received: u64,
    ended: u64,
}

// === impl TopicReader ===

impl TopicReader {
    pub(crate) async fn subscribe(
        session: Session,
        key: String,
        topic: Topic,
    ) -> Result<TopicReader, RosError> {
        let (sender, latest) = watch::channel(None);
        let (received, ended) = (AtomicU64::new(0), AtomicU64::new(0));
        let inbox = Arc::new(MessageIntake { latest: sender, received, ended });
        let receiving = Arc::clone(&inbox);
        let messages = session
            .declare_subscriber(key.clone())
            .callback(move |sample| receiving.receive(&sample))
            .await
            .map_err(RosError::zenoh)?;
        let (appeared, mut publishers) = mpsc::channel(PUBLISHERS_MAX);
        let (forgetting, all) = (Arc::clone(&inbox), format!("{key}/@adv/**"));
        let remaining = all.clone();
        let tokens = session
            .liveliness()
            .declare_subscriber(format!("{key}/@adv/pub/**"))
            .callback(move |token| {
                let asked = match token.kind() {
                    SampleKind::Put => token.key_expr().to_string(),
                    SampleKind::Delete => {
                        forgetting.forget();
                        remaining.clone()
                    }
                };
                drop(appeared.try_send(asked));
            })
            .await
            .map_err(RosError::zenoh)?;
        inbox.recall(&session, &all).await?;
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

    /// Forgets the latest message, because a publisher has ended: its last message says nothing about
    /// the present.
    fn forget(&self) {
        self.latest.send_modify(|latest| {
            self.ended.fetch_add(1, Ordering::SeqCst);
            *latest = None;
        });
    }

    /// Requests the last message of the publishers with the key `publishers`.
    async fn recall(self: &Arc<Self>, session: &Session, publishers: &str) -> Result<(), RosError> {
        let inbox = Arc::clone(self);
        let start = RecallStart {
            received: self.received.load(Ordering::SeqCst),
            ended: self.ended.load(Ordering::SeqCst),
        };
        let history = session
            .get(format!("{publishers}?_max=1"))
            .accept_replies(ReplyKeyExpr::Any)
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            .timeout(HISTORY_TIMEOUT)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    inbox.remember(TopicMessage::of(sample), start);
                }
            });
        history.await.map_err(RosError::zenoh)
    }

    /// Takes a message that was published before, unless it is older than the latest one. Where
    /// times are missing, a message that was received after the `start` of the request is newer. If a
    /// publisher has ended since, the message may be of that one, and those that remain are asked
    /// again.
    fn remember(&self, message: TopicMessage, start: RecallStart) {
        self.latest.send_if_modified(|latest| {
            if self.ended.load(Ordering::SeqCst) != start.ended {
                return false;
            }
            let known = latest.as_ref().and_then(|latest| latest.published_at);
            let is_newer = match (known, message.published_at) {
                (Some(known), Some(published_at)) => published_at > known,
                _ => self.received.load(Ordering::SeqCst) == start.received,
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

#[cfg(test)]
mod tests {
    use super::*;

    fn message(byte: u8) -> TopicMessage {
        TopicMessage { bytes: vec![byte], published_at: None }
    }

    #[test]
    fn a_late_answer_of_a_publisher_that_has_ended_is_not_remembered() {
        let (latest, seen) = watch::channel(None);
        let (received, ended) = (AtomicU64::new(0), AtomicU64::new(0));
        let intake = MessageIntake { latest, received, ended };
        let last = || seen.borrow().as_ref().map(|message: &TopicMessage| message.bytes[0]);
        let before = RecallStart { received: 0, ended: 0 };
        intake.remember(message(1), before);
        assert_eq!(last(), Some(1));
        intake.forget();
        intake.remember(message(1), before);
        assert_eq!(last(), None, "it was asked before the publisher ended");
        intake.remember(message(2), RecallStart { received: 0, ended: 1 });
        assert_eq!(last(), Some(2));
    }
}
