//! `althing check --tree`: reads every PDDL file below a folder, and counts the results.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use serde_json::{Value, json};
use terminal::limits::LimitWatch;
use terminal::pddl_tree::{self, FileOutcome, OutcomeCounts, PddlTree, ReadFile};
use terminal::report::DiagnosticReport;
use terminal::{exit, output, visible};

use crate::cli::CheckArgs;

/// The kinds of PDDL files, in the order of the rows of the table. Each has its name in the JSON
/// output and its name in the table.
const KINDS: [(&str, &str); 4] = [
    ("domain", "domains"),
    ("problem", "problems"),
    ("action model", "action models"),
    ("unknown", "other files"),
];

/// Reads the PDDL files below `folder`, and prints the counts and the refused files. Returns the
/// exit code.
pub(super) fn run(args: &CheckArgs, folder: &Path, deadline: &LimitWatch) -> ExitCode {
    let tree = match pddl_tree::read(folder, &mut |_| ()) {
        Ok(tree) => tree,
        Err(failure) => {
            let mut report = DiagnosticReport::default();
            report.add_failure(failure);
            let json = args.print.json;
            return deadline.answer(|| output::show(&report, json, "bad-input", exit::BAD_INPUT));
        }
    };
    let code = match tree.counts(None).refused {
        0 => exit::DONE,
        _ => exit::BAD_INPUT,
    };
    deadline.answer(|| match args.print.json {
        true => output::print_json(&json_tree(&tree), code),
        false => output::print(people(&tree, args.warnings), code),
    })
}

/// Formats the results for people: the table of counts, the refused files, the files without a
/// domain, and the unsupported features with the number of files that use each. If `warnings` is
/// true, the warnings with the number of files follow.
fn people(tree: &PddlTree, warnings: bool) -> String {
    let mut text = format!(
        "{:<15}{:>8}{:>8}{:>8}{:>13}{:>11}{:>9}\n",
        "", "files", "read", "odd", "unsupported", "no domain", "refused"
    );
    for (kind, name) in KINDS {
        let counts = tree.counts(Some(kind));
        if counts.files > 0 {
            row(&mut text, name, counts);
        }
    }
    row(&mut text, "all", tree.counts(None));
    let refused = |file: &ReadFile| match &file.outcome {
        FileOutcome::Refused(why) => Some(why.clone()),
        _ => None,
    };
    files(&mut text, tree, "refused", &refused);
    let alone = |file: &ReadFile| match &file.outcome {
        FileOutcome::Alone(why) => Some(why.clone()),
        _ => None,
    };
    files(&mut text, tree, "without a domain", &alone);
    reasons(&mut text, "unsupported", unsupported(tree));
    if warnings {
        reasons(&mut text, "odd", odd(tree));
    }
    text
}

fn row(text: &mut String, name: &str, counts: OutcomeCounts) {
    let OutcomeCounts { files, read, odd, unsupported, alone, refused } = counts;
    let _ = writeln!(
        text,
        "{name:<15}{files:>8}{read:>8}{odd:>8}{unsupported:>13}{alone:>11}{refused:>9}"
    );
}

fn files(
    text: &mut String,
    tree: &PddlTree,
    title: &str,
    why: &dyn Fn(&ReadFile) -> Option<String>,
) {
    let mut is_first = true;
    for file in &tree.files {
        let Some(why) = why(file) else { continue };
        if std::mem::replace(&mut is_first, false) {
            let _ = writeln!(text, "\n{title}");
        }
        let path = file.path.display().to_string();
        let _ = writeln!(text, "  {}: {why}", visible::line(&path));
    }
}

fn reasons(text: &mut String, title: &str, reasons: BTreeMap<String, usize>) {
    if !reasons.is_empty() {
        let _ = writeln!(text, "\n{title}");
    }
    for (reason, count) in reasons {
        let _ = writeln!(text, "  {count:>6}  {reason}");
    }
}

/// Counts, for each unsupported feature, the files that use it. Messages that differ only in names
/// count as one.
fn unsupported(tree: &PddlTree) -> BTreeMap<String, usize> {
    let features = tree.files.iter().filter_map(|file| match &file.outcome {
        FileOutcome::Unsupported(feature) => Some(general(feature)),
        _ => None,
    });
    counted(features)
}

/// Counts, for each warning, the files that cause it. Messages that differ only in names count as
/// one.
fn odd(tree: &PddlTree) -> BTreeMap<String, usize> {
    let read = tree.files.iter().filter(|file| file.outcome == FileOutcome::Read);
    counted(read.flat_map(|file| {
        let mut kinds: Vec<String> = file.warnings.iter().map(|warning| general(warning)).collect();
        kinds.sort();
        kinds.dedup();
        kinds
    }))
}

fn counted(all: impl Iterator<Item = String>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for one in all {
        *counts.entry(one).or_insert(0) += 1;
    }
    counts
}

/// Replaces each name between backquotes in a message by `…`, so that messages of several files can
/// be equal. Keywords of PDDL, which begin with a colon, are kept.
fn general(message: &str) -> String {
    let mut parts = message.split('`');
    let mut general = parts.next().unwrap_or_default().to_owned();
    while let (Some(quoted), rest) = (parts.next(), parts.next()) {
        general += &match quoted.starts_with(':') {
            true => format!("`{quoted}`"),
            false => "…".to_owned(),
        };
        general += rest.unwrap_or_default();
    }
    general
}

fn json_tree(tree: &PddlTree) -> Value {
    let kinds: serde_json::Map<String, Value> = { KINDS.iter() }
        .map(|(kind, _)| ((*kind).to_owned(), json_counts(tree.counts(Some(kind)))))
        .collect();
    let all = tree.counts(None);
    let files: Vec<Value> = tree.files.iter().filter_map(json_file).collect();
    json!({
        "status": if all.refused > 0 { "bad-input" } else { "ok" },
        "counts": json_counts(all),
        "kinds": kinds,
        "unsupported": unsupported(tree),
        "odd": odd(tree),
        "files": files,
    })
}

fn json_counts(counts: OutcomeCounts) -> Value {
    let OutcomeCounts { files, read, odd, unsupported, alone, refused } = counts;
    json!({
        "files": files,
        "read": read,
        "odd": odd,
        "unsupported": unsupported,
        "no_domain": alone,
        "refused": refused,
    })
}

/// Describes the result for one file as JSON; `None` if the file was read without warnings.
fn json_file(file: &ReadFile) -> Option<Value> {
    let (outcome, why) = match &file.outcome {
        FileOutcome::Read if file.warnings.is_empty() => return None,
        FileOutcome::Read => ("odd", None),
        FileOutcome::Unsupported(why) => ("unsupported", Some(why)),
        FileOutcome::Alone(why) => ("no-domain", Some(why)),
        FileOutcome::Refused(why) => ("refused", Some(why)),
    };
    Some(json!({
        "file": file.path.display().to_string(),
        "kind": file.kind,
        "domain": file.domain.as_ref().map(|domain| domain.display().to_string()),
        "outcome": outcome,
        "reason": why,
        "warnings": file.warnings,
    }))
}
