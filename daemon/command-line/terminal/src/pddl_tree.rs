//! Reads all PDDL files of a folder and its subfolders as `check` does, and counts the outcomes.
//!
//! - Folders are walked by name, so that the same tree gives the same result everywhere. Links to
//!   files are followed. Links to folders are not followed, so that there can be no cycle.
//! - A problem is checked against the domain with the most similar file name. This domain is beside
//!   the problem, in the folder above, or in a folder `domains`: the places where collections of
//!   problems keep domains.
//! - Texts are dropped once they are read; only the outcome of a file is kept.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pddl::{Document, Domain, Severity};

use crate::domain_search::distance;
use crate::pddl_files::{self, DomainText};
use crate::report::{DiagnosticReport, SourceText};

/// Outcomes of reading all files of a folder and the folders in it.
#[derive(Debug, Default)]
pub struct PddlTree {
    /// Outcome of each file, sorted by path.
    pub files: Vec<ReadFile>,
}

/// Outcome of reading one file.
#[derive(Debug)]
pub struct ReadFile {
    /// Path of the file.
    pub path: PathBuf,
    /// Kind of the file: “domain”, “problem”, “action model”, or “unknown”.
    pub kind: &'static str,
    /// File of the domain that a problem or action model was checked against; `None` if there is
    /// none.
    pub domain: Option<PathBuf>,
    /// Whether the file can be used, and why not.
    pub outcome: FileOutcome,
    /// Warnings about the file.
    pub warnings: Vec<String>,
}

/// The verdict on a PDDL file: whether it can be used, or why not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileOutcome {
    /// The file is valid, and plans can be made with it.
    Read,
    /// The file is valid, but uses this feature, which this version does not support.
    Unsupported(String),
    /// The file is a problem without errors, but its domain was not found. The text gives the
    /// reason.
    Alone(String),
    /// The file has errors: the place and text of the first one.
    Refused(String),
}

/// Number of files with each outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutcomeCounts {
    /// Number of all files.
    pub files: usize,
    /// Number of files that are valid and have no warnings.
    pub read: usize,
    /// Number of files that are valid and have warnings.
    pub odd: usize,
    /// Number of files that are valid, but use a feature that is not supported.
    pub unsupported: usize,
    /// Number of problems without errors for which no domain was found.
    pub alone: usize,
    /// Number of files with errors.
    pub refused: usize,
}

/// Domains read so far, by path. Problems with the same domain share it.
#[derive(Default)]
struct DomainCache {
    known: BTreeMap<PathBuf, Option<Arc<DomainText>>>,
    /// Files that contain a domain, by folder.
    folders: BTreeMap<PathBuf, Arc<Vec<PathBuf>>>,
}

/// Maximum number of domains kept in memory. When it is reached, all are dropped, and are read
/// again when they are needed.
const DOMAINS_KEPT: usize = 64;

/// Maximum number of files of one folder that are searched for a domain: the first ones by name.
const CANDIDATES_MAX: usize = 2_000;

/// Number of bytes at the beginning of a file that are read to find out which kind of file it is.
const HEAD_BYTES: usize = 4_096;

/// Reads every PDDL file below `folder`, and calls `tell` with the outcome of each file.
///
/// # Errors
///
/// Returns an error if `folder` is not a folder, or if it or a subfolder cannot be read. The
/// message completes the sentence “failed to …”. A file that cannot be read is not an error, but
/// the outcome of that file.
pub fn read(folder: &Path, tell: &mut dyn FnMut(&ReadFile)) -> Result<PddlTree, String> {
    if !folder.is_dir() {
        return Err(format!("read `{}`: it is not a folder", folder.display()));
    }
    let mut paths = Vec::new();
    walk(folder, &mut paths)
        .map_err(|err| format!("read `{}`: {}", folder.display(), crate::report::reason(&err)))?;
    paths.sort();
    let mut domains = DomainCache::default();
    let mut tree = PddlTree::default();
    for path in paths {
        let file = read_file(path, &mut domains);
        tell(&file);
        tree.files.push(file);
    }
    Ok(tree)
}

/// Collects the paths of all PDDL files below a folder. Uses no recursion, because a tree may be
/// deep.
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

fn read_file(path: PathBuf, domains: &mut DomainCache) -> ReadFile {
    let source = match SourceText::read(&path) {
        Ok(source) => source,
        Err(failure) => {
            let outcome = FileOutcome::Refused(format!("failed to {failure}"));
            return ReadFile { path, kind: "unknown", domain: None, outcome, warnings: Vec::new() };
        }
    };
    let mut report = DiagnosticReport::default();
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
        (FileOutcome::Read, Some(lacks)) => FileOutcome::Alone(lacks),
        (outcome, _) => outcome,
    };
    let warnings = report.findings().iter().map(|finding| &finding.diagnostic);
    let warnings = warnings.filter(|found| found.severity == Severity::Warning);
    let warnings = warnings.map(|found| found.message.clone()).collect();
    ReadFile { path, kind, domain: beside.map(|(path, _)| path), outcome, warnings }
}

