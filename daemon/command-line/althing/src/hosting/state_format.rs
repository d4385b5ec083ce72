//! The format of a daemon's state folder.
//!
//! One number stands for all files in the folder that have no number of their own (docs/packages.md,
//! “Formats of the state”, lists the others). A version that writes one of them in another way raises
//! the number, and reads the format before it. So a daemon of an older version never takes such a
//! file for a broken one.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use acl::{DaemonId, EcosystemId};
use serde::{Deserialize, Serialize};

use super::folders::{FolderError, state_base, state_folder};

/// Format of the state that this version writes, which is also the newest that it reads. A folder
/// without a number has format 1: versions before this one wrote none.
pub(crate) const STATE_FORMAT: u64 = 1;

/// Name of the file with the number.
const FILE: &str = "format.json";

/// The content of the file.
#[derive(Debug, Serialize, Deserialize)]
struct StateVersion {
    format: u64,
    /// Version of the program that wrote the state last.
    #[serde(default)]
    written_by: String,
}

/// Reason why a state folder cannot be used. The message completes the sentence “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum StateFormatError {
    /// A newer version wrote the state.
    #[error(
        "use the state in {}: althing {written_by} wrote it (format {found}; this version reads up \
         to {STATE_FORMAT}); install that version again, or restore a backup that this one made: \
         althing restore FILE --replace",
        folder.display()
    )]
    Newer {
        /// The folder, which is left as it is.
        folder: PathBuf,
        /// Number of the format of the state.
        found: u64,
        /// Version that wrote the state last.
        written_by: String,
    },
    /// The number cannot be read or written.
    #[error("use {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error that the operating system reports.
        #[source]
        source: io::Error,
    },
    /// The folder cannot be used.
    #[error("{0}")]
    Folder(#[from] FolderError),
}

/// Checks that this version can read the state of a daemon, and writes its own number there. Nothing
/// else in the folder is read or written before.
///
/// # Errors
///
/// Returns an error if a newer version wrote the state, or if the folder cannot be used.
pub(crate) fn claim_state(
    ecosystem: &EcosystemId,
    daemon: &DaemonId,
) -> Result<(), StateFormatError> {
    // Before the folder is made or its permissions are changed.
    check_state(&state_base().join(ecosystem.as_str()).join(daemon.as_str()))?;
    let folder = state_folder(ecosystem, daemon)?;
    let path = folder.join(FILE);
    let failed = |source| StateFormatError::Io { path: path.clone(), source };
    let written_by = env!("CARGO_PKG_VERSION").to_owned();
    let text = serde_json::to_vec(&StateVersion { format: STATE_FORMAT, written_by });
    let text = text.map_err(io::Error::other).map_err(failed)?;
    if fs::read(&path).is_ok_and(|before| before == text) {
        return Ok(());
    }
    agent::replace_file(&path, &text).map_err(failed)
}

/// Checks that this version can read the state in `folder`, and writes nothing. A folder that does not
/// exist can be read.
///
/// # Errors
///
/// Returns an error if a newer version wrote the state, or if its number cannot be read.
pub(crate) fn check_state(folder: &Path) -> Result<(), StateFormatError> {
    let path = folder.join(FILE);
    let text = match fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(source) => return Err(StateFormatError::Io { path, source }),
    };
    // The file is written as a whole; a torn one is of a disk that lost it, and says nothing.
    let Ok(version) = serde_json::from_slice::<StateVersion>(&text) else {
        tracing::warn!(file = %path.display(), "the format of the state cannot be read");
        return Ok(());
    };
    if version.format > STATE_FORMAT {
        return Err(StateFormatError::Newer {
            folder: folder.to_owned(),
            found: version.format,
            written_by: terminal::visible::line(&version.written_by).into_owned(),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_newer_state_is_refused_by_name_and_left_as_it_is() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(FILE);
        check_state(folder.path()).expect("a folder without a number is the oldest format");
        check_state(&folder.path().join("missing")).expect("there is nothing");
        let newer = format!("{{\"format\":{},\"written_by\":\"9.0.0\"}}", STATE_FORMAT + 1);
        fs::write(&path, &newer).expect("written");
        let error = check_state(folder.path()).expect_err("it is newer").to_string();
        assert!(error.contains("althing 9.0.0 wrote it"), "{error}");
        assert_eq!(fs::read_to_string(&path).expect("it is there"), newer);
        fs::write(&path, "torn").expect("written");
        check_state(folder.path()).expect("it says nothing");
    }
}
