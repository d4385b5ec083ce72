//! `althing check`: reports the mistakes in files, each with its line.
//!
//! - The kind of a file is recognised by its extension (`.toml` is an ecosystem file) and its
//!   contents (`[people.NAME]` is a table of a file of people).
//! - The agents of an ecosystem are built as `althing up` would build them, but not launched.
//! - A problem or an action model is checked against the domain that it names: one of the files on
//!   the command line or, if none of them is that domain, a file found beside it.

mod tree;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use accounts::PeopleFile;
use agent::Mode;
use pddl::{Diagnostic, Document, Domain, Name};
use planner::Cancel;
use serde_json::{Value, json};
use terminal::domain_search;
use terminal::limits::{LimitWatch, RunLimits};
use terminal::pddl_files::{self, DomainText};
use terminal::render::plural;
use terminal::report::{DiagnosticReport, SourceText};
use terminal::{exit, output, visible};

use crate::cli::{CheckArgs, PddlPart};
use crate::config::{self, Ecosystem, KnownPlugin, Overrides};
use crate::interfacing;
use crate::review::{self, ReviewScope};

/// The result of checking one file.
struct CheckedFile {
    file: String,
    kind: &'static str,
    /// A short description of what the file contains, apart from its mistakes.
    about: String,
    has_errors: bool,
}

/// The domains among the given files, and the results so far.
struct FileCheck {
    domains: Vec<DomainText>,
    report: DiagnosticReport,
    checked: Vec<CheckedFile>,
    /// The part of ecosystem files that is printed, if one is asked for, and its text so far.
    wanted: Option<PddlPart>,
    printed: String,
}

/// Runs `althing check`: checks every file, and prints the mistakes.
pub(crate) fn run(args: &CheckArgs, known_plugins: &[KnownPlugin]) -> ExitCode {
    let limits = RunLimits::of_time(args.time_limit);
    let give = terminal::limits::refusal(args.print.json);
    let deadline = LimitWatch::start(limits, Instant::now(), Cancel::new(), give);
    if let Some(folder) = &args.tree {
        return tree::run(args, folder, &deadline);
    }
    let Some(files) = named_files(&args.files) else {
        let problem = "there is no althing.toml here nor in the configuration folders; name a file: \
                       althing check FILE";
        return super::wrong(problem, args.print.json);
    };
    let mut desk = FileCheck {
        domains: Vec::new(),
        report: DiagnosticReport::default(),
        checked: Vec::new(),
        wanted: args.printed,
        printed: String::new(),
    };
    let (people, others): (Vec<&PathBuf>, Vec<&PathBuf>) =
        files.iter().partition(|path| is_people(path));
    let (ecosystems, texts): (Vec<&PathBuf>, Vec<&PathBuf>) =
        others.into_iter().partition(|path| is_ecosystem(path));
    desk.check_texts(&texts);
    for path in people {
        desk.check_people(path);
    }
    for path in ecosystems {
        desk.check_ecosystem(path, known_plugins);
    }
    desk.report.dedup();
    deadline.answer(|| desk.show(args.print.json))
}

/// Returns the files to check: those that the user names, otherwise the ecosystem file that `althing up`
/// finds; `None` if it finds none.
fn named_files(named: &[PathBuf]) -> Option<Vec<PathBuf>> {
    match named {
        [] => Some(vec![config::find_ecosystem_file()?]),
        named => Some(named.to_vec()),
    }
}

/// Whether a file is a file of people: it has a table of a person, and no table of an ecosystem.
fn is_people(path: &Path) -> bool {
    let Ok(source) = SourceText::read(path) else { return false };
    let mut lines = source.text.lines().map(str::trim);
    let has_ecosystem = lines.clone().any(|line| line.starts_with("[ecosystem]"));
    !has_ecosystem && lines.any(|line| line.starts_with("[people."))
}

/// Whether a file is an ecosystem file: it has the extension `.toml`, or contains the table
/// `[ecosystem]`.
fn is_ecosystem(path: &Path) -> bool {
    let has_ending = path.extension().is_some_and(|ending| ending == "toml");
    let has_table = || {
        let source = SourceText::read(path).ok();
        source.is_some_and(|source| source.text.lines().any(|line| line.trim() == "[ecosystem]"))
    };
    has_ending || has_table()
}

