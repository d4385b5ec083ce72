//! The messages that `althing watch` shows, in a queue that never blocks Zenoh. The user is
//! notified if messages are lost because the output is slow, and if a conversation has no messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use acl::Message;
use bytes::Bytes;
use tokio::sync::mpsc;
use tokio::time::Instant;

/// How long `althing watch` waits for the first message of a conversation before the user is
/// notified, because the identifier may be mistyped. Agents that work on a conversation send
/// messages within seconds.
pub(super) const QUIET_AFTER: Duration = Duration::from_secs(10);

/// The receiving end of the queue.
pub(super) struct WatchedMessages {
    queue: mpsc::Receiver<Bytes>,
    lost: Arc<AtomicU64>,
    /// The conversation that is shown; `None` if all messages are shown.
    conversation: Option<String>,
    /// Time at which the user is notified that no message of the conversation has arrived. Set when
    /// the queue is created; `None` once a message of the conversation has arrived, once the user
    /// has been notified, or if all messages are shown.
    quiet_at: Option<Instant>,
}

/// The sending end of the queue.
#[derive(Clone)]
pub(super) struct MessageTap {
    queue: mpsc::Sender<Bytes>,
    lost: Arc<AtomicU64>,
}

/// Next item that `althing watch` shows.
#[derive(Debug)]
pub(super) enum WatchEvent {
    Message(Box<Message>),
    /// This many messages were lost, because the queue was full.
    Lost(u64),
    /// The conversation has had no message yet.
    Quiet,
}

/// Creates a queue for `capacity` messages. The receiving end shows only messages of
/// `conversation`, or all messages if that is `None`.
pub(super) fn queue(
    capacity: usize,
    conversation: Option<String>,
) -> (MessageTap, WatchedMessages) {
    let (send, receive) = mpsc::channel(capacity);
    let lost = Arc::new(AtomicU64::new(0));
    let quiet_at = conversation.as_ref().map(|_| Instant::now() + QUIET_AFTER);
    let tap = MessageTap { queue: send, lost: Arc::clone(&lost) };
    (tap, WatchedMessages { queue: receive, lost, conversation, quiet_at })
}

impl MessageTap {
    /// Adds a message to the queue, or counts it as lost if the queue is full.
    pub(super) fn push(&self, payload: Bytes) {
        if self.queue.try_send(payload).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl WatchedMessages {
    /// Waits for the next item to show. Returns `None` when no more messages can arrive.
    pub(super) async fn next(&mut self) -> Option<WatchEvent> {
        loop {
            let lost = self.lost.swap(0, Ordering::Relaxed);
            if lost > 0 {
                return Some(WatchEvent::Lost(lost));
            }
            let received = match self.quiet_at {
                None => self.queue.recv().await,
                Some(at) => match tokio::time::timeout_at(at, self.queue.recv()).await {
                    Ok(received) => received,
                    Err(_) => {
                        self.quiet_at = None;
                        return Some(WatchEvent::Quiet);
                    }
                },
            };
            let Ok(message) = acl::decode(&received?) else { continue };
            let asked = self.conversation.as_deref();
            if asked.is_none_or(|asked| asked == message.conversation_id.as_str()) {
                self.quiet_at = None;
                return Some(WatchEvent::Message(Box::new(message)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn payload(conversation: &str) -> Bytes {
        let message = serde_json::json!({
            "version": acl::SCHEMA_VERSION, "id": "m1", "performative": "inform", "sender": "alice",
            "incarnation": 1, "conversation_id": conversation, "content": {},
        });
        Bytes::from(message.to_string())
    }

    async fn shown(messages: &mut WatchedMessages) -> String {
        match messages.next().await.expect("the tap is open") {
            WatchEvent::Message(message) => message.conversation_id.to_string(),
            WatchEvent::Lost(count) => format!("{count} lost"),
            WatchEvent::Quiet => "quiet".to_owned(),
        }
    }

    #[tokio::test]
    async fn lost_messages_are_counted() {
        let (tap, mut messages) = queue(2, None);
        for conversation in ["a", "b", "c", "d", "e"] {
            tap.push(payload(conversation));
        }
        assert_eq!(shown(&mut messages).await, "3 lost");
        assert_eq!(shown(&mut messages).await, "a");
        assert_eq!(shown(&mut messages).await, "b");
        tap.push(payload("f"));
        assert_eq!(shown(&mut messages).await, "f", "each loss is told once");
    }

    /// Messages of other conversations do not delay the notice that the watched conversation has
    /// none.
    #[tokio::test(start_paused = true)]
    async fn a_quiet_conversation_is_reported_once() {
        let (tap, mut messages) = queue(100, Some("mistyped".to_owned()));
        let began = Instant::now();
        let others = tap.clone();
        tokio::spawn(async move {
            loop {
                others.push(payload("other"));
                tokio::time::sleep(Duration::from_secs(1)).await;
            }
        });
        assert_eq!(shown(&mut messages).await, "quiet");
        assert!(began.elapsed() >= QUIET_AFTER);
        let again = tokio::time::timeout(QUIET_AFTER * 3, shown(&mut messages)).await;
        assert!(again.is_err(), "{again:?}");
        tap.push(payload("mistyped"));
        assert_eq!(shown(&mut messages).await, "mistyped");
    }

    #[tokio::test(start_paused = true)]
    async fn a_conversation_with_messages_is_never_reported_as_quiet() {
        let (tap, mut messages) = queue(100, Some("goal".to_owned()));
        tap.push(payload("goal"));
        assert_eq!(shown(&mut messages).await, "goal");
        let later = tokio::time::timeout(QUIET_AFTER * 3, shown(&mut messages)).await;
        assert!(later.is_err(), "{later:?}");
    }
}
