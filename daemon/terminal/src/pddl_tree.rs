//! Whole folders of PDDL: every file is read as `check` reads it, and what becomes of it is counted.
//!
//! - Folders are walked by name, so that the same tree gives the same answer everywhere. Links are
//!   followed to files and not to folders: there is no way round in a circle.
//! - A problem is checked against the domain beside it that its file's name fits best, or in the
//!   folder above or a folder `domains`, as collections of problems have them.
//! - Texts are let go once they are read: what is kept of a file is its outcome.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pddl::{Document, Domain, Severity};

use crate::beside::distance;
use crate::pddl_files::{self, DomainText};
use crate::report::{Report, Source};

/// What all files of a tree came to.
#[derive(Debug, Default)]
pub struct Tree {
    /// In the order of their paths.
    pub files: Vec<ReadFile>,
}

/// What one file came to.
#[derive(Debug)]
pub struct ReadFile {
    /// The file.
    pub path: PathBuf,
    /// “domain”, “problem”, “action model”, or “unknown”.
    pub kind: &'static str,
    /// The domain that a problem was checked against.
    pub domain: Option<PathBuf>,
    /// Whether it can be used.
    pub outcome: Outcome,
    /// The oddities that it was read in spite of.
    pub warnings: Vec<String>,
}

/// Whether a file can be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It is read and can be planned with.
    Read,
    /// It is read, and means what this version does not plan with.
    Unsupported(String),
    /// It is a problem, and its domain is not there.
    Alone(String),
    /// It is refused: the place and the first mistake.
    Refused(String),
}

/// How many files have each outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// All.
    pub files: usize,
    /// Read without a word.
    pub read: usize,
    /// Read with warnings.
    pub odd: usize,
    /// Read, and not planned with.
    pub unsupported: usize,
    /// Problems whose domain is not there.
    pub alone: usize,
    /// Refused.
    pub refused: usize,
}

/// The domains met so far, by path; problems share them.
#[derive(Default)]
struct Domains {
    known: BTreeMap<PathBuf, Option<Arc<DomainText>>>,
    /// By folder: its files that hold a domain.
    folders: BTreeMap<PathBuf, Arc<Vec<PathBuf>>>,
}

/// Domains that are kept read; more are read again when they are asked for.
const DOMAINS_KEPT: usize = 64;

/// Files of one folder that are looked into for a domain.
const CANDIDATES_MAX: usize = 2_000;

/// Bytes at the beginning of a file in which it says what it is.
const HEAD_BYTES: usize = 4_096;

/// Reads every PDDL file below `folder`; `tell` hears of each.
pub fn read(folder: &Path, tell: &mut dyn FnMut(&ReadFile)) -> Result<Tree, String> {
    if !folder.is_dir() {
        return Err(format!("read `{}`: it is no folder", folder.display()));
    }
    let mut paths = Vec::new();
    walk(folder, &mut paths)
        .map_err(|err| format!("read `{}`: {}", folder.display(), crate::report::reason(&err)))?;
    paths.sort();
    let mut domains = Domains::default();
    let mut tree = Tree::default();
    for path in paths {
        let file = read_file(path, &mut domains);
        tell(&file);
        tree.files.push(file);
    }
    Ok(tree)
}

/// All PDDL files below a folder, without recursion: a tree may be deep.
fn walk(folder: &Path, paths: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder)? {
            let entry = entry?;
            let path = entry.path();
            if entry.file_type()?.is_dir() {
                open.push(path);
            } else if is_pddl(&path) && path.is_file() {
                paths.push(path);
            }
        }
    }
    Ok(())
}

fn is_pddl(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("pddl"))
}

fn read_file(path: PathBuf, domains: &mut Domains) -> ReadFile {
    let source = match Source::read(&path) {
        Ok(source) => source,
        Err(failure) => {
            let outcome = Outcome::Refused(format!("failed to {failure}"));
            return ReadFile { path, kind: "unknown", domain: None, outcome, warnings: Vec::new() };
        }
    };
    let mut report = Report::default();
    let (mut beside, mut lacks) = (None, None);
    let (kind, feature) = match pddl::parse_document(&source.text).value {
        Some(Document::Domain(_)) => {
            let text = pddl_files::domain_of(source, &mut report);
            ("domain", text.domain.as_ref().and_then(time_in_domain))
        }
        Some(Document::Problem(problem)) => {
            beside = domains.of(&path, problem.domain.as_str());
            let domain = beside.as_ref().map(|(_, text)| &**text);
            let later = problem.timed_literal().map(|_| "timed initial literals");
            let feature = later.or_else(|| domain?.domain.as_ref().and_then(time_in_domain));
            pddl_files::problem_of(&source, domain, &mut report);
            lacks =
                domain.is_none().then(|| format!("no domain `{}` is beside it", problem.domain));
            ("problem", feature)
        }
        Some(Document::ActionModel(model)) => {
            beside = domains.of(&path, model.domain.as_str());
            let domain = beside.as_ref().map(|(_, text)| &**text);
            pddl_files::action_model_of(&source, domain, &mut report);
            ("action model", None)
        }
        None => {
            report.add(&source, pddl::parse_document(&source.text).diagnostics);
            ("unknown", None)
        }
    };
    let outcome = match (outcome(&report, feature), lacks) {
        (Outcome::Read, Some(lacks)) => Outcome::Alone(lacks),
        (outcome, _) => outcome,
    };
    let warnings = report.findings().iter().map(|finding| &finding.diagnostic);
    let warnings = warnings.filter(|found| found.severity == Severity::Warning);
    let warnings = warnings.map(|found| found.message.clone()).collect();
    ReadFile { path, kind, domain: beside.map(|(path, _)| path), outcome, warnings }
}