// === impl FileCheck ===

impl FileCheck {
    /// Checks the domains first. Problems and action models then find their domains, in whatever
    /// order the files are given.
    fn check_texts(&mut self, paths: &[&PathBuf]) {
        let mut others = Vec::new();
        for path in paths {
            let Some(source) = pddl_files::read(path, &mut self.report) else {
                self.note(path, "unreadable file", String::new(), true);
                continue;
            };
            match pddl::parse_document(&source.text).value {
                Some(Document::Domain(_)) => self.check_domain(path, source),
                Some(Document::Problem(problem)) => {
                    others.push((path, source, Some(problem.domain)))
                }
                Some(Document::ActionModel(model)) => {
                    others.push((path, source, Some(model.domain)))
                }
                None => others.push((path, source, None)),
            }
        }
        for (path, source, domain) in others {
            match domain {
                Some(domain) => self.check_dependent(path, &source, &domain),
                None => self.check_unknown(path, &source),
            }
        }
    }

    fn check_domain(&mut self, path: &Path, source: Arc<SourceText>) {
        let mut report = DiagnosticReport::default();
        let text = pddl_files::domain_of(Arc::clone(&source), &mut report);
        let about = text.domain.as_ref().map(about_domain).unwrap_or_default();
        // A domain that fits better together with the standard ontology is a vocabulary.
        if !report.is_empty() {
            let mut as_vocabulary = DiagnosticReport::default();
            let extend = |more: &Domain| ontology::extended(ontology::standard_domain(), more);
            pddl_files::vocabulary_of(&source, extend, &mut as_vocabulary);
            if as_vocabulary.is_empty() {
                self.note(path, "vocabulary", about, false);
                return self.report.extend(as_vocabulary);
            }
        }
        self.note(path, "domain", about, report.has_errors());
        self.report.extend(report);
        self.domains.push(text);
    }

    /// Checks a problem or an action model, which depends on the domain named `domain`.
    fn check_dependent(&mut self, path: &Path, source: &Arc<SourceText>, domain: &Name) {
        let mut report = DiagnosticReport::default();
        let given = domain_search::domain_given(path, domain, &self.domains);
        let found = if given.is_none() { domain_search::nearby_domain(path, domain) } else { None };
        let text = given.or(found.as_ref());
        if text.is_none() {
            report.add(source, [unknown_domain(domain)]);
        }
        let (kind, about) = match pddl::parse_document(&source.text).value {
            Some(Document::ActionModel(_)) => {
                let model = pddl_files::action_model_of(source, text, &mut report);
                ("action model", model.map(|model| about_model(&model)))
            }
            // A problem with an empty goal is a map.
            Some(Document::Problem(problem)) if problem.goal.is_always() => {
                let map = pddl_files::map_of(source, text, &mut report);
                ("problem", map.map(|map| about_problem(&map)))
            }
            _ => {
                let problem = pddl_files::problem_of(source, text, &mut report);
                ("problem", problem.map(|problem| about_problem(&problem)))
            }
        };
        let report = report.refused();
        self.note(path, kind, about.unwrap_or_default(), report.has_errors());
        self.report.extend(report);
    }

    fn check_unknown(&mut self, path: &Path, source: &Arc<SourceText>) {
        self.report.add(source, pddl::parse_document(&source.text).diagnostics);
        self.note(path, "unknown file", String::new(), true);
    }

    fn check_ecosystem(&mut self, path: &Path, known_plugins: &[KnownPlugin]) {
        let reading = Ecosystem::read(path, &Overrides::default(), known_plugins);
        let mut report = review::review(&reading, ReviewScope::Building);
        let ecosystem = reading.ecosystem.as_ref();
        if let Some(ecosystem) = ecosystem.filter(|_| !reading.report.has_errors()) {
            report.extend(interfacing::check(ecosystem, known_plugins));
        }
        let about = ecosystem.map(about_ecosystem).unwrap_or_default();
        if let (Some(ecosystem), Some(part)) = (ecosystem, self.wanted) {
            self.printed += &match part {
                PddlPart::Map => ecosystem.problem.to_string(),
                PddlPart::Ontology => ecosystem.domain.to_string(),
            };
        }
        self.note(path, "ecosystem", about, report.has_errors());
        self.report.extend(report);
    }

