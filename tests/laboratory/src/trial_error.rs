//! The reason why a trial cannot be played.

/// The reason why a trial cannot be played. The message completes the sentence “failed to …”.
#[derive(Debug)]
pub struct TrialError(String);

impl TrialError {
    /// Returns the error for an ontology or a map that cannot be parsed.
    pub(crate) fn parse_error(mistakes: Vec<pddl::Diagnostic>) -> TrialError {
        let mistakes: Vec<_> = mistakes.iter().map(ToString::to_string).collect();
        TrialError(format!("read the domain or map of the trial: {}", mistakes.join("; ")))
    }
}

impl From<std::io::Error> for TrialError {
    fn from(error: std::io::Error) -> TrialError {
        TrialError(format!("set the trial up: {error}"))
    }
}

impl From<building::LayoutError> for TrialError {
    fn from(error: building::LayoutError) -> TrialError {
        TrialError(format!("draw the building: {error}"))
    }
}

impl std::fmt::Display for TrialError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for TrialError {}
