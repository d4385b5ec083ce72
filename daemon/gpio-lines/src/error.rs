//! Reasons why a line cannot be used, with advice.

use std::io;
use std::path::PathBuf;

/// Reason why a line cannot be used. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// There is no such chip (now).
    #[error("find the GPIO chip `{wanted}`; {}", known_chips_text(known))]
    NoChip {
        /// The chip that was asked for.
        wanted: String,
        /// Chips that are present, with their labels.
        known: Vec<String>,
    },
    /// The chip has no line of this number.
    #[error("find line {number} of `{chip}`: it has lines 0 to {}", count.saturating_sub(1))]
    NoNumber {
        /// The chip.
        chip: String,
        /// The line that was asked for.
        number: u32,
        /// Number of lines that the chip has.
        count: u32,
    },
    /// No line has this name (now).
    #[error("find a line named `{wanted}`; {}", nearest_line_text(near.as_deref(), known))]
    NoName {
        /// The name that was asked for.
        wanted: String,
        /// A similar name, if there is one.
        near: Option<String>,
        /// Chips that are present, with their labels.
        known: Vec<String>,
    },
    /// Several lines have this name.
    #[error("choose between the lines named `{name}`: write {}", lines.join(" or "))]
    Ambiguous {
        /// The name.
        name: String,
        /// The lines with this name.
        lines: Vec<String>,
    },
    /// The line is in use.
    #[error("use the line `{line}`: {consumer} uses it already")]
    Used {
        /// The line.
        line: String,
        /// Description of its user.
        consumer: String,
    },
    /// The user of this process may not open the chip.
    #[error("open `{}`: permission denied; add this user to the group `gpio`", path.display())]
    NotAllowed {
        /// Path of the chip.
        path: PathBuf,
    },
    /// Another error of the kernel, for example because the chip is gone.
    #[error("{what} the line `{line}`: {source}")]
    Kernel {
        /// The operation that failed.
        what: &'static str,
        /// The line.
        line: String,
        /// The error.
        source: io::Error,
    },
}

fn known_chips_text(known: &[String]) -> String {
    match known {
        [] => "this machine has none that this user may open".to_owned(),
        known => format!("there are {}", known.join(", ")),
    }
}

fn nearest_line_text(near: Option<&str>, known: &[String]) -> String {
    match (near, known) {
        (Some(near), _) => format!("did you mean `{near}`?"),
        (None, known) => format!("looked on all chips: {}", known_chips_text(known)),
    }
}
