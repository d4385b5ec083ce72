//! Lines of a page: pieces of text, each with its tone.

use ratatui::buffer::Buffer;
use ratatui::style::{Modifier, Style};

use crate::text;
use crate::tone::Tone;

/// A line of a page, as pieces that follow each other.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct StyledLine {
    pieces: Vec<(String, Tone)>,
}

impl StyledLine {
    /// Makes a line of one piece. The text may be from anywhere.
    pub(crate) fn of(text: &str, tone: Tone) -> Self {
        Self::default().and(text, tone)
    }

    /// Appends a piece. The text may be from anywhere.
    pub(crate) fn and(mut self, text: &str, tone: Tone) -> Self {
        self.push(text, tone);
        self
    }

    /// Appends a piece. The text may be from anywhere.
    pub(crate) fn push(&mut self, text: &str, tone: Tone) {
        if !text.is_empty() {
            self.pieces.push((text::clean(text), tone));
        }
    }

    /// Appends the pieces of another line.
    pub(crate) fn append(&mut self, other: Self) {
        self.pieces.extend(other.pieces);
    }

    /// Returns the cells that the line takes.
    pub(crate) fn width(&self) -> usize {
        self.pieces.iter().map(|(text, _)| text::width(text)).sum()
    }

    /// Cuts the line to `columns` cells and fills it with spaces up to them.
    pub(crate) fn fit(self, columns: usize) -> Self {
        let mut fitted = Self::default();
        let total = self.width();
        let mut left = columns;
        for (text, tone) in self.pieces {
            let width = text::width(&text);
            // The last piece that fits keeps a cell for the sign that something is left out.
            let is_cut = width > left || (width == left && total > columns);
            let shown = match is_cut {
                true if width <= left => text::cut(&format!("{text}…"), left),
                true => text::cut(&text, left),
                false => text,
            };
            left -= text::width(&shown).min(left);
            fitted.pieces.push((shown, tone));
            if is_cut {
                break;
            }
        }
        if left > 0 {
            fitted.pieces.push((" ".repeat(left), Tone::Plain));
        }
        fitted
    }

    /// Breaks the line into lines of at most `columns` cells; later ones are indented by `indent`.
    pub(crate) fn wrap(&self, columns: usize, indent: usize) -> Vec<Self> {
        let columns = columns.max(1);
        // Where there is little room, an indent would take it from the words.
        let indent = if columns >= indent * 3 { indent } else { indent.min(columns / 10) };
        let mut lines = vec![Self::default()];
        let mut used = 0;
        let begin = |lines: &mut Vec<Self>| {
            lines.push(Self { pieces: vec![(" ".repeat(indent), Tone::Plain)] });
            indent
        };
        let words = self.pieces.iter().flat_map(|(text, tone)| {
            let words = text.split_inclusive(' ');
            words.map(|word| (word.trim_end_matches(' '), word.ends_with(' '), *tone))
        });
        for (word, is_spaced, tone) in words {
            let is_begun = used > if lines.len() > 1 { indent } else { 0 };
            if used + text::width(word) > columns && is_begun {
                used = begin(&mut lines);
            }
            let mut word = word;
            while used + text::width(word) > columns {
                let head = text::take(word, columns - used);
                if head.is_empty() {
                    // A wide character in a terminal of one column: nothing of it fits.
                    word = "";
                    break;
                }
                push_piece(&mut lines, head, tone);
                word = &word[head.len()..];
                used = begin(&mut lines);
            }
            push_piece(&mut lines, word, tone);
            used += text::width(word);
            if is_spaced && used < columns {
                push_piece(&mut lines, " ", tone);
                used += 1;
            }
        }
        lines
    }

    /// Leaves the first `columns` cells out.
    pub(crate) fn skip(mut self, columns: usize) -> Self {
        let mut left = columns;
        while left > 0 && !self.pieces.is_empty() {
            let (text, tone) = &self.pieces[0];
            let width = text::width(text);
            if width <= left {
                left -= width;
                self.pieces.remove(0);
            } else {
                let head = text::take(text, left);
                // Half of a wide character is a space.
                let missing = left - text::width(head);
                let tail = &text[head.len()..];
                let wide = text::take(tail, 2);
                let rest = match missing {
                    0 => tail.to_owned(),
                    _ => format!(" {}", &tail[wide.len()..]),
                };
                self.pieces[0] = (rest, *tone);
                left = 0;
            }
        }
        self
    }

    /// Whether a part of the line was left out.
    pub(crate) fn is_cut(&self) -> bool {
        self.pieces.iter().any(|(text, _)| text.trim_end().ends_with('…'))
    }

    /// Returns the text as it is said: without the sign before it.
    pub(crate) fn spoken(&self) -> String {
        text::without_sign(self.text().trim()).to_owned()
    }

    /// Returns the text without tones.
    pub(crate) fn text(&self) -> String {
        self.pieces.iter().map(|(text, _)| text.as_str()).collect()
    }

    /// Draws the line from a cell on, over at most `columns` cells.
    pub(crate) fn draw(&self, buffer: &mut Buffer, at: (u16, u16), columns: u16, look: LineLook) {
        let (start, row) = at;
        let mut column = start;
        let end = start.saturating_add(columns);
        for (text, tone) in &self.pieces {
            let left = end.saturating_sub(column);
            if left == 0 || row >= buffer.area.bottom() || column >= buffer.area.right() {
                return;
            }
            let style = look.style(*tone);
            (column, _) = buffer.set_stringn(column, row, text, usize::from(left), style);
        }
        if look.selected {
            let rest = " ".repeat(usize::from(end.saturating_sub(column)));
            buffer.set_string(column, row, rest, look.style(Tone::Plain));
        }
    }
}

/// Appends a piece to the last of `lines`.
fn push_piece(lines: &mut [StyledLine], text: &str, tone: Tone) {
    if let Some(last) = lines.last_mut() {
        last.pieces.push((text.to_owned(), tone));
    }
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LineLook {
    /// Whether the terminal has colors.
    pub(crate) color: bool,
    /// Whether the line is the selected one.
    pub(crate) selected: bool,
}

impl LineLook {
    fn style(self, tone: Tone) -> Style {
        // One color along the whole line: pieces of several would look like several selections.
        if self.selected {
            Style::default().add_modifier(Modifier::REVERSED)
        } else {
            tone.style(self.color)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_cut_with_a_sign() {
        let line = StyledLine::of("goal ", Tone::Dim).and("temperatures", Tone::Name);
        assert_eq!(line.clone().fit(20).text(), "goal temperatures   ");
        assert_eq!(line.clone().fit(9).text(), "goal tem…");
        assert_eq!(line.clone().fit(5).text(), "goal…");
        assert_eq!(line.fit(0).text(), "");
    }

    #[test]
    fn a_line_is_wrapped_between_words() {
        let line =
            StyledLine::of("• ", Tone::Bad).and("turtlebot-1 is gone for 3 min", Tone::Plain);
        let lines: Vec<_> = line.wrap(16, 2).iter().map(StyledLine::text).collect();
        assert_eq!(lines, ["• turtlebot-1 is", "  gone for 3 min"].map(str::to_owned));
        for columns in 1..40 {
            for line in line.wrap(columns, 2) {
                assert!(text::width(line.text().trim_end()) <= columns, "{columns}: {line:?}");
            }
        }
    }
}
