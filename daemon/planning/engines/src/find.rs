//! Finds an external engine: at the configured path, or on `PATH`. Fast Downward may also be in an
//! installed Python package.
//!
//! - `ALTHING_FAST_DOWNWARD` and `ALTHING_METRIC_FF` give the path of the engine's program. If the
//!   variable of an engine is set, its value is used without a further search.
//! - `pip install up-fast-downward` installs the driver script as data of a package, not as a
//!   program on `PATH`. Each `python3` and `python` on `PATH` is run to find the folder of that
//!   package. The package is not imported, because that takes a second and requires its
//!   dependencies.

use std::env;
use std::ffi::{OsStr, OsString};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::engine::ExternalEngine;
use crate::outcome::EngineError;

/// An installed engine: the command that starts it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Installation {
    pub(crate) engine: ExternalEngine,
    /// The path of the engine's program, and its first arguments.
    pub(crate) command: Vec<OsString>,
}

/// Python script that prints the folder of the package `up-fast-downward`, or exits with 1 if that
/// package is not installed.
const WHERE: &str = "import importlib.util, sys
spec = importlib.util.find_spec('up_fast_downward')
sys.exit(1) if spec is None else print(list(spec.submodule_search_locations)[0])";

// === impl Installation ===

impl Installation {
    /// Creates the installation of an engine from the command that starts it, for example `python3
    /// fast-downward.py`.
    pub fn of(
        engine: ExternalEngine,
        command: impl IntoIterator<Item = impl Into<OsString>>,
    ) -> Installation {
        Installation { engine, command: command.into_iter().map(Into::into).collect() }
    }

    /// Returns the command that starts the engine: the path of its program, and the first
    /// arguments.
    pub fn command(&self) -> &[OsString] {
        &self.command
    }

    /// Finds an engine on this machine.
    ///
    /// # Errors
    ///
    /// Returns [`EngineError::NotFound`] if the environment variable of the engine does not give
    /// the path of a program. If the variable is not set, returns the error if the engine is
    /// neither on `PATH` nor installed in a Python on `PATH`.
    pub fn find(engine: ExternalEngine) -> Result<Installation, EngineError> {
        if let Some(configured) = env::var_os(engine.variable()).filter(|it| !it.is_empty()) {
            return configured_at(engine, PathBuf::from(configured));
        }
        let path = env::var_os("PATH").unwrap_or_default();
        on_path(engine, &path)
            .or_else(|| match engine {
                ExternalEngine::FastDownward => in_a_python(&path),
                ExternalEngine::MetricFf => None,
            })
            .ok_or(EngineError::NotFound { engine, configured: None })
    }
}

fn configured_at(engine: ExternalEngine, program: PathBuf) -> Result<Installation, EngineError> {
    if !is_program(&program) {
        return Err(EngineError::NotFound { engine, configured: Some(program) });
    }
    // The program runs in another folder, so its path must be absolute.
    let program = std::path::absolute(&program).unwrap_or(program);
    Ok(Installation::of(engine, [program]))
}

fn on_path(engine: ExternalEngine, path: &OsStr) -> Option<Installation> {
    let found = engine.programs().iter().find_map(|name| programs(path, name).next())?;
    Some(Installation::of(engine, [found]))
}

/// Returns the command that runs the driver script of Fast Downward with the first Python on `path`
/// that has this script; `None` if there is none.
fn in_a_python(path: &OsStr) -> Option<Installation> {
    let pythons = ["python3", "python"].into_iter().flat_map(|name| programs(path, name));
    pythons.into_iter().find_map(|python| {
        let driver = driver_in(&python)?;
        Some(Installation::of(
            ExternalEngine::FastDownward,
            [python.into_os_string(), driver.into()],
        ))
    })
}

fn driver_in(python: &Path) -> Option<PathBuf> {
    // Python runs in `/`, so that it does not find a package in the current folder instead.
    let output = Command::new(python)
        .args(["-c", WHERE])
        .current_dir("/")
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .ok()?;
    let printed = String::from_utf8(output.stdout).ok()?;
    let driver = Path::new(printed.trim()).join("downward").join("fast-downward.py");
    (output.status.success() && driver.is_file()).then_some(driver)
}

/// Returns the executable files called `name` in the folders of `path`, in the order of these
/// folders.
fn programs(path: &OsStr, name: &str) -> impl Iterator<Item = PathBuf> {
    // An empty part stands for the current folder, which is hardly ever intended.
    let folders = env::split_paths(path).filter(|folder| !folder.as_os_str().is_empty());
    let folders: Vec<PathBuf> = folders.collect();
    let candidates = folders.into_iter().map(move |folder| folder.join(name));
    // A folder of `PATH` may be relative, but the program runs in another folder.
    candidates.filter(|program| is_program(program)).filter_map(|it| std::path::absolute(it).ok())
}

fn is_program(path: &Path) -> bool {
    let is_executable = |metadata: std::fs::Metadata| {
        metadata.is_file() && metadata.permissions().mode() & 0o111 != 0
    };
    path.metadata().is_ok_and(is_executable)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configured_path_is_used_without_a_fallback() {
        let shell =
            configured_at(ExternalEngine::MetricFf, PathBuf::from("/bin/sh")).expect("a program");
        assert_eq!(shell, Installation::of(ExternalEngine::MetricFf, ["/bin/sh"]));
        let nowhere = configured_at(ExternalEngine::MetricFf, PathBuf::from("/nowhere/ff"));
        let err = nowhere.expect_err("nothing is there");
        assert_eq!(err.to_string(), "find Metric-FF at `/nowhere/ff`");
        assert!(err.help().is_some_and(|help| help.contains("ALTHING_METRIC_FF")));
    }

    #[test]
    fn programs_are_found_on_the_path_and_folders_are_not() {
        let path = OsStr::new("/nowhere:/:/bin");
        assert_eq!(programs(path, "sh").next(), Some(PathBuf::from("/bin/sh")));
        assert_eq!(programs(path, "bin").next(), None, "`/bin` is a folder");
        assert_eq!(on_path(ExternalEngine::FastDownward, OsStr::new("/nowhere")), None);
    }

    #[test]
    fn the_error_for_a_missing_engine_explains_how_to_install_it() {
        let err = EngineError::NotFound { engine: ExternalEngine::FastDownward, configured: None };
        assert_eq!(err.to_string(), "find Fast Downward");
        let help = err.help().expect("help");
        assert!(help.contains("pip install up-fast-downward"), "{help}");
        assert!(help.contains("ALTHING_FAST_DOWNWARD"), "{help}");
    }
}
