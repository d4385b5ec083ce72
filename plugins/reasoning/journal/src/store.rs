//! The Journal's records on disk, in one file of an embedded store (a database library). The file
//! stays consistent after a crash.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use acl::content::Record;
use redb::{
    Database, DatabaseError, ReadableDatabase, ReadableTable, StorageError, TableDefinition,
};

/// Format of the Journal's file that this version writes; this is also the newest format that it
/// can read.
pub const FORMAT: u64 = 1;

const RECORDS: TableDefinition<&str, &[u8]> = TableDefinition::new("records");
const METADATA: TableDefinition<&str, u64> = TableDefinition::new("about");
const FORMAT_KEY: &str = "format";

/// Text that the embedded store's error contains if another version of the store wrote the file.
const FOREIGN_FORMAT: &str = "file format version";

/// Size of the database's cache, in bytes. All records are in memory already; the default size
/// would be a gigabyte.
const CACHE_BYTES: usize = 4 << 20;

/// Storage of a Journal's records in memory, which outlives the Journal. The tests that run a whole
/// building in one process use it in place of the disk.
#[derive(Debug, Default)]
pub struct MemoryStore(Mutex<BTreeMap<String, Vec<u8>>>);

impl MemoryStore {
    /// Returns all records in this storage.
    pub fn records(&self) -> Vec<Record> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.values().filter_map(|bytes| serde_json::from_slice(bytes).ok()).collect()
    }
}

/// Storage of a Journal's records: a file, or memory.
pub(crate) enum Store {
    File(JournalFile),
    Memory(std::sync::Arc<MemoryStore>),
}

/// A file of the embedded store. After a failed write the store accepts no further writes until it
/// is opened again. Therefore the next write opens the file again, and a disk that is full for a
/// moment causes no lasting failure.
pub(crate) struct JournalFile {
    path: PathBuf,
    /// The open database; `None` after a failed write.
    database: Mutex<Option<Database>>,
}

/// Reason why records cannot be stored. The text of each variant completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum StoreError {
    /// The daemon has no state folder in which records could be stored.
    #[error("keep anything: this daemon has no state folder")]
    Nowhere,
    /// A newer version of Althing wrote the Journal's file.
    #[error(
        "read {}: a newer Althing wrote it (format {found}; this one reads up to {FORMAT}); \
         update this machine, or move the file away: the other Journals have copies",
        path.display()
    )]
    Newer {
        /// Path of the file that a newer version of Althing wrote.
        path: PathBuf,
        /// Number of the format in which the file is written.
        found: u64,
    },
    /// Another version of the embedded store wrote the Journal's file.
    #[error(
        "read {}: another version of the store wrote it ({why}); update this machine, or move the file \
         away: the other Journals have copies",
        path.display()
    )]
    Foreign {
        /// Path of the file that another version of the embedded store wrote.
        path: PathBuf,
        /// Error text of the embedded store about the format of the file.
        why: String,
    },
    /// Another process has the Journal's file open.
    #[error("open {}: another process has it open", path.display())]
    InUse {
        /// Path of the file that is in use.
        path: PathBuf,
    },
    /// The disk or the embedded store returned an error when the file was opened or moved.
    #[error("{what} {}: {why}", path.display())]
    Failed {
        /// Name of the failed operation, as it follows “failed to” in the error's text.
        what: &'static str,
        /// Path of the file with which the operation failed.
        path: PathBuf,
        /// Reason of the failure, as reported by the disk or the store.
        why: String,
    },
    /// The embedded store returned an error when records were written.
    #[error("write to the journal: {0}")]
    Write(String),
    /// The thread that used the disk ended without a result.
    #[error("use the disk: {0}")]
    Lost(String),
}

// === impl StoreError ===

