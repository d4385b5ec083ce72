//! Queue of the texts that were received for the topics that match one filter.
//!
//! For each topic, only the latest text waits: a device that repeats a text a thousand times takes one
//! place, and the latest text of each topic is not lost while the reader is busy. In a queue for events,
//! the latest few texts of each topic wait.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use crate::TopicText;

/// Maximum number of topics with waiting texts at the same time. The largest installations describe some
/// ten thousand entities.
const TOPICS_MAX: usize = 1 << 16;

/// Maximum size of all waiting texts of a queue together, in bytes.
const BYTES_MAX: usize = 1 << 28;

/// Receiving half of a queue of texts. Texts that arrive after this value is dropped are not kept.
pub struct Inbox(pub(crate) Arc<InboxQueue>);

/// Maximum number of waiting texts of one topic in a queue for events.
const EVENTS_MAX: usize = 32;

#[derive(Debug)]
pub(crate) struct InboxQueue {
    texts: Mutex<QueuedTexts>,
    arrival: Notify,
    /// Maximum number of waiting texts of one topic.
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
    /// Whether a text was left out for lack of room since a text was last taken from the queue.
    has_overflowed: bool,
}

impl Inbox {
    /// Takes the waiting texts of up to `at_most` topics, each text with its topic. The topic that has
    /// waited longest comes first. Waits until there is a text.
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
    /// Returns a queue for events, in which the latest few texts of each topic wait.
    pub(crate) fn of_events() -> InboxQueue {
        InboxQueue { of_each: EVENTS_MAX, ..InboxQueue::default() }
    }

    /// Adds a text to the queue, unless there is no room. Returns `true` if the text is left out, and is
    /// the first that is left out since a text was last taken from the queue.
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
    fn what_does_not_fit_is_told_once_and_harms_nothing() {
        let inbox = Inbox(Arc::default());
        let first: Vec<_> =
            (0..TOPICS_MAX + 3).filter(|number| inbox.0.push(&number.to_string(), "x")).collect();
        assert_eq!(first, [TOPICS_MAX]);
        assert_eq!(inbox.0.take(usize::MAX).len(), TOPICS_MAX);
        assert!(!inbox.0.push("again", "x"));
    }
}
