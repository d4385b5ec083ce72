//! A bounded table: the oldest entry gives way to a new one.

use std::collections::{HashMap, VecDeque};
use std::hash::Hash;

/// A table of at most so many entries, in the order in which they were added.
#[derive(Debug)]
pub(crate) struct RecentTable<K, V> {
    known: HashMap<K, V>,
    order: VecDeque<K>,
    entries_max: usize,
}

// === impl RecentTable ===

impl<K: Clone + Eq + Hash, V> RecentTable<K, V> {
    pub(crate) fn new(entries_max: usize) -> RecentTable<K, V> {
        RecentTable { known: HashMap::new(), order: VecDeque::new(), entries_max }
    }

    /// Adds an entry. An entry with the same key is replaced.
    pub(crate) fn insert(&mut self, key: K, value: V) {
        if self.known.insert(key.clone(), value).is_some() {
            return;
        }
        self.order.push_back(key);
        if self.order.len() > self.entries_max
            && let Some(oldest) = self.order.pop_front()
        {
            self.known.remove(&oldest);
        }
    }

    pub(crate) fn remove(&mut self, key: &K) -> Option<V> {
        let removed = self.known.remove(key)?;
        self.order.retain(|known| known != key);
        Some(removed)
    }

    pub(crate) fn contains(&self, key: &K) -> bool {
        self.known.contains_key(key)
    }

    pub(crate) fn get_mut(&mut self, key: &K) -> Option<&mut V> {
        self.known.get_mut(key)
    }

    /// Iterates over the entries, oldest first.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&K, &V)> {
        self.order.iter().filter_map(|key| self.known.get_key_value(key))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_entry_gives_way() {
        let mut table = RecentTable::new(2);
        table.insert(1, "a");
        table.insert(2, "b");
        table.insert(1, "c");
        table.insert(3, "d");
        assert!(!table.contains(&1) && table.contains(&2) && table.contains(&3));
        assert_eq!(table.remove(&2), Some("b"));
        assert_eq!(table.iter().collect::<Vec<_>>(), [(&3, &"d")]);
    }
}