impl StoreError {
    /// Returns `true` if the cause of the error may disappear without action of a person.
    pub(crate) fn is_transient(&self) -> bool {
        match self {
            StoreError::Nowhere | StoreError::Newer { .. } | StoreError::Foreign { .. } => false,
            StoreError::InUse { .. }
            | StoreError::Failed { .. }
            | StoreError::Write(_)
            | StoreError::Lost(_) => true,
        }
    }
}

// === impl Store ===

impl Store {
    /// Opens the Journal's file, or creates it, and returns it with all records in it. A damaged
    /// file is moved aside, which is logged as an error; the other Journals have the records of
    /// that file.
    pub(crate) fn open(path: &Path) -> Result<(Store, Vec<Record>), StoreError> {
        if !path.exists() {
            return create_file(path);
        }
        match read(path) {
            Err(OpenFailure::Broken(why)) => {
                let aside = free_name_beside(path);
                tracing::error!(file = %path.display(), aside = %aside.display(), why,
                    "the journal is broken; it is moved aside, and a new one begins");
                let failed = |error: io::Error| failed("move aside", path, &error);
                fs::rename(path, &aside).map_err(failed)?;
                create_file(path)
            }
            other => other.map_err(|trouble| trouble.into_store_error(path)),
        }
    }

    pub(crate) fn in_memory(shelf: &std::sync::Arc<MemoryStore>) -> (Store, Vec<Record>) {
        (Store::Memory(std::sync::Arc::clone(shelf)), shelf.records())
    }

    /// Writes `records` and removes the records with the keys `gone`, all in one transaction.
    /// Returns when the transaction is on disk.
    pub(crate) fn write(&self, records: &[Record], gone: &[String]) -> Result<(), StoreError> {
        let bytes = |record: &Record| {
            serde_json::to_vec(record).map_err(|error| StoreError::Write(error.to_string()))
        };
        match self {
            Store::Memory(shelf) => {
                let mut kept = shelf.0.lock().unwrap_or_else(PoisonError::into_inner);
                gone.iter().for_each(|key| drop(kept.remove(key)));
                for record in records {
                    kept.insert(record.key.clone(), bytes(record)?);
                }
                Ok(())
            }
            Store::File(file) => file.write(records, gone),
        }
    }
}

// === impl JournalFile ===

impl JournalFile {
    fn new(path: &Path, database: Database) -> JournalFile {
        JournalFile { path: path.to_owned(), database: Mutex::new(Some(database)) }
    }

    fn write(&self, records: &[Record], gone: &[String]) -> Result<(), StoreError> {
        let mut open = self.database.lock().unwrap_or_else(PoisonError::into_inner);
        let database = match open.take() {
            Some(database) => database,
            None => {
                open_database(&self.path).map_err(|error| StoreError::Write(error.to_string()))?
            }
        };
        write(&database, records, gone).map_err(|error| StoreError::Write(error.to_string()))?;
        *open = Some(database);
        Ok(())
    }
}

fn write(database: &Database, records: &[Record], gone: &[String]) -> Result<(), redb::Error> {
    let writing = database.begin_write()?;
    {
        let mut table = writing.open_table(RECORDS)?;
        for key in gone {
            table.remove(key.as_str())?;
        }
        for record in records {
            // Serialising cannot fail: the record was parsed from JSON.
            let bytes = serde_json::to_vec(record).unwrap_or_default();
            table.insert(record.key.as_str(), bytes.as_slice())?;
        }
    }
    Ok(writing.commit()?)
}

/// Reason why the Journal's file cannot be opened or created.
enum OpenFailure {
    Broken(String),
    Newer(u64),
    Foreign(String),
    InUse,
    Other(String),
}

impl OpenFailure {
    fn into_store_error(self, path: &Path) -> StoreError {
        let path = path.to_owned();
        match self {
            OpenFailure::Newer(found) => StoreError::Newer { path, found },
            OpenFailure::Foreign(why) => StoreError::Foreign { path, why },
            OpenFailure::InUse => StoreError::InUse { path },
            OpenFailure::Broken(why) | OpenFailure::Other(why) => {
                StoreError::Failed { what: "open", path, why }
            }
        }
    }
}

