//! Growth of long arrays: by a quarter of their length, with a function that returns the required
//! memory in advance.
//!
//! While an array grows, the old and the new allocation exist at the same time. Code that enforces
//! a memory limit must count both before the growth, because a failed allocation ends the process.

/// Size in bytes from which an array grows by a quarter instead of doubling. At this size, saving
/// memory is more important than saving copies.
const LONG: usize = 64 << 20;

/// Reserves room for `more` additional items. A long array grows by a quarter of its length, or by
/// `more` items if that is greater; a shorter one grows as [`Vec`] does.
#[inline]
pub(crate) fn make_room<T>(items: &mut Vec<T>, more: usize) {
    if items.len() + more > items.capacity() && is_long(items) {
        items.reserve_exact((items.len() / 4).max(more));
    }
}

/// Returns the number of bytes of the array's allocation. If the array has no room for `more`
/// additional items, the bytes of the next, larger allocation are added.
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
    fn predicted_bytes_include_both_arrays_while_one_grows() {
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