    fn check_people(&mut self, path: &Path) {
        let mut report = DiagnosticReport::default();
        let mut about = String::new();
        match PeopleFile::new(path).text() {
            Ok(text) => {
                let text = text.unwrap_or_default();
                let read = accounts::read_people(&text);
                about = format!("({})", people_count(read.records.len()));
                // An excerpt of the text must not show hashes.
                let shown = accounts::without_secrets(&text);
                let name = visible::line(&path.display().to_string()).into_owned();
                report.add(&SourceText::new(name, shown), read.mistakes);
            }
            Err(error) => report.add_failure(error),
        }
        self.note(path, "people", about, report.has_errors());
        self.report.extend(report);
    }

    fn note(&mut self, path: &Path, kind: &'static str, about: String, has_errors: bool) {
        let file = visible::line(&path.display().to_string()).into_owned();
        self.checked.push(CheckedFile { file, kind, about, has_errors });
    }

    fn show(&self, json: bool) -> ExitCode {
        let has_errors = self.report.has_errors();
        let (status, code) = match has_errors {
            true => self.report.refusal(),
            false => ("ok", exit::DONE),
        };
        if json {
            let files: Vec<Value> = self.checked.iter().map(CheckedFile::json).collect();
            let value = json!({
                "status": status,
                "files": files,
                "diagnostics": terminal::render::json(&self.report),
            });
            return output::print_json(&value, code);
        }
        output::show_to_person(&self.report);
        if self.wanted.is_some() {
            return output::print(&self.printed, code);
        }
        let lines: String = self.checked.iter().map(CheckedFile::line).collect();
        output::print(lines, code)
    }
}

// === impl CheckedFile ===

impl CheckedFile {
    fn line(&self) -> String {
        let CheckedFile { file, kind, about, has_errors } = self;
        let verdict = if *has_errors { "has errors" } else { "ok" };
        match about.as_str() {
            "" => format!("{file}: {kind}: {verdict}\n"),
            about => format!("{file}: {kind} {about}: {verdict}\n"),
        }
    }

    fn json(&self) -> Value {
        let CheckedFile { file, kind, about, has_errors } = self;
        json!({ "file": file, "kind": kind, "about": about, "ok": !has_errors })
    }
}

fn unknown_domain(name: &Name) -> Diagnostic {
    Diagnostic::error(name.span(), format!("domain `{name}` is neither given nor beside this file"))
        .with_help("name the file of the domain on the command line too")
}

/// Returns a number of people in words.
fn people_count(count: usize) -> String {
    match count {
        1 => "1 person".to_owned(),
        count => format!("{count} people"),
    }
}

fn about_domain(domain: &Domain) -> String {
    let predicates = plural(domain.predicates.len(), "predicate");
    let actions = plural(domain.actions.len() + domain.durative_actions.len(), "action");
    format!("{} ({predicates}, {actions})", domain.name)
}

fn about_problem(problem: &pddl::Problem) -> String {
    format!("{} ({})", problem.name, plural(problem.objects.len(), "object"))
}

fn about_model(model: &pddl::ActionModel) -> String {
    let actions = plural(model.actions.len() + model.durative_actions.len(), "action");
    format!("{} ({actions})", model.agent)
}

fn about_ecosystem(ecosystem: &Ecosystem) -> String {
    let agents = plural(ecosystem.agents.len(), "agent");
    let place = match ecosystem.daemons.len() {
        0 => " on one machine".to_owned(),
        daemons => format!(", {}", plural(daemons, "daemon")),
    };
    let mode = match ecosystem.mode {
        Mode::Centralized => "centralized",
        Mode::Decentralized => "decentralized",
    };
    let interfaces = match ecosystem.interfaces.len() {
        0 => String::new(),
        interfaces => format!(", {}", plural(interfaces, "interface")),
    };
    format!("{} ({agents}{place}{interfaces}, {mode})", ecosystem.name)
}
