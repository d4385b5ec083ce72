//! Checks of an ecosystem file beyond its form. `althing check` runs them, and `althing up` runs
//! them before it starts.
//!
//! - [`entries`]: the entries of agents, checked by the agents' plugins; [`culprit`] finds the value
//!   that is wrong, and [`models`] shows mistakes in the text of an action model.
//! - [`entry_texts`]: facts and goals in the entries of agents, against all agents of the file; and
//!   safeguards of agents without actions.
//! - [`map`]: the connections of the map, their lengths, and places that no robot can reach. Of a
//!   building in `[rooms]` and `[doors]`, only the last is left to check.
//! - [`goals`]: the words of goals, checked against the ontology, the map and the agents' action
//!   models.
//! - [`composition`]: parts of the agents' action models that the composed domain leaves out.
//! - [`sensors`]: sensors that no goal of the file asks for.
//! - [`reach`]: goals of the file that no agent of the file could ever reach.
//! - [`rivals`]: two agents that use one thing, such as a line of a board or a topic.
//! - [`roles`]: whether there are agents that take goals, that plan, and that carry out plans.
//! - [`rooms`]: agents in a place where they can do nothing.
//! - [`network`]: the table `[zenoh]`.
//! - [`people`]: the file of people.
//! - [`secret_files`]: files with secrets that are not there, or that other users can read.
//! - [`daemons`]: names of daemons that are probably misspelled.
//! - [`words`]: the phrases of the file, against the ontology and the agents' action models.
//!
//! Each check reports a mistake at its place in the text, with a correction. What only follows from
//! another report is taken out again ([`consequences`]).

mod composition;
mod config_value;

mod consequences;

mod culprit;

mod daemons;

mod entries;
mod examples;

mod entry_texts;

mod goals;
mod hardware_stops;

mod map;
mod models;

mod network;

mod people;

mod reach;

mod rivals;

mod roles;

mod rooms;

mod secret_files;

mod sensors;

mod wording;

mod words;

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::DaemonId;
use pddl::{Diagnostic, Severity, Span};
use terminal::report::{DiagnosticReport, SourceText, SourcedDiagnostic};

use crate::config::{Ecosystem, MistakeLocation, ParsedEcosystem};
use crate::hosting;

/// The part of an ecosystem that is reviewed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ReviewScope<'s> {
    /// The whole ecosystem and beyond its files, for `althing check`: sensors that no goal asks for,
    /// and goals that no agent could reach.
    Building,
    /// The whole ecosystem.
    Everything,
    /// The part that this daemon needs to start, for `althing up`. A mistake in the entry of
    /// another daemon's agent is only a warning, because one machine must not stop the others.
    Daemon(&'s DaemonId),
}

/// Returns all mistakes in an ecosystem file, including those that were found when it was read.
pub(crate) fn review(reading: &ParsedEcosystem, scope: ReviewScope<'_>) -> DiagnosticReport {
    let mut report = reading.report.clone();
    if let Some(ecosystem) = &reading.ecosystem {
        if !reading.is_whole {
            // An item that seems to be missing may be in the part that could not be parsed.
            return consequences::only_certain(&report, ecosystem);
        }
        let is_complete = !reading.report.has_errors();
        let said = places(&reading.report);
        report.extend(of_ecosystem(ecosystem, scope, is_complete, said));
    }
    report.dedup();
    report.sort();
    consequences::remove(&mut report);
    report
}

/// Checks an ecosystem. If `is_complete` is false, some entries could not be understood, and may
/// contain an item that seems to be missing.
fn of_ecosystem(
    ecosystem: &Ecosystem,
    scope: ReviewScope<'_>,
    is_complete: bool,
    said: BTreeSet<(String, u32)>,
) -> DiagnosticReport {
    let mut desk = Reviewer { ecosystem, is_complete, said, report: DiagnosticReport::default() };
    desk.entries(scope);
    if !matches!(scope, ReviewScope::Daemon(_)) {
        // A daemon runs without people, too: a mistake in their file does not keep it from starting.
        desk.people();
    }
    if ecosystem.are_files_sound {
        desk.map();
        desk.rooms();
        desk.goals();
        desk.entry_texts();
        desk.safeguarded_agents();
        desk.words();
        desk.hardware_stops();
    }
    desk.roles();
    desk.daemons();
    desk.network();
    desk.rivals();
    if !matches!(scope, ReviewScope::Daemon(_))
        && desk.is_complete
        && !desk.report.has_errors()
        && ecosystem.are_files_sound
    {
        // The Domain Maintainer of a running ecosystem tells it by itself.
        desk.composition(&hosting::models(ecosystem));
    }
    // A sensor in a wrong room or a word that is unknown would only be told a second time.
    let is_sound = !desk.report.has_errors() && desk.report.count(Severity::Warning) == 0;
    if matches!(scope, ReviewScope::Building) && is_sound {
        let models = hosting::models(ecosystem);
        desk.sensors(&models);
        desk.reach(&models);
    }
    // What is missing on this machine says nothing about the file.
    desk.secret_files();
    if desk.is_complete
        && !desk.report.has_errors()
        && let Err(error) = hosting::simulate(ecosystem)
    {
        let (place, problem) = (error.place.clone(), format!("failed to {error}"));
        desk.report_at(&place, Diagnostic::error(Span::default(), problem));
    }
    desk.report
}

/// Returns the places of the errors in a report. A place is the name of the text and the offset in
/// it.
fn places(report: &DiagnosticReport) -> BTreeSet<(String, u32)> {
    let errors = report.findings().iter().filter(|finding| finding.diagnostic.is_error());
    let place = |SourcedDiagnostic { source, diagnostic }: &SourcedDiagnostic| {
        Some((source.as_ref()?.name.clone(), diagnostic.span.start))
    };
    errors.filter_map(place).collect()
}

/// The data that all checks of the review share.
struct Reviewer<'e> {
    ecosystem: &'e Ecosystem,
    /// Whether all entries of the file could be understood.
    is_complete: bool,
    /// The places of the errors that were found when the file was read.
    said: BTreeSet<(String, u32)>,
    report: DiagnosticReport,
}

// === impl Reviewer ===

impl Reviewer<'_> {
    /// Reports the mistake `found` at the place `at`.
    fn report_at(&mut self, at: &MistakeLocation, mut found: Diagnostic) {
        match at {
            MistakeLocation::Map(span) => {
                found.span = *span;
                self.report_map(found);
            }
            MistakeLocation::Key(path) => self.report_value(path, found),
        }
    }

    /// Reports the mistake `found` at the value that stands at `path` in the ecosystem file. If no
    /// value is there, reports it at the nearest table or entry around the path.
    fn report_value(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, is_it)) => {
                found.span = if is_it { place.value } else { place.key };
                self.report.add(&source, [found]);
            }
            None => self.report_file(found),
        }
    }

    /// Reports the mistake `found` at the key that stands at `path` in the ecosystem file.
    fn report_key(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, _)) => {
                found.span = place.key;
                self.report.add(&source, [found]);
            }
            None => self.report_file(found),
        }
    }

    /// Reports the mistake `found`, which concerns the ecosystem file as a whole.
    fn report_file(&mut self, found: Diagnostic) {
        let file: Arc<SourceText> = Arc::clone(&self.ecosystem.sources.file);
        self.report.add(&file, [found]);
    }

    /// Reports the mistake `found` in the map, at the span that it already has.
    fn report_map(&mut self, found: Diagnostic) {
        let map: Arc<SourceText> = Arc::clone(&self.ecosystem.sources.map);
        self.report.add(&map, [found]);
    }
}
