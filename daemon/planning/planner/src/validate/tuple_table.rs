//! Tables: sets of tuples of objects, with a lookup of a whole tuple and of all tuples with a given
//! object in one column.
//!
//! - A tuple keeps its row number even after it is removed, so that other data (indexes, values)
//!   can refer to rows.
//! - The index of a column is built on first use, and maintained from then on. Most tables for a
//!   building are so small that no index is built.

use std::hash::Hasher;
use std::sync::OnceLock;

use rustc_hash::{FxHashMap, FxHasher};

use super::symbols::Object;

/// Number of rows up to which scanning all rows is faster than hashing.
pub(super) const SCANNED_MAX: usize = 8;

/// Marks a row without a tuple (after a removal), and the end of a chain of rows.
const NOWHERE: u32 = u32::MAX;

/// A set of tuples of equal length.
#[derive(Clone, Debug, Default)]
pub(super) struct TupleTable {
    arity: usize,
    /// Objects of all tuples, row after row.
    cells: Vec<Object>,
    /// For each hash: the newest row with that hash. The map is empty while there are at most
    /// [`SCANNED_MAX`] rows.
    newest: FxHashMap<u64, u32>,
    /// For each row: the previous row with the same hash; [`NOWHERE`] if there is none.
    earlier: Vec<u32>,
    /// Rows of the tuples that are in the table. Rows are in order of insertion as long as no tuple
    /// is removed.
    rows: Vec<u32>,
    /// For each row: its position in `rows`; [`NOWHERE`] if its tuple has been removed.
    places: Vec<u32>,
    columns: Vec<OnceLock<Column>>,
}

/// Index of one column: for each object, the rows of the tuples that have the object in this
/// column.
#[derive(Clone, Debug, Default)]
struct Column {
    groups: FxHashMap<Object, Vec<u32>>,
    /// For each row: its position in its group of rows.
    places: Vec<u32>,
}

// === impl TupleTable ===

impl TupleTable {
    pub(super) fn new(arity: usize) -> TupleTable {
        TupleTable { arity, ..TupleTable::default() }
    }

    /// Returns the number of tuples in the table.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Returns the number of rows, including the rows of removed tuples.
    pub(super) fn row_count(&self) -> usize {
        self.earlier.len()
    }

    pub(super) fn tuple(&self, row: u32) -> &[Object] {
        let start = row as usize * self.arity;
        &self.cells[start..start + self.arity]
    }

    /// Returns the rows of all tuples in the table.
    pub(super) fn rows(&self) -> &[u32] {
        &self.rows
    }

    /// Iterates over all tuples in the table, in no particular order.
    pub(super) fn tuples(&self) -> impl Iterator<Item = &[Object]> {
        self.rows.iter().map(|row| self.tuple(*row))
    }

    /// Returns the rows of the tuples in the table that have `object` in a column.
    pub(super) fn matching(&self, column: usize, object: Object) -> &[u32] {
        let column = self.columns[column].get_or_init(|| self.indexed(column));
        column.groups.get(&object).map_or(&[], Vec::as_slice)
    }

    /// Whether a tuple is in the table; `cell` returns the tuple's object for each column.
    pub(super) fn contains(&self, cell: impl Fn(usize) -> Object) -> bool {
        self.find(cell).is_some_and(|row| self.places[row as usize] != NOWHERE)
    }

    /// Returns the row of a tuple, even if the tuple has been removed; `None` if it never was in
    /// the table. `cell` returns the tuple's object for each column.
    pub(super) fn find(&self, cell: impl Fn(usize) -> Object) -> Option<u32> {
        let is_it = |row: u32| {
            let cells = self.tuple(row).iter().enumerate();
            cells.into_iter().all(|(column, object)| cell(column) == *object)
        };
        let count = self.row_count() as u32;
        if count as usize <= SCANNED_MAX {
            return (0..count).find(|row| is_it(*row));
        }
        let mut row = *self.newest.get(&hash((0..self.arity).map(&cell)))?;
        while row != NOWHERE {
            if is_it(row) {
                return Some(row);
            }
            row = self.earlier[row as usize];
        }
        None
    }

    /// Adds a tuple. Returns `false` if the tuple is already in the table.
    pub(super) fn insert(&mut self, tuple: &[Object]) -> bool {
        let row = match self.find(|column| tuple[column]) {
            Some(row) if self.places[row as usize] != NOWHERE => return false,
            Some(row) => row,
            None => self.append(tuple),
        };
        self.places[row as usize] = self.rows.len() as u32;
        self.rows.push(row);
        for (column, object) in self.columns.iter_mut().zip(tuple) {
            if let Some(column) = column.get_mut() {
                column.insert(row, *object);
            }
        }
        true
    }

