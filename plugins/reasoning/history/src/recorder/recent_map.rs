//! A map of bounded size, which forgets its oldest entries.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

/// Map from names to values, of at most `max` entries. A new entry replaces the oldest one.
#[derive(Debug)]
pub(crate) struct RecentMap<V> {
    max: usize,
    entries: HashMap<Arc<str>, V>,
    order: VecDeque<Arc<str>>,
}

impl<V> RecentMap<V> {
    /// Creates an empty map of at most `max` entries.
    pub(crate) fn new(max: usize) -> RecentMap<V> {
        RecentMap { max, entries: HashMap::new(), order: VecDeque::new() }
    }

    /// Returns the value of `name`; `None` if there is none.
    pub(crate) fn get(&self, name: &str) -> Option<&V> {
        self.entries.get(name)
    }

    /// Returns the value of `name`, to be changed; `None` if there is none.
    pub(crate) fn get_mut(&mut self, name: &str) -> Option<&mut V> {
        self.entries.get_mut(name)
    }

    /// Whether there is a value of `name`.
    pub(crate) fn contains(&self, name: &str) -> bool {
        self.entries.contains_key(name)
    }

    /// Sets the value of `name`. The age of an entry is that of its first value.
    pub(crate) fn insert(&mut self, name: &str, value: V) {
        if let Some(entry) = self.entries.get_mut(name) {
            *entry = value;
            return;
        }
        if self.order.len() >= self.max
            && let Some(oldest) = self.order.pop_front()
        {
            self.entries.remove(&oldest);
        }
        let name: Arc<str> = name.into();
        self.order.push_back(Arc::clone(&name));
        self.entries.insert(name, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_entry_makes_room() {
        let mut map = RecentMap::new(2);
        map.insert("a", 1);
        map.insert("b", 2);
        map.insert("a", 3);
        map.insert("c", 4);
        assert!(!map.contains("a"));
        assert_eq!(map.get("b"), Some(&2));
        assert_eq!(map.get_mut("c").copied(), Some(4));
    }
}
