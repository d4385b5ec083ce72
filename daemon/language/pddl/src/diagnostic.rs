//! Diagnostics: mistakes in a text, as plain data with places in this text.
//!
//! - The parser and `check` create diagnostics, and other crates display them.
//! - Places are byte offsets; [`line_column`] converts one into the line and column that editors
//!   show.
//! - A diagnostic and its notes refer to the same text.

use std::borrow::Cow;
use std::fmt;

use crate::tree::Span;

/// Severity of a mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// The text is valid, but may contain an oversight.
    Hint,
    /// The text is valid, but probably does not have the intended meaning.
    Warning,
    /// The text is invalid and cannot be used.
    Error,
}

/// One mistake in a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Severity of the mistake.
    pub severity: Severity,
    /// Description of the mistake in one lower-case clause: “unknown predicate `conected`”.
    pub message: String,
    /// Place of the mistake.
    pub span: Span,
    /// Label for the place of the mistake; `None` if the message is enough.
    pub label: Option<String>,
    /// Proposal for a correction, such as “did you mean `connected`?”; `None` if there is none.
    pub help: Option<String>,
    /// The violated rule in PDDL notation: a production of the grammar, or a declaration. `None` if
    /// no such rule applies.
    pub rule: Option<Cow<'static, str>>,
    /// Other places of the same text that are related to the mistake.
    pub notes: Vec<Note>,
    /// Whether the text is valid PDDL that Althing does not support.
    pub is_unsupported: bool,
}

/// A place that is related to a mistake, other than the place of the mistake itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// The related place, in the same text as the mistake.
    pub span: Span,
    /// Description of the related place.
    pub message: String,
}

/// Result of parsing: a value, if one could be built, and all mistakes that were found.
#[derive(Clone, Debug)]
pub struct Parsed<T> {
    /// The value of the text, without its invalid parts. `None` if not even the kind of the text
    /// could be determined.
    pub value: Option<T>,
    /// Mistakes that were found, in the order of the text.
    pub diagnostics: Vec<Diagnostic>,
}

/// The mistakes found so far. At most [`DIAGNOSTICS_MAX`] mistakes are stored; further ones are
/// only counted.
#[derive(Debug, Default)]
pub(crate) struct DiagnosticList {
    list: Vec<Diagnostic>,
    omitted: usize,
}

/// Maximum number of stored mistakes; further mistakes are only counted. A screen shows about 50,
/// and a text with a thousand mistakes is not PDDL.
const DIAGNOSTICS_MAX: usize = 1_000;

/// Returns the line and the column of a byte offset, both counted from 1. Columns count characters.
///
/// An offset after the end of the text is treated as the end. An offset inside a character is
/// treated as the first byte of the character.
pub fn line_column(text: &str, offset: usize) -> (usize, usize) {
    let mut offset = offset.min(text.len());
    while !text.is_char_boundary(offset) {
        offset -= 1;
    }
    let before = &text[..offset];
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    let line = before.bytes().filter(|byte| *byte == b'\n').count() + 1;
    (line, before[line_start..].chars().count() + 1)
}

// === impl Severity ===

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Severity::Hint => "hint",
            Severity::Warning => "warning",
            Severity::Error => "error",
        })
    }
}

// === impl Diagnostic ===

impl Diagnostic {
    /// Creates an error at `span`.
    pub fn error(span: Span, message: impl Into<String>) -> Diagnostic {
        Diagnostic::new(Severity::Error, span, message.into())
    }

    /// Creates an error at `span` for valid PDDL with an unsupported feature. `feature` is the
    /// whole message, such as “preferences are not supported”.
    pub fn unsupported(span: Span, feature: impl Into<String>) -> Diagnostic {
        Diagnostic { is_unsupported: true, ..Diagnostic::error(span, feature) }
    }

    /// Creates a warning at `span`.
    pub fn warning(span: Span, message: impl Into<String>) -> Diagnostic {
        Diagnostic::new(Severity::Warning, span, message.into())
    }

    /// Creates a hint at `span`.
    pub fn hint(span: Span, message: impl Into<String>) -> Diagnostic {
        Diagnostic::new(Severity::Hint, span, message.into())
    }

    fn new(severity: Severity, span: Span, message: String) -> Diagnostic {
        Diagnostic {
            severity,
            message,
            span,
            label: None,
            help: None,
            rule: None,
            notes: Vec::new(),
            is_unsupported: false,
        }
    }

