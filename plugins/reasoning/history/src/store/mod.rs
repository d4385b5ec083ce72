//! The events on disk: a folder of parts, each with segments of blocks.
//!
//! - `block` encodes up to 64 events.
//! - `segment` says which blocks of 64 have a word.
//! - `part` is one file. The newest part is written to; the oldest is deleted when the history is
//!   too long.
//! - `files` has all parts. The newest, incomplete block is written anew with each batch of events.
//! - `reader` finds events.

mod block;
mod error;
mod files;
mod part;
mod reader;
mod segment;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

pub use self::error::HistoryStoreError;
use self::files::HistoryFiles;
pub use self::part::FORMAT;
use self::part::Part;
pub(crate) use self::reader::{EventReader, ScanFilter};
pub(crate) use self::segment::SEGMENT_EVENTS;
use crate::event::RecordedEvent;

/// How much is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HistoryLimits {
    /// Greatest age of an event, in milliseconds.
    pub keep_ms: u64,
    /// Greatest size of all files together, in bytes.
    pub bytes_max: u64,
}

/// The events on disk.
pub struct HistoryStore {
    folder: PathBuf,
    limits: HistoryLimits,
    /// The open files; `None` after a failed write. The embedded store accepts no further writes
    /// then until a file is opened again, so the next use opens them.
    files: Mutex<Option<HistoryFiles>>,
    /// Damaged files that were moved aside since the last [`HistoryStore::take_notices`].
    notices: Mutex<Vec<String>>,
}

/// What was found when the history was opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenedHistory {
    /// Number of the newest event; 0 if there is none.
    pub newest: u64,
    /// Number of messages and events that were lost since the history began.
    pub lost: u64,
    /// Damaged files that were moved aside, each as text for a person.
    pub notices: Vec<String>,
}

// === impl HistoryStore ===

impl HistoryStore {
    /// Opens the history in `folder`, or creates it. A damaged file is moved aside, which is logged
    /// as an error and is in [`OpenedHistory::notices`].
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be used, or if a newer version wrote a file in it;
    /// then no file is changed.
    pub fn open(
        folder: &Path,
        limits: HistoryLimits,
    ) -> Result<(HistoryStore, OpenedHistory), HistoryStoreError> {
        let (files, notices) = HistoryFiles::open(folder)?;
        let lost = files.parts.iter().map(|part| part.lost).max().unwrap_or(0);
        let opened = OpenedHistory { newest: files.newest, lost, notices };
        let (files, notices) = (Mutex::new(Some(files)), Mutex::default());
        Ok((HistoryStore { folder: folder.to_owned(), limits, files, notices }, opened))
    }

    /// Opens the files again after a failed write.
    fn reopen(&self) -> Result<HistoryFiles, HistoryStoreError> {
        let (files, moved) = HistoryFiles::open(&self.folder)?;
        self.notices.lock().unwrap_or_else(PoisonError::into_inner).extend(moved);
        Ok(files)
    }

    /// Returns the damaged files that were moved aside since the last call, each as text for a
    /// person.
    pub(crate) fn take_notices(&self) -> Vec<String> {
        std::mem::take(&mut *self.notices.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Writes the events, which are in the order of their numbers, and deletes what is older than
    /// the limits. Returns when the events are on disk. Events that are on disk already are left
    /// out.
    ///
    /// # Errors
    ///
    /// Returns an error if the disk does not take the events. Some of them may be on disk; the
    /// caller can give the same events again. Returns [`HistoryStoreError::Outnumbered`] if the
    /// events need greater numbers.
    pub fn append(
        &self,
        events: &[RecordedEvent],
        lost: u64,
        now_ms: u64,
    ) -> Result<(), HistoryStoreError> {
        let mut guard = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        let mut files = match guard.take() {
            Some(files) => files,
            None => self.reopen()?,
        };
        // Without this check they would count as events that are on disk already.
        if let Some(last) = events.last()
            && last.number < files.newest
        {
            let newest = files.newest;
            *guard = Some(files);
            return Err(HistoryStoreError::Outnumbered { newest });
        }
        files.append(&self.folder, events, lost, self.limits)?;
        files.enforce(self.limits, now_ms)?;
        *guard = Some(files);
        Ok(())
    }

    /// Calls `read` with a reader of the events.
    ///
    /// # Errors
    ///
    /// Returns an error if the files cannot be read.
    pub(crate) fn read<T>(
        &self,
        read: impl FnOnce(&mut EventReader<'_>) -> Result<T, HistoryStoreError>,
    ) -> Result<T, HistoryStoreError> {
        let mut guard = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        let files = match guard.take() {
            Some(files) => files,
            None => self.reopen()?,
        };
        let files = guard.insert(files);
        read(&mut EventReader::new(files))
    }

    /// Returns the length of all files together.
    pub fn file_bytes(&self) -> u64 {
        let guard = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        guard.iter().flat_map(|files| &files.parts).map(Part::file_bytes).sum()
    }
}

#[cfg(test)]
mod tests;
