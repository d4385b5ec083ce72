//! A file of text that is replaced at once, unless it has changed since it was read.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Maximum length of a file, in bytes. An ecosystem file of a campus has some ten thousand.
const FILE_BYTES_MAX: u64 = 4 << 20;

/// How long a change waits for another process that changes a file of the folder. A change takes
/// milliseconds.
const LOCK_WAIT_MAX: Duration = Duration::from_secs(5);

/// How often a change looks whether the folder is free: the system's lock has no deadline.
const LOCK_POLL: Duration = Duration::from_millis(20);

/// Reason why a file cannot be read or written. The text completes the sentence “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileEditError {
    /// The file cannot be read.
    #[error("read {}: {}", path.display(), read_reason(source))]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: io::Error,
    },
    /// The file cannot be written. The file that was there is as it was.
    #[error("write {}: {}; nothing is changed", path.display(), write_reason(source))]
    Write {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: io::Error,
    },
    /// The file is no text that can be edited.
    #[error("edit {}: {reason}", path.display())]
    Text {
        /// Path of the file.
        path: PathBuf,
        /// Reason, as text for a person.
        reason: &'static str,
    },
    /// The file has changed since it was read.
    #[error(
        "change {}: it was edited meanwhile; nothing is changed, so run the same command once more",
        path.display()
    )]
    Changed {
        /// Path of the file.
        path: PathBuf,
    },
    /// The file exists already.
    #[error("write {}: it exists already, and is not overwritten", path.display())]
    Exists {
        /// Path of the file.
        path: PathBuf,
    },
    /// Another process changes a file of the same folder.
    #[error("change {}: another program has been changing its folder for too long", path.display())]
    Locked {
        /// Path of the file.
        path: PathBuf,
    },
}

fn read_reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file".to_owned(),
        io::ErrorKind::PermissionDenied => "you may not read it".to_owned(),
        io::ErrorKind::IsADirectory => "it is a folder; name a file in it".to_owned(),
        _ => error.to_string(),
    }
}

fn write_reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such folder".to_owned(),
        io::ErrorKind::PermissionDenied => "you may not write there".to_owned(),
        io::ErrorKind::ReadOnlyFilesystem => "the disk is read-only".to_owned(),
        io::ErrorKind::StorageFull => "the disk is full".to_owned(),
        io::ErrorKind::QuotaExceeded => "your share of the disk is used up".to_owned(),
        _ => error.to_string(),
    }
}

/// A file that was read in order to be changed.
#[derive(Clone, Debug)]
pub struct EditableFile {
    /// Path of the file itself, and not of a symbolic link to it.
    path: PathBuf,
    text: String,
}

// === impl EditableFile ===

impl EditableFile {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, is too long, or is not text in UTF-8.
    pub fn read(path: &Path) -> Result<EditableFile, FileEditError> {
        let failed = |source| FileEditError::Read { path: path.to_owned(), source };
        let real = fs::canonicalize(path).map_err(failed)?;
        let text = read_text(&real)?;
        Ok(EditableFile { path: real, text })
    }

    /// Returns the text of the file when it was read.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Replaces the file by one with the text `new`, of the same owner and with the same
    /// permissions. A reader sees the old text or the new one, and never a part of it.
    ///
    /// # Errors
    ///
    /// Returns an error if the file has changed since it was read, or cannot be written. The file
    /// is then as it was.
    pub fn replace(&self, new: &str) -> Result<(), FileEditError> {
        let failed = |source| FileEditError::Write { path: self.path.clone(), source };
        let folder = File::open(folder_of(&self.path)).map_err(failed)?;
        // The lock ends with the file handle, also if this process dies.
        self.lock(&folder)?;
        let is_same = read_text(&self.path).is_ok_and(|text| text == self.text);
        if !is_same {
            return Err(FileEditError::Changed { path: self.path.clone() });
        }
        let aside = aside(&self.path);
        let replaced = self.write_aside(&aside, new).and_then(|()| fs::rename(&aside, &self.path));
        replaced.map_err(|error| {
            let _ = fs::remove_file(&aside);
            failed(error)
        })?;
        // Without this, the name of the new file could be lost with the power.
        folder.sync_all().map_err(failed)
    }

