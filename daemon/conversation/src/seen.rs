//! Duplicate window: finds messages that were received before, because of a retry or a substrate
//! that doubles them.

use std::collections::{HashSet, VecDeque};

use acl::MessageId;

/// The ids of the last messages received; older ones are dropped.
#[derive(Clone, Debug)]
pub struct Seen {
    ids: HashSet<MessageId>,
    order: VecDeque<MessageId>,
    ids_max: usize,
}

impl Seen {
    /// Creates a window of `ids_max` messages. It must hold more messages than can be under way to
    /// one listener while any of them is still retried.
    pub fn new(ids_max: usize) -> Seen {
        Seen { ids: HashSet::new(), order: VecDeque::new(), ids_max }
    }

    /// Whether a message was received before.
    pub fn has(&self, id: &MessageId) -> bool {
        self.ids.contains(id)
    }

    /// Adds a message; returns `false` if it was received before.
    pub fn note(&mut self, id: &MessageId) -> bool {
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
    fn the_oldest_is_forgotten_first() {
        let mut seen = Seen::new(2);
        let [a, b, c] = ["a", "b", "c"].map(MessageId::new);
        assert!(seen.note(&a) && seen.note(&b));
        assert!(!seen.note(&a), "heard before");
        assert!(seen.note(&c), "pushes `a` out");
        assert!(seen.note(&a), "forgotten");
        assert!(!seen.note(&c));
    }
}
