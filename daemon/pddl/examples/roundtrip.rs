//! Reads every PDDL file of a folder, prints it, reads it back, and says how it went.
//!
//! `cargo run --release -p pddl --example roundtrip -- FOLDER`
//!
//! Exits with 1 if a file has an error or does not come back as the tree it was.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use pddl::{Diagnostic, Document, parse_document, text_from_bytes};

/// Enough repetitions that a small file is not measured with a clock that is too coarse.
const REPETITIONS: u32 = 5;

#[derive(Default)]
struct Tally {
    files: usize,
    bytes: usize,
    errors: usize,
    warnings: usize,
    unequal: usize,
    reading: Duration,
}

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: roundtrip FOLDER");
        return ExitCode::FAILURE;
    };
    let mut files = Vec::new();
    collect(&folder, &mut files);
    files.sort();
    let mut tally = Tally::default();
    for file in &files {
        match std::fs::read(file) {
            Ok(bytes) => read(file, &text_from_bytes(&bytes), &mut tally),
            Err(error) => eprintln!("{}: {error}", file.display()),
        }
    }
    tally.print();
    if tally.errors + tally.unequal > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "pddl") {
            files.push(path);
        }
    }
}

fn read(file: &Path, text: &str, tally: &mut Tally) {
    let started = Instant::now();
    for _ in 1..REPETITIONS {
        std::hint::black_box(parse_document(text));
    }
    let parsed = parse_document(text);
    tally.reading += started.elapsed() / REPETITIONS;
    tally.files += 1;
    tally.bytes += text.len();
    tally.count(file, text, &parsed.diagnostics);
    let returned: Option<Document> =
        parsed.value.as_ref().and_then(|document| parse_document(&document.to_string()).value);
    if returned.is_none() || returned != parsed.value {
        tally.unequal += 1;
        println!("{}: comes back as another tree", file.display());
    }
}

impl Tally {
    fn count(&mut self, file: &Path, text: &str, diagnostics: &[Diagnostic]) {
        for diagnostic in diagnostics {
            println!("{}:{}", file.display(), diagnostic.located(text));
            if diagnostic.is_error() {
                self.errors += 1;
            } else {
                self.warnings += 1;
            }
        }
    }

    fn print(&self) {
        let megabytes = self.bytes as f64 / 1e6;
        println!(
            "{} files, {} errors, {} warnings, {} come back unequal; {:.1} MB at {:.0} MB/s",
            self.files,
            self.errors,
            self.warnings,
            self.unequal,
            megabytes,
            megabytes / self.reading.as_secs_f64(),
        );
    }
}
