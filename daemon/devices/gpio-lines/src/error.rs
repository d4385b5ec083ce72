//! Reasons why a GPIO line cannot be used, with advice.

use std::io;
use std::path::PathBuf;

/// Reason why a GPIO line cannot be used. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// No chip with the requested name is present.
    #[error("find the GPIO chip `{wanted}`; {}", known_chips_text(known))]
    NoChip {
        /// Requested name of the chip.
        wanted: String,
        /// Names of the chips that are present, with their labels.
        known: Vec<String>,
    },
    /// The chip has no line with the requested number.
    #[error("find line {number} of `{chip}`: it has lines 0 to {}", count.saturating_sub(1))]
    NoNumber {
        /// Name of the chip.
        chip: String,
        /// Requested number of the line.
        number: u32,
        /// Number of lines of the chip.
        count: u32,
    },
    /// No line with the requested name is present.
    #[error("find a line named `{wanted}`; {}", nearest_line_text(near.as_deref(), known))]
    NoName {
        /// Requested name of the line.
        wanted: String,
        /// Name of an existing line that is similar to the requested name; `None` if there is none.
        near: Option<String>,
        /// Names of the chips that are present, with their labels.
        known: Vec<String>,
    },
    /// Several lines have the requested name.
    #[error("choose between the lines named `{name}`: write {}", lines.join(" or "))]
    Ambiguous {
        /// Requested name of the line.
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
    /// The user of this process has no permission to open the chip.
    #[error("open `{}`: permission denied; add this user to the group `gpio`", path.display())]
    NotAllowed {
        /// Path of the chip's file.
        path: PathBuf,
    },
    /// Another error of the kernel, for example because the chip was unplugged.
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
