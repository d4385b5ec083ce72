//! Tuples of objects, each once, found again by any of their columns.

use crate::id_table::{IdTable, hash_words};
use crate::task::ObjectId;

/// No further row.
const END: u32 = u32::MAX;

/// The tuples of one predicate, or of one action.
#[derive(Clone, Debug)]
pub(super) struct Relation {
    arity: usize,
    flat: Vec<ObjectId>,
    count: usize,
    set: IdTable,
    indices: Vec<Index>,
    /// Rows below this are in the indices; the rest wait for their turn.
    indexed: usize,
    /// Rows below this hold in the initial state.
    pub(super) initial: usize,
}

/// Rows by the values of some columns: a list per combination.
#[derive(Clone, Debug)]
struct Index {
    columns: Vec<usize>,
    /// The first row of each list.
    heads: IdTable,
    next: Vec<u32>,
}

/// Names an index of a relation.
pub(super) type IndexId = usize;

// === impl Relation ===

impl Relation {
    pub(super) fn new(arity: usize) -> Relation {
        Relation {
            arity,
            flat: Vec::new(),
            count: 0,
            set: IdTable::default(),
            indices: Vec::new(),
            indexed: 0,
            initial: 0,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Bytes taken, without the small change.
    pub(super) fn bytes(&self) -> usize {
        let indices = self.indices.iter().map(|index| index.heads.bytes() + index.next.len() * 4);
        self.flat.len() * 4 + self.set.bytes() + indices.sum::<usize>()
    }

    pub(super) fn row(&self, row: usize) -> &[ObjectId] {
        &self.flat[row * self.arity..(row + 1) * self.arity]
    }

    /// The row of a tuple.
    pub(super) fn find(&self, tuple: &[ObjectId]) -> Option<usize> {
        let found = self.set.find(hash(tuple.iter()), |id| self.row(id as usize) == tuple);
        found.map(|id| id as usize)
    }

    /// Whether the tuple is there and has had its turn.
    pub(super) fn contains_indexed(&self, tuple: &[ObjectId]) -> bool {
        self.find(tuple).is_some_and(|row| row < self.indexed)
    }

    /// Adds a tuple; whether it is new.
    pub(super) fn insert(&mut self, tuple: &[ObjectId]) -> bool {
        debug_assert_eq!(tuple.len(), self.arity);
        let key = hash(tuple.iter());
        if self.find(tuple).is_some() {
            return false;
        }
        self.flat.extend_from_slice(tuple);
        let Relation { arity, flat, set, .. } = self;
        let row_hash =
            |id: u32| hash(flat[id as usize * *arity..(id as usize + 1) * *arity].iter());
        set.insert(key, self.count as u32, row_hash);
        self.count += 1;
        true
    }

    /// Whether a row waits for its turn.
    pub(super) fn next_unindexed(&self) -> Option<usize> {
        (self.indexed < self.count).then_some(self.indexed)
    }

    /// Puts the next waiting row into the indices.
    pub(super) fn index_next(&mut self) {
        let row = self.indexed;
        self.indexed += 1;
        for index in &mut self.indices {
            index.add(row, &self.flat, self.arity);
        }
    }

    /// The index over these columns, made where there is none.
    pub(super) fn index(&mut self, columns: &[usize]) -> IndexId {
        if let Some(found) = self.indices.iter().position(|index| index.columns == columns) {
            return found;
        }
        let mut index =
            Index { columns: columns.to_vec(), heads: IdTable::default(), next: Vec::new() };
        (0..self.indexed).for_each(|row| index.add(row, &self.flat, self.arity));
        self.indices.push(index);
        self.indices.len() - 1
    }

    /// The rows whose indexed columns have these values, in the order of their turns but for the
    /// first.
    pub(super) fn matching(&self, index: IndexId, key: &[ObjectId]) -> Matching<'_> {
        let index = &self.indices[index];
        let is_it = |id: u32| {
            let row = self.row(id as usize);
            index.columns.iter().zip(key).all(|(column, value)| row[*column] == *value)
        };
        let first = index.heads.find(hash(key.iter()), is_it);
        Matching { index, next: first.unwrap_or(END) }
    }

    /// How many different values a column has.
    pub(super) fn distinct(&self, column: usize) -> usize {
        let mut values: Vec<ObjectId> = (0..self.count).map(|row| self.row(row)[column]).collect();
        values.sort_unstable();
        values.dedup();
        values.len()
    }
}

/// Rows of a list.
pub(super) struct Matching<'r> {
    index: &'r Index,
    next: u32,
}

impl Iterator for Matching<'_> {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        if self.next == END {
            return None;
        }
        let row = self.next as usize;
        self.next = self.index.next[row];
        Some(row)
    }
}

// === impl Index ===

impl Index {
    fn add(&mut self, row: usize, flat: &[ObjectId], arity: usize) {
        let Index { columns, heads, next } = self;
        let column = |id: usize, column: usize| flat[id * arity + column];
        let key_hash = |id: u32| hash(columns.iter().map(|one| &flat[id as usize * arity + *one]));
        let same =
            |id: u32| columns.iter().all(|one| column(id as usize, *one) == column(row, *one));
        let row_hash = key_hash(row as u32);
        match heads.find(row_hash, same) {
            // The head stays where the table knows it; the row goes right behind it.
            Some(head) => {
                next.push(next[head as usize]);
                next[head as usize] = row as u32;
            }
            None => {
                next.push(END);
                heads.insert(row_hash, row as u32, key_hash);
            }
        }
    }
}

fn hash<'o>(objects: impl Iterator<Item = &'o ObjectId>) -> u64 {
    hash_words(objects.map(|object| object.index() as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tuple(values: &[usize]) -> Vec<ObjectId> {
        values.iter().map(|value| ObjectId::from_index(*value)).collect()
    }

    #[test]
    fn rows_are_found_by_columns_once_they_had_their_turn() {
        let mut relation = Relation::new(2);
        let first = relation.index(&[0]);
        for pair in [[1, 2], [1, 3], [2, 3], [1, 2]] {
            relation.insert(&tuple(&pair));
        }
        assert_eq!(relation.len(), 3);
        assert_eq!(relation.matching(first, &tuple(&[1])).count(), 0);
        while relation.next_unindexed().is_some() {
            relation.index_next();
        }
        assert_eq!(relation.matching(first, &tuple(&[1])).collect::<Vec<_>>(), [0, 1]);
        let late = relation.index(&[1]);
        assert_eq!(relation.matching(late, &tuple(&[3])).collect::<Vec<_>>(), [1, 2]);
        let all = relation.index(&[]);
        assert_eq!(relation.matching(all, &[]).count(), 3);
    }
}
