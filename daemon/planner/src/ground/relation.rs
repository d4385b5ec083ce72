//! Tuples of objects, found again by any of their columns.

use std::cell::OnceCell;

use crate::arena;
use crate::id_table::IdTable;
use crate::normalize::lifted::LiftedTerm;
use crate::task::ObjectId;

/// No further row.
const END: u32 = u32::MAX;

/// The tuples of one predicate, or of one action.
#[derive(Clone, Debug)]
pub(super) struct Relation {
    arity: usize,
    flat: Vec<ObjectId>,
    count: usize,
    /// Keeps every tuple from being there twice; a relation whose tuples come but once has none.
    set: Option<IdTable>,
    indices: Vec<Index>,
    /// Rows below this are in the indices; the rest wait for their turn.
    indexed: usize,
    /// Rows below this hold in the initial state.
    pub(super) initial: usize,
    /// How many different values each column has, once somebody asked.
    distinct: Vec<OnceCell<usize>>,
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
            set: Some(IdTable::default()),
            indices: Vec::new(),
            indexed: 0,
            initial: 0,
            distinct: vec![OnceCell::new(); arity],
        }
    }

    /// A relation that trusts whoever adds tuples to add none twice, and cannot find them.
    pub(super) fn of_distinct(arity: usize) -> Relation {
        Relation { set: None, ..Relation::new(arity) }
    }

    /// Takes all tuples out of a relation without set and indices.
    pub(super) fn clear(&mut self, arity: usize) {
        self.arity = arity;
        self.flat.clear();
        self.count = 0;
    }

    /// Whether tuples can be found without an index.
    pub(super) fn has_set(&self) -> bool {
        self.set.is_some()
    }

    pub(super) fn arity(&self) -> usize {
        self.arity
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Bytes taken, and those that the next tuple may take, without the small change.
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

    /// The row of a tuple.
    pub(super) fn find(&self, tuple: &[ObjectId]) -> Option<usize> {
        let key = hash(tuple.iter().copied());
        let found = self.set.as_ref()?.find(key, |id| self.row(id as usize) == tuple);
        found.map(|id| id as usize)
    }

    /// The row of the tuple that terms stand for.
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

    /// Adds a tuple, unless it is there.
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

    /// Forgets what was true of fewer rows.
    pub(super) fn forget_statistics(&mut self) {
        self.distinct.iter_mut().for_each(|distinct| {
            distinct.take();
        });
    }

    /// Adds the tuple that terms stand for, unless it is there.
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

    /// Puts the row that comes next into the set.
    fn note(&mut self, key: u64) {
        let Relation { arity, flat, set, count, .. } = self;
        let row_hash =
            |id: u32| hash(flat[id as usize * *arity..(id as usize + 1) * *arity].iter().copied());
        if let Some(set) = set {
            set.insert(key, *count as u32, row_hash);
        }
    }

    /// Whether a tuple is there and has had its turn.
    pub(super) fn has_indexed(&self, terms: &[LiftedTerm]) -> bool {
        self.find_terms(terms, &[]).is_some_and(|row| self.is_indexed(row))
    }

    /// How many rows have had their turn.
    pub(super) fn indexed_len(&self) -> usize {
        self.indexed
    }

    /// Whether a row has had its turn.
    #[inline]
    pub(super) fn is_indexed(&self, row: usize) -> bool {
        row < self.indexed
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

    /// Puts all waiting rows into the indices.
    pub(super) fn index_all(&mut self) {
        while self.next_unindexed().is_some() {
            self.index_next();
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

    /// How many different values a column has; asked of relations that grow no more.
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

/// Rows of a list.
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

/// Mixes as much as the table needs, which multiplies once more.
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
    fn rows_are_found_by_columns_once_they_had_their_turn() {
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
