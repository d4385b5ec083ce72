//! Relations: sets of tuples of objects, each with indices over some of its columns.

use std::cell::OnceCell;

use crate::arena;
use crate::id_table::IdTable;
use crate::normalize::lifted::LiftedTerm;
use crate::task::ObjectId;

/// Marks the end of a list of rows in an index.
const END: u32 = u32::MAX;

/// A relation: the tuples of one predicate, or of one action.
#[derive(Clone, Debug)]
pub(super) struct Relation {
    arity: usize,
    flat: Vec<ObjectId>,
    count: usize,
    /// Set of all tuples, for detecting duplicates; `None` if the source of the tuples cannot
    /// produce duplicates.
    set: Option<IdTable>,
    indices: Vec<Index>,
    /// Number of rows in the indices. The rows after them have not been processed yet.
    indexed: usize,
    /// Number of rows that hold in the initial state, which come first.
    pub(super) initial: usize,
    /// Per column: the number of different values; computed at the first use.
    distinct: Vec<OnceCell<usize>>,
}

/// An index over some columns: lists of the rows with the same values in these columns.
#[derive(Clone, Debug)]
struct Index {
    columns: Vec<usize>,
    /// Table of the first row of each list.
    heads: IdTable,
    next: Vec<u32>,
}

/// Number of an index among the indices of one relation.
pub(super) type IndexId = usize;

// === impl Relation ===

impl Relation {
    pub(super) fn new(arity: usize) -> Relation {
        Relation {
            arity,
            flat: Vec::new(),
            count: 0,
            set: Some(IdTable::default()),
            indices: Vec::new(),
            indexed: 0,
            initial: 0,
            distinct: vec![OnceCell::new(); arity],
        }
    }

    /// Creates a relation that does not check for duplicates. The caller must not add a tuple
    /// twice, and tuples cannot be looked up by value.
    pub(super) fn of_distinct(arity: usize) -> Relation {
        Relation { set: None, ..Relation::new(arity) }
    }

    /// Removes all tuples, and sets the number of columns to `arity`. The relation must have no set
    /// and no indices.
    pub(super) fn clear(&mut self, arity: usize) {
        self.arity = arity;
        self.flat.clear();
        self.count = 0;
    }

    /// Whether tuples can be looked up without an index.
    pub(super) fn has_set(&self) -> bool {
        self.set.is_some()
    }

    pub(super) fn arity(&self) -> usize {
        self.arity
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Returns the number of bytes of the relation, including the growth that the next tuple may
    /// cause. Small fixed parts are not counted.
    pub(super) fn bytes(&self) -> usize {
        let indices =
            self.indices.iter().map(|index| index.heads.bytes() + arena::bytes(&index.next, 1));
        let set = self.set.as_ref().map_or(0, IdTable::bytes);
        arena::bytes(&self.flat, self.arity) + set + indices.sum::<usize>()
    }

    #[inline]
    pub(super) fn row(&self, row: usize) -> &[ObjectId] {
        &self.flat[row * self.arity..(row + 1) * self.arity]
    }

    /// Returns the row of a tuple; `None` if the relation does not contain the tuple or has no set
    /// for look-ups.
    pub(super) fn find(&self, tuple: &[ObjectId]) -> Option<usize> {
        let key = hash(tuple.iter().copied());
        let found = self.set.as_ref()?.find(key, |id| self.row(id as usize) == tuple);
        found.map(|id| id as usize)
    }

    /// Returns the row of the tuple that results from `terms` under a binding; `None` if the
    /// relation does not contain the tuple or has no set for look-ups.
    #[inline]
    pub(super) fn find_terms(&self, terms: &[LiftedTerm], binding: &[ObjectId]) -> Option<usize> {
        let key = hash(terms.iter().map(|term| term.object(binding)));
        let found = self.set.as_ref()?.find(key, |id| self.is_row(id as usize, terms, binding));
        found.map(|id| id as usize)
    }

    fn is_row(&self, row: usize, terms: &[LiftedTerm], binding: &[ObjectId]) -> bool {
        let row = self.row(row).iter();
        row.zip(terms).all(|(object, term)| *object == term.object(binding))
    }

    /// Adds a tuple, unless the relation contains it.
    pub(super) fn insert(&mut self, tuple: &[ObjectId]) {
        debug_assert_eq!(tuple.len(), self.arity);
        if self.set.is_some() {
            let key = hash(tuple.iter().copied());
            let found = self
                .set
                .as_ref()
                .and_then(|set| set.find(key, |id| self.row(id as usize) == tuple));
            if found.is_some() {
                return;
            }
            self.note(key);
        }
        arena::make_room(&mut self.flat, self.arity);
        self.flat.extend_from_slice(tuple);
        self.count += 1;
    }

    /// Drops the cached column statistics, because the relation has grown.
    pub(super) fn forget_statistics(&mut self) {
        self.distinct.iter_mut().for_each(|distinct| {
            distinct.take();
        });
    }

    /// Adds the tuple that results from `terms` under a binding, unless the relation contains it.
    #[inline]
    pub(super) fn insert_terms(&mut self, terms: &[LiftedTerm], binding: &[ObjectId]) {
        if self.set.is_some() {
            let key = hash(terms.iter().map(|term| term.object(binding)));
            let found = self
                .set
                .as_ref()
                .and_then(|set| set.find(key, |id| self.is_row(id as usize, terms, binding)));
            if found.is_some() {
                return;
            }
            self.note(key);
        }
        arena::make_room(&mut self.flat, self.arity);
        self.flat.extend(terms.iter().map(|term| term.object(binding)));
        self.count += 1;
    }

    /// Adds the row that is about to be stored to the set of tuples. `key` is the hash of the row.
    fn note(&mut self, key: u64) {
        let Relation { arity, flat, set, count, .. } = self;
        let row_hash =
            |id: u32| hash(flat[id as usize * *arity..(id as usize + 1) * *arity].iter().copied());
        if let Some(set) = set {
            set.insert(key, *count as u32, row_hash);
        }
    }

    /// Whether the relation contains the tuple of the constant `terms` and has already indexed it.
    pub(super) fn has_indexed(&self, terms: &[LiftedTerm]) -> bool {
        self.find_terms(terms, &[]).is_some_and(|row| self.is_indexed(row))
    }

    /// Returns the number of rows that have been indexed.
    pub(super) fn indexed_len(&self) -> usize {
        self.indexed
    }

    /// Whether a row has already been processed and entered into the indices.
    #[inline]
    pub(super) fn is_indexed(&self, row: usize) -> bool {
        row < self.indexed
    }

    /// Returns the first row that is not indexed; `None` if all rows are indexed.
    pub(super) fn next_unindexed(&self) -> Option<usize> {
        (self.indexed < self.count).then_some(self.indexed)
    }

    /// Adds the first row that is not indexed to the indices.
    pub(super) fn index_next(&mut self) {
        let row = self.indexed;
        self.indexed += 1;
        for index in &mut self.indices {
            index.add(row, &self.flat, self.arity);
        }
    }

    /// Adds all rows that are not indexed to the indices.
    pub(super) fn index_all(&mut self) {
        while self.next_unindexed().is_some() {
            self.index_next();
        }
    }

    /// Returns the number of the index over these columns, which is built if there is none.
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

    /// Returns the rows that have the values of `key` in the indexed columns. A variable in `key`
    /// has its value in `binding`. The row that was indexed first comes first; the others follow in
    /// reverse order.
    #[inline]
    pub(super) fn matching(
        &self,
        index: IndexId,
        key: &[LiftedTerm],
        binding: &[ObjectId],
    ) -> Matching<'_> {
        let index = &self.indices[index];
        let is_it = |id: u32| {
            let row = self.row(id as usize);
            index.columns.iter().zip(key).all(|(column, term)| row[*column] == term.object(binding))
        };
        let hash = hash(key.iter().map(|term| term.object(binding)));
        let first = index.heads.find(hash, is_it);
        Matching { index, next: first.unwrap_or(END) }
    }

