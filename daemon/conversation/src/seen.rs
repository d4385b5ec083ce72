//! Messages that were heard before: a retry, or a substrate that doubles.

use std::collections::{HashSet, VecDeque};

use acl::MessageId;

/// The last ids heard; older ones are forgotten.
#[derive(Clone, Debug)]
pub struct Seen {
    ids: HashSet<MessageId>,
    order: VecDeque<MessageId>,
    ids_max: usize,
}

impl Seen {
    /// Remembers `ids_max` messages: more than can be under way to one listener while any of
    /// them is still retried.
    pub fn new(ids_max: usize) -> Seen {
        Seen { ids: HashSet::new(), order: VecDeque::new(), ids_max }
    }

    /// Whether a message was heard before.
    pub fn has(&self, id: &MessageId) -> bool {
        self.ids.contains(id)
    }

    /// Notes a message; `false` if it was heard before.
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
