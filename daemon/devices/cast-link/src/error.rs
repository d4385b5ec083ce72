//! Errors of a Chromecast.

use std::time::Duration;

/// Reason why a Chromecast did not do what was asked of it. The message completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CastError {
    /// No connection could be made, or it failed.
    #[error("reach the Chromecast at {address}: {problem}")]
    Unreachable {
        /// Address of the Chromecast.
        address: String,
        /// Reason that the network reports.
        problem: String,
    },
    /// The Chromecast has closed the connection.
    #[error("go on: the Chromecast at {address} has closed the connection")]
    Closed {
        /// Address of the Chromecast.
        address: String,
    },
    /// The Chromecast is silent, although it has to answer every few seconds.
    #[error("reach the Chromecast at {address}: it has been silent for {silence:?}")]
    Silent {
        /// Address of the Chromecast.
        address: String,
        /// Time for which nothing has arrived.
        silence: Duration,
    },
    /// The Chromecast has declined a command, for instance because it cannot play a medium. The
    /// connection works.
    #[error("{what}: {why}")]
    Declined {
        /// Description of the command.
        what: String,
        /// Reason that the Chromecast gives.
        why: String,
    },
    /// The Chromecast did not answer a command in time.
    #[error("{what}: there was no answer within {within:?}")]
    TimedOut {
        /// Description of the command.
        what: String,
        /// Time within which the answer had to arrive.
        within: Duration,
    },
    /// The Chromecast has sent something that is no message of the protocol.
    #[error("read a message of the Chromecast at {address}: {problem}")]
    Malformed {
        /// Address of the Chromecast.
        address: String,
        /// Description of the mistake.
        problem: String,
    },
}

impl CastError {
    /// Whether the connection still works, and only the command has failed.
    pub fn is_of_command(&self) -> bool {
        matches!(self, CastError::Declined { .. })
    }

    pub(crate) fn declined(what: impl Into<String>, why: impl AsRef<str>) -> CastError {
        CastError::Declined { what: what.into(), why: excerpt(why.as_ref()) }
    }
}

/// Maximum length of a text from a Chromecast, in characters; the rest is cut off.
const EXCERPT_CHARS_MAX: usize = 200;

/// Returns a text from a Chromecast as one line of bounded length, without control characters.
pub(crate) fn excerpt(text: &str) -> String {
    let mut line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if let Some((end, _)) = line.char_indices().nth(EXCERPT_CHARS_MAX) {
        line.truncate(end);
        line.push('…');
    }
    line
}
