//! Checks of an ecosystem beyond the form of its file: for `althing check`, and for `althing up`
//! before it starts.
//!
//! - [`entries`]: the entries of agents, as their plugins read them.
//! - [`map`]: connections, lengths, and places that no robot can reach.
//! - [`goals`]: the words of goals, checked against the ontology, the map and the agents' action
//!   models.
//! - [`roles`]: whether there are agents that take goals, plan, and carry plans out.
//! - [`rooms`]: agents in a place where they can do nothing.
//! - [`network`]: the table for Zenoh.
//! - [`daemons`]: names of daemons that are probably misspelled.
//!
//! Each check reports mistakes at their place in the text, with a correction.

mod daemons;

mod entries;

mod goals;

mod map;

mod network;

mod roles;

mod rooms;

mod wording;

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::DaemonId;
use pddl::{Diagnostic, Span};
use terminal::report::{DiagnosticReport, SourceText, SourcedDiagnostic};

use crate::config::{self, Ecosystem, ParsedEcosystem};
use crate::hosting;

/// The part of an ecosystem that is reviewed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ReviewScope<'s> {
    /// All of it, for `althing check`.
    Everything,
    /// The part that a daemon needs to start. A mistake in an entry of another daemon is only a
    /// warning, because one machine must not keep the others from working.
    Daemon(&'s DaemonId),
}

/// Returns all mistakes in what was read, including those of the reading itself.
pub(crate) fn review(reading: &ParsedEcosystem, scope: ReviewScope<'_>) -> DiagnosticReport {
    let mut report = reading.report.clone();
    if let Some(ecosystem) = &reading.ecosystem {
        if !reading.is_whole {
            // Things that seem to be missing may be in the part that could not be parsed.
            return only_certain(&report, ecosystem);
        }
        let is_complete = !reading.report.has_errors();
        let said = places(&reading.report);
        report.extend(of_ecosystem(ecosystem, scope, is_complete, said));
    }
    report.dedup();
    report.sort();
    report
}

/// Checks an ecosystem. If `is_complete` is false, some entries could not be understood, and things
/// that seem to be missing may be theirs.
fn of_ecosystem(
    ecosystem: &Ecosystem,
    scope: ReviewScope<'_>,
    is_complete: bool,
    said: BTreeSet<(String, u32)>,
) -> DiagnosticReport {
    let mut desk = Reviewer { ecosystem, is_complete, said, report: DiagnosticReport::default() };
    desk.entries(scope);
    if ecosystem.are_files_sound {
        desk.map();
        desk.rooms();
        desk.goals();
    }
    desk.roles();
    desk.daemons();
    desk.network();
    if desk.is_complete
        && !desk.report.has_errors()
        && let Err(error) = hosting::simulate(ecosystem)
    {
        let (place, problem) = (error.place.clone(), format!("failed to {error}"));
        desk.report_at(&place, Diagnostic::error(Span::default(), problem));
    }
    desk.report
}

/// Returns the places of the errors in a report.
fn places(report: &DiagnosticReport) -> BTreeSet<(String, u32)> {
    let errors = report.findings().iter().filter(|finding| finding.diagnostic.is_error());
    let place = |SourcedDiagnostic { source, diagnostic }: &SourcedDiagnostic| {
        Some((source.as_ref()?.name.clone(), diagnostic.span.start))
    };
    errors.filter_map(place).collect()
}

/// For a file that is not entirely TOML: returns the mistakes that do not follow from the part that
/// could not be parsed.
fn only_certain(report: &DiagnosticReport, ecosystem: &Ecosystem) -> DiagnosticReport {
    let file = &ecosystem.sources.file;
    let syntax = |finding: &&SourcedDiagnostic| config::is_syntax_error(&finding.diagnostic);
    let broken = report.findings().iter().filter(syntax).map(|found| found.diagnostic.span.start);
    let broken = broken.min().unwrap_or_default();
    let is_certain = |SourcedDiagnostic { source, diagnostic }: &&SourcedDiagnostic| {
        let is_elsewhere = source.as_ref().is_none_or(|source| source.name != file.name);
        let is_before = diagnostic.span.start < broken
            && !in_one_entry(&file.text, diagnostic.span.start, broken);
        let misses = ["is missing", "there is no agent"];
        let misses_something = misses.iter().any(|words| diagnostic.message.contains(words));
        let is_consequence = !is_before || !diagnostic.is_error() || misses_something;
        is_elsewhere || config::is_syntax_error(diagnostic) || !is_consequence
    };
    let mut certain = DiagnosticReport::default();
    for SourcedDiagnostic { source, diagnostic } in report.findings().iter().filter(is_certain) {
        match source {
            Some(source) => certain.add(source, [diagnostic.clone()]),
            None => certain.add_general(diagnostic.clone()),
        }
    }
    certain
}

/// Whether there is no header of a table between two places.
fn in_one_entry(text: &str, from: u32, to: u32) -> bool {
    let between = text.get(from as usize..to as usize).unwrap_or_default();
    !between.lines().skip(1).any(|line| line.trim_start().starts_with('['))
}

/// The place of a mistake.
#[derive(Clone, Debug)]
pub(crate) enum MistakeLocation {
    /// A span of the map.
    Map(Span),
    /// The path of a key in the ecosystem file, such as `agent.3.config.start`; if nothing is
    /// there, the nearest thing around it.
    Key(String),
}

/// The data that all checks share.
struct Reviewer<'e> {
    ecosystem: &'e Ecosystem,
    /// Whether all entries could be understood.
    is_complete: bool,
    /// The places of errors from the reading.
    said: BTreeSet<(String, u32)>,
    report: DiagnosticReport,
}

// === impl Desk ===

impl Reviewer<'_> {
    /// Reports a finding at a place.
    fn report_at(&mut self, at: &MistakeLocation, mut found: Diagnostic) {
        match at {
            MistakeLocation::Map(span) => {
                found.span = *span;
                self.report_map(found);
            }
            MistakeLocation::Key(path) => self.report_value(path, found),
        }
    }

    /// Reports a finding about the value at a path of the ecosystem file or, if nothing is there,
    /// about the nearest thing around it.
    fn report_value(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, is_it)) => {
                found.span = if is_it { place.value } else { place.key };
                self.report.add(&source, [found]);
            }
            None => self.report_file(found),
        }
    }

    /// Reports a finding about the key at a path.
    fn report_key(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, _)) => {
                found.span = place.key;
                self.report.add(&source, [found]);
            }
            None => self.report_file(found),
        }
    }

    /// Reports a finding about the file as a whole.
    fn report_file(&mut self, found: Diagnostic) {
        let file: Arc<SourceText> = Arc::clone(&self.ecosystem.sources.file);
        self.report.add(&file, [found]);
    }

    /// Reports a finding at its own span in the map.
    fn report_map(&mut self, found: Diagnostic) {
        let map: Arc<SourceText> = Arc::clone(&self.ecosystem.sources.map);
        self.report.add(&map, [found]);
    }
}
