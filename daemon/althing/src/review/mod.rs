//! What is wrong with an ecosystem beyond the shape of its file: what `check` says, and `up` before it
//! starts.
//!
//! - [`entries`]: the entries of agents, as their plugins read them, in the words of their author.
//! - [`map`]: ways, lengths, and places that no robot reaches.
//! - [`goals`]: the words of goals, held against the ontology, the map and what the agents bring.
//! - [`roles`]: whether somebody takes goals, plans and carries out.
//! - [`rooms`]: agents in a place where they can do nothing.
//! - [`network`]: the table that is handed to Zenoh.
//! - [`daemons`]: names of daemons that are probably slips of others.
//!
//! Each says what it finds where it was written, with what would be right.

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

/// How much of an ecosystem is reviewed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Scope<'s> {
    /// All of it: `check`.
    Everything,
    /// What a daemon needs to start. A mistake in an entry of another daemon is only a warning: one
    /// machine must not keep the others from working.
    Daemon(&'s DaemonId),
}

/// All that is wrong with what was read, the mistakes of the reading included.
pub(crate) fn review(reading: &Reading, scope: Scope<'_>) -> Report {
    let mut report = reading.report.clone();
    if let Some(ecosystem) = &reading.ecosystem {
        if !reading.is_whole {
            // What seems to be missing may stand where nothing could be read.
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

/// Where `is_complete` is false, some entries could not be understood, and what is missing may be
/// theirs.
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

/// Where errors are.
fn places(report: &Report) -> BTreeSet<(String, u32)> {
    let errors = report.findings().iter().filter(|finding| finding.diagnostic.is_error());
    let place = |Finding { source, diagnostic }: &Finding| {
        Some((source.as_ref()?.name.clone(), diagnostic.span.start))
    };
    errors.filter_map(place).collect()
}

/// Of a file that is not all TOML: what does not follow from the part that could not be read.
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

/// Whether no header of a table stands between two places.
fn in_one_entry(text: &str, from: u32, to: u32) -> bool {
    let between = text.get(from as usize..to as usize).unwrap_or_default();
    !between.lines().skip(1).any(|line| line.trim_start().starts_with('['))
}

/// Where a thing was written that is found wrong.
#[derive(Clone, Debug)]
pub(crate) enum At {
    /// A place of the map.
    Map(Span),
    /// A key of the ecosystem file, such as `agent.3.config.start`, or what is nearest around it.
    Key(String),
}

/// What the parts of the review share.
struct Desk<'e> {
    ecosystem: &'e Ecosystem,
    /// Whether all entries could be understood.
    is_complete: bool,
    /// Where the reading has found errors.
    said: BTreeSet<(String, u32)>,
    report: Report,
}

// === impl Desk ===

impl Desk<'_> {
    /// Says something about a place.
    fn say_at(&mut self, at: &At, mut found: Diagnostic) {
        match at {
            At::Map(span) => {
                found.span = *span;
                self.say_of_map(found);
            }
            At::Key(path) => self.say_of(path, found),
        }
    }

    /// Says something about the value at a path of the ecosystem file; about what is nearest around
    /// it where nothing stands there.
    fn say_of(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, is_it)) => {
                found.span = if is_it { place.value } else { place.key };
                self.report.add(&source, [found]);
            }
            None => self.say_of_file(found),
        }
    }

    /// Says something about the key at a path.
    fn say_of_key(&mut self, path: &str, mut found: Diagnostic) {
        match self.ecosystem.places.find(path) {
            Some((source, place, _)) => {
                found.span = place.key;
                self.report.add(&source, [found]);
            }
            None => self.say_of_file(found),
        }
    }

    /// Says something about the file as a whole.
    fn say_of_file(&mut self, found: Diagnostic) {
        let file: Arc<Source> = Arc::clone(&self.ecosystem.texts.file);
        self.report.add(&file, [found]);
    }

    /// Says something about the place of the map that it names.
    fn say_of_map(&mut self, found: Diagnostic) {
        let map: Arc<Source> = Arc::clone(&self.ecosystem.texts.map);
        self.report.add(&map, [found]);
    }
}
