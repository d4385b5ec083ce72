//! Why a line cannot be used, and what would be right.

use std::io;
use std::path::PathBuf;

/// Why a line cannot be used. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// There is no such chip (now).
    #[error("find the GPIO chip `{wanted}`; {}", there_are(known))]
    NoChip {
        /// The chip that was asked for.
        wanted: String,
        /// The chips that are there, with their labels.
        known: Vec<String>,
    },
    /// The chip has no such line.
    #[error("find line {number} of `{chip}`: it has lines 0 to {}", count.saturating_sub(1))]
    NoNumber {
        /// The chip.
        chip: String,
        /// The line that was asked for.
        number: u32,
        /// How many lines it has.
        count: u32,
    },
    /// No line has this name (now).
    #[error("find a line named `{wanted}`; {}", there_is(near.as_deref(), known))]
    NoName {
        /// The name that was asked for.
        wanted: String,
        /// A name that is much like it.
        near: Option<String>,
        /// The chips that are there, with their labels.
        known: Vec<String>,
    },
    /// Several lines have this name.
    #[error("choose between the lines named `{name}`: write {}", lines.join(" or "))]
    Ambiguous {
        /// The name.
        name: String,
        /// The lines that have it.
        lines: Vec<String>,
    },
    /// Somebody uses it.
    #[error("use the line `{line}`: {consumer} uses it already")]
    Used {
        /// The line.
        line: String,
        /// Who it is, in words.
        consumer: String,
    },
    /// We may not open its chip.
    #[error("open `{}`: permission denied; let this user into the group `gpio`", path.display())]
    NotAllowed {
        /// The chip.
        path: PathBuf,
    },
    /// The kernel says something else, such as that its chip is gone.
    #[error("{what} the line `{line}`: {source}")]
    Kernel {
        /// What could not be done.
        what: &'static str,
        /// The line.
        line: String,
        /// What the kernel says.
        source: io::Error,
    },
}

fn there_are(known: &[String]) -> String {
    match known {
        [] => "this machine has none that this user may open".to_owned(),
        known => format!("there are {}", known.join(", ")),
    }
}

fn there_is(near: Option<&str>, known: &[String]) -> String {
    match (near, known) {
        (Some(near), _) => format!("did you mean `{near}`?"),
        (None, known) => format!("looked on all chips: {}", there_are(known)),
    }
}
