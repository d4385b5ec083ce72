//! Takes out of a review what only follows from another report: the author mends the cause, and the
//! consequence is gone. Reports are told apart by their words; `tests/it/home_mistakes.rs` fails if
//! one of them is worded anew.

use pddl::Diagnostic;
use terminal::report::{DiagnosticReport, SourcedDiagnostic};

use crate::config::{self, Ecosystem};

/// Tables that were not read because their name is wrong: the words of the cause in its message or
/// help, and the words in the messages of the consequences.
const UNREAD: &[(&str, &[&str])] = &[
    ("did you mean `[rooms]`?", ROOMS),
    ("unknown key `rooms`", ROOMS),
    ("did you mean `[doors]`?", DOORS),
    ("unknown key `doors`", DOORS),
    ("did you mean `[[agent]]`?", &["there is no agent `", "has no key `daemon`"]),
];
const ROOMS: &[&str] = &[" under [rooms]", "[rooms] names no place"];
const DOORS: &[&str] = &["no door leads there from its start"];

/// Pairs of a cause and its consequence in the same line, by words of their messages: a wrong value
/// of `keep`, and a misspelt key of a safeguard.
const IN_ONE_LINE: &[(&str, &str)] = &[
    (".keep` must be ", "only a kept goal is asked for always"),
    ("unknown key `", "this safeguard has no effect"),
];

/// The words of a report about a name that no agent can have.
const NO_NAME: &str = " cannot be the name of an agent";

/// Removes the reports that only follow from another one.
pub(super) fn remove(report: &mut DiagnosticReport) {
    without_misspelt(report);
    without_misplaced(report);
    without_repeated_names(report);
    without_unread(report);
    IN_ONE_LINE.iter().for_each(|pair| without_consequence(report, *pair));
}

/// Removes the reports that refer to an agent by a name that no agent can have, if its own entry is
/// reported for the same name.
fn without_repeated_names(report: &mut DiagnosticReport) {
    let cause = |found: &SourcedDiagnostic| {
        let (name, _) = found.diagnostic.message.split_once(NO_NAME)?;
        (found.diagnostic.is_error() && name.starts_with('`')).then(|| name.to_owned())
    };
    let wrong: Vec<String> = report.findings().iter().filter_map(cause).collect();
    report.retain(|found| match found.diagnostic.message.split_once(NO_NAME) {
        Some((before, _)) if before.starts_with("config of `") => {
            !wrong.iter().any(|name| before.ends_with(&format!(": {name}")))
        }
        _ => true,
    });
}

/// Removes the reports about what stands in a table that was not read.
fn without_unread(report: &mut DiagnosticReport) {
    for (cause, consequences) in UNREAD {
        let is_cause = |SourcedDiagnostic { diagnostic, .. }: &SourcedDiagnostic| {
            let helps = diagnostic.help.as_deref().is_some_and(|help| help.contains(cause));
            diagnostic.is_error() && (diagnostic.message.contains(cause) || helps)
        };
        if report.findings().iter().any(is_cause) {
            report.retain(|SourcedDiagnostic { diagnostic, .. }| {
                !consequences.iter().any(|words| diagnostic.message.contains(words))
            });
        }
    }
}

/// Removes each report `consequence` that stands in the same line as the report `cause`.
fn without_consequence(report: &mut DiagnosticReport, (cause, consequence): (&str, &str)) {
    let line = |found: &SourcedDiagnostic| {
        let before = found.source.as_ref()?.text.get(..found.diagnostic.span.start as usize)?;
        Some(before.matches('\n').count())
    };
    let is_cause = |found: &&SourcedDiagnostic| found.diagnostic.message.contains(cause);
    let wrong: Vec<_> = report.findings().iter().filter(is_cause).filter_map(line).collect();
    report.retain(|found| {
        let follows = found.diagnostic.message.contains(consequence);
        !follows || line(found).is_none_or(|line| !wrong.contains(&line))
    });
}

