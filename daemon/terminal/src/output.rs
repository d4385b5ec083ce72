//! The two streams: results on stdout, everything about them on stderr.
//!
//! A reader that goes away (`althing plan … | head -1`) is no error, and whoever prints on and on asks
//! [`is_reader_gone`]. Colors only where a person looks: on a terminal, and never with `NO_COLOR`.
//! While a prompt is on the terminal, everything goes [`above`] it, so that nothing garbles the line
//! that is being edited.
//!
//! Everything that is printed goes through here, and here it is made [`visible`]: much of it was said by
//! others, and a terminal obeys what it is sent.

use std::borrow::Cow;
use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::render::{self, Look};
use crate::report::Report;
use crate::styled::Styled;
use crate::{exit, visible};

/// Whether a write to stdout has found nobody there.
static READER_GONE: AtomicBool = AtomicBool::new(false);

/// The way to above the prompt, while there is one.
static ABOVE: Mutex<Option<Sender<String>>> = Mutex::new(None);

/// What a word stands for, for a person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Color {
    /// As it comes.
    Plain,
    /// Of no weight.
    Dim,
    /// Good.
    Green,
    /// It wants something of the user.
    Yellow,
    /// Bad.
    Red,
}

/// Sends everything above a prompt from now on, or, with `None`, to the two streams again.
pub fn above(prompt: Option<Sender<String>>) {
    *lock() = prompt;
}

/// Prints above the prompt; gives the text back where there is none.
fn print_above(text: String) -> Result<(), String> {
    match &*lock() {
        Some(prompt) => prompt.send(text).map_err(|unsent| unsent.0),
        None => Err(text),
    }
}

fn lock() -> MutexGuard<'static, Option<Sender<String>>> {
    ABOVE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A word in its color, where stdout has any. For a word of our own; [`Styled`] paints those of others.
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

/// Standard error, or above the prompt: for the log. What it writes is safe already: who formats a line
/// of the log makes visible what others said.
pub struct Notes;

impl Write for Notes {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match print_above(String::from_utf8_lossy(bytes).into_owned()) {
            Ok(()) => Ok(bytes.len()),
            Err(_) => io::stderr().lock().write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().lock().flush()
    }
}

/// Writes a result to stdout; `code` if that worked.
pub fn print(text: impl Display, code: u8) -> ExitCode {
    write(visible::text(&text.to_string()), code)
}

/// Writes a result with colors in it to stdout; `code` if that worked.
pub fn print_styled(text: &Styled, code: u8) -> ExitCode {
    write(text.as_str().into(), code)
}

/// Writes text that is no news of anybody's, byte by byte: a script for a shell.
pub fn print_raw(text: &str, code: u8) -> ExitCode {
    write(text.into(), code)
}

fn write(text: Cow<'_, str>, code: u8) -> ExitCode {
    let text = match print_above(text.into_owned()) {
        Ok(()) => return exit::with(code),
        Err(text) => text,
    };
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Ok(()) => exit::with(code),
        Err(err) if err.kind() == ErrorKind::BrokenPipe => {
            READER_GONE.store(true, Ordering::Relaxed);
            exit::with(code)
        }
        Err(err) => {
            note(&format!("failed to write the result: {err}"));
            exit::with(exit::OUTPUT)
        }
    }
}

/// Whether nobody reads stdout any more.
pub fn is_reader_gone() -> bool {
    READER_GONE.load(Ordering::Relaxed)
}

/// Breaks a long line between words where stdout is a terminal; what follows is indented.
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

/// Writes one JSON value and a newline to stdout.
pub fn print_json(value: &serde_json::Value, code: u8) -> ExitCode {
    let mut text = visible::json(&value.to_string()).into_owned();
    text.push('\n');
    write(text.into(), code)
}

/// Writes a line for people to stderr. There is nowhere to say that this failed.
pub fn note(line: &str) {
    if let Err(line) = print_above(format!("{}\n", visible::text(line))) {
        let _ = io::stderr().lock().write_all(line.as_bytes());
    }
}

/// Shows mistakes: to people on stderr, or on stdout as one JSON object.
pub fn show(report: &Report, json: bool, status: &str, code: u8) -> ExitCode {
    if json {
        let diagnostics = render::json(report);
        let value = serde_json::json!({ "status": status, "diagnostics": diagnostics });
        return print_json(&value, code);
    }
    show_people(report);
    exit::with(code)
}

/// Shows mistakes and how many they are on stderr.
pub fn show_people(report: &Report) {
    if report.is_empty() {
        return;
    }
    let text = render::human(report, Look::of_stderr());
    if let Err(text) = print_above(text) {
        let _ = io::stderr().lock().write_all(text.as_bytes());
    }
    note(&render::summary(report));
}

/// Whether notes go to a terminal, so that the progress of a long job is worth a note.
pub fn notes_reach_a_terminal() -> bool {
    io::stderr().is_terminal()
}

/// Whether stderr may have colors.
pub fn stderr_is_colored() -> bool {
    notes_reach_a_terminal() && colors_are_welcome()
}

/// Whether stdout may have colors.
pub fn stdout_is_colored() -> bool {
    io::stdout().is_terminal() && colors_are_welcome()
}

fn colors_are_welcome() -> bool {
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
