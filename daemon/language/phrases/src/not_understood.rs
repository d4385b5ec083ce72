//! The answer to a text that is not understood.

use std::fmt;

use pddl::{Diagnostic, Span};

/// The place at which a text is not understood, and the nearest texts that are.
#[derive(Clone, Debug, PartialEq)]
pub struct NotUnderstood {
    /// The place of the first word that is not understood.
    pub at: Span,
    /// The reason, as a sentence without a period.
    pub why: String,
    /// The nearest texts that are understood, the best one first.
    pub nearest: Vec<String>,
    /// Whether the text is near enough to words that words were probably meant. Then the nearest texts
    /// are what was probably meant.
    pub is_near: bool,
    /// How many of the words that were written are words of the language.
    pub(crate) likeness: f64,
}

// === impl NotUnderstood ===

impl NotUnderstood {
    pub(crate) fn new(at: Span, why: impl Into<String>) -> NotUnderstood {
        let (nearest, likeness) = (Vec::new(), 0.0);
        NotUnderstood { at, why: why.into(), nearest, is_near: false, likeness }
    }

    /// Returns the answer if there are no words at all.
    pub fn nothing() -> NotUnderstood {
        NotUnderstood::new(Span::new(0, 0), "the text says nothing")
    }

    /// Returns the answer of the language that has most of the words that were written: `self`, the
    /// chosen language, unless the other one has more.
    #[must_use]
    pub fn nearer(self, other: NotUnderstood) -> NotUnderstood {
        if other.likeness > self.likeness { other } else { self }
    }

    /// Returns the answer as a diagnostic with its place.
    pub fn diagnostic(&self) -> Diagnostic {
        Diagnostic::error(self.at, self.to_string())
    }
}

impl fmt::Display for NotUnderstood {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.why)?;
        let nearest: Vec<_> = self.nearest.iter().map(|text| format!("`{text}`")).collect();
        match nearest.is_empty() {
            true => Ok(()),
            false if self.is_near => write!(f, "; did you mean {}?", nearest.join(" or ")),
            false => write!(f, "; the nearest that can be said is {}", nearest.join(" or ")),
        }
    }
}

impl std::error::Error for NotUnderstood {}
