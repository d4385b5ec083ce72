//! Text with colors for people. All escape sequences in the text come from this module.

use std::fmt;

use crate::formatting::{self, Color};
use crate::visible;

/// A text that can be sent to a terminal safely. It consists of escape sequences of this program,
/// and of other texts in which control characters were replaced by visible ones.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Styled(String);

impl Styled {
    /// Creates a styled text from `text`, which then stands in one line: each control character,
    /// also a line break, is replaced by a visible one, such as `␊`.
    pub fn line(text: &str) -> Styled {
        Styled(visible::line(text).into_owned())
    }

    /// Creates a styled text from `text`, as [`Styled::line`] does, and colors it if stdout is
    /// colored.
    pub fn painted(color: Color, text: &str) -> Styled {
        Styled(formatting::paint(color, &visible::line(text)))
    }

    /// Appends `text`. As in [`Styled::line`], control characters in it are replaced by visible
    /// ones.
    #[must_use]
    pub fn and(mut self, text: &str) -> Styled {
        self.0.push_str(&visible::line(text));
        self
    }

    /// Appends another styled text.
    #[must_use]
    pub fn and_styled(mut self, other: &Styled) -> Styled {
        self.0.push_str(&other.0);
        self
    }

    /// Appends a line break to the text.
    #[must_use]
    pub fn end(mut self) -> Styled {
        self.0.push('\n');
        self
    }

    /// Breaks the text between words if stdout is a terminal; all lines but the first are indented
    /// by `indent` columns.
    #[must_use]
    pub fn folded(self, indent: usize) -> Styled {
        Styled(formatting::folded(&self.0, indent))
    }

    /// Returns the characters of the text, escape sequences included.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Styled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromIterator<Styled> for Styled {
    fn from_iter<I: IntoIterator<Item = Styled>>(parts: I) -> Styled {
        Styled(parts.into_iter().map(|part| part.0).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_from_outside_are_made_visible() {
        let line = Styled::line("a\u{1b}[31m").and("b\n").end();
        assert_eq!(line.as_str(), "a␛[31mb␊\n");
    }
}
