//! The mistake in the times of a goal.

/// A mistake in the times of a goal. The text is a sentence for a person.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct ScheduleError {
    /// The option with the mistake, without `--`: `at`, `by`, `every`, `on`, `between`, `until`,
    /// `for` or `time-zone`.
    pub option: &'static str,
    /// What is wrong, and what would be right.
    pub message: String,
}

impl ScheduleError {
    pub(crate) fn new(option: &'static str, message: impl Into<String>) -> ScheduleError {
        ScheduleError { option, message: message.into() }
    }
}
