//! Duplicate window: recognises repeated messages, which a sender has retried or a substrate has
//! duplicated.

use std::collections::{HashSet, VecDeque};

use acl::{AgentId, MessageId};

/// The last received messages; older ones are dropped. A message is known by its sender and its
/// identifier: identifiers can be guessed, and another agent may use one before its owner does.
#[derive(Clone, Debug)]
pub struct DuplicateWindow {
    ids: HashSet<(AgentId, MessageId)>,
    order: VecDeque<(AgentId, MessageId)>,
    ids_max: usize,
}

impl DuplicateWindow {
    /// Creates a window for the identifiers of `ids_max` messages. This number must exceed the
    /// number of messages to one listener that can arrive while any of them is still retried.
    pub fn new(ids_max: usize) -> DuplicateWindow {
        DuplicateWindow { ids: HashSet::new(), order: VecDeque::new(), ids_max }
    }

    /// Whether the message `id` of `sender` was received before.
    pub fn contains(&self, sender: &AgentId, id: &MessageId) -> bool {
        self.ids.contains(&(sender.clone(), id.clone()))
    }

    /// Adds the message `id` of `sender` to the window. Returns `false` if the message was received
    /// before.
    pub fn insert(&mut self, sender: &AgentId, id: &MessageId) -> bool {
        let message = (sender.clone(), id.clone());
        if !self.ids.insert(message.clone()) {
            return false;
        }
        self.order.push_back(message);
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
        let robot = AgentId::new("robot").expect("a name");
        let [a, b, c] = ["a", "b", "c"].map(MessageId::new);
        assert!(seen.insert(&robot, &a) && seen.insert(&robot, &b));
        assert!(!seen.insert(&robot, &a), "heard before");
        assert!(seen.insert(&robot, &c), "pushes `a` out");
        assert!(seen.insert(&robot, &a), "forgotten");
        assert!(!seen.insert(&robot, &c));
    }

    #[test]
    fn an_identifier_counts_for_its_sender_only() {
        let mut seen = DuplicateWindow::new(8);
        let [robot, other] = ["robot", "other"].map(|name| AgentId::new(name).expect("a name"));
        let id = MessageId::new("robot.1.2");
        assert!(seen.insert(&other, &id));
        assert!(!seen.contains(&robot, &id));
        assert!(seen.insert(&robot, &id));
    }
}