fn failed(what: &'static str, path: &Path, error: &io::Error) -> StoreError {
    StoreError::Failed { what, path: path.to_owned(), why: error.to_string() }
}

/// Creates the Journal's file. If this fails, removes the partial file that a full disk may leave,
/// because such a file would be treated as damaged at the next attempt.
fn create_file(path: &Path) -> Result<(Store, Vec<Record>), StoreError> {
    read(path).map_err(|trouble| {
        if matches!(trouble, OpenFailure::Broken(_) | OpenFailure::Other(_)) {
            let _ = fs::remove_file(path);
        }
        trouble.into_store_error(path)
    })
}

/// Opens a database file, or creates it.
fn open_database(path: &Path) -> Result<Database, DatabaseError> {
    Database::builder().set_cache_size(CACHE_BYTES).create(path)
}

/// Returns an unused path beside `path`, to which a damaged file can be moved.
fn free_name_beside(path: &Path) -> PathBuf {
    let name = |number: u32| path.with_extension(format!("broken-{number}"));
    (1..).map(name).find(|name| !name.exists()).unwrap_or_else(|| name(0))
}

fn read(path: &Path) -> Result<(Store, Vec<Record>), OpenFailure> {
    let database = open_database(path).map_err(|error| match error {
        DatabaseError::DatabaseAlreadyOpen => OpenFailure::InUse,
        DatabaseError::Storage(StorageError::Io(error)) if is_content_error(error.kind()) => {
            OpenFailure::Broken(error.to_string())
        }
        DatabaseError::Storage(StorageError::Io(error)) => OpenFailure::Other(error.to_string()),
        DatabaseError::UpgradeRequired(version) => {
            OpenFailure::Foreign(format!("its format is {version}, which is too old"))
        }
        // The store has no error kind for this case; a test checks that its text is still the same.
        DatabaseError::Storage(StorageError::Corrupted(why)) if why.contains(FOREIGN_FORMAT) => {
            OpenFailure::Foreign(why)
        }
        broken => OpenFailure::Broken(broken.to_string()),
    })?;
    let records = read_all(&database).map_err(|error| match error {
        ReadFailure::Newer(found) => OpenFailure::Newer(found),
        ReadFailure::Store(redb::Error::Io(error)) if !is_content_error(error.kind()) => {
            OpenFailure::Other(error.to_string())
        }
        ReadFailure::Store(broken) => OpenFailure::Broken(broken.to_string()),
    })?;
    Ok((Store::File(JournalFile::new(path, database)), records))
}

/// Returns `true` if an I/O error comes from the content or the length of the file, and not from
/// the disk.
fn is_content_error(kind: io::ErrorKind) -> bool {
    matches!(kind, io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof)
}

enum ReadFailure {
    Newer(u64),
    Store(redb::Error),
}

impl<E: Into<redb::Error>> From<E> for ReadFailure {
    fn from(error: E) -> ReadFailure {
        ReadFailure::Store(error.into())
    }
}

/// Returns all records in a database. First writes the format number to the database if it is new.
fn read_all(database: &Database) -> Result<Vec<Record>, ReadFailure> {
    let writing = database.begin_write()?;
    {
        let mut about = writing.open_table(METADATA)?;
        let found = about.get(FORMAT_KEY)?.map(|format| format.value());
        match found {
            Some(found) if found > FORMAT => return Err(ReadFailure::Newer(found)),
            Some(_) => (),
            None => drop(about.insert(FORMAT_KEY, FORMAT)?),
        }
        writing.open_table(RECORDS)?;
    }
    writing.commit()?;
    let reading = database.begin_read()?;
    let table = reading.open_table(RECORDS)?;
    let mut records = Vec::new();
    for entry in table.iter()? {
        let (key, value) = entry?;
        match serde_json::from_slice(value.value()) {
            Ok(record) => records.push(record),
            Err(error) => tracing::warn!(key = key.value(), %error, "a record cannot be read"),
        }
    }
    Ok(records)
}

