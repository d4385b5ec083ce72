//! A part of the history: one file of an embedded store (a database library) with a range of
//! segments. The file stays consistent after a crash.
//!
//! The oldest part is deleted as a whole when the history is too long. A single file would not
//! become shorter, because the embedded store doubles a file that is full, and shortens it by
//! rewriting it only.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use redb::{
    Database, DatabaseError, ReadOnlyDatabase, ReadableDatabase, ReadableTable, StorageError,
    TableDefinition, TableError,
};

use super::error::HistoryStoreError;
use super::segment::{SEGMENT_BLOCKS, SegmentSpan};

/// Format of the files that this version writes; this is also the newest format that it can read.
pub const FORMAT: u64 = 1;

const BLOCKS: TableDefinition<u64, &[u8]> = TableDefinition::new("blocks");
const INDEXES: TableDefinition<u64, &[u8]> = TableDefinition::new("indexes");
const SPANS: TableDefinition<u64, &[u8]> = TableDefinition::new("spans");
const METADATA: TableDefinition<&str, u64> = TableDefinition::new("about");
const FORMAT_KEY: &str = "format";
const LOST_KEY: &str = "lost";

/// Text that the embedded store's error contains if another version of the store wrote the file.
const FOREIGN_FORMAT: &str = "file format version";

/// Size of the cache of one part, in bytes; the operating system has a cache of its own.
const CACHE_BYTES: usize = 1 << 20;

/// Ending of the names of the files.
const ENDING: &str = "redb";

/// One file, with what is known of it.
pub(crate) struct Part {
    pub(crate) path: PathBuf,
    database: Database,
    /// The closed segments in the file, oldest first.
    pub(crate) spans: Vec<SegmentSpan>,
    /// Number of the first block in the file that belongs to no closed segment.
    pub(crate) first_open_block: u64,
    /// Number of lost messages and events, as this file has it.
    pub(crate) lost: u64,
}

/// Changes of a part that are written together.
#[derive(Debug, Default)]
pub(crate) struct PartChange {
    /// Blocks, each with its number.
    pub(crate) blocks: Vec<(u64, Vec<u8>)>,
    /// The segment that ends with these blocks, with its index.
    pub(crate) closed: Option<(SegmentSpan, Vec<u8>)>,
    /// New number of lost messages and events.
    pub(crate) lost: u64,
}

// === impl Part ===

impl Part {
    /// Returns the path of the part that begins with `segment`.
    pub(crate) fn path_of(folder: &Path, segment: u64) -> PathBuf {
        folder.join(format!("{segment:012}.{ENDING}"))
    }

