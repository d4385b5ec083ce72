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
use terminal::report::{Finding, Report, Source};

use crate::config::{self, Ecosystem, Reading};
use crate::hosting;

/// The part of an ecosystem that is reviewed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Scope<'s> {
    /// All of it, for `althing check`.
    Everything,
    /// The part that a daemon needs to start. A mistake in an entry of another daemon is only a
    /// warning, because one machine must not keep the others from working.
    Daemon(&'s DaemonId),
}

/// Returns all mistakes in what was read, including those of the reading itself.
pub(crate) fn review(reading: &Reading, scope: Scope<'_>) -> Report {
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
    scope: Scope<'_>,
    is_complete: bool,
    said: BTreeSet<(String, u32)>,
) -> Report {
    let mut desk = Desk { ecosystem, is_complete, said, report: Report::default() };
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
        desk.say_at(&place, Diagnostic::error(Span::default(), problem));
    }
    desk.report
}

/// Returns the places of the errors in a report.
fn places(report: &Report) -> BTreeSet<(String, u32)> {
    let errors = report.findings().iter().filter(|finding| finding.diagnostic.is_error());
    let place = |Finding { source, diagnostic }: &Finding| {
        Some((source.as_ref()?.name.clone(), diagnostic.span.start))
    };
    errors.filter_map(place).collect()
}

/// For a file that is not entirely TOML: returns the mistakes that do not follow from the part that
/// could not be parsed.
fn only_certain(report: &Report, ecosystem: &Ecosystem) -> Report {
    let file = &ecosystem.texts.file;
    let syntax = |finding: &&Finding| config::is_syntax_error(&finding.diagnostic);
    let broken = report.findings().iter().filter(syntax).map(|found| found.diagnostic.span.start);
    let broken = broken.min().unwrap_or_default();
    let is_certain = |Finding { source, diagnostic }: &&Finding| {
        let is_elsewhere = source.as_ref().is_none_or(|source| source.name != file.name);
        let is_before = diagnostic.span.start < broken
            && !in_one_entry(&file.text, diagnostic.span.start, broken);
        let misses = ["is missing", "there is no agent"];
        let misses_something = misses.iter().any(|words| diagnostic.message.contains(words));
        let is_consequence = !is_before || !diagnostic.is_error() || misses_something;
        is_elsewhere || config::is_syntax_error(diagnostic) || !is_consequence
    };
    let mut certain = Report::default();
    for Finding { source, diagnostic } in report.findings().iter().filter(is_certain) {
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
pub(crate) enum At {
    /// A span of the map.
    Map(Span),
    /// The path of a key in the ecosystem file, such as `agent.3.config.start`; if nothing is
    /// there, the nearest thing around it.
    Key(String),
}

/// The data that all checks share.
struct Desk<'e> {
    ecosystem: &'e Ecosystem,
    /// Whether all entries could be understood.
    is_complete: bool,
    /// The places of errors from the reading.
    said: BTreeSet<(String, u32)>,
    report: Report,
}

// === impl Desk ===

impl Desk<'_> {
    /// Reports a finding at a place.
    fn say_at(&mut self, at: &At, mut found: Diagnostic) {
        match at {
            At::Map(span) => {
                found.span = *span;
                self.say_of_map(found);
            }
            At::Key(path) => self.say_of(path, found),
        }
    }

    /// Reports a finding about the value at a path of the ecosystem file or, if nothing is there,
    /// about the nearest thing around it.
    fn say_of(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, is_it)) => {
                found.span = if is_it { place.value } else { place.key };
                self.report.add(&source, [found]);
            }
            None => self.say_of_file(found),
        }
    }

    /// Reports a finding about the key at a path.
    fn say_of_key(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, _)) => {
                found.span = place.key;
                self.report.add(&source, [found]);
            }
            None => self.say_of_file(found),
        }
    }

    /// Reports a finding about the file as a whole.
    fn say_of_file(&mut self, found: Diagnostic) {
        let file: Arc<Source> = Arc::clone(&self.ecosystem.texts.file);
        self.report.add(&file, [found]);
    }

    /// Reports a finding at its own span in the map.
    fn say_of_map(&mut self, found: Diagnostic) {
        let map: Arc<Source> = Arc::clone(&self.ecosystem.texts.map);
        self.report.add(&map, [found]);
    }
}
