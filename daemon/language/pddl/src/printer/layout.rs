//! Line breaks of printed texts.
//!
//! A list is printed on one line if it fits. Otherwise its first items stay on the first line, and
//! each other item is on a line of its own, indented by two more spaces.

use std::fmt::{self, Write};

use crate::tree::Name;

/// Maximum number of characters of a line; a longer line is broken. A line without a possible break
/// may be longer, as in the examples of the literature.
const COLUMNS_MAX: usize = 100;

/// Number of spaces of indentation for each level.
const INDENT: usize = 2;

/// A piece of text with the structure that decides where its lines break.
pub(super) struct PrintLayout<'t> {
    /// Number of characters of the text on one line.
    width: usize,
    kind: LayoutKind<'t>,
}

enum LayoutKind<'t> {
    Word(&'t str),
    Variable(&'t str),
    Written(String),
    /// Items in parentheses. If the lines break, the first `kept` items stay on the first line.
    List {
        kept: usize,
        items: Vec<PrintLayout<'t>>,
    },
    /// Items without parentheses, with lines that break like those of prose.
    Group(Vec<PrintLayout<'t>>),
}

// === impl PrintLayout ===

impl<'t> PrintLayout<'t> {
    pub(super) fn word(word: &'t str) -> PrintLayout<'t> {
        PrintLayout { width: word.chars().count(), kind: LayoutKind::Word(word) }
    }

    pub(super) fn name(name: &'t Name) -> PrintLayout<'t> {
        PrintLayout::word(name.spelled())
    }

    pub(super) fn variable(name: &'t Name) -> PrintLayout<'t> {
        PrintLayout {
            width: name.spelled().chars().count() + 1,
            kind: LayoutKind::Variable(name.spelled()),
        }
    }

    pub(super) fn written(value: impl fmt::Display) -> PrintLayout<'t> {
        let written = value.to_string();
        PrintLayout { width: written.chars().count(), kind: LayoutKind::Written(written) }
    }

    /// Creates the list `(items…)`. If its lines break, the first `kept` items stay on the first
    /// line.
    pub(super) fn list(kept: usize, items: Vec<PrintLayout<'t>>) -> PrintLayout<'t> {
        PrintLayout { width: width(&items) + 2, kind: LayoutKind::List { kept, items } }
    }

    /// Creates the list `(word items…)`.
    pub(super) fn headed(
        word: &'t str,
        items: impl IntoIterator<Item = PrintLayout<'t>>,
    ) -> PrintLayout<'t> {
        let head = std::iter::once(PrintLayout::word(word));
        PrintLayout::list(1, head.chain(items).collect())
    }

    /// Creates a group `items…` without parentheses, which stays on one line if possible.
    pub(super) fn group(items: Vec<PrintLayout<'t>>) -> PrintLayout<'t> {
        PrintLayout { width: width(&items), kind: LayoutKind::Group(items) }
    }

    /// Writes the text on one line.
    pub(super) fn write_flat(&self, out: &mut dyn Write) -> fmt::Result {
        match &self.kind {
            LayoutKind::Word(word) => out.write_str(word),
            LayoutKind::Written(word) => out.write_str(word),
            LayoutKind::Variable(name) => {
                out.write_char('?')?;
                out.write_str(name)
            }
            LayoutKind::List { items, .. } => {
                out.write_char('(')?;
                write_flat(items, out)?;
                out.write_char(')')
            }
            LayoutKind::Group(items) => write_flat(items, out),
        }
    }

    /// Writes the text, starting at column `indent`, on as many lines as necessary.
    pub(super) fn write(&self, indent: usize, out: &mut dyn Write) -> fmt::Result {
        if indent + self.width <= COLUMNS_MAX {
            return self.write_flat(out);
        }
        self.write_broken(indent, out)
    }

    /// Writes the text on several lines, even if it would fit on one.
    pub(super) fn write_broken(&self, indent: usize, out: &mut dyn Write) -> fmt::Result {
        match &self.kind {
            LayoutKind::List { kept, items } => write_list(*kept, items, indent, out),
            LayoutKind::Group(items) => write_group(items, indent, out),
            LayoutKind::Word(_) | LayoutKind::Variable(_) | LayoutKind::Written(_) => {
                self.write_flat(out)
            }
        }
    }
}

/// Ends the line, and indents the next one by `indent` spaces.
pub(super) fn write_newline(indent: usize, out: &mut dyn Write) -> fmt::Result {
    write!(out, "\n{:indent$}", "")
}

fn width(items: &[PrintLayout<'_>]) -> usize {
    items.iter().map(|item| item.width + 1).sum::<usize>().saturating_sub(1)
}

fn write_flat(items: &[PrintLayout<'_>], out: &mut dyn Write) -> fmt::Result {
    for (index, item) in items.iter().enumerate() {
        if index > 0 {
            out.write_char(' ')?;
        }
        item.write_flat(out)?;
    }
    Ok(())
}

fn write_list(
    kept: usize,
    items: &[PrintLayout<'_>],
    indent: usize,
    out: &mut dyn Write,
) -> fmt::Result {
    let (first, rest) = items.split_at(kept.min(items.len()));
    out.write_char('(')?;
    write_group(first, indent + 1, out)?;
    for (index, item) in rest.iter().enumerate() {
        if index > 0 || !first.is_empty() {
            write_newline(indent + INDENT, out)?;
        }
        item.write(indent + INDENT, out)?;
    }
    out.write_char(')')
}

fn write_group(items: &[PrintLayout<'_>], indent: usize, out: &mut dyn Write) -> fmt::Result {
    let mut column = indent;
    for (index, item) in items.iter().enumerate() {
        if index > 0 {
            column += 1;
            // A label (`:effect`) and its value begin on the same line, even if the value is long.
            let breaks =
                column + item.width > COLUMNS_MAX && !matches!(item.kind, LayoutKind::List { .. });
            if breaks {
                write_newline(indent, out)?;
                column = indent;
            } else {
                out.write_char(' ')?;
            }
        }
        if column + item.width <= COLUMNS_MAX {
            item.write_flat(out)?;
        } else {
            item.write_broken(indent, out)?;
        }
        column += item.width;
    }
    Ok(())
}
