//! Line breaks.
//!
//! A list is printed on one line if it fits. Otherwise its first items stay on the line, and each
//! other item has a line of its own, indented by two more spaces.

use std::fmt::{self, Write};

use crate::tree::Name;

/// Longest line, in characters; a longer one is broken. As in the examples of the literature, it is
/// no hard limit.
const COLUMNS_MAX: usize = 100;

/// Number of spaces per level.
const INDENT: usize = 2;

/// Text with a structure.
pub(super) struct Layout<'t> {
    /// Number of characters on one line.
    width: usize,
    kind: Kind<'t>,
}

enum Kind<'t> {
    Word(&'t str),
    Variable(&'t str),
    Written(String),
    /// Parentheses. If they break, the first `kept` items stay on the first line.
    List {
        kept: usize,
        items: Vec<Layout<'t>>,
    },
    /// Items without parentheses; they break like words of prose.
    Group(Vec<Layout<'t>>),
}

// === impl Layout ===

impl<'t> Layout<'t> {
    pub(super) fn word(word: &'t str) -> Layout<'t> {
        Layout { width: word.chars().count(), kind: Kind::Word(word) }
    }

    pub(super) fn name(name: &'t Name) -> Layout<'t> {
        Layout::word(name.spelled())
    }

    pub(super) fn variable(name: &'t Name) -> Layout<'t> {
        Layout { width: name.spelled().chars().count() + 1, kind: Kind::Variable(name.spelled()) }
    }

    pub(super) fn written(value: impl fmt::Display) -> Layout<'t> {
        let written = value.to_string();
        Layout { width: written.chars().count(), kind: Kind::Written(written) }
    }

    /// `(items…)`, the first `kept` on the first line.
    pub(super) fn list(kept: usize, items: Vec<Layout<'t>>) -> Layout<'t> {
        Layout { width: width(&items) + 2, kind: Kind::List { kept, items } }
    }

    /// `(word items…)`
    pub(super) fn headed(word: &'t str, items: impl IntoIterator<Item = Layout<'t>>) -> Layout<'t> {
        let head = std::iter::once(Layout::word(word));
        Layout::list(1, head.chain(items).collect())
    }

    /// `items…`, kept together.
    pub(super) fn group(items: Vec<Layout<'t>>) -> Layout<'t> {
        Layout { width: width(&items), kind: Kind::Group(items) }
    }

    /// Writes on one line.
    pub(super) fn write_flat(&self, out: &mut dyn Write) -> fmt::Result {
        match &self.kind {
            Kind::Word(word) => out.write_str(word),
            Kind::Written(word) => out.write_str(word),
            Kind::Variable(name) => {
                out.write_char('?')?;
                out.write_str(name)
            }
            Kind::List { items, .. } => {
                out.write_char('(')?;
                write_flat(items, out)?;
                out.write_char(')')
            }
            Kind::Group(items) => write_flat(items, out),
        }
    }

    /// Writes from column `indent` on, on as many lines as it takes.
    pub(super) fn write(&self, indent: usize, out: &mut dyn Write) -> fmt::Result {
        if indent + self.width <= COLUMNS_MAX {
            return self.write_flat(out);
        }
        self.write_broken(indent, out)
    }

    /// Writes on several lines, even if it would fit on one.
    pub(super) fn write_broken(&self, indent: usize, out: &mut dyn Write) -> fmt::Result {
        match &self.kind {
            Kind::List { kept, items } => write_list(*kept, items, indent, out),
            Kind::Group(items) => write_group(items, indent, out),
            Kind::Word(_) | Kind::Variable(_) | Kind::Written(_) => self.write_flat(out),
        }
    }
}

/// Breaks the line, and starts the next at column `indent`.
pub(super) fn write_newline(indent: usize, out: &mut dyn Write) -> fmt::Result {
    write!(out, "\n{:indent$}", "")
}

fn width(items: &[Layout<'_>]) -> usize {
    items.iter().map(|item| item.width + 1).sum::<usize>().saturating_sub(1)
}

fn write_flat(items: &[Layout<'_>], out: &mut dyn Write) -> fmt::Result {
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
    items: &[Layout<'_>],
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

fn write_group(items: &[Layout<'_>], indent: usize, out: &mut dyn Write) -> fmt::Result {
    let mut column = indent;
    for (index, item) in items.iter().enumerate() {
        if index > 0 {
            column += 1;
            // A label (`:effect`) and its value share a line, whatever the length of the value.
            let breaks =
                column + item.width > COLUMNS_MAX && !matches!(item.kind, Kind::List { .. });
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