    /// Writes a new file.
    ///
    /// # Errors
    ///
    /// Returns an error if the file exists or cannot be written. No part of it is left.
    pub fn create(path: &Path, text: &str) -> Result<(), FileEditError> {
        let failed = |source| FileEditError::Write { path: path.to_owned(), source };
        let exists = || FileEditError::Exists { path: path.to_owned() };
        // The name of a broken link counts as taken, too.
        if fs::symlink_metadata(path).is_ok() {
            return Err(exists());
        }
        let aside = aside(path);
        // Removes the remnant of a process that died.
        let _ = fs::remove_file(&aside);
        let written = write_new(&aside, text, None).and_then(|_| {
            let renamed = rustix::fs::renameat_with(
                rustix::fs::CWD,
                &aside,
                rustix::fs::CWD,
                path,
                rustix::fs::RenameFlags::NOREPLACE,
            );
            match renamed {
                // File systems without the flag, such as NFS.
                Err(rustix::io::Errno::INVAL) => fs::hard_link(&aside, path),
                renamed => renamed.map_err(io::Error::from),
            }
        });
        let _ = fs::remove_file(&aside);
        match written {
            Ok(()) => Ok(()),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Err(exists()),
            Err(error) => Err(failed(error)),
        }
    }

    fn lock(&self, folder: &File) -> Result<(), FileEditError> {
        let began = Instant::now();
        loop {
            match folder.try_lock() {
                Ok(()) => return Ok(()),
                Err(TryLockError::Error(source)) => {
                    return Err(FileEditError::Write { path: self.path.clone(), source });
                }
                Err(TryLockError::WouldBlock) if began.elapsed() >= LOCK_WAIT_MAX => {
                    return Err(FileEditError::Locked { path: self.path.clone() });
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(LOCK_POLL),
            }
        }
    }

    fn write_aside(&self, aside: &Path, text: &str) -> io::Result<()> {
        // Removes the remnant of a process that died.
        let _ = fs::remove_file(aside);
        let before = fs::metadata(&self.path)?;
        let file = write_new(aside, text, Some(before.mode() & 0o7777))?;
        let made = file.metadata()?;
        if (before.uid(), before.gid()) != (made.uid(), made.gid()) {
            // The daemon of another user has to read the file as before.
            fchown(&file, Some(before.uid()), Some(before.gid()))?;
        }
        file.sync_all()
    }
}

/// Writes a file that must not exist, with the permissions `mode`, or else those of new files.
fn write_new(path: &Path, text: &str, mode: Option<u32>) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    if mode.is_some() {
        // Until it has its own permissions, other users cannot read the text.
        options.mode(0o600);
    }
    let mut file = options.open(path)?;
    file.write_all(text.as_bytes())?;
    if let Some(mode) = mode {
        file.set_permissions(fs::Permissions::from_mode(mode))?;
    }
    file.sync_all()?;
    Ok(file)
}

fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns the path of the new file until it takes the place of the old one.
fn aside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.new-{}", std::process::id()))
}

fn read_text(path: &Path) -> Result<String, FileEditError> {
    let failed = |source| FileEditError::Read { path: path.to_owned(), source };
    let unfit = |reason| FileEditError::Text { path: path.to_owned(), reason };
    let about = fs::metadata(path).map_err(failed)?;
    if about.is_dir() {
        return Err(unfit("it is a folder; name a file in it"));
    }
    if !about.is_file() {
        // Opening a pipe would wait for a writer.
        return Err(unfit("it is no regular file"));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(unfit("it has more than 4 MiB"));
    }
    String::from_utf8(bytes).map_err(|_| unfit("it is not text in UTF-8; save it as UTF-8 first"))
}
