//! A hash table of ids. The caller stores the values with these ids.
//!
//! States and tuples are stored in flat arenas. With this table, the id of an equal state or tuple
//! is found without a second copy of it. The table is never iterated over, so its order has no
//! influence on results.

use std::hash::Hasher;

use rustc_hash::FxHasher;

/// Value of a free slot.
const FREE: u32 = u32::MAX;

/// Hash table of ids with open addressing. At most 7 of 8 slots are occupied.
#[derive(Clone, Debug, Default)]
pub(crate) struct IdTable {
    places: Vec<u32>,
    count: usize,
}

// === impl IdTable ===

impl IdTable {
    /// Returns the id with the hash `hash` for which `is_it` returns `true`; `None` if there is no
    /// such id. `is_it` may also be called for ids with other hashes.
    pub(crate) fn find(&self, hash: u64, mut is_it: impl FnMut(u32) -> bool) -> Option<u32> {
        if self.places.is_empty() {
            return None;
        }
        let mask = self.places.len() - 1;
        let mut place = self.home(hash);
        loop {
            match self.places[place] {
                FREE => return None,
                id if is_it(id) => return Some(id),
                _ => place = (place + 1) & mask,
            }
        }
    }

    /// Adds the id `id`, which must not be in the table. `hash_of` must return the hash of any id
    /// in the table; it is called when the table grows.
    pub(crate) fn insert(&mut self, hash: u64, id: u32, hash_of: impl Fn(u32) -> u64) {
        if self.is_full() {
            let grown = self.grown();
            let old = std::mem::replace(&mut self.places, vec![FREE; grown]);
            for id in old.into_iter().filter(|id| *id != FREE) {
                self.place(hash_of(id), id);
            }
        }
        self.place(hash, id);
        self.count += 1;
    }

    /// Returns the number of bytes of the table. If the table is full, the bytes of the next,
    /// larger table are added.
    pub(crate) fn bytes(&self) -> usize {
        let grown = if self.is_full() { self.grown() } else { 0 };
        (self.places.len() + grown) * size_of::<u32>()
    }

    fn is_full(&self) -> bool {
        (self.count + 1) * 8 > self.places.len() * 7
    }

    fn grown(&self) -> usize {
        (self.places.len() * 2).max(16)
    }

    fn place(&mut self, hash: u64, id: u32) {
        let mask = self.places.len() - 1;
        let mut place = self.home(hash);
        while self.places[place] != FREE {
            place = (place + 1) & mask;
        }
        self.places[place] = id;
    }

    /// Returns the first slot to search for a hash. The upper bits of a product are used, because
    /// they are mixed best.
    fn home(&self, hash: u64) -> usize {
        let bits = self.places.len().trailing_zeros();
        (hash.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - bits)) as usize
    }
}

/// Returns the hash of a sequence of words.
pub(crate) fn hash_words(words: impl IntoIterator<Item = u64>) -> u64 {
    let mut hasher = FxHasher::default();
    words.into_iter().for_each(|word| hasher.write_u64(word));
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_inserted_entries_are_found() {
        let things: Vec<u64> = (0..1_000).map(|index| index * 64).collect();
        let hash_of = |id: u32| hash_words([things[id as usize]]);
        let mut table = IdTable::default();
        for id in 0..things.len() as u32 {
            table.insert(hash_of(id), id, hash_of);
        }
        for (id, thing) in things.iter().enumerate() {
            let found = table.find(hash_words([*thing]), |other| things[other as usize] == *thing);
            assert_eq!(found, Some(id as u32));
        }
        assert_eq!(table.find(hash_words([1]), |other| things[other as usize] == 1), None);
    }
}
