//! Errors of backups.

use std::io;
use std::path::PathBuf;

use crate::manifest::BACKUP_FORMAT;

/// Reason why an archive cannot be made, read or restored. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BackupError {
    /// A file or a folder cannot be used.
    #[error("{what} {}: {source}", path.display())]
    Io {
        /// Name of the operation, as it follows “failed to”.
        what: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        #[source]
        source: io::Error,
    },
    /// The archive cannot be written, for example because the disk is full.
    #[error("write {}: {source}; an archive that was there before is as it was", path.display())]
    Write {
        /// The archive.
        path: PathBuf,
        /// Error of the operating system.
        #[source]
        source: io::Error,
    },
    /// A file changed each time that it was read.
    #[error(
        "copy {}: it changes all the time; stop the daemon for the backup, or leave it out",
        path.display()
    )]
    Unsteady {
        /// The file.
        path: PathBuf,
    },
    /// The file is no archive of this program.
    #[error("read {}: it is no backup of althing ({problem})", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Description of what is wrong.
        problem: String,
    },
    /// A newer version made the archive.
    #[error(
        "read {}: althing {made_by} made it (format {found}; this version reads up to \
         {BACKUP_FORMAT}); install that version, or a later one",
        path.display()
    )]
    Newer {
        /// The archive.
        path: PathBuf,
        /// Number of the format of the archive.
        found: u64,
        /// Version that made the archive.
        made_by: String,
    },
    /// The archive is damaged or cut off.
    #[error("read {}: {problem}; nothing was changed", path.display())]
    Damaged {
        /// The archive.
        path: PathBuf,
        /// Description of what is wrong.
        problem: String,
    },
    /// There are files where the archive is to be restored.
    #[error(
        "restore: {} is there already{}; --replace keeps it under another name beside it",
        first.display(),
        more(*.others)
    )]
    Occupied {
        /// The first place with other content.
        first: PathBuf,
        /// Number of further places.
        others: usize,
    },
    /// A part cannot be put in place. All parts are as they were, except those that are listed.
    #[error(
        "put {} in place: {source}; {}",
        path.display(),
        undone(.stuck)
    )]
    Place {
        /// The place.
        path: PathBuf,
        /// Error of the operating system.
        #[source]
        source: io::Error,
        /// Places that could not be given their former content again.
        stuck: Vec<StuckPlace>,
    },
}

/// A place that could not be given its former content again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StuckPlace {
    /// The place.
    pub place: PathBuf,
    /// Whether the new content is there.
    pub is_new: bool,
    /// Name under which the former content is now; `None` if there was none.
    pub before: Option<PathBuf>,
}

fn more(others: usize) -> String {
    match others {
        0 => String::new(),
        others => format!(", and {others} more"),
    }
}

fn undone(stuck: &[StuckPlace]) -> String {
    if stuck.is_empty() {
        return "all is as it was".to_owned();
    }
    let cure = |StuckPlace { place, is_new, before }: &StuckPlace| {
        let place = place.display();
        match (is_new, before.as_ref().map(|before| before.display())) {
            (true, None) => format!("remove {place}, which was not there"),
            (true, Some(before)) => format!("move {place} away, and {before} back to it"),
            (false, Some(before)) => format!("move {before} back to {place}"),
            (false, None) => format!("look at {place}"),
        }
    };
    let cures: Vec<String> = stuck.iter().map(cure).collect();
    format!("the rest is as it was, but {}", cures.join("; and "))
}

/// Returns a function that makes an error of the system an error about `path`.
pub(crate) fn failed(
    what: &'static str,
    path: impl Into<PathBuf>,
) -> impl FnOnce(io::Error) -> BackupError {
    let path = path.into();
    move |source| BackupError::Io { what, path, source }
}
