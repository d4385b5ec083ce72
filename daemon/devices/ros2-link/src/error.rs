//! Errors of a robot: it could not be reached, or did not do what was asked of it.

use std::time::Duration;

use ros_messages::{CdrDecodeError, CdrEncodeError, UnknownTypeError};

/// A failed operation on a robot. The text of each variant completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RosError {
    /// There is no link to the robot.
    #[error("reach the robot at `{endpoint}`: {reason}")]
    NotLinked {
        /// Endpoint of the robot's bridge or router.
        endpoint: String,
        /// Reason why the last attempt to connect failed.
        reason: String,
    },
    /// The address of the robot is malformed.
    #[error("{0}")]
    Address(String),
    /// No node of the robot answered a call of a service.
    #[error("call `{service}`: no node of the robot answered within {within:?}; is it running?")]
    NoAnswer {
        /// Name of the service.
        service: String,
        /// Time for which an answer was awaited.
        within: Duration,
    },
    /// The service answered with an error of Zenoh's, or of the bridge.
    #[error("call `{service}`: {reason}")]
    Refused {
        /// Name of the service.
        service: String,
        /// Text of the error.
        reason: String,
    },
    /// A message of the robot cannot be read.
    #[error("read what `{name}` says: {source}")]
    Decode {
        /// Name of the topic or service.
        name: String,
        /// Error of the decoder.
        #[source]
        source: CdrDecodeError,
    },
    /// A message to the robot cannot be written.
    #[error("write a message for `{name}`: {source}")]
    Encode {
        /// Name of the topic or service.
        name: String,
        /// Error of the encoder.
        #[source]
        source: CdrEncodeError,
    },
    /// A type is not known.
    #[error(transparent)]
    UnknownType(#[from] UnknownTypeError),
    /// An operation of Zenoh failed, for this reason, which is Zenoh's text.
    #[error("use the link to the robot: {0}")]
    Zenoh(String),
    /// An action server rejected a goal.
    #[error("begin: `{action}` rejected the goal")]
    Rejected {
        /// Name of the action.
        action: String,
    },
    /// Nav2 gave a goal up: it found no way, or did not get through.
    #[error("drive there: {reason}")]
    NoWay {
        /// Reason of Nav2.
        reason: String,
    },
    /// The robot did not do what was asked, for this reason.
    #[error("{0}")]
    Robot(String),
}

impl RosError {
    pub(crate) fn zenoh(error: impl std::fmt::Display) -> RosError {
        RosError::Zenoh(error.to_string())
    }
}

/// Returns a text of the robot's without control characters, and not too long for one line.
pub fn printable(text: &str) -> String {
    const LENGTH_MAX: usize = 200;
    text.chars()
        .map(|letter| if letter.is_control() { ' ' } else { letter })
        .take(LENGTH_MAX)
        .collect()
}
