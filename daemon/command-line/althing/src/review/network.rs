//! Checks the table `[zenoh]`: endpoints that cannot be reached, and settings that Zenoh does not
//! have.

use pddl::{Diagnostic, Span};

use super::Reviewer;

impl Reviewer<'_> {
    /// Reports the mistakes in the table `[zenoh]`.
    pub(super) fn network(&mut self) {
        let ecosystem = self.ecosystem;
        let is_secured = ecosystem.security.is_some();
        for problem in substrate_zenoh::problems(&ecosystem.name, &ecosystem.zenoh, is_secured) {
            let path = match problem.at.as_str() {
                "" => "zenoh".to_owned(),
                at => format!("zenoh.{at}"),
            };
            let message = format!("failed to {}", problem.message);
            self.report_value(&path, Diagnostic::error(Span::default(), message));
        }
    }
}
