//! Plugin packages for tests: this repository's Python package, and its sensors as a program.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use super::left_out::left_out;

/// Whether there is a Python with Zenoh that can be confined; reports it if not.
pub(crate) fn has_python() -> bool {
    python().is_some()
}

/// Returns a Python that has Zenoh and runs a plugin in its confinement. Returns `None` with a
/// report if there is none. Tried are the program that `python3` really is, that of an active
/// virtual environment, and the system's.
pub(crate) fn python() -> Option<&'static Path> {
    match found_python() {
        Ok(python) => Some(python),
        Err(why) => {
            left_out(why);
            None
        }
    }
}

/// Returns the `PATH` for daemons with plugins that use `python3`; unchanged if the right Python is
/// first on it.
pub(crate) fn path() -> std::ffi::OsString {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = found_python().as_ref().ok();
    let folder = found.and_then(|python| python.parent());
    let is_first =
        on_path().is_some_and(|first| Some(first.as_path()) == found.map(PathBuf::as_path));
    match folder.filter(|_| !is_first) {
        Some(folder) => {
            let all = std::env::split_paths(&path).collect::<Vec<_>>();
            let all = std::iter::once(folder.to_owned()).chain(all);
            std::env::join_paths(all).expect("folders of a path")
        }
        None => path,
    }
}

/// Returns the first `python3` on the path; it may be a shim.
fn on_path() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut found = std::env::split_paths(&path).map(|folder| folder.join("python3"));
    found.find(|file| file.is_file())
}

/// Returns the result of the search, which is done once per test program.
fn found_python() -> &'static Result<PathBuf, String> {
    static FOUND: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    FOUND.get_or_init(find_python)
}

fn find_python() -> Result<PathBuf, String> {
    let active =
        std::env::var_os("VIRTUAL_ENV").map(|folder| Path::new(&folder).join("bin/python3"));
    let candidates = [on_path(), on_path().and_then(real), active, Some("/usr/bin/python3".into())];
    let mut looked_at: Vec<PathBuf> = Vec::new();
    let mut why = Vec::new();
    for python in candidates.into_iter().flatten() {
        if looked_at.contains(&python) || !python.is_file() {
            continue;
        }
        match is_of_use(&python) {
            Ok(()) => return Ok(python),
            Err(problem) => why.push(format!("{}: {problem}", python.display())),
        }
        looked_at.push(python);
    }
    let why = if why.is_empty() { "there is no python3".to_owned() } else { why.join("; ") };
    Err(format!("no Python that plugins can use: {why}: pip install eclipse-zenoh"))
}

/// Returns the program that a Python, or a shim of one, really runs.
fn real(python: PathBuf) -> Option<PathBuf> {
    let said = asked(&python, "import sys; print(sys.executable)").ok()?;
    Some(PathBuf::from(said.trim())).filter(|file| file.is_file())
}

/// Runs a line of Python; returns the last line that it prints.
fn asked(python: &Path, script: &str) -> Result<String, String> {
    let mut command = Command::new(python);
    command.args(["-c", script]).env_remove("PYTHONPATH").stdin(Stdio::null());
    let output = command.output().map_err(|error| error.to_string())?;
    let last = |bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes).into_owned();
        text.lines().last().unwrap_or_default().to_owned()
    };
    match output.status.success() {
        true => Ok(last(&output.stdout)),
        false => Err(last(&output.stderr)),
    }
}

/// Checks that a Python has Zenoh, outside and inside the confinement.
fn is_of_use(python: &Path) -> Result<(), String> {
    asked(python, "import zenoh")?;
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let package = folder.path().join("thermometer");
    copy(&thermometer(), &package);
    let rest = std::env::var_os("PATH").unwrap_or_default();
    let path = [python.parent().map(Path::to_owned).unwrap_or_default()].into_iter();
    let path = std::env::join_paths(path.chain(std::env::split_paths(&rest)));
    let mut check = Command::new(env!("CARGO_BIN_EXE_althing"));
    check.args(["plugin", "check"]).arg(&package).current_dir(folder.path());
    check.env("PATH", path.map_err(|error| error.to_string())?);
    let output = check.output().map_err(|error| error.to_string())?;
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
    }
}

/// Returns the folder of this repository's Python package.
pub(crate) fn thermometer() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../plugins/python/thermometer")
}

/// Copies a folder of files.
pub(crate) fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder").flatten() {
        fs::copy(entry.path(), to.join(entry.file_name())).expect("a file");
    }
}

/// Replaces a text in a file; the text must be there.
pub(crate) fn replace(file: &Path, was: &str, is: &str) {
    let text = fs::read_to_string(file).expect("a file");
    assert!(text.contains(was), "{was} is not in {}", file.display());
    fs::write(file, text.replace(was, is)).expect("a file");
}

/// Returns the plugin `sensor` as a program of its own.
pub(crate) fn sensor_process() -> PathBuf {
    let deps = std::env::current_exe().expect("this test");
    let folder = deps.ancestors().nth(2).expect("the profile's folder");
    let program = folder.join("examples/sensor-process");
    assert!(program.exists(), "build it: cargo build --workspace --example sensor-process");
    program
}