    /// Returns the number of different values in a column. The relation must be complete.
    pub(super) fn distinct(&self, column: usize) -> usize {
        *self.distinct[column].get_or_init(|| {
            let all = (0..self.count).map(|row| self.row(row)[column]);
            let mut values: Vec<ObjectId> = all.collect();
            values.sort_unstable();
            values.dedup();
            values.len()
        })
    }
}

/// Iterator over the rows of one list of an index.
pub(super) struct Matching<'r> {
    index: &'r Index,
    next: u32,
}

impl Iterator for Matching<'_> {
    type Item = usize;

    #[inline]
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
        let key_hash = |id: u32| hash(columns.iter().map(|one| column(id as usize, *one)));
        let same =
            |id: u32| columns.iter().all(|one| column(id as usize, *one) == column(row, *one));
        let row_hash = key_hash(row as u32);
        match heads.find(row_hash, same) {
            // The head of the list stays, because the table refers to it. The new row is inserted
            // right after it.
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

/// Returns a cheap hash of a tuple. This is sufficient, because the hash table multiplies the hash
/// again.
#[inline]
fn hash(objects: impl Iterator<Item = ObjectId>) -> u64 {
    objects.fold(0, |hash: u64, object| {
        (hash.rotate_left(26) ^ object.index() as u64).wrapping_mul(0xF135_7AEA_2E62_A9C5)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tuple(values: &[usize]) -> Vec<ObjectId> {
        values.iter().map(|value| ObjectId::from_index(*value)).collect()
    }

    fn terms(values: &[usize]) -> Vec<LiftedTerm> {
        tuple(values).into_iter().map(LiftedTerm::Object).collect()
    }

    #[test]
    fn rows_are_found_by_column_after_they_are_indexed() {
        let mut relation = Relation::new(2);
        let first = relation.index(&[0]);
        for pair in [[1, 2], [1, 3], [2, 3]] {
            relation.insert(&tuple(&pair));
        }
        relation.insert_terms(&terms(&[1, 2]), &[]);
        assert_eq!(relation.len(), 3);
        assert_eq!(relation.find(&tuple(&[2, 3])), Some(2));
        assert_eq!(relation.find_terms(&terms(&[3, 2]), &[]), None);
        assert_eq!(relation.matching(first, &terms(&[1]), &[]).count(), 0);
        relation.index_all();
        assert_eq!(relation.matching(first, &terms(&[1]), &[]).collect::<Vec<_>>(), [0, 1]);
        let late = relation.index(&[1]);
        assert_eq!(relation.matching(late, &terms(&[3]), &[]).collect::<Vec<_>>(), [1, 2]);
        let all = relation.index(&[]);
        assert_eq!(relation.matching(all, &[], &[]).count(), 3);
    }
}
