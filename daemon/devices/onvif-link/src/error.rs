//! Errors of a camera.

use std::time::Duration;

/// Reason why a camera did not do what was asked of it. The text of each variant completes “failed
/// to …”, and never contains a password.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// No connection could be made, or it was lost.
    #[error("reach the camera at {address}: {problem}")]
    Unreachable {
        /// Address of the camera.
        address: String,
        /// Reason that the network reports.
        problem: String,
    },
    /// The camera did not answer in time.
    #[error("get an answer to {call} from the camera at {address} within {limit:?}")]
    TimedOut {
        /// Address of the camera.
        address: String,
        /// Operation that was not answered.
        call: String,
        /// Time limit of the operation.
        limit: Duration,
    },
    /// The camera rejects the login.
    #[error("log in at the camera at {address}: {problem}")]
    LoginRejected {
        /// Address of the camera.
        address: String,
        /// Advice for a correction.
        problem: String,
    },
    /// The camera refuses an operation.
    #[error("have the camera carry out {call}: it answers “{reason}”")]
    Fault {
        /// Operation that was refused.
        call: String,
        /// Reason that the camera gives.
        reason: String,
    },
    /// The answer of the camera cannot be understood.
    #[error("understand the camera's answer to {call}: {problem}")]
    Unreadable {
        /// Operation that was answered.
        call: String,
        /// Description of the mistake in the answer.
        problem: String,
    },
    /// The camera does not have a function that is needed.
    #[error("{0}")]
    Unsupported(String),
    /// A file of the login or of the certificates cannot be used.
    #[error("{0}")]
    File(String),
}

/// Maximum length of a text from the camera in an error, in characters; the rest is cut off.
const EXCERPT_MAX: usize = 200;

/// Returns a text from a camera for an error: one line, without control characters, not long.
pub(crate) fn excerpt(text: &str) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut plain: String =
        words.chars().filter(|symbol| !symbol.is_control()).take(EXCERPT_MAX).collect();
    if words.chars().count() > EXCERPT_MAX {
        plain.push('…');
    }
    plain
}
