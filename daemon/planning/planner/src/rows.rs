//! Lists of numbers in two flat arrays, which replace a `Vec<Vec<u32>>` with fewer allocations.

/// Numbered lists of `u32`.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    starts: Vec<u32>,
    items: Vec<u32>,
}

// === impl Rows ===

impl Default for Rows {
    fn default() -> Rows {
        Rows { starts: vec![0], items: Vec::new() }
    }
}

impl Rows {
    /// Builds `count` lists from pairs of list index and item. The items of a list have the order
    /// of their pairs.
    pub(crate) fn collect(count: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Rows {
        let mut starts = vec![0u32; count + 1];
        for (row, _) in pairs.clone() {
            starts[row as usize + 1] += 1;
        }
        for row in 0..count {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut items = vec![0; starts[count] as usize];
        for (row, item) in pairs {
            let place = &mut next[row as usize];
            items[*place as usize] = item;
            *place += 1;
        }
        Rows { starts, items }
    }

    /// Returns the inverse lists: for each item below `count`, the indices of the lists that
    /// contain the item.
    pub(crate) fn inverted(&self, count: usize) -> Rows {
        let rows = 0..self.len() as u32;
        Rows::collect(
            count,
            rows.flat_map(|row| self.row(row).iter().map(move |item| (*item, row))),
        )
    }

    /// Adds a list after the last one.
    pub(crate) fn push(&mut self, items: &[u32]) {
        self.items.extend_from_slice(items);
        self.starts.push(self.items.len() as u32);
    }

    /// Returns the number of lists.
    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns the total number of items of all lists.
    pub(crate) fn item_count(&self) -> usize {
        self.items.len()
    }

    #[inline]
    pub(crate) fn row(&self, row: u32) -> &[u32] {
        &self.items[self.range(row)]
    }

    /// Returns the item at the position `index` in the sequence of all lists.
    #[inline]
    pub(crate) fn item(&self, index: usize) -> u32 {
        self.items[index]
    }

    /// Returns the range of a list's items among the items of all lists.
    #[inline]
    pub(crate) fn range(&self, row: u32) -> std::ops::Range<usize> {
        let row = row as usize;
        self.starts[row] as usize..self.starts[row + 1] as usize
    }

    /// Returns the number of bytes of the lists.
    pub(crate) fn bytes(&self) -> usize {
        (self.starts.len() + self.items.len()) * size_of::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverted_rows_list_the_rows_of_each_item() {
        let mut rows = Rows::default();
        rows.push(&[2, 0]);
        rows.push(&[]);
        rows.push(&[2]);
        let inverted = rows.inverted(3);
        let all: Vec<&[u32]> = (0..3).map(|row| inverted.row(row)).collect();
        assert_eq!(all, [&[0][..], &[], &[0, 2]]);
        assert_eq!((inverted.len(), inverted.item_count()), (3, 3));
    }
}
