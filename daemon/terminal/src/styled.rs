//! Text for people with colors in it: what was painted here and nothing else is an escape.

use std::fmt;

use crate::output::{self, Color};
use crate::visible;

/// A text that may go to a terminal as it is: of our own escapes, and of other texts with everything
/// shown that a terminal would obey.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Styled(String);

impl Styled {
    /// A part of a line.
    pub fn line(text: &str) -> Styled {
        Styled(visible::line(text).into_owned())
    }

    /// A part of a line in its color, where stdout has any.
    pub fn painted(color: Color, text: &str) -> Styled {
        Styled(output::paint(color, &visible::line(text)))
    }

    /// The same with more of the line.
    #[must_use]
    pub fn and(mut self, text: &str) -> Styled {
        self.0.push_str(&visible::line(text));
        self
    }

    /// The same with more that is safe already.
    #[must_use]
    pub fn and_styled(mut self, other: &Styled) -> Styled {
        self.0.push_str(&other.0);
        self
    }

    /// The same, ended.
    #[must_use]
    pub fn end(mut self) -> Styled {
        self.0.push('\n');
        self
    }

    /// The same, broken between words where stdout is a terminal; what follows is indented.
    #[must_use]
    pub fn folded(self, indent: usize) -> Styled {
        Styled(output::folded(&self.0, indent))
    }

    /// Its characters, escapes included.
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
    fn only_our_own_escapes_are_any() {
        let line = Styled::line("a\u{1b}[31m").and("b\n").end();
        assert_eq!(line.as_str(), "a␛[31mb␊\n");
    }
}
