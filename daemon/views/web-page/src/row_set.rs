//! The rows of a topic as they are computed: keys and JSON in one buffer, which is used again.

use serde::Serialize;

/// Rows with their keys.
#[derive(Debug, Default)]
pub(crate) struct RowSet {
    bytes: Vec<u8>,
    /// The ends of the key and of the JSON of each row in `bytes`.
    ends: Vec<(usize, usize)>,
    /// Whether pages show the rows in this order; else they sort them.
    pub(crate) is_ordered: bool,
    /// Smallest key that is kept, if these rows only add to those of before; `None` if they replace
    /// them.
    pub(crate) adds_from: Option<String>,
    /// Whether these rows only change those of before: no other row is removed.
    pub(crate) is_change: bool,
}

impl RowSet {
    /// Removes all rows, and keeps the buffer.
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        self.ends.clear();
        self.is_ordered = false;
        self.adds_from = None;
        self.is_change = false;
    }

    /// Adds a row.
    pub(crate) fn push(&mut self, key: &str, row: &impl Serialize) {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(key.as_bytes());
        let key_end = self.bytes.len();
        match serde_json::to_writer(&mut self.bytes, row) {
            Ok(()) => self.ends.push((key_end, self.bytes.len())),
            Err(error) => {
                self.bytes.truncate(start);
                tracing::warn!(%error, "a row of a page cannot be written");
            }
        }
    }

    /// Iterates over the rows: key and JSON.
    pub(crate) fn rows(&self) -> impl Iterator<Item = (&str, &str)> {
        let starts = std::iter::once(0).chain(self.ends.iter().map(|(_, end)| *end));
        starts.zip(&self.ends).map(|(start, (key_end, end))| {
            let text = |range| std::str::from_utf8(&self.bytes[range]).unwrap_or_default();
            (text(start..*key_end), text(*key_end..*end))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_returned_as_they_were_added() {
        let mut rows = RowSet::default();
        for _ in 0..2 {
            rows.clear();
            rows.push("a", &1);
            rows.push("", &"x\ny");
            rows.push("ü", &[true]);
        }
        let all: Vec<_> = rows.rows().collect();
        assert_eq!(all, [("a", "1"), ("", "\"x\\ny\""), ("ü", "[true]")]);
    }
}