/// What has to do with time in a domain.
fn time_in_domain(domain: &Domain) -> Option<&'static str> {
    (!domain.durative_actions.is_empty()).then_some("durative actions")
}

fn outcome(report: &Report, feature: Option<&str>) -> Outcome {
    let errors = || report.findings().iter().filter(|finding| finding.diagnostic.is_error());
    if let Some(found) = errors().find(|finding| finding.diagnostic.is_unsupported) {
        return Outcome::Unsupported(found.diagnostic.message.clone());
    }
    if let Some(found) = errors().next() {
        let place = found.source.as_ref().map(|source| {
            let (line, column) = source.line_column(found.diagnostic.span);
            format!("{line}:{column}: ")
        });
        return Outcome::Refused(place.unwrap_or_default() + &found.diagnostic.message);
    }
    match feature {
        Some(feature) => Outcome::Unsupported(format!("{feature} are not supported")),
        None => Outcome::Read,
    }
}

// === impl Tree ===

impl Tree {
    /// How many files of this kind have each outcome; of `None`, of all kinds.
    pub fn counts(&self, kind: Option<&str>) -> Counts {
        let mut counts = Counts::default();
        for file in self.files.iter().filter(|file| kind.is_none_or(|kind| file.kind == kind)) {
            counts.files += 1;
            match &file.outcome {
                Outcome::Read if file.warnings.is_empty() => counts.read += 1,
                Outcome::Read => counts.odd += 1,
                Outcome::Unsupported(_) => counts.unsupported += 1,
                Outcome::Alone(_) => counts.alone += 1,
                Outcome::Refused(_) => counts.refused += 1,
            }
        }
        counts
    }
}

// === impl Domains ===

impl Domains {
    /// The domain that a problem most likely belongs to: by the names of files, then by the name that
    /// the problem gives.
    fn of(&mut self, problem: &Path, name: &str) -> Option<(PathBuf, Arc<DomainText>)> {
        let folder = problem.parent()?;
        let above = folder.parent().map(Path::to_owned);
        let folders = [
            Some(folder.to_owned()),
            above.clone(),
            Some(folder.join("domains")),
            above.as_ref().map(|above| above.join("domains")),
            above.map(|above| above.join("domain")),
        ];
        let mut found: Option<(PathBuf, Arc<DomainText>)> = None;
        for folder in folders.into_iter().flatten() {
            let mut files: Vec<PathBuf> = self.domain_files(&folder).to_vec();
            files.sort_by_cached_key(|path| (fitness(path, problem), path.clone()));
            for file in files {
                let fitness = fitness(&file, problem);
                // It says that it belongs to another problem.
                if fitness == OF_ANOTHER {
                    continue;
                }
                let Some(text) = self.text(&file) else { continue };
                let is_named = text.domain.as_ref().is_some_and(|domain| domain.name == *name);
                match fitness {
                    0 => return Some((file, text)),
                    _ if is_named => return Some((file, text)),
                    // Of another name, and yet the only one there: collections have such.
                    _ => drop(found.get_or_insert((file, text))),
                }
            }
        }
        found
    }

    fn text(&mut self, path: &Path) -> Option<Arc<DomainText>> {
        if let Some(known) = self.known.get(path) {
            return known.clone();
        }
        let source = Source::read(path).ok();
        let text =
            source.map(|source| Arc::new(pddl_files::domain_of(source, &mut Report::default())));
        if self.known.len() >= DOMAINS_KEPT {
            self.known.clear();
        }
        self.known.insert(path.to_owned(), text.clone());
        text
    }

    /// The files of a folder that say in their first lines that they are domains.
    fn domain_files(&mut self, folder: &Path) -> Arc<Vec<PathBuf>> {
        if let Some(files) = self.folders.get(folder) {
            return Arc::clone(files);
        }
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        files.retain(|path| is_pddl(path) && path.is_file());
        files.sort();
        files.truncate(CANDIDATES_MAX);
        files.retain(|path| says_domain(path));
        let files = Arc::new(files);
        self.folders.insert(folder.to_owned(), Arc::clone(&files));
        files
    }
}

/// How unlikely a file is to be the domain of a problem, by their names alone: 0 where both have the
/// same words but for what they are (`domain-7` and `instance-7`), else as `check` judges it.
fn fitness(domain: &Path, problem: &Path) -> usize {
    let words = |path: &Path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
        let words = stem.split(['-', '_', '.']).map(str::to_owned);
        words.filter(|word| !["domain", "problem", "instance"].contains(&word.as_str())).collect()
    };
    let (own, others): (Vec<String>, Vec<String>) = (words(domain), words(problem));
    if !own.is_empty() && own == others { 0 } else { 1 + distance(domain, problem) }
}

/// The fitness of a domain whose file has the name of another problem.
const OF_ANOTHER: usize = 3;

/// Whether the first words of a file, comments left out, define a domain.
fn says_domain(path: &Path) -> bool {
    use std::io::Read as _;
    let Ok(file) = std::fs::File::open(path) else { return false };
    let mut head = Vec::new();
    if file.take(HEAD_BYTES as u64).read_to_end(&mut head).is_err() {
        return false;
    }
    let text = pddl::text_from_bytes(&head).to_lowercase();
    let code: String =
        text.lines().map(|line| line.split(';').next().unwrap_or("")).collect::<Vec<_>>().join(" ");
    let words: Vec<&str> = code.split(|c: char| c.is_whitespace() || "()".contains(c)).collect();
    let words: Vec<&str> = words.into_iter().filter(|word| !word.is_empty()).collect();
    words.windows(2).any(|pair| pair == ["define", "domain"])
        // The comment at the top may be longer than what was read.
        || !words.contains(&"define")
            && path.file_stem().is_some_and(|stem| {
                stem.to_string_lossy().to_lowercase().contains("domain")
            })
}
