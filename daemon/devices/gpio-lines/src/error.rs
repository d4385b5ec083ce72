//! Reasons why a GPIO line cannot be used, with advice.

use std::io;
use std::path::PathBuf;

/// Reason why a GPIO line cannot be used. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// No chip with the name that was asked for is present now.
    #[error("find the GPIO chip `{wanted}`; {}", known_chips_text(known))]
    NoChip {
        /// Name of the chip that was asked for.
        wanted: String,
        /// Names of the chips that are present, with their labels.
        known: Vec<String>,
    },
    /// The chip has no line with the number that was asked for.
    #[error("find line {number} of `{chip}`: it has lines 0 to {}", count.saturating_sub(1))]
    NoNumber {
        /// Name of the chip.
        chip: String,
        /// Number of the line that was asked for.
        number: u32,
        /// Number of lines that the chip has.
        count: u32,
    },
    /// No line with the name that was asked for is present now.
    #[error("find a line named `{wanted}`; {}", nearest_line_text(near.as_deref(), known))]
    NoName {
        /// Name of the line that was asked for.
        wanted: String,
        /// Name of a line that is similar to the name that was asked for, if there is one.
        near: Option<String>,
        /// Names of the chips that are present, with their labels.
        known: Vec<String>,
    },
    /// Several lines have the name that was asked for.
    #[error("choose between the lines named `{name}`: write {}", lines.join(" or "))]
    Ambiguous {
        /// Name of the line that was asked for.
        name: String,
        /// Positions of the lines with this name, each as chip and number.
        lines: Vec<String>,
    },
    /// The line is already in use.
    #[error("use the line `{line}`: {consumer} uses it already")]
    Used {
        /// Name of the line.
        line: String,
        /// Description of the line's user.
        consumer: String,
    },
    /// The user of this process may not open the chip.
    #[error("open `{}`: permission denied; add this user to the group `gpio`", path.display())]
    NotAllowed {
        /// Path of the chip's file.
        path: PathBuf,
    },
    /// Another error of the kernel, for example because the chip is gone.
    #[error("{what} the line `{line}`: {source}")]
    Kernel {
        /// The operation on the line that failed.
        what: &'static str,
        /// Name of the line.
        line: String,
        /// Error of the kernel.
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
