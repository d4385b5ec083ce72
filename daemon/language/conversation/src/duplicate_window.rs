//! Duplicate window: recognises repeated messages, which a sender has retried or a substrate has
//! duplicated.

use std::collections::{HashSet, VecDeque};

use acl::MessageId;

/// The identifiers of the last received messages; older ones are dropped.
#[derive(Clone, Debug)]
pub struct DuplicateWindow {
    ids: HashSet<MessageId>,
    order: VecDeque<MessageId>,
    ids_max: usize,
}

impl DuplicateWindow {
    /// Creates a window for the identifiers of `ids_max` messages. This number must exceed the
    /// number of messages to one listener that can arrive while any of them is still retried.
    pub fn new(ids_max: usize) -> DuplicateWindow {
        DuplicateWindow { ids: HashSet::new(), order: VecDeque::new(), ids_max }
    }

    /// Whether the message `id` was received before.
    pub fn contains(&self, id: &MessageId) -> bool {
        self.ids.contains(id)
    }

    /// Adds the message `id` to the window. Returns `false` if the message was received before.
    pub fn insert(&mut self, id: &MessageId) -> bool {
        if !self.ids.insert(id.clone()) {
            return false;
        }
        self.order.push_back(id.clone());
        if self.order.len() > self.ids_max
            && let Some(oldest) = self.order.pop_front()
        {
            self.ids.remove(&oldest);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_id_is_dropped_first() {
        let mut seen = DuplicateWindow::new(2);
        let [a, b, c] = ["a", "b", "c"].map(MessageId::new);
        assert!(seen.insert(&a) && seen.insert(&b));
        assert!(!seen.insert(&a), "heard before");
        assert!(seen.insert(&c), "pushes `a` out");
        assert!(seen.insert(&a), "forgotten");
        assert!(!seen.insert(&c));
    }
}
