//! The file of people on disk: read with its permissions checked, and changed atomically by one
//! process at a time.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, fchown};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::error::AccountsError;
use crate::file_text::{PeopleText, read_people, without_secrets, write_people};
use crate::records::PeopleRecords;

/// Maximum length of a file of people, in bytes. A person takes two hundred, a token as many.
const FILE_BYTES_MAX: u64 = 4 << 20;

/// How long a change waits for another process that changes the file. A change takes milliseconds.
const LOCK_WAIT_MAX: Duration = Duration::from_secs(10);

/// How often a change looks whether the file is free: the system's lock has no deadline of its own.
const LOCK_POLL: Duration = Duration::from_millis(20);

/// Permission bits with which other users could write the file.
const OTHERS_WRITE: u32 = 0o022;

/// Permissions of a written file.
const FILE_MODE: u32 = 0o600;

/// The file with the people of an ecosystem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PeopleFile {
    path: PathBuf,
}

/// The state of a file by which a change is noticed. A renamed file has another inode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileStamp {
    device: u64,
    inode: u64,
    length: u64,
    mode: u32,
    changed: (i64, i64),
}

// === impl PeopleFile ===

impl PeopleFile {
    /// Returns the file at this path; it need not exist.
    pub fn new(path: impl Into<PathBuf>) -> PeopleFile {
        PeopleFile { path: path.into() }
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the people of the file; none if it does not exist.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, if others can write it, or if it has mistakes.
    pub fn read(&self) -> Result<PeopleRecords, AccountsError> {
        let Some(text) = self.text()? else { return Ok(PeopleRecords::default()) };
        let PeopleText { records, mistakes, .. } = read_people(&text);
        if mistakes.iter().any(pddl::Diagnostic::is_error) {
            let (path, text) = (self.path.clone(), without_secrets(&text));
            return Err(AccountsError::Mistakes { path, text, mistakes });
        }
        Ok(records)
    }

    /// Returns the text of the file; `None` if it does not exist. The text contains hashes.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, if it is too long or no text, or if others can
    /// write it.
    pub fn text(&self) -> Result<Option<String>, AccountsError> {
        let about = match fs::metadata(&self.path) {
            Ok(about) => about,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(self.failed(error)),
        };
        if !about.is_file() {
            // Opening a pipe would wait for a writer.
            return Err(self.failed(io::Error::other("it is no regular file")));
        }
        let file = File::open(&self.path).map_err(|error| self.failed(error))?;
        let mode = file.metadata().map_err(|error| self.failed(error))?.mode() & 0o777;
        if mode & OTHERS_WRITE != 0 {
            return Err(AccountsError::Writable { path: self.path.clone(), mode });
        }
        let mut bytes = Vec::new();
        let read = file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes);
        read.map_err(|error| self.failed(error))?;
        if bytes.len() as u64 > FILE_BYTES_MAX {
            return Err(AccountsError::TooLong { path: self.path.clone(), max: FILE_BYTES_MAX });
        }
        let text = String::from_utf8(bytes);
        Ok(Some(text.map_err(|_| self.failed(io::Error::other("it is not UTF-8 text")))?))
    }

    /// Returns the permissions with which other users can read or write the file; `None` if they
    /// cannot, or if there is no file.
    pub fn loose_mode(&self) -> Option<u32> {
        let mode = fs::metadata(&self.path).ok()?.mode() & 0o777;
        (mode & 0o077 != 0).then_some(mode)
    }

    /// Changes the file: reads it, lets `change` change the people, and replaces the file by a new
    /// one, which is on disk when this function returns. Only one process changes the file at a
    /// time. A reader sees the old file or the new one, and never a part of it.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, locked or written, or the error of `change`; the
    /// file is then as it was.
    pub fn change<T>(
        &self,
        change: impl FnOnce(&mut PeopleRecords) -> Result<T, AccountsError>,
    ) -> Result<T, AccountsError> {
        // A rename would replace a symbolic link, and not the file that it leads to.
        let real = match fs::canonicalize(&self.path) {
            Ok(real) => PeopleFile::new(real),
            Err(error) if error.kind() == io::ErrorKind::NotFound => self.clone(),
            Err(error) => return Err(self.failed(error)),
        };
        let folder = real.folder();
        // The lock is released when the folder is closed, also by a process that dies.
        let locked = real.lock(&folder)?;
        let mut records = real.read()?;
        let result = change(&mut records)?;
        real.replace(&write_people(&records))?;
        // Without this, the name of the new file could be lost with the power.
        locked.sync_all().map_err(|source| AccountsError::Io { path: folder, source })?;
        Ok(result)
    }

    fn folder(&self) -> PathBuf {
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.unwrap_or(Path::new(".")).to_owned()
    }

    /// Locks the folder of the file: the file itself is replaced at each change.
    fn lock(&self, folder: &Path) -> Result<File, AccountsError> {
        let failed = |source| AccountsError::Io { path: folder.to_owned(), source };
        let opened = File::open(folder).map_err(failed)?;
        let began = Instant::now();
        loop {
            match opened.try_lock() {
                Ok(()) => return Ok(opened),
                Err(TryLockError::Error(source)) => return Err(failed(source)),
                Err(TryLockError::WouldBlock) if began.elapsed() >= LOCK_WAIT_MAX => {
                    let path = self.path.clone();
                    return Err(AccountsError::Locked { path, waited: LOCK_WAIT_MAX });
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(LOCK_POLL),
            }
        }
    }

    /// Replaces the file by one with this text, of the same owner.
    fn replace(&self, text: &str) -> Result<(), AccountsError> {
        let aside = self.path.with_extension(format!("toml.new-{}", std::process::id()));
        let written = self.write_aside(&aside, text).and_then(|()| fs::rename(&aside, &self.path));
        written.map_err(|error| {
            let _ = fs::remove_file(&aside);
            self.failed(error)
        })
    }

    fn write_aside(&self, aside: &Path, text: &str) -> io::Result<()> {
        // Removes the remnant of a process that died.
        let _ = fs::remove_file(aside);
        let mut options = OpenOptions::new();
        let mut file = options.write(true).create_new(true).mode(FILE_MODE).open(aside)?;
        let made = file.metadata()?;
        // The first file that root makes is for the user to whom the folder belongs.
        let folder = || fs::metadata(self.folder()).ok().filter(|_| made.uid() == 0);
        if let Some(before) = fs::metadata(&self.path).ok().or_else(folder)
            && (before.uid(), before.gid()) != (made.uid(), made.gid())
        {
            // The daemon of another user has to read the file as before.
            fchown(&file, Some(before.uid()), Some(before.gid()))?;
        }
        file.write_all(text.as_bytes())?;
        file.sync_all()
    }

    /// Returns the state of the file by which a change is noticed; `None` if it does not exist.
    pub(crate) fn stamp(&self) -> Option<FileStamp> {
        let about = fs::metadata(&self.path).ok()?;
        Some(FileStamp {
            device: about.dev(),
            inode: about.ino(),
            length: about.len(),
            mode: about.mode(),
            changed: (about.ctime(), about.ctime_nsec()),
        })
    }

    fn failed(&self, source: io::Error) -> AccountsError {
        AccountsError::Io { path: self.path.clone(), source }
    }
}
