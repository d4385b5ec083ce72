//! What was said under the topics of one filter, until it is taken.
//!
//! Of each topic the last text waits: a device that says the same thing a thousand times takes one
//! place, and nothing is lost while the reader is busy.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use crate::Told;

/// Topics that wait at once. The largest installations describe some ten thousand entities.
const TOPICS_MAX: usize = 1 << 16;

/// Bytes of texts that wait at once.
const BYTES_MAX: usize = 1 << 28;

/// The receiving half; what comes in after it is dropped is not kept.
pub struct Inbox(pub(crate) Arc<Waiting>);

#[derive(Debug, Default)]
pub(crate) struct Waiting {
    texts: Mutex<Texts>,
    news: Notify,
}

#[derive(Debug, Default)]
struct Texts {
    order: VecDeque<String>,
    by_topic: HashMap<String, String>,
    bytes: usize,
    /// Whether something was left out since the last text was taken.
    is_over: bool,
}

impl Inbox {
    /// Takes up to `at_most` texts, each with its topic, once there is any; the longest waiting first.
    pub async fn take(&self, at_most: usize) -> Vec<Told> {
        loop {
            let news = self.0.news.notified();
            let taken = self.0.take(at_most);
            if !taken.is_empty() {
                return taken;
            }
            news.await;
        }
    }
}

impl Waiting {
    /// Puts a text in; returns whether it is the first that does not fit.
    pub(crate) fn put(&self, topic: &str, text: &str) -> bool {
        let mut texts = self.texts();
        let before = texts.by_topic.get(topic).map(String::len);
        let bytes = texts.bytes - before.unwrap_or(0) + text.len();
        if bytes > BYTES_MAX || (before.is_none() && texts.order.len() >= TOPICS_MAX) {
            return !std::mem::replace(&mut texts.is_over, true);
        }
        texts.bytes = bytes;
        if texts.by_topic.insert(topic.to_owned(), text.to_owned()).is_none() {
            texts.order.push_back(topic.to_owned());
        }
        drop(texts);
        self.news.notify_one();
        false
    }

    fn take(&self, at_most: usize) -> Vec<Told> {
        let mut texts = self.texts();
        let count = at_most.min(texts.order.len());
        let topics: Vec<_> = texts.order.drain(..count).collect();
        texts.is_over &= count == 0;
        let mut taken = Vec::with_capacity(count);
        for topic in topics {
            let text = texts.by_topic.remove(&topic).unwrap_or_default();
            texts.bytes -= text.len();
            taken.push((topic, text));
        }
        taken
    }

    fn texts(&self) -> MutexGuard<'_, Texts> {
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
            assert!(!inbox.0.put(topic, text));
        }
        let told = |topic: &str, text: &str| (topic.to_owned(), text.to_owned());
        assert_eq!(inbox.take(2).await, [told("a", "2"), told("b", "1")]);
        assert!(!inbox.0.put("a", "3"));
        assert_eq!(inbox.take(9).await, [told("c", "1"), told("a", "3")]);
    }

    #[test]
    fn what_does_not_fit_is_told_once_and_harms_nothing() {
        let inbox = Inbox(Arc::default());
        let first: Vec<_> =
            (0..TOPICS_MAX + 3).filter(|number| inbox.0.put(&number.to_string(), "x")).collect();
        assert_eq!(first, [TOPICS_MAX]);
        assert_eq!(inbox.0.take(usize::MAX).len(), TOPICS_MAX);
        assert!(!inbox.0.put("again", "x"));
    }
}