    /// Removes a tuple. Returns `false` if the tuple is not in the table.
    pub(super) fn remove(&mut self, tuple: &[Object]) -> bool {
        let Some(row) = self.find(|column| tuple[column]) else { return false };
        if self.places[row as usize] == NOWHERE {
            return false;
        }
        remove(&mut self.rows, &mut self.places, row);
        for (column, object) in self.columns.iter_mut().zip(tuple) {
            if let Some(column) = column.get_mut() {
                column.remove(row, *object);
            }
        }
        true
    }

    fn append(&mut self, tuple: &[Object]) -> u32 {
        let row = self.earlier.len() as u32;
        self.cells.extend_from_slice(tuple);
        self.earlier.push(NOWHERE);
        self.places.push(NOWHERE);
        if row == 0 {
            self.columns.resize_with(self.arity, OnceLock::new);
        }
        match row as usize {
            ..SCANNED_MAX => (),
            SCANNED_MAX => (0..=row).for_each(|row| self.chain(row)),
            _ => self.chain(row),
        }
        row
    }

    fn chain(&mut self, row: u32) {
        let hash = hash(self.tuple(row).iter().copied());
        self.earlier[row as usize] = self.newest.insert(hash, row).unwrap_or(NOWHERE);
    }

    fn indexed(&self, column: usize) -> Column {
        let mut index = Column::default();
        for row in &self.rows {
            index.insert(*row, self.tuple(*row)[column]);
        }
        index
    }
}

impl PartialEq for TupleTable {
    /// Compares the tuples that are in the tables. Removed tuples do not matter.
    fn eq(&self, other: &TupleTable) -> bool {
        let has = |tuple: &[Object]| other.contains(|column| tuple[column]);
        self.arity == other.arity && self.len() == other.len() && self.tuples().all(has)
    }
}

// === impl Column ===

impl Column {
    fn insert(&mut self, row: u32, object: Object) {
        if self.places.len() <= row as usize {
            self.places.resize(row as usize + 1, NOWHERE);
        }
        let group = self.groups.entry(object).or_default();
        self.places[row as usize] = group.len() as u32;
        group.push(row);
    }

    fn remove(&mut self, row: u32, object: Object) {
        if let Some(group) = self.groups.get_mut(&object) {
            remove(group, &mut self.places, row);
        }
    }
}

/// Removes a row from a group; the last row of the group moves to its position.
fn remove(group: &mut Vec<u32>, places: &mut [u32], row: u32) {
    let place = std::mem::replace(&mut places[row as usize], NOWHERE) as usize;
    group.swap_remove(place);
    if let Some(moved) = group.get(place) {
        places[*moved as usize] = place as u32;
    }
}

fn hash(objects: impl Iterator<Item = Object>) -> u64 {
    let mut hasher = FxHasher::default();
    objects.for_each(|object| hasher.write_usize(object.index()));
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(table: &TupleTable, rows: &[u32]) -> Vec<Vec<usize>> {
        let tuple = |row: &u32| table.tuple(*row).iter().map(|object| object.index()).collect();
        let mut tuples: Vec<Vec<usize>> = rows.iter().map(tuple).collect();
        tuples.sort();
        tuples
    }

    #[test]
    fn an_index_follows_additions_removals_and_repeated_additions() {
        let pairs = || (0..40).map(|index| [index / 7, index % 7].map(Object::stranger));
        let mut table = TupleTable::new(2);
        assert!(pairs().take(20).all(|pair| table.insert(&pair)));
        let second = Object::stranger(2);
        let before = sorted(&table, table.matching(1, second));
        assert!(pairs().skip(20).all(|pair| table.insert(&pair)));
        assert!(!table.insert(&[second, second]), "it is there already");
        assert!(pairs().skip(20).all(|pair| table.remove(&pair)));
        assert!(!table.remove(&[Object::stranger(5), second]), "it is gone already");
        assert_eq!(sorted(&table, table.matching(1, second)), before);
        assert_eq!((table.len(), table.row_count()), (20, 40));
        assert!(pairs().skip(20).all(|pair| table.insert(&pair)));
        assert_eq!((table.len(), table.row_count()), (40, 40));
        let expected: Vec<_> = pairs().filter(|pair| pair[1] == second).collect();
        assert_eq!(table.matching(1, second).len(), expected.len());
        assert!(pairs().all(|pair| table.contains(|column| pair[column])));
    }

    #[test]
    fn the_empty_tuple_can_be_added_and_removed() {
        let mut table = TupleTable::new(0);
        assert!(!table.contains(|_| Object::UNBOUND));
        assert!(table.insert(&[]) && !table.insert(&[]));
        assert!(table.contains(|_| Object::UNBOUND));
        assert!(table.remove(&[]) && !table.contains(|_| Object::UNBOUND));
    }
}