    /// Returns the paths of all parts in the folder, the oldest first.
    pub(crate) fn paths(folder: &Path) -> io::Result<Vec<PathBuf>> {
        let mut paths = Vec::new();
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            let is_part = path.extension().is_some_and(|ending| ending == ENDING);
            paths.extend((is_part && segment_of(&path).is_some()).then_some(path));
        }
        paths.sort();
        Ok(paths)
    }

    /// Opens a part, or creates it. If the file cannot be created whole, what a full disk has left
    /// of it is removed, because such a file would count as damaged at the next attempt.
    pub(crate) fn open(path: &Path) -> Result<Part, PartFailure> {
        let is_new = !path.exists();
        let part = Part::read(path);
        if is_new && matches!(part, Err(PartFailure::Broken(_) | PartFailure::Other(_))) {
            let _ = fs::remove_file(path);
        }
        part
    }

    fn read(path: &Path) -> Result<Part, PartFailure> {
        let first = Part::first_segment_of(path);
        Part::refuse_newer(path)?;
        let database =
            Database::builder().set_cache_size(CACHE_BYTES).create(path).map_err(open_failure)?;
        match format_of(&database)? {
            Some(found) if found > FORMAT => return Err(PartFailure::Newer(found)),
            Some(_) => (),
            None => begin(&database)?,
        }
        // Only reads, so that a full disk can be read.
        let reading = database.begin_read()?;
        let lost = reading.open_table(METADATA)?.get(LOST_KEY)?.map_or(0, |lost| lost.value());
        let mut spans = Vec::new();
        for entry in reading.open_table(SPANS)?.iter()? {
            let (segment, bytes) = entry?;
            spans.extend(SegmentSpan::from_bytes(segment.value(), bytes.value()));
        }
        let next = spans.last().map_or(first, |span| span.segment + 1);
        let first_open_block = next * SEGMENT_BLOCKS;
        Ok(Part { path: path.to_owned(), database, spans, first_open_block, lost })
    }

    /// Returns an error if a newer version wrote the file, which is then left as it is: opening a
    /// file for writing may already shorten it. A file that needs a repair is not read here.
    fn refuse_newer(path: &Path) -> Result<(), PartFailure> {
        let Ok(database) = ReadOnlyDatabase::open(path) else { return Ok(()) };
        match format_of(&database) {
            Ok(Some(found)) if found > FORMAT => Err(PartFailure::Newer(found)),
            _ => Ok(()),
        }
    }

    /// Returns the number of the first segment that the file may have.
    pub(crate) fn first_segment(&self) -> u64 {
        Part::first_segment_of(&self.path)
    }

    /// Returns the number of the first segment that the file with this path may have.
    pub(crate) fn first_segment_of(path: &Path) -> u64 {
        segment_of(path).unwrap_or_default()
    }

    /// Returns the bytes of the closed segments.
    pub(crate) fn live_bytes(&self) -> u64 {
        self.spans.iter().map(|span| span.bytes).sum()
    }

    /// Returns the length of the file.
    pub(crate) fn file_bytes(&self) -> u64 {
        fs::metadata(&self.path).map_or(0, |file| file.len())
    }

    /// Writes the change. Returns when it is on the disk.
    pub(crate) fn write(&mut self, change: &PartChange) -> Result<(), redb::Error> {
        let writing = self.database.begin_write()?;
        {
            let mut blocks = writing.open_table(BLOCKS)?;
            for (number, bytes) in &change.blocks {
                blocks.insert(number, bytes.as_slice())?;
            }
            if let Some((span, index)) = &change.closed {
                writing.open_table(INDEXES)?.insert(span.segment, index.as_slice())?;
                writing.open_table(SPANS)?.insert(span.segment, span.to_bytes().as_slice())?;
            }
            if change.lost != self.lost {
                writing.open_table(METADATA)?.insert(LOST_KEY, change.lost)?;
            }
        }
        writing.commit()?;
        self.lost = change.lost;
        if let Some((span, _)) = &change.closed {
            self.spans.push(*span);
            self.first_open_block = (span.segment + 1) * SEGMENT_BLOCKS;
        }
        Ok(())
    }

    /// Deletes the segments whose newest event is older than `oldest_ms`.
    pub(crate) fn delete_older(&mut self, oldest_ms: u64) -> Result<(), redb::Error> {
        let is_old = |span: &SegmentSpan| span.to_ms < oldest_ms;
        if !self.spans.first().is_some_and(is_old) {
            return Ok(());
        }
        let old: Vec<_> = self.spans.iter().take_while(|span| is_old(span)).copied().collect();
        let writing = self.database.begin_write()?;
        for span in &old {
            writing.open_table(INDEXES)?.remove(span.segment)?;
            writing.open_table(SPANS)?.remove(span.segment)?;
            let first = span.segment * SEGMENT_BLOCKS;
            let numbers = first..first + SEGMENT_BLOCKS;
            writing.open_table(BLOCKS)?.retain_in(numbers, |_, _| false)?;
        }
        writing.commit()?;
        self.spans.drain(..old.len());
        Ok(())
    }

    /// Shortens the file to what it contains; for a part to which nothing more is added.
    pub(crate) fn compact(&mut self) {
        if let Err(error) = self.database.compact() {
            tracing::warn!(file = %self.path.display(), %error, "the file could not be shortened");
        }
    }

    /// Changes the format that the file names.
    #[cfg(test)]
    pub(crate) fn write_format(&self, format: u64) {
        let writing = self.database.begin_write().expect("begun");
        writing.open_table(METADATA).expect("there").insert(FORMAT_KEY, format).expect("put");
        writing.commit().expect("written");
    }

    /// Returns a block; `None` if the file does not have it.
    pub(crate) fn block(&self, number: u64) -> Result<Option<Vec<u8>>, redb::Error> {
        let table = self.database.begin_read()?.open_table(BLOCKS)?;
        Ok(table.get(number)?.map(|bytes| bytes.value().to_vec()))
    }

    /// Returns the blocks that belong to no closed segment, in their order.
    pub(crate) fn open_blocks(&self) -> Result<Vec<(u64, Vec<u8>)>, redb::Error> {
        let table = self.database.begin_read()?.open_table(BLOCKS)?;
        let mut blocks = Vec::new();
        for entry in table.range(self.first_open_block..)? {
            let (number, bytes) = entry?;
            blocks.push((number.value(), bytes.value().to_vec()));
        }
        Ok(blocks)
    }

    /// Calls `read` with the index of a closed segment, or with an empty one if it is missing.
    pub(crate) fn with_index<T>(
        &self,
        segment: u64,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, redb::Error> {
        let table = self.database.begin_read()?.open_table(INDEXES)?;
        Ok(match table.get(segment)? {
            Some(index) => read(index.value()),
            None => read(&[]),
        })
    }
}