/// Returns the feature of a domain that involves time, which is not supported. Returns `None` if
/// the domain has none.
fn time_in_domain(domain: &Domain) -> Option<&'static str> {
    (!domain.durative_actions.is_empty()).then_some("durative actions")
}

fn outcome(report: &DiagnosticReport, feature: Option<&str>) -> FileOutcome {
    let errors = || report.findings().iter().filter(|finding| finding.diagnostic.is_error());
    if let Some(found) = errors().find(|finding| finding.diagnostic.is_unsupported) {
        return FileOutcome::Unsupported(found.diagnostic.message.clone());
    }
    if let Some(found) = errors().next() {
        let place = found.source.as_ref().map(|source| {
            let (line, column) = source.line_column(found.diagnostic.span);
            format!("{line}:{column}: ")
        });
        return FileOutcome::Refused(place.unwrap_or_default() + &found.diagnostic.message);
    }
    match feature {
        Some(feature) => FileOutcome::Unsupported(format!("{feature} are not supported")),
        None => FileOutcome::Read,
    }
}

// === impl PddlTree ===

impl PddlTree {
    /// Returns the number of files with each outcome. Counts the files of the kind `kind`, or all
    /// files if it is `None`.
    pub fn counts(&self, kind: Option<&str>) -> OutcomeCounts {
        let mut counts = OutcomeCounts::default();
        for file in self.files.iter().filter(|file| kind.is_none_or(|kind| file.kind == kind)) {
            counts.files += 1;
            match &file.outcome {
                FileOutcome::Read if file.warnings.is_empty() => counts.read += 1,
                FileOutcome::Read => counts.odd += 1,
                FileOutcome::Unsupported(_) => counts.unsupported += 1,
                FileOutcome::Alone(_) => counts.alone += 1,
                FileOutcome::Refused(_) => counts.refused += 1,
            }
        }
        counts
    }
}

// === impl DomainCache ===

impl DomainCache {
    /// Returns the domain that most likely belongs to a problem. This is the first one with the
    /// same words in its file name, or with the domain name `name`, which the problem gives.
    /// Otherwise it is the one with the most similar file name. Returns `None` if no file fits.
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
                // The name of this file belongs to another problem.
                if fitness == OF_ANOTHER {
                    continue;
                }
                let Some(text) = self.text(&file) else { continue };
                let is_named = text.domain.as_ref().is_some_and(|domain| domain.name == *name);
                match fitness {
                    0 => return Some((file, text)),
                    _ if is_named => return Some((file, text)),
                    // The domain has another name, but is the best candidate so far: some
                    // collections have such pairs.
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
        let source = SourceText::read(path).ok();
        let text = source.map(|source| {
            Arc::new(pddl_files::domain_of(source, &mut DiagnosticReport::default()))
        });
        if self.known.len() >= DOMAINS_KEPT {
            self.known.clear();
        }
        self.known.insert(path.to_owned(), text.clone());
        text
    }

    /// Returns the files of a folder that begin with a domain definition.
    fn domain_files(&mut self, folder: &Path) -> Arc<Vec<PathBuf>> {
        if let Some(files) = self.folders.get(folder) {
            return Arc::clone(files);
        }
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        files.retain(|path| is_pddl(path) && path.is_file());
        files.sort();
        files.truncate(CANDIDATES_MAX);
        files.retain(|path| begins_with_domain(path));
        let files = Arc::new(files);
        self.folders.insert(folder.to_owned(), Arc::clone(&files));
        files
    }
}

/// Returns how badly the file name of `domain` fits that of `problem`. The result is 0 if both have
/// the same words apart from the kind of the file, as `domain-7` and `instance-7` have. Otherwise
/// it is one more than [`distance`].
fn fitness(domain: &Path, problem: &Path) -> usize {
    let words = |path: &Path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
        let words = stem.split(['-', '_', '.']).map(str::to_owned);
        words.filter(|word| !["domain", "problem", "instance"].contains(&word.as_str())).collect()
    };
    let (own, others): (Vec<String>, Vec<String>) = (words(domain), words(problem));
    if !own.is_empty() && own == others { 0 } else { 1 + distance(domain, problem) }
}

/// Result of [`fitness`] for a domain with a file name that belongs to another problem.
const OF_ANOTHER: usize = 3;

/// Whether a file begins with a domain definition, apart from comments.
fn begins_with_domain(path: &Path) -> bool {
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
        // The comment at the top may be longer than the part that was read. In that case the file
        // name decides.
        || !words.contains(&"define")
            && path.file_stem().is_some_and(|stem| {
                stem.to_string_lossy().to_lowercase().contains("domain")
            })
}
