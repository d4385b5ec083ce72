//! The two streams: results on stdout, everything about them on stderr.
//!
//! A reader that goes away (`althing plan … | head -1`) is no error. Colors only where a person
//! looks: on a terminal, and never with `NO_COLOR`.

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::process::ExitCode;

use crate::exit;
use crate::render::{self, Look};
use crate::report::Report;

/// Writes a result to stdout; `code` if that worked.
pub(crate) fn print(text: impl Display, code: u8) -> ExitCode {
    let mut stdout = io::stdout().lock();
    match write!(stdout, "{text}").and_then(|()| stdout.flush()) {
        Ok(()) => exit::with(code),
        Err(err) if err.kind() == ErrorKind::BrokenPipe => exit::with(code),
        Err(err) => {
            note(&format!("failed to write the result: {err}"));
            exit::with(exit::OUTPUT)
        }
    }
}

/// Writes one JSON value and a newline to stdout.
pub(crate) fn print_json(value: &serde_json::Value, code: u8) -> ExitCode {
    print(format_args!("{value}\n"), code)
}

/// Writes a line for people to stderr. There is nowhere to say that this failed.
pub(crate) fn note(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// Shows mistakes: to people on stderr, or on stdout as one JSON object.
pub(crate) fn show(report: &Report, json: bool, status: &str, code: u8) -> ExitCode {
    if json {
        let diagnostics = render::json(report);
        let value = serde_json::json!({ "status": status, "diagnostics": diagnostics });
        return print_json(&value, code);
    }
    show_people(report);
    exit::with(code)
}

/// Shows mistakes and how many they are on stderr.
pub(crate) fn show_people(report: &Report) {
    if report.is_empty() {
        return;
    }
    let text = render::human(report, Look::of_stderr());
    let _ = write!(io::stderr().lock(), "{text}");
    note(&render::summary(report));
}

/// Whether stderr may have colors.
pub(crate) fn stderr_is_colored() -> bool {
    let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    io::stderr().is_terminal() && !refused && !dumb
}
