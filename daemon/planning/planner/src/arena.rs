//! How long arrays grow: by a quarter of their length, and with the memory for the growth known
//! beforehand.
//!
//! While an array grows, the old and the new allocation exist at once. Code that enforces a memory
//! limit must count both before the growth happens, because an allocation that fails ends the process.

/// Size in bytes from which on an array grows by a quarter instead of doubling: in arrays of this size,
/// saved memory counts more than saved copying.
const LONG: usize = 64 << 20;

/// Makes room for `more` further items. A long array grows by a quarter of its length, or by `more`
/// items if that is greater; a shorter one grows as [`Vec`] does.
#[inline]
pub(crate) fn make_room<T>(items: &mut Vec<T>, more: usize) {
    if items.len() + more > items.capacity() && is_long(items) {
        items.reserve_exact((items.len() / 4).max(more));
    }
}

/// Returns the number of bytes that the array takes. If the array has no room for `more` further items,
/// the size of the array that it will grow to is added.
#[inline]
pub(crate) fn bytes<T>(items: &Vec<T>, more: usize) -> usize {
    let (length, capacity) = (items.len(), items.capacity());
    let grown = match length + more > capacity {
        true if is_long(items) => length + (length / 4).max(more),
        // `Vec` doubles, and begins with room for at least this many items.
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
