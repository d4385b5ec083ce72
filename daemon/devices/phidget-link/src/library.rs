//! Finds and loads `libphidget22`.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::ffi::{self, LibraryFunctions};

/// File names of the library: the name in Phidgets' own packages, and the name in a build from
/// source.
const NAMES: [&str; 2] = ["libphidget22.so.0", "libphidget22.so"];

/// Path of the library in the wheel `phidget22` from PyPI, below a folder of Python packages.
const IN_WHEEL: &str = "Phidget22/.libs/libphidget22.so";

/// Loaded libraries, by the argument of [`Library::load`]. A library is loaded once and never
/// unloaded.
static LOADED: Mutex<BTreeMap<Option<PathBuf>, Library>> = Mutex::new(BTreeMap::new());

/// The loaded library `libphidget22`. It stays loaded until the process ends, because it has
/// threads of its own.
#[derive(Clone, Copy)]
pub struct Library {
    pub(crate) functions: &'static LibraryFunctions,
}

/// Reason why `libphidget22` could not be loaded. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[error(
    "load libphidget22: {reason}; install it from www.phidgets.com, or `pip install phidget22` and \
     say where: library = \"…/site-packages\""
)]
pub struct LibraryError {
    reason: String,
}

impl Library {
    /// Loads the library from the system's folders if `from` is `None`; otherwise from the file or
    /// folder `from`. The folder contains the library, or is a virtual environment of Python or its
    /// `site-packages` with an installed `phidget22`.
    ///
    /// # Errors
    ///
    /// Returns an error if the library is missing, or the file is another library.
    pub fn load(from: Option<&Path>) -> Result<Library, LibraryError> {
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        let key = from.map(Path::to_owned);
        if let Some(known) = loaded.get(&key) {
            return Ok(*known);
        }
        let library = load(from).map_err(|reason| LibraryError { reason })?;
        loaded.insert(key, library);
        Ok(library)
    }

    /// Returns the version that the library reports.
    ///
    /// # Errors
    ///
    /// Returns an error if the library reports no version.
    pub fn version(&self) -> Result<String, ffi::CallError> {
        self.functions.version()
    }
}

fn load(from: Option<&Path>) -> Result<Library, String> {
    let candidates: Vec<OsString> = match from {
        None => NAMES.map(OsString::from).to_vec(),
        Some(folder) if folder.is_dir() => {
            let file = in_folder(folder).ok_or_else(|| {
                format!("there is none in {}, and no Python package that has it", folder.display())
            })?;
            vec![file.into_os_string()]
        }
        // The path is made absolute, because a bare name would be searched for in the system's
        // folders.
        Some(file) => match std::path::absolute(file) {
            Ok(file) if file.exists() => vec![file.into_os_string()],
            _ => return Err(format!("there is no {}", file.display())),
        },
    };
    let mut reasons = Vec::new();
    for candidate in &candidates {
        match LibraryFunctions::load(candidate) {
            Ok(functions) => return Ok(Library { functions }),
            Err(reason) => reasons.push(reason),
        }
    }
    // The first name is that of the packages; therefore its error is reported.
    Err(reasons.into_iter().next().unwrap_or_default())
}

/// Returns the path of the library in a folder, or in the Python packages below the folder; `None`
/// if there is none.
fn in_folder(folder: &Path) -> Option<PathBuf> {
    let here = NAMES.map(|name| folder.join(name));
    let in_packages = [folder.join(IN_WHEEL), folder.join(".libs/libphidget22.so")];
    let pythons = std::fs::read_dir(folder.join("lib")).into_iter().flatten().flatten();
    let in_environment = pythons.map(|python| python.path().join("site-packages").join(IN_WHEEL));
    here.into_iter().chain(in_packages).chain(in_environment).find(|file| file.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_found_in_a_folder_a_package_and_an_environment() {
        for (file, expected) in [
            ("libphidget22.so.0", true),
            ("libphidget22.so", true),
            (".libs/libphidget22.so", true),
            ("Phidget22/.libs/libphidget22.so", true),
            ("lib/python3.11/site-packages/Phidget22/.libs/libphidget22.so", true),
            ("libphidget21.so.0", false),
        ] {
            let folder = tempfile::tempdir().expect("a folder");
            let file = folder.path().join(file);
            std::fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
            std::fs::write(&file, "").expect("a file");
            assert_eq!(in_folder(folder.path()), expected.then_some(file));
        }
    }

    #[test]
    fn a_missing_library_is_reported_with_the_way_to_install_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let (empty, gone) = (folder.path().to_owned(), folder.path().join("gone.so"));
        let text = folder.path().join("text.so");
        std::fs::write(&text, "no library").expect("a file");
        for (from, expected) in
            [(empty, "there is none in /"), (gone, "there is no /"), (text, "file too short")]
        {
            let problem = Library::load(Some(&from)).err().expect("there is none").to_string();
            assert!(problem.starts_with("load libphidget22: "), "{problem}");
            assert!(problem.contains(expected), "{problem} is not {expected}");
            assert!(problem.contains("; install it from www.phidgets.com, or `pip install"));
        }
    }
}
