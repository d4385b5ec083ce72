//! The two output streams: results go to stdout, notes about the results go to stderr.
//!
//! A reader of stdout that goes away (`althing plan … | head -1`) is not an error; a program that
//! prints continuously checks [`is_reader_gone`]. Colors are used only on a terminal, and never
//! with `NO_COLOR`. If a prompt is active on the terminal, everything is printed above it
//! ([`set_prompt`]), so that the line being edited stays intact.
//!
//! Everything that is printed goes through this module, which makes control characters [`visible`]:
//! much of the text comes from outside, and a terminal would execute them.

use std::borrow::Cow;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::render::{self, RenderStyle};
use crate::report::DiagnosticReport;
use crate::styled::Styled;
use crate::{exit, visible};

pub use crate::formatting::{
    Color, folded, is_stderr_terminal, paint, stderr_is_colored, stdout_is_colored,
    stdout_is_terminal,
};

/// Whether a write to stdout has failed because no process reads stdout any more.
static READER_GONE: AtomicBool = AtomicBool::new(false);

/// Channel that prints lines above the interactive prompt; `None` when no prompt is active.
static PROMPT_PRINTER: Mutex<Option<Sender<String>>> = Mutex::new(None);

/// Sets the channel to the active prompt. Everything is printed above that prompt from now on. With
/// `None`, everything is printed to the two streams again.
pub fn set_prompt(prompt: Option<Sender<String>>) {
    *lock() = prompt;
}

/// Prints text above the prompt. If no prompt is active, returns the text as an error.
fn print_above(text: String) -> Result<(), String> {
    match &*lock() {
        Some(prompt) => prompt.send(text).map_err(|unsent| unsent.0),
        None => Err(text),
    }
}

fn lock() -> MutexGuard<'static, Option<Sender<String>>> {
    PROMPT_PRINTER.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Stream for the log: stderr, or the lines above the prompt if one is active. Control characters
/// are not replaced here, because the formatter of log lines has made them visible already.
pub struct NoteStream;

impl Write for NoteStream {
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

/// Writes a result to stdout. Returns `code`, or [`exit::OUTPUT`] if writing failed.
pub fn print(text: impl Display, code: u8) -> ExitCode {
    write(visible::text(&text.to_string()), code)
}

/// Writes a result that contains colors to stdout. Returns `code`, or [`exit::OUTPUT`] if writing
/// failed.
pub fn print_styled(text: &Styled, code: u8) -> ExitCode {
    write(text.as_str().into(), code)
}

/// Writes text to stdout without changing it, such as a script for a shell. The text must not
/// contain parts from outside the program. Returns `code`, or [`exit::OUTPUT`] if writing failed.
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
            print_note(&format!("failed to write the result: {err}"));
            exit::with(exit::OUTPUT)
        }
    }
}

/// Whether no process reads stdout any more.
pub fn is_reader_gone() -> bool {
    READER_GONE.load(Ordering::Relaxed)
}

/// Writes one JSON value and a newline to stdout. Returns `code`, or [`exit::OUTPUT`] if writing
/// failed.
pub fn print_json(value: &serde_json::Value, code: u8) -> ExitCode {
    let mut text = visible::json(&value.to_string()).into_owned();
    text.push('\n');
    write(text.into(), code)
}

/// Writes a line for people to stderr. A failure is ignored, because it could not be reported.
pub fn print_note(line: &str) {
    if let Err(line) = print_above(format!("{}\n", visible::text(line))) {
        let _ = io::stderr().lock().write_all(line.as_bytes());
    }
}

/// Shows the diagnostics of a report: to people on stderr, or, if `json`, to programs as one JSON
/// object on stdout.
pub fn show(report: &DiagnosticReport, json: bool, status: &str, code: u8) -> ExitCode {
    if json {
        let diagnostics = render::json(report);
        let value = serde_json::json!({ "status": status, "diagnostics": diagnostics });
        return print_json(&value, code);
    }
    show_to_person(report);
    exit::with(code)
}

/// Shows the diagnostics of a report, and how many there are, on stderr.
pub fn show_to_person(report: &DiagnosticReport) {
    if report.is_empty() {
        return;
    }
    let text = render::human(report, RenderStyle::of_stderr());
    if let Err(text) = print_above(text) {
        let _ = io::stderr().lock().write_all(text.as_bytes());
    }
    print_note(&render::summary(report));
}
