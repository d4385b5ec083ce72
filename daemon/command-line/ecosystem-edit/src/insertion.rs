//! Places in a text at which lines and keys are inserted.
//!
//! Text is inserted and never replaced, so that comments, order, line ends and a byte order mark
//! stay as they are.

use toml_edit::{InlineTable, Item, Table, TableLike, Value};

/// A text to insert before the byte at an offset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TextInsertion {
    offset: usize,
    text: String,
}

// === impl TextInsertion ===

impl TextInsertion {
    /// Returns the insertion of whole lines behind the line of `offset`, and behind the comments
    /// that belong to it. `lines` ends with a line end, and stands behind an empty line if
    /// `is_apart`.
    pub(crate) fn of_lines(
        text: &str,
        offset: usize,
        lines: &str,
        is_apart: bool,
    ) -> TextInsertion {
        let offset = end_of_block(text, offset);
        let before = text.get(..offset).unwrap_or_default();
        let is_line_begun = !before.is_empty() && !before.ends_with('\n');
        let mut inserted = String::new();
        if is_line_begun {
            inserted.push('\n');
        }
        if is_apart && !before.trim_start_matches('\u{feff}').is_empty() {
            inserted.push('\n');
        }
        inserted.push_str(lines);
        TextInsertion { offset, text: inserted }
    }

    /// Returns the insertion of `entry`, a key and its value, as the last entry of an inline table;
    /// `None` if the place of the table in the text is not known.
    pub(crate) fn of_entry(text: &str, table: &InlineTable, entry: &str) -> Option<TextInsertion> {
        let last = table.iter().filter_map(|(_, value)| value_end(value)).max();
        if let Some(offset) = last {
            return Some(TextInsertion { offset, text: format!(", {entry}") });
        }
        let span = table.span()?;
        let inside = text.get(span.start + 1..span.end.checked_sub(1)?)?;
        let space = if inside.is_empty() { " " } else { "" };
        Some(TextInsertion { offset: span.start + 1, text: format!(" {entry}{space}") })
    }

    /// Returns `text` with the insertion, with the line ends of the text.
    pub(crate) fn applied_to(&self, text: &str) -> String {
        let ends_with_returns = text.contains("\r\n");
        let inserted = match ends_with_returns {
            true => self.text.replace('\n', "\r\n"),
            false => self.text.clone(),
        };
        let (before, after) = text.split_at_checked(self.offset).unwrap_or((text, ""));
        format!("{before}{inserted}{after}")
    }
}

/// Returns the end of the line of `offset`, or of the comments behind it that belong to it: those
/// that follow directly, and that an empty line or the end of the text follows. Comments directly
/// before something else belong to that.
fn end_of_block(text: &str, offset: usize) -> usize {
    let line_end = |from: usize| {
        let rest = text.get(from..).unwrap_or_default();
        rest.find('\n').map_or(text.len(), |length| from + length + 1)
    };
    let own = line_end(offset);
    let mut end = own;
    loop {
        let next = line_end(end);
        let line = text.get(end..next).unwrap_or_default().trim();
        if line.is_empty() {
            return end;
        }
        if !line.starts_with('#') {
            return own;
        }
        end = next;
    }
}

/// Returns the offset behind everything in an item, its subtables included.
pub(crate) fn item_end(item: &Item) -> Option<usize> {
    match item {
        Item::None => None,
        Item::Value(value) => value_end(value),
        Item::Table(table) => table_end(table),
        Item::ArrayOfTables(tables) => tables.iter().filter_map(table_end).max(),
    }
}

fn table_end(table: &Table) -> Option<usize> {
    let header = table.span().map(|span| span.end);
    let inside = table.iter().filter_map(|(_, item)| item_end(item));
    inside.chain(header).max()
}

/// Returns the offset behind the header and the keys of a table, without its subtables.
pub(crate) fn own_keys_end(table: &Table) -> Option<usize> {
    let header = table.span().map(|span| span.end);
    let is_key = |item: &Item| match item {
        Item::Value(_) => true,
        Item::Table(table) => table.is_dotted(),
        _ => false,
    };
    let keys = table.iter().filter(|(_, item)| is_key(item));
    keys.filter_map(|(_, item)| item_end(item)).chain(header).max()
}

fn value_end(value: &Value) -> Option<usize> {
    let own = value.span().map(|span| span.end);
    match value {
        // A dotted key is a table without a place of its own.
        Value::InlineTable(table) if table.is_dotted() => {
            table.iter().filter_map(|(_, value)| value_end(value)).max()
        }
        _ => own,
    }
}

/// Returns the number of the line of an entry of a table, from 1.
pub(crate) fn line_of(text: &str, table: &dyn TableLike, name: &str) -> usize {
    let key = table.key(name).and_then(toml_edit::Key::span);
    let value = || table.get(name).and_then(Item::span);
    line_at(text, key.or_else(value).map_or(0, |span| span.start))
}

/// Returns the number of the line of an offset, from 1.
pub(crate) fn line_at(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().get(..offset).unwrap_or_default();
    before.iter().filter(|byte| **byte == b'\n').count() + 1
}