#[cfg(test)]
mod tests {
    use acl::content::Version;
    use serde_json::json;

    use super::*;

    fn record(key: &str, count: u64) -> Record {
        Record { key: key.to_owned(), version: Version { term: 1, count }, body: json!(count) }
    }

    #[test]
    fn written_records_are_restored_on_reopening() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal.redb");
        let (store, empty) = Store::open(&path).expect("made");
        assert!(empty.is_empty());
        assert!(matches!(Store::open(&path), Err(StoreError::InUse { .. })));
        store.write(&[record("goal/a", 1), record("goal/b", 1)], &[]).expect("written");
        store.write(&[record("goal/a", 2)], &["goal/b".to_owned()]).expect("written");
        drop(store);
        let (_, records) = Store::open(&path).expect("opened");
        assert_eq!(records, [record("goal/a", 2)]);
    }

    #[test]
    fn the_file_is_opened_again_after_a_failed_write() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal.redb");
        let (store, _) = Store::open(&path).expect("made");
        store.write(&[record("goal/a", 1)], &[]).expect("written");
        let Store::File(file) = &store else { panic!("a file") };
        *file.database.lock().expect("no panic") = None;
        store.write(&[record("goal/b", 1)], &[]).expect("written");
        drop(store);
        let (_, records) = Store::open(&path).expect("opened");
        assert_eq!(records, [record("goal/a", 1), record("goal/b", 1)]);
    }

    #[test]
    fn a_newer_format_is_refused_and_left_unchanged() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal.redb");
        let (store, _) = Store::open(&path).expect("made");
        let Store::File(file) = store else { panic!("a file") };
        let database = file.database.lock().expect("no panic").take().expect("it is open");
        let writing = database.begin_write().expect("begun");
        writing.open_table(METADATA).expect("there").insert(FORMAT_KEY, FORMAT + 1).expect("put");
        writing.commit().expect("written");
        drop(database);
        let before = fs::read(&path).expect("readable");
        let refused = Store::open(&path).map(drop).expect_err("newer").to_string();
        assert!(refused.contains("a newer Althing wrote it (format 2"), "{refused}");
        assert_eq!(fs::read(&path).expect("readable").len(), before.len());
    }

    #[test]
    fn a_newer_format_of_the_store_is_refused_and_left_unchanged() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal.redb");
        drop(Store::open(&path).expect("made"));
        let mut bytes = fs::read(&path).expect("readable");
        // Each of the two commit slots begins with its version.
        for slot in [64, 64 + 128] {
            bytes[slot] = 9;
        }
        fs::write(&path, &bytes).expect("written");
        let refused = Store::open(&path).map(drop).expect_err("newer");
        assert!(matches!(refused, StoreError::Foreign { .. }), "{refused}");
        assert!(!refused.is_transient());
        assert_eq!(fs::read(&path).expect("readable"), bytes);
    }

    #[test]
    fn damaged_files_are_moved_aside_under_separate_names() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal.redb");
        let (store, _) = Store::open(&path).expect("made");
        store.write(&[record("goal/a", 1)], &[]).expect("written");
        drop(store);
        let whole = fs::read(&path).expect("readable");
        // Random bytes, and files truncated at several lengths.
        let torn = [100, 600, 5_000, whole.len() / 2].map(|length| whole[..length].to_vec());
        for (count, broken) in std::iter::once(vec![7; 100_000]).chain(torn).enumerate() {
            fs::write(&path, &broken).expect("written");
            let (_, records) = Store::open(&path).expect("begun anew");
            assert!(records.is_empty());
            let aside = path.with_extension(format!("broken-{}", count + 1));
            assert_eq!(fs::read(aside).expect("it is aside").len(), broken.len());
        }
    }
}
