//! A map with a bounded number of entries: the oldest entry is dropped first.

use std::borrow::Borrow;
use std::collections::BTreeMap;

/// A map that drops its oldest entries. Its order depends on the insertions only, so that equal
/// events give equal views.
#[derive(Clone, Debug)]
pub(crate) struct BoundedMap<K, V> {
    entries: BTreeMap<K, (u64, V)>,
    /// The keys in the order of their insertion or last renewal.
    order: BTreeMap<u64, K>,
    next: u64,
    entries_max: usize,
}

impl<K: Ord + Clone, V> BoundedMap<K, V> {
    /// Creates an empty map for `entries_max` entries, at least one.
    pub(crate) fn new(entries_max: usize) -> BoundedMap<K, V> {
        BoundedMap {
            entries: BTreeMap::new(),
            order: BTreeMap::new(),
            next: 0,
            entries_max: entries_max.max(1),
        }
    }

    /// Inserts an entry as the newest. Returns the oldest entry if it had to be dropped.
    pub(crate) fn insert(&mut self, key: K, value: V) -> Option<(K, V)> {
        self.remove(&key);
        let dropped = if self.entries.len() >= self.entries_max { self.pop_oldest() } else { None };
        self.order.insert(self.next, key.clone());
        self.entries.insert(key, (self.next, value));
        self.next += 1;
        dropped
    }

    /// Makes an entry the newest.
    pub(crate) fn renew(&mut self, key: &K) {
        let Some((number, _)) = self.entries.get_mut(key) else { return };
        self.order.remove(number);
        *number = self.next;
        self.order.insert(self.next, key.clone());
        self.next += 1;
    }

    pub(crate) fn remove<Q: Ord + ?Sized>(&mut self, key: &Q) -> Option<V>
    where
        K: Borrow<Q>,
    {
        let (number, value) = self.entries.remove(key)?;
        self.order.remove(&number);
        Some(value)
    }

    /// Removes and returns the oldest entry.
    pub(crate) fn pop_oldest(&mut self) -> Option<(K, V)> {
        let (_, key) = self.order.pop_first()?;
        let (_, value) = self.entries.remove(&key)?;
        Some((key, value))
    }

    pub(crate) fn get<Q: Ord + ?Sized>(&self, key: &Q) -> Option<&V>
    where
        K: Borrow<Q>,
    {
        self.entries.get(key).map(|(_, value)| value)
    }

    pub(crate) fn get_mut<Q: Ord + ?Sized>(&mut self, key: &Q) -> Option<&mut V>
    where
        K: Borrow<Q>,
    {
        self.entries.get_mut(key).map(|(_, value)| value)
    }

    pub(crate) fn contains<Q: Ord + ?Sized>(&self, key: &Q) -> bool
    where
        K: Borrow<Q>,
    {
        self.entries.contains_key(key)
    }

    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(crate) fn is_full(&self) -> bool {
        self.entries.len() >= self.entries_max
    }

    /// Iterates over the entries, sorted by key.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&K, &V)> {
        self.entries.iter().map(|(key, (_, value))| (key, value))
    }

    /// Iterates over the keys, the oldest first.
    pub(crate) fn oldest_first(&self) -> impl Iterator<Item = &K> {
        self.order.values()
    }

    /// Iterates over the entries, the newest first.
    pub(crate) fn newest_first(&self) -> impl Iterator<Item = (&K, &V)> {
        self.order.values().rev().filter_map(|key| Some((key, self.get(key)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_entry_is_dropped_first() {
        let mut map = BoundedMap::new(2);
        assert_eq!(map.insert("a", 1), None);
        assert_eq!(map.insert("b", 2), None);
        map.renew(&"a");
        assert_eq!(map.insert("c", 3), Some(("b", 2)));
        assert_eq!(map.insert("a", 4), None, "it was there");
        let newest: Vec<_> = map.newest_first().map(|(key, value)| (*key, *value)).collect();
        assert_eq!(newest, [("a", 4), ("c", 3)]);
        assert_eq!(map.pop_oldest(), Some(("c", 3)));
        assert_eq!((map.len(), map.order.len()), (1, 1));
    }
}
