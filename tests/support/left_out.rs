//! Reports a test that cannot run because the machine lacks something it needs.
//!
//! The report goes to standard error and into `target/left-out.tsv`, one line per test: package,
//! Cargo's options for its target, test, reason. `.ci/run` runs exactly those tests again once it
//! has installed what they need, with `CI=true`, which makes such a report fail the test. Tests of
//! several crates include this file.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;

/// The file, below Cargo's target folder.
const FILE: &str = "left-out.tsv";

/// Reports that this test proves nothing here, and the reason.
///
/// # Panics
///
/// Panics if `CI=true`, because then every test has to run.
#[track_caller]
pub(crate) fn left_out(why: &str) {
    let why = why.split_whitespace().collect::<Vec<_>>().join(" ");
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("main");
    assert!(!is_strict(), "CI=true, and this cannot be tested: {why}");
    // Written directly to standard error: libtest captures the output of a test that passes.
    let _ = writeln!(std::io::stderr(), "\nNOT TESTED: {test}: {why}\n");
    let Some(file) = file() else { return };
    let line = format!("{}\t{}\t{test}\t{why}\n", env!("CARGO_PKG_NAME"), target());
    let noted = OpenOptions::new().create(true).append(true).open(&file);
    if let Err(error) = noted.and_then(|mut file| file.write_all(line.as_bytes())) {
        let _ = writeln!(std::io::stderr(), "failed to note it in {}: {error}", file.display());
    }
}

/// Whether a test that cannot run must fail.
pub(crate) fn is_strict() -> bool {
    std::env::var("CI").is_ok_and(|ci| ci == "true")
}

/// Cargo's options that select the target this file is compiled into.
fn target() -> String {
    match (option_env!("CARGO_TARGET_TMPDIR"), option_env!("CARGO_BIN_NAME")) {
        // Cargo sets this folder for integration tests only.
        (Some(_), _) => format!("--test {}", env!("CARGO_CRATE_NAME")),
        (None, Some(bin)) => format!("--bin {bin}"),
        (None, None) => "--lib".to_owned(),
    }
}

/// The file of reports, in Cargo's target folder: this program is `target/PROFILE/deps/NAME-HASH`.
fn file() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    Some(program.ancestors().nth(3)?.join(FILE))
}
