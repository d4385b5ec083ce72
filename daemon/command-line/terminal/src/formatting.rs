//! Formatting for the two output streams: colors, and the width of lines. Nothing is written here.

use std::io::{self, IsTerminal};

/// Color of a word. The color expresses the meaning of the word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Color {
    /// No color: the word has no special meaning.
    Plain,
    /// Dim: the word is unimportant.
    Dim,
    /// Green: the word reports success.
    Green,
    /// Yellow: the user should do something.
    Yellow,
    /// Red: the word reports a failure.
    Red,
}

/// Returns a word with color if stdout is colored, otherwise without. The word must come from this
/// program: a word from outside needs [`Styled`](crate::styled::Styled).
pub fn paint(color: Color, word: &str) -> String {
    let code = match color {
        Color::Plain => return word.to_owned(),
        Color::Dim => "2",
        Color::Green => "32",
        Color::Yellow => "1;33",
        Color::Red => "31",
    };
    if stdout_is_colored() { format!("\x1b[{code}m{word}\x1b[0m") } else { word.to_owned() }
}

/// Returns a line broken between words where it is too long, if stdout is a terminal. All lines but
/// the first are indented by `indent` columns.
pub fn folded(line: &str, indent: usize) -> String {
    let Some((columns, _)) = terminal_size::terminal_size_of(io::stdout()) else {
        return line.to_owned();
    };
    fold(line, usize::from(columns.0), indent)
}

fn fold(line: &str, columns: usize, indent: usize) -> String {
    let indent = " ".repeat(indent);
    // A name is never broken, not even at its hyphens.
    let options = textwrap::Options::new(columns.max(40))
        .subsequent_indent(&indent)
        .word_splitter(textwrap::WordSplitter::NoHyphenation)
        .break_words(false);
    textwrap::fill(line, options)
}

/// Whether stderr is a terminal, so that progress of a long job should be shown.
pub fn is_stderr_terminal() -> bool {
    io::stderr().is_terminal()
}

/// Whether stderr may have colors.
pub fn stderr_is_colored() -> bool {
    is_stderr_terminal() && are_colors_allowed()
}

/// Whether stdout is a terminal.
pub fn stdout_is_terminal() -> bool {
    io::stdout().is_terminal()
}

/// Whether stdout may have colors.
pub fn stdout_is_colored() -> bool {
    stdout_is_terminal() && are_colors_allowed()
}

fn are_colors_allowed() -> bool {
    let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    !refused && !dumb
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_between_words() {
        let line = "progress chosen: `turtlebot-1` for `(known-temperature office1)` at cost 6";
        let folded = fold(line, 48, 9);
        assert_eq!(
            folded,
            "progress chosen: `turtlebot-1` for\n         `(known-temperature office1)` at cost 6"
        );
        assert_eq!(fold("done     the goal holds", 48, 9), "done     the goal holds");
    }
}