    /// Adds a proposal for a correction.
    #[must_use]
    pub fn with_help(mut self, help: impl Into<String>) -> Diagnostic {
        self.help = Some(help.into());
        self
    }

    /// Adds “did you mean `NAME`?” as a proposal for a correction. With `None`, nothing is added.
    #[must_use]
    pub fn with_suggestion(mut self, name: Option<&str>) -> Diagnostic {
        if let Some(name) = name {
            self.help = Some(format!("did you mean `{name}`?"));
        }
        self
    }

    /// Adds a label to print beside the place of the mistake.
    #[must_use]
    pub fn with_label(mut self, label: impl Into<String>) -> Diagnostic {
        self.label = Some(label.into());
        self
    }

    /// Adds the rule that the text violates, in PDDL notation.
    #[must_use]
    pub fn with_rule(mut self, rule: impl Into<Cow<'static, str>>) -> Diagnostic {
        self.rule = Some(rule.into());
        self
    }

    /// Adds a place of the same text that is related to the mistake, with a description of that
    /// place.
    #[must_use]
    pub fn with_note(mut self, span: Span, message: impl Into<String>) -> Diagnostic {
        self.notes.push(Note { span, message: message.into() });
        self
    }

    /// Whether the text cannot be used because of this mistake.
    pub fn is_error(&self) -> bool {
        self.severity == Severity::Error
    }

    /// Returns one line with the place in `text`: `3:14: error: unknown predicate `conected``.
    pub fn located(&self, text: &str) -> String {
        let (line, column) = line_column(text, self.span.start as usize);
        format!("{line}:{column}: {self}")
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.severity, self.message)?;
        if let Some(help) = &self.help {
            write!(f, "; {help}")?;
        }
        if let Some(rule) = &self.rule {
            write!(f, " [{rule}]")?;
        }
        Ok(())
    }
}

impl std::error::Error for Diagnostic {}

// === impl DiagnosticList ===

impl DiagnosticList {
    pub(crate) fn push(&mut self, diagnostic: Diagnostic) {
        if self.list.len() < DIAGNOSTICS_MAX {
            self.list.push(diagnostic);
        } else {
            self.omitted += 1;
        }
    }

    /// Whether the list is full. Further mistakes are only counted, so the caller need not prepare
    /// them in detail.
    pub(crate) fn is_full(&self) -> bool {
        self.list.len() >= DIAGNOSTICS_MAX
    }

    /// Returns all listed mistakes in the order of the text.
    pub(crate) fn into_sorted(mut self) -> Vec<Diagnostic> {
        self.list.sort_by_key(|diagnostic| (diagnostic.span.start, diagnostic.span.end));
        if let (1.., Some(last)) = (self.omitted, self.list.last()) {
            let message = format!("{} more mistakes are not listed", self.omitted);
            self.list.push(Diagnostic::error(last.span, message));
        }
        self.list
    }
}

// === impl Parsed ===

impl<T> Parsed<T> {
    /// Whether there is a value and no error. Warnings and hints do not count as errors.
    pub fn is_ok(&self) -> bool {
        self.value.is_some() && !self.diagnostics.iter().any(Diagnostic::is_error)
    }

    /// Returns the value if the text has no errors. Warnings and hints are dropped.
    ///
    /// # Errors
    ///
    /// Returns all diagnostics if one of them is an error, or if there is no value.
    pub fn into_result(self) -> Result<T, Vec<Diagnostic>> {
        match self.value {
            Some(value) if !self.diagnostics.iter().any(Diagnostic::is_error) => Ok(value),
            _ => Err(self.diagnostics),
        }
    }

    /// Converts the value and keeps the diagnostics.
    pub fn map<U>(self, convert: impl FnOnce(T) -> U) -> Parsed<U> {
        Parsed { value: self.value.map(convert), diagnostics: self.diagnostics }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, offset: usize, expected: (usize, usize)) {
        assert_eq!(line_column(text, offset), expected);
    }

    #[test]
    fn columns_count_characters() {
        check("büro\nflur", 3, (1, 3));
        check("büro\nflur", 2, (1, 2));
    }

    #[test]
    fn a_line_ends_with_a_newline_and_the_end_has_a_position() {
        check("a\r\nb", 3, (2, 1));
        check("a\n", 99, (2, 1));
    }
}
