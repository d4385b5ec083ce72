//! Reads every PDDL file of a folder, prints it, reads it back, checks it, and reports the results.
//!
//! `cargo run --release -p pddl --example roundtrip -- FOLDER`
//!
//! A problem is checked against its domain, which is searched for in the folder of the problem and
//! in the folder above. The program exits with 1 if a file has an error, or if the printed text
//! parses to a different tree.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use pddl::{
    Diagnostic, Document, Domain, Problem, check_domain, check_problem, parse_document,
    text_from_bytes,
};

/// Number of times that each file is read, because a single reading of a small file is too short to
/// measure.
const REPETITIONS: u32 = 5;

struct File {
    path: PathBuf,
    text: String,
    document: Option<Document>,
}

#[derive(Default)]
struct Tally {
    bytes: usize,
    errors: usize,
    warnings: usize,
    unequal: usize,
    unpaired: usize,
    reading: Duration,
    printing: Duration,
    checking: Duration,
}

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: roundtrip FOLDER");
        return ExitCode::FAILURE;
    };
    let mut paths = Vec::new();
    collect(&folder, &mut paths);
    paths.sort();
    let mut tally = Tally::default();
    let files: Vec<File> = paths.into_iter().filter_map(|path| tally.read(path)).collect();
    for file in &files {
        tally.check(file, &files);
    }
    tally.print(files.len());
    if tally.errors + tally.unequal > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

fn collect(folder: &Path, paths: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            collect(&path, paths);
        } else if path.extension().is_some_and(|extension| extension == "pddl") {
            paths.push(path);
        }
    }
}

/// Returns the domain that a problem refers to, from the folder of the problem or the folder above;
/// `None` if there is none. Of several domains, the one with a similar file name is preferred.
fn domain_of<'a>(file: &File, problem: &Problem, files: &'a [File]) -> Option<&'a Domain> {
    let stem = stem(&file.path);
    let token = stem.split(['-', '_']).next().unwrap_or(stem);
    let mut candidates = Vec::new();
    for other in files {
        let Some(Document::Domain(domain)) = &other.document else { continue };
        let folder = other.path.parent();
        let is_near =
            folder == file.path.parent() || folder == file.path.parent().and_then(Path::parent);
        if is_near && domain.name == problem.domain {
            candidates.push((self::stem(&other.path), domain));
        }
    }
    let alike = candidates.iter().find(|(other, _)| other.contains(token));
    let usual = candidates.iter().find(|(other, _)| *other == "domain");
    alike.or(usual).or(candidates.first()).map(|(_, domain)| *domain)
}

fn stem(path: &Path) -> &str {
    path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("")
}

impl Tally {
    fn read(&mut self, path: PathBuf) -> Option<File> {
        let text = match std::fs::read(&path) {
            Ok(bytes) => text_from_bytes(&bytes).into_owned(),
            Err(error) => {
                eprintln!("{}: {error}", path.display());
                return None;
            }
        };
        let started = Instant::now();
        for _ in 1..REPETITIONS {
            std::hint::black_box(parse_document(&text));
        }
        let parsed = parse_document(&text);
        self.reading += started.elapsed() / REPETITIONS;
        self.bytes += text.len();
        self.count(&path, &text, &parsed.diagnostics);
        let file = File { path, text, document: parsed.value };
        self.print_and_return(&file);
        Some(file)
    }

    fn print_and_return(&mut self, file: &File) {
        let started = Instant::now();
        let printed = file.document.as_ref().map(ToString::to_string);
        self.printing += started.elapsed();
        let returned = printed.and_then(|printed| parse_document(&printed).value);
        if returned.is_none() || returned != file.document {
            self.unequal += 1;
            println!("{}: comes back as another tree", file.path.display());
        }
    }

    fn check(&mut self, file: &File, files: &[File]) {
        let started = Instant::now();
        let diagnostics = match &file.document {
            Some(Document::Domain(domain)) => check_domain(domain),
            Some(Document::Problem(problem)) => match domain_of(file, problem, files) {
                Some(domain) => check_problem(domain, problem),
                None => {
                    self.unpaired += 1;
                    println!("{}: no domain found", file.path.display());
                    Vec::new()
                }
            },
            Some(Document::ActionModel(_)) | None => Vec::new(),
        };
        self.checking += started.elapsed();
        self.count(&file.path, &file.text, &diagnostics);
    }

    fn count(&mut self, path: &Path, text: &str, diagnostics: &[Diagnostic]) {
        for diagnostic in diagnostics {
            println!("{}:{}", path.display(), diagnostic.located(text));
            if diagnostic.is_error() {
                self.errors += 1;
            } else {
                self.warnings += 1;
            }
        }
    }

    fn print(&self, files: usize) {
        let megabytes = self.bytes as f64 / 1e6;
        let speed = |time: Duration| megabytes / time.as_secs_f64();
        println!(
            "{files} files, {megabytes:.1} MB: {} errors, {} warnings, {} come back unequal, \
             {} problems without a domain",
            self.errors, self.warnings, self.unequal, self.unpaired,
        );
        println!(
            "read at {:.0} MB/s, printed at {:.0} MB/s, checked at {:.0} MB/s",
            speed(self.reading),
            speed(self.printing),
            speed(self.checking),
        );
    }
}
