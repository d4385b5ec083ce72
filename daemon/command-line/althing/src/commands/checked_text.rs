//! Checks the text of an ecosystem file before it is written, as `althing check` does.

use std::path::Path;

use terminal::report::DiagnosticReport;

use crate::config::{Ecosystem, Overrides, ParsedEcosystem};
use crate::review::{self, ReviewScope};
use crate::{interfacing, plugins};

/// A text that was read as an ecosystem file.
pub(super) struct CheckedText {
    /// The ecosystem, as far as the text can be understood.
    pub(super) ecosystem: Option<Ecosystem>,
    /// The mistakes and warnings.
    pub(super) report: DiagnosticReport,
}

/// Checks `text` as the text of the file `file`. The files that it names are relative to the folder of `file`.
pub(super) fn check(file: &Path, text: &str) -> CheckedText {
    let known = plugins::known();
    let reading = Ecosystem::read_text(file, text, &Overrides::default(), &known);
    let mut report = review::review(&reading, ReviewScope::Building);
    let ParsedEcosystem { ecosystem, .. } = reading;
    if let Some(ecosystem) = ecosystem.as_ref().filter(|_| !report.has_errors()) {
        report.extend(interfacing::check(ecosystem, &known));
    }
    CheckedText { ecosystem, report }
}

// === impl CheckedText ===

impl CheckedText {
    /// Returns the findings that `before` does not have.
    pub(super) fn new_findings(&self, before: &CheckedText) -> DiagnosticReport {
        let known: Vec<&str> =
            before.report.findings().iter().map(|it| it.diagnostic.message.as_str()).collect();
        let mut report = DiagnosticReport::default();
        for finding in self.report.findings() {
            if known.contains(&finding.diagnostic.message.as_str()) {
                continue;
            }
            match &finding.source {
                Some(source) => report.add(source, [finding.diagnostic.clone()]),
                None => report.add_general(finding.diagnostic.clone()),
            }
        }
        report
    }
}
