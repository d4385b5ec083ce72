//! Packages of plugins: that of this repository in Python, and its sensors as a program.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Whether there is a Python that has Zenoh; says so loudly where not.
pub(crate) fn has_python() -> bool {
    let has_zenoh = Command::new("python3").args(["-c", "import zenoh"]).output();
    if has_zenoh.is_ok_and(|output| output.status.success()) {
        return true;
    }
    assert!(std::env::var_os("CI").is_none(), "python3 has no zenoh");
    // Past what libtest swallows of a test that passes.
    let _ =
        writeln!(std::io::stderr(), "NOT TESTED: python3 has no zenoh: pip install eclipse-zenoh");
    false
}

/// The package in Python that this repository has.
pub(crate) fn thermometer() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../plugins/python/thermometer")
}

/// Copies a folder of files.
pub(crate) fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder").flatten() {
        fs::copy(entry.path(), to.join(entry.file_name())).expect("a file");
    }
}

/// Changes a text in a file, which is there.
pub(crate) fn replace(file: &Path, was: &str, is: &str) {
    let text = fs::read_to_string(file).expect("a file");
    assert!(text.contains(was), "{was} is not in {}", file.display());
    fs::write(file, text.replace(was, is)).expect("a file");
}

/// The plugin `sensor`, linked into a program of its own.
pub(crate) fn sensor_process() -> PathBuf {
    let deps = std::env::current_exe().expect("this test");
    let folder = deps.ancestors().nth(2).expect("the profile's folder");
    let program = folder.join("examples/sensor-process");
    assert!(program.exists(), "build it: cargo build --workspace --example sensor-process");
    program
}