/// Returns the format that a file names; `None` if it names none, because it is new.
fn format_of(database: &impl ReadableDatabase) -> Result<Option<u64>, redb::Error> {
    match database.begin_read()?.open_table(METADATA) {
        Ok(about) => Ok(about.get(FORMAT_KEY)?.map(|format| format.value())),
        Err(TableError::TableDoesNotExist(_)) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Writes the format and the tables of a new file.
fn begin(database: &Database) -> Result<(), redb::Error> {
    let writing = database.begin_write()?;
    writing.open_table(METADATA)?.insert(FORMAT_KEY, FORMAT)?;
    // A table exists from its first opening for writing.
    writing.open_table(BLOCKS)?;
    writing.open_table(INDEXES)?;
    writing.open_table(SPANS)?;
    Ok(writing.commit()?)
}

/// Reason why a part cannot be opened or created.
pub(crate) enum PartFailure {
    Broken(String),
    Newer(u64),
    Foreign(String),
    InUse,
    Other(String),
}

impl PartFailure {
    pub(crate) fn into_store_error(self, path: &Path) -> HistoryStoreError {
        let path = path.to_owned();
        match self {
            PartFailure::Newer(found) => HistoryStoreError::Newer { path, found },
            PartFailure::Foreign(why) => HistoryStoreError::Foreign { path, why },
            PartFailure::InUse => HistoryStoreError::InUse { path },
            PartFailure::Broken(why) | PartFailure::Other(why) => {
                HistoryStoreError::Failed { what: "open", path, why }
            }
        }
    }
}

impl<E: Into<redb::Error>> From<E> for PartFailure {
    fn from(error: E) -> PartFailure {
        match error.into() {
            redb::Error::Io(error) if !is_content_error(error.kind()) => {
                PartFailure::Other(error.to_string())
            }
            broken => PartFailure::Broken(broken.to_string()),
        }
    }
}

fn open_failure(error: DatabaseError) -> PartFailure {
    match error {
        DatabaseError::DatabaseAlreadyOpen => PartFailure::InUse,
        DatabaseError::UpgradeRequired(version) => {
            PartFailure::Foreign(format!("its format is {version}, which is too old"))
        }
        // The store has no error kind for this case; a test checks that its text is still the same.
        DatabaseError::Storage(StorageError::Corrupted(why)) if why.contains(FOREIGN_FORMAT) => {
            PartFailure::Foreign(why)
        }
        DatabaseError::Storage(StorageError::Io(error)) if !is_content_error(error.kind()) => {
            PartFailure::Other(error.to_string())
        }
        broken => PartFailure::Broken(broken.to_string()),
    }
}

/// Returns `true` if an I/O error comes from the content or the length of the file, and not from
/// the disk.
fn is_content_error(kind: io::ErrorKind) -> bool {
    matches!(kind, io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof)
}

/// Returns the number of the first segment of a part, which is its name.
fn segment_of(path: &Path) -> Option<u64> {
    path.file_stem()?.to_str()?.parse().ok()
}