/// Removes the reports that a key is missing if the same entry has that key, misspelt.
fn without_misspelt(report: &mut DiagnosticReport) {
    let misspelt: Vec<(String, u32, String)> = report
        .findings()
        .iter()
        .filter(|found| found.diagnostic.message.starts_with("unknown key `"))
        .filter_map(|SourcedDiagnostic { source, diagnostic }| {
            let meant = diagnostic.help.as_deref()?.strip_prefix("did you mean `")?;
            let meant = meant.strip_suffix("`?")?.to_owned();
            Some((source.as_ref()?.name.clone(), diagnostic.span.start, meant))
        })
        .collect();
    report.retain(|SourcedDiagnostic { source, diagnostic }| {
        let (Some(source), Some(missing)) = (source, missing_key(diagnostic)) else { return true };
        let (from, text) = (diagnostic.span.start, &source.text);
        !misspelt.iter().any(|(file, at, meant)| {
            *file == source.name && meant == missing && *at > from && in_one_entry(text, from, *at)
        })
    });
}

/// Removes the reports that an agent needs a key if the key stands beside its `config`.
fn without_misplaced(report: &mut DiagnosticReport) {
    let misplaced: Vec<(String, u32, String)> = report
        .findings()
        .iter()
        .filter(|found| found.diagnostic.message.starts_with("unknown key `"))
        .filter_map(|SourcedDiagnostic { source, diagnostic }| {
            let (_, moved) = diagnostic.help.as_deref()?.split_once("move `")?;
            let (key, _) = moved.split_once("` into the entry's `config`")?;
            Some((source.as_ref()?.name.clone(), diagnostic.span.start, key.to_owned()))
        })
        .collect();
    report.retain(|SourcedDiagnostic { source, diagnostic }| {
        let Some(source) = source else { return true };
        let (from, message) = (diagnostic.span.start, &diagnostic.message);
        !misplaced.iter().any(|(file, at, key)| {
            let needs = [format!(" needs the `{key}`"), format!(" needs a `{key}`")];
            *file == source.name
                && needs.iter().any(|words| message.contains(words))
                && source
                    .text
                    .get(from.min(*at) as usize..from.max(*at) as usize)
                    .is_some_and(|between| !between.contains("[["))
        })
    });
}

/// Returns the key that is missing according to a diagnostic: `` `fail-safe` is missing`` or
/// `` `per` needs `at-most` ``. Returns `None` if it is about something else.
fn missing_key(found: &Diagnostic) -> Option<&str> {
    let (key, rest) = found.message.strip_prefix('`')?.split_once('`')?;
    if rest == " is missing" || rest.starts_with(" is missing in ") {
        return Some(key);
    }
    rest.strip_prefix(" needs `")?.strip_suffix('`')
}

/// Returns those mistakes of `report` that are certain although a part of the file could not be
/// parsed. Used for a file that is not valid TOML as a whole.
pub(super) fn only_certain(report: &DiagnosticReport, ecosystem: &Ecosystem) -> DiagnosticReport {
    let file = &ecosystem.sources.file;
    let syntax = |finding: &&SourcedDiagnostic| config::is_syntax_error(&finding.diagnostic);
    let broken = report.findings().iter().filter(syntax).map(|found| found.diagnostic.span.start);
    let broken = broken.min().unwrap_or_default();
    let is_certain = |SourcedDiagnostic { source, diagnostic }: &&SourcedDiagnostic| {
        let is_elsewhere = source.as_ref().is_none_or(|source| source.name != file.name);
        let is_before = diagnostic.span.start < broken
            && !in_one_entry(&file.text, diagnostic.span.start, broken);
        let misses = ["is missing", "there is no agent", "under [rooms]"];
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

/// Whether the offsets `from` and `to` are in the same entry: there is no header of a table between
/// them.
fn in_one_entry(text: &str, from: u32, to: u32) -> bool {
    let between = text.get(from as usize..to as usize).unwrap_or_default();
    !between.lines().skip(1).any(|line| line.trim_start().starts_with('['))
}
