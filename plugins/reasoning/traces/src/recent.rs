//! The last keys of a kind, in bounded memory.

use std::collections::{BTreeSet, VecDeque};

/// A bounded set: the oldest key gives way to a new one.
#[derive(Debug)]
pub(crate) struct RecentKeys<K> {
    known: BTreeSet<K>,
    order: VecDeque<K>,
    keys_max: usize,
}

impl<K: Ord + Clone> RecentKeys<K> {
    pub(crate) fn new(keys_max: usize) -> RecentKeys<K> {
        RecentKeys { known: BTreeSet::new(), order: VecDeque::new(), keys_max }
    }

    /// Adds a key; returns `false` if it is known already.
    pub(crate) fn insert(&mut self, key: K) -> bool {
        if !self.known.insert(key.clone()) {
            return false;
        }
        self.order.push_back(key);
        if self.order.len() > self.keys_max
            && let Some(oldest) = self.order.pop_front()
        {
            self.known.remove(&oldest);
        }
        true
    }

    pub(crate) fn contains(&self, key: &K) -> bool {
        self.known.contains(key)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_key_gives_way() {
        let mut keys = RecentKeys::new(2);
        assert!(keys.insert(1) && keys.insert(2) && !keys.insert(1));
        assert!(keys.insert(3));
        assert!(!keys.contains(&1) && keys.contains(&2) && keys.contains(&3));
    }
}
