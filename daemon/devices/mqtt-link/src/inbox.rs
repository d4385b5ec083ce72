//! Queue of the texts that were received for the topics of one filter.
//!
//! Only the latest text of each topic is queued: a device that repeats a text a thousand times
//! takes one place, and the latest text of each topic survives while the reader is busy. A queue
//! for events keeps the latest few texts of each topic.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use crate::TopicText;

/// Maximum number of topics with queued texts; texts of further topics are dropped. The largest
/// installations have some ten thousand entities.
const TOPICS_MAX: usize = 1 << 16;

/// Maximum size of all queued texts together, in bytes; a text that does not fit is dropped.
const BYTES_MAX: usize = 1 << 28;

/// Receiving half of a queue of texts. When this value is dropped, the queue receives no more
/// texts.
pub struct Inbox(pub(crate) Arc<InboxQueue>);

/// Maximum number of queued texts of one topic in a queue for events; of more, the oldest is
/// dropped.
const EVENTS_MAX: usize = 32;

#[derive(Debug)]
pub(crate) struct InboxQueue {
    texts: Mutex<QueuedTexts>,
    arrival: Notify,
    /// Maximum number of queued texts of one topic; of more, the oldest is dropped.
    of_each: usize,
}

impl Default for InboxQueue {
    fn default() -> InboxQueue {
        InboxQueue { texts: Mutex::default(), arrival: Notify::new(), of_each: 1 }
    }
}

#[derive(Debug, Default)]
struct QueuedTexts {
    order: VecDeque<String>,
    by_topic: HashMap<String, VecDeque<String>>,
    bytes: usize,
    /// Whether a text was dropped for lack of room since the last `take`.
    has_overflowed: bool,
}

impl Inbox {
    /// Takes the queued texts of up to `at_most` topics, each text with its topic. The topic that
    /// has waited longest comes first. Waits until there is a text.
    pub async fn take(&self, at_most: usize) -> Vec<TopicText> {
        loop {
            let news = self.0.arrival.notified();
            let taken = self.0.take(at_most);
            if !taken.is_empty() {
                return taken;
            }
            news.await;
        }
    }
}

impl InboxQueue {
    /// Returns a queue for events, which keeps the latest few texts of each topic.
    pub(crate) fn of_events() -> InboxQueue {
        InboxQueue { of_each: EVENTS_MAX, ..InboxQueue::default() }
    }

    /// Adds a text to the queue, or drops it if there is no room. Returns `true` for the first
    /// dropped text since the last `take`.
    pub(crate) fn push(&self, topic: &str, text: &str) -> bool {
        let mut texts = self.texts();
        let before = texts.by_topic.get(topic);
        let is_new = before.is_none();
        let over = before.filter(|before| before.len() >= self.of_each).and_then(VecDeque::front);
        let is_full = over.is_some();
        let bytes = texts.bytes - over.map_or(0, String::len) + text.len();
        if bytes > BYTES_MAX || (is_new && texts.order.len() >= TOPICS_MAX) {
            return !std::mem::replace(&mut texts.has_overflowed, true);
        }
        texts.bytes = bytes;
        let waiting = texts.by_topic.entry(topic.to_owned()).or_default();
        if is_full {
            waiting.pop_front();
        }
        waiting.push_back(text.to_owned());
        if is_new {
            texts.order.push_back(topic.to_owned());
        }
        drop(texts);
        self.arrival.notify_one();
        false
    }

    fn take(&self, at_most: usize) -> Vec<TopicText> {
        let mut texts = self.texts();
        let count = at_most.min(texts.order.len());
        let topics: Vec<_> = texts.order.drain(..count).collect();
        texts.has_overflowed &= count == 0;
        let mut taken = Vec::with_capacity(count);
        for topic in topics {
            for text in texts.by_topic.remove(&topic).unwrap_or_default() {
                texts.bytes -= text.len();
                taken.push((topic.clone(), text));
            }
        }
        taken
    }

    fn texts(&self) -> MutexGuard<'_, QueuedTexts> {
        self.texts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_last_text_of_each_topic_waits_in_order() {
        let inbox = Inbox(Arc::default());
        for (topic, text) in [("a", "1"), ("b", "1"), ("a", "2"), ("c", "1")] {
            assert!(!inbox.0.push(topic, text));
        }
        let told = |topic: &str, text: &str| (topic.to_owned(), text.to_owned());
        assert_eq!(inbox.take(2).await, [told("a", "2"), told("b", "1")]);
        assert!(!inbox.0.push("a", "3"));
        assert_eq!(inbox.take(9).await, [told("c", "1"), told("a", "3")]);
    }

    #[tokio::test]
    async fn the_last_few_events_of_each_topic_wait() {
        let inbox = Inbox(Arc::new(InboxQueue::of_events()));
        for number in 0..4 {
            assert!(!inbox.0.push("a", &number.to_string()));
        }
        let texts =
            |taken: Vec<TopicText>| taken.into_iter().map(|(_, text)| text).collect::<Vec<_>>();
        assert_eq!(texts(inbox.take(9).await), ["0", "1", "2", "3"]);
        for number in 0..EVENTS_MAX + 2 {
            assert!(!inbox.0.push("a", &number.to_string()));
        }
        let taken = texts(inbox.take(9).await);
        assert_eq!((taken.len(), taken[0].as_str()), (EVENTS_MAX, "2"));
    }

    #[test]
    fn a_text_without_room_is_reported_once_and_dropped() {
        let inbox = Inbox(Arc::default());
        let first: Vec<_> =
            (0..TOPICS_MAX + 3).filter(|number| inbox.0.push(&number.to_string(), "x")).collect();
        assert_eq!(first, [TOPICS_MAX]);
        assert_eq!(inbox.0.take(usize::MAX).len(), TOPICS_MAX);
        assert!(!inbox.0.push("again", "x"));
    }
}
