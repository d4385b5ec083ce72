//! Reasons why the history cannot be kept or read.

use std::path::PathBuf;

use super::part::FORMAT;

/// Reason why events cannot be kept or read. The text of each variant completes “failed to …”.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HistoryStoreError {
    /// The daemon has no state folder in which events could be kept.
    #[error("keep anything: this daemon has no state folder")]
    Nowhere,
    /// A newer version of Althing wrote the file.
    #[error(
        "read {}: a newer Althing wrote it (format {found}; this one reads up to {FORMAT}); \
         update this machine, or move the folder of the file away",
        path.display()
    )]
    Newer {
        /// Path of the file that a newer version of Althing wrote.
        path: PathBuf,
        /// Number of the format in which the file is written.
        found: u64,
    },
    /// Another version of the embedded store wrote the file.
    #[error(
        "read {}: another version of the store wrote it ({why}); update this machine, or move the \
         folder of the file away",
        path.display()
    )]
    Foreign {
        /// Path of the file that another version of the embedded store wrote.
        path: PathBuf,
        /// Error text of the embedded store about the format of the file.
        why: String,
    },
    /// Another process has the file open.
    #[error("open {}: another process has it open", path.display())]
    InUse {
        /// Path of the file that is in use.
        path: PathBuf,
    },
    /// The disk or the embedded store returned an error when a file was opened or moved.
    #[error("{what} {}: {why}", path.display())]
    Failed {
        /// Name of the failed operation, as it follows “failed to” in the error's text.
        what: &'static str,
        /// Path of the file with which the operation failed.
        path: PathBuf,
        /// Reason of the failure, as reported by the disk or the store.
        why: String,
    },
    /// The embedded store returned an error when events were written.
    #[error("write to the history: {0}")]
    Write(String),
    /// The newest file was broken and is moved aside. Numbers up to `newest` may have been used in it.
    #[error("write to the history: its newest file was broken and is moved aside")]
    Outnumbered {
        /// Greatest number that an event may have had.
        newest: u64,
    },
    /// The embedded store returned an error when events were read.
    #[error("read the history: {0}")]
    Read(String),
    /// The thread that used the disk ended without a result.
    #[error("use the disk: {0}")]
    Lost(String),
}

impl HistoryStoreError {
    /// Returns `true` if the cause of the error may disappear without action of a person.
    pub fn is_transient(&self) -> bool {
        !matches!(
            self,
            HistoryStoreError::Nowhere
                | HistoryStoreError::Newer { .. }
                | HistoryStoreError::Foreign { .. }
        )
    }
}
