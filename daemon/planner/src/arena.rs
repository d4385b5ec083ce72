//! Long arrays that grow: by less than they are long, and known beforehand.
//!
//! While an array grows, the old and the new are there at once. Whoever holds memory against a limit
//! counts both before it happens: an allocation that fails ends the process.

/// Bytes of an array from which on memory counts more than copying.
const LONG: usize = 64 << 20;

/// Makes room for more items, in a long array for a quarter of those that are there.
#[inline]
pub(crate) fn make_room<T>(items: &mut Vec<T>, more: usize) {
    if items.len() + more > items.capacity() && is_long(items) {
        items.reserve_exact((items.len() / 4).max(more));
    }
}

/// Bytes taken; of an array without room for that many more, also those that it grows to.
#[inline]
pub(crate) fn bytes<T>(items: &Vec<T>, more: usize) -> usize {
    let (length, capacity) = (items.len(), items.capacity());
    let grown = match length + more > capacity {
        true if is_long(items) => length + (length / 4).max(more),
        // Nor does an array begin with less.
        true => (capacity * 2).max(length + more).max(8),
        false => 0,
    };
    (capacity + grown) * size_of::<T>()
}

fn is_long<T>(items: &[T]) -> bool {
    size_of_val(items) >= LONG
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_while_an_array_grows_is_told_before() {
        let mut items: Vec<u64> = Vec::new();
        while items.len() < (100 << 20) / size_of::<u64>() {
            let (told, before) = (bytes(&items, 1), items.capacity());
            make_room(&mut items, 1);
            items.push(0);
            let both = if items.capacity() > before { before + items.capacity() } else { before };
            assert!(told >= both * size_of::<u64>(), "{told} bytes told, {both} items there");
        }
        assert!(items.capacity() < items.len() + items.len() / 4 + 1);
    }
}
