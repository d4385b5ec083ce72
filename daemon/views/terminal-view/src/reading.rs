//! Texts that are read over a page: the help, and the output of a command.

use crate::keys::{self, KeyPress, NamedKey};
use crate::page::{PAGES, PageName};
use crate::styled_line::StyledLine;
use crate::tone::Tone;

/// Most lines of an output that are kept: the last ones.
const LINES_MAX: usize = 2_000;

/// Cells of the names of keys in the help.
const LABELS: usize = 13;

/// A text that is read over a page.
#[derive(Clone)]
pub(crate) struct Reading {
    /// The title.
    pub(crate) title: String,
    /// How the title looks.
    pub(crate) tone: Tone,
    /// Whether this is the help.
    pub(crate) is_help: bool,
    lines: Vec<(StyledLine, usize)>,
    scroll: usize,
}

impl Reading {
    /// Shows the keys of a page.
    pub(crate) fn help(page: PageName, is_recording: bool) -> Self {
        let mut lines = vec![(
            StyledLine::of(page.name(), Tone::Name)
                .and(" shows ", Tone::Plain)
                .and(page.shows(), Tone::Plain)
                .and(".", Tone::Plain),
            0,
        )];
        lines.push(Default::default());
        let mut line = |keys: &str, help: &str| {
            let keys = format!("{keys:<LABELS$} ");
            let indent = keys.chars().count();
            lines.push((StyledLine::of(&keys, Tone::Key).and(help, Tone::Plain), indent));
        };
        for binding in keys::bindings(page, is_recording) {
            line(&binding.labels(), binding.help);
        }
        for facts in PAGES {
            if let Some(digit) = facts.digit {
                line(&digit.to_string(), &format!("{}: {}", facts.name, facts.shows));
            }
        }
        Self { title: format!("keys of {page}"), tone: Tone::Bar, is_help: true, lines, scroll: 0 }
    }

    /// Shows the output of a command.
    pub(crate) fn output(title: &str, text: &str, succeeded: bool) -> Self {
        let said: Vec<_> = text.lines().collect();
        let skipped = said.len().saturating_sub(LINES_MAX);
        let mut lines: Vec<_> =
            said[skipped..].iter().map(|line| (StyledLine::of(line, Tone::Plain), 2)).collect();
        if skipped > 0 {
            let text = format!("({skipped} lines before these are left out)");
            lines.insert(0, (StyledLine::of(&text, Tone::Dim), 0));
        }
        if lines.is_empty() {
            lines.push((StyledLine::of("It printed nothing.", Tone::Dim), 0));
        }
        let (sign, tone) = if succeeded { ("✓", Tone::Bar) } else { ("✗ failed:", Tone::Bad) };
        let title = format!("{sign} {title}");
        Self { title, tone, is_help: false, lines, scroll: 0 }
    }

    /// Shows the output of a dry run.
    pub(crate) fn plan(text: &str, succeeded: bool) -> Self {
        let title = if succeeded { "✓ a plan" } else { "✗ no plan" };
        Self { title: title.to_owned(), ..Self::output("", text, succeeded) }
    }

    /// Returns the lines in a terminal of `columns` cells.
    pub(crate) fn wrapped(&self, columns: usize) -> Vec<StyledLine> {
        self.lines.iter().flat_map(|(line, indent)| line.wrap(columns, *indent)).collect()
    }

    /// Returns the first line to show in an area of this size.
    pub(crate) fn first(&self, lines: usize, height: usize) -> usize {
        self.scroll.min(lines.saturating_sub(height))
    }

    /// Takes a key; returns whether the text is still read. A key without a meaning
    /// does not end it, so that the keys after it do not act on the page below.
    pub(crate) fn press(&mut self, key: KeyPress, columns: usize, height: usize) -> bool {
        let last = self.wrapped(columns.max(1)).len().saturating_sub(height);
        let page = height.saturating_sub(1).max(1);
        let scroll = self.scroll.min(last);
        self.scroll = match key {
            KeyPress::Named(NamedKey::Up) | KeyPress::Character('k') => scroll.saturating_sub(1),
            KeyPress::Named(NamedKey::Down) | KeyPress::Character('j') => scroll + 1,
            KeyPress::Named(NamedKey::PageUp) => scroll.saturating_sub(page),
            KeyPress::Named(NamedKey::PageDown) | KeyPress::Character(' ') => scroll + page,
            KeyPress::Named(NamedKey::Home) => 0,
            KeyPress::Named(NamedKey::End) | KeyPress::Character('G') => last,
            KeyPress::Named(NamedKey::Escape | NamedKey::Enter | NamedKey::Backspace)
            | KeyPress::Character('q' | '?' | 'o') => return false,
            _ => scroll,
        }
        .min(last);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_is_bounded_and_scrolls_within_itself() {
        let text: String = (0..10_000).map(|number| format!("line {number}\n")).collect();
        let mut reading = Reading::output("goal", &text, true);
        let lines = reading.wrapped(80);
        assert_eq!(lines.len(), LINES_MAX + 1);
        assert_eq!(lines.last().map(StyledLine::text), Some("line 9999".to_owned()));
        assert!(reading.press(KeyPress::Named(NamedKey::End), 80, 20));
        assert_eq!(reading.first(lines.len(), 20), LINES_MAX + 1 - 20);
        assert!(reading.press(KeyPress::Named(NamedKey::PageDown), 80, 20));
        assert_eq!(reading.first(lines.len(), 20), LINES_MAX + 1 - 20);
        assert!(!reading.press(KeyPress::Named(NamedKey::Escape), 80, 20));
    }

    #[test]
    fn the_help_has_the_keys_that_count() {
        let text = |is_recording| -> String {
            let lines = Reading::help(PageName::Goals, is_recording).wrapped(200);
            lines.iter().map(|line| line.text() + "\n").collect()
        };
        assert!(text(false).contains("c             cancels the selected goal"));
        assert!(!text(true).contains("cancels the selected goal"));
        assert!(text(true).contains("plays the recording"));
    }
}
