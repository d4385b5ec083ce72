//! Checks words that source must not contain: effects in the pure crates, `unwrap` in production,
//! Rust in data.

use crate::folders::folder_of;
use crate::layers::PURE;
use crate::source::{code, line_of, production, read, rust_files, words};
use crate::{none, root};

/// Words that no pure crate contains: each stands for waiting, a clock, the environment, a file or
/// a log.
const EFFECTS: &[&str] = &[
    "async",
    "await",
    "Instant",
    "SystemTime",
    "env",
    "fs",
    "net",
    "tracing",
    "print",
    "println",
    "eprint",
    "eprintln",
];

/// Words that print without `terminal::output`, which makes control characters from other agents
/// visible.
const PRINTS: &[&str] = &["print", "println", "eprint", "eprintln", "stdout", "stderr"];

/// Files that may contain these words, with reasons.
const PRINTS_ITSELF: &[(&str, &str)] = &[
    ("daemon/command-line/terminal/src/output.rs", "it is that place"),
    (
        "daemon/command-line/terminal/src/formatting.rs",
        "asks whether there is a terminal, and how wide it is",
    ),
    ("daemon/command-line/terminal/src/render.rs", "asks how wide the terminal is"),
    ("daemon/command-line/althing/src/prompt/input.rs", "asks whether there is a terminal"),
    ("daemon/command-line/althing/src/interruption.rs", "waits for a reader to go away"),
    ("daemon/command-line/althing-plan/src/progress.rs", "asks whether there is a terminal"),
    (
        "daemon/command-line/althing/src/commands/plugin/allow.rs",
        "asks whether there is a terminal",
    ),
];

/// Returns the places in `code` that print, or that name a stream to print to.
fn prints(code: &str) -> Vec<(usize, &str)> {
    let said = |(start, word): &(usize, &str)| {
        let rest = code[start + word.len()..].trim_start();
        let before = code[..*start].trim_end();
        // A method or a field of another value is not the stream.
        let is_call = rest.starts_with('!') || rest.starts_with("()");
        is_call && !before.ends_with('.') && !before.ends_with("fn")
    };
    let found = words(code).filter(|(_, word)| PRINTS.contains(word)).filter(said);
    found.map(|(start, word)| (line_of(code, start), word)).collect()
}

/// Returns the words of `code` that are effects, with their lines.
fn effects(code: &str) -> Vec<(usize, &str)> {
    words(code)
        .filter(|(_, word)| EFFECTS.contains(word))
        .map(|(start, word)| (line_of(code, start), word))
        .collect()
}

/// Returns the lines of `code` that call `unwrap`.
fn unwraps(code: &str) -> Vec<usize> {
    code.match_indices(".unwrap()").map(|(start, _)| line_of(code, start)).collect()
}

/// Whether a file begins with a comment on its purpose.
fn opens_with_its_role(source: &str) -> bool {
    source.starts_with("//! ")
}

#[test]
fn pure_crates_have_no_effects() {
    let mut complaints = Vec::new();
    for name in PURE {
        let files = production(&folder_of(name));
        assert!(!files.is_empty(), "`{name}` is gone, so this test looks at nothing");
        for (path, code) in files {
            complaints.extend(
                effects(&code)
                    .into_iter()
                    .map(|(line, word)| format!("{}:{line}: `{word}`", path.display())),
            );
        }
    }
    none(&complaints, "the pure crates do not wait, read clocks or files, or log");
}

#[test]
fn production_unwraps_nothing() {
    let folders = ["daemon", "plugins"].map(|folder| root().join(folder));
    let complaints: Vec<_> = folders
        .iter()
        .flat_map(|folder| production(folder))
        .flat_map(|(path, code)| {
            let at = move |line| format!("{}:{line}", path.display());
            unwraps(&code).into_iter().map(at).collect::<Vec<_>>()
        })
        .collect();
    none(&complaints, "production has no `unwrap()`: `expect(\"invariant: …\")` where proven");
}

/// Benchmarks, examples and plugin processes may print directly.
#[test]
fn everything_printed_goes_through_one_place() {
    let mut complaints = Vec::new();
    let mut needed = Vec::new();
    for name in ["althing", "althing-plan", "terminal", "plugin-host", "engines", "agent"] {
        for (path, code) in production(&folder_of(name).join("src")) {
            let file = path.strip_prefix(root()).unwrap_or(&path).display().to_string();
            let found = prints(&code);
            if PRINTS_ITSELF.iter().any(|(known, _)| *known == file) {
                needed.extend((!found.is_empty()).then_some(file));
                continue;
            }
            let at = |(line, word)| format!("{file}:{line}: `{word}`");
            complaints.extend(found.into_iter().map(at));
        }
    }
    let unused = PRINTS_ITSELF.iter().filter(|(known, _)| !needed.iter().any(|file| file == known));
    complaints.extend(unused.map(|(file, why)| format!("{file} prints nothing: drop “{why}”")));
    none(&complaints, "everything printed goes through `terminal::output`");
}

#[test]
fn every_file_opens_with_its_role() {
    let complaints: Vec<_> = ["daemon", "plugins", "tests"]
        .iter()
        .flat_map(|folder| rust_files(&root().join(folder)))
        .filter(|path| !opens_with_its_role(&read(path)))
        .map(|path| path.display().to_string())
        .collect();
    none(&complaints, "every file opens with `//!`: what it is for, and what it leaves to others");
}

#[test]
fn buildings_are_files_only() {
    for folder in ["domains", "ecosystems"] {
        assert!(root().join(folder).is_dir(), "`{folder}` is gone, so this test looks at nothing");
        let rust: Vec<_> = rust_files(&root().join(folder))
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        none(&rust, "`domains/` and `ecosystems/` hold no Rust");
    }
}

// === the rules can fail ===

#[test]
fn effects_are_found_in_code_only() {
    for (source, expected) in [
        ("pub async fn wait() {}", 1),
        ("use std::time::{Duration, Instant};", 1),
        ("use std::{env, iter};", 1),
        ("fn a() { println!(\"x\"); }", 1),
        ("fn instantiate(task: Instantiation) {} // Instant, async", 0),
        ("const HELP: &str = \"async println\";", 0),
    ] {
        assert_eq!(effects(&code(source)).len(), expected, "{source}");
    }
}

#[test]
fn printing_is_found() {
    for (source, expected) in [
        ("fn a() { println!(\"x\"); }", 1),
        ("fn a() { std::io::stderr().write(b) }", 1),
        ("fn a() { output::print(\"x\", 0); let stdout = stdout(&run); }", 0),
        ("fn a() { run.stdout(); command.stderr(pipe) }", 0),
        ("fn print() {} fn stdout() {}", 0),
    ] {
        assert_eq!(prints(&code(source)).len(), expected, "{source}");
    }
}

#[test]
fn unwraps_are_found_in_code_only() {
    assert_eq!(unwraps(&code("fn a() {\n  b.unwrap();\n}")), [2]);
    assert!(unwraps(&code("// b.unwrap()\nfn a() { b.unwrap_or(\".unwrap()\") }")).is_empty());
}

#[test]
fn a_file_without_a_role_is_found() {
    assert!(opens_with_its_role("//! What it is for.\n"));
    assert!(!opens_with_its_role("use std::fmt;\n//! Late.\n"));
}
