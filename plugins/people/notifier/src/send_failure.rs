//! Why a delivery did not arrive.

use std::time::Duration;

/// Why a delivery did not arrive. The texts complete “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum SendFailure {
    /// It may arrive later: the receiver is away or busy. It may ask for a pause.
    Later {
        /// The reason.
        why: String,
        /// Pause that the receiver asks for.
        pause: Option<Duration>,
    },
    /// It will never be taken.
    Never(String),
}

// === impl SendFailure ===

impl SendFailure {
    /// Creates a failure that may pass.
    pub(crate) fn later(why: impl Into<String>) -> SendFailure {
        SendFailure::Later { why: why.into(), pause: None }
    }
}
