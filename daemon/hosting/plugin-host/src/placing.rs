//! Changes of files and folders in the plugin folder: locked, copied, put on disk, exchanged, and
//! given to the user that runs the daemon. `package_store` decides which changes belong to a
//! package.

use std::fs::{self, DirBuilder, File, OpenOptions, Permissions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{
    DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown, lchown,
    symlink,
};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{CWD, RenameFlags, renameat_with, syncfs};
use rustix::io::Errno;

/// File mode of a folder that only its owner can enter.
pub(crate) const FOLDER_MODE: u32 = 0o700;
/// File mode of a file that only its owner can read.
const FILE_MODE: u32 = 0o600;
/// Bits of a file mode that let the group or other users write.
pub(crate) const OTHERS_WRITE: u32 = 0o022;
/// Bits of a file mode that are copied.
const COPIED_MODE: u32 = 0o777;

/// Time for which a command waits for another one that changes the plugin folder. The other command
/// copies a package, which may hold an interpreter with its libraries.
const LOCK_TIMEOUT: Duration = Duration::from_secs(30);
const LOCK_POLL_PERIOD: Duration = Duration::from_millis(10);

/// User and group that get what a process of root makes in the plugin folder: those of the packaged
/// daemon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FolderOwner {
    /// Number of the user.
    pub user: u32,
    /// Number of the group.
    pub group: u32,
}

/// Lock under which the plugin folder is changed, released on drop. It is `None` on a file system
/// without locks.
#[derive(Debug)]
pub(crate) struct FolderLock {
    _file: Option<File>,
}

/// Reason why a folder cannot be copied.
#[derive(Debug)]
pub(crate) struct CopyFailure {
    /// The file operation that failed.
    pub(crate) doing: &'static str,
    pub(crate) path: PathBuf,
    pub(crate) source: io::Error,
}

// === impl FolderLock ===

impl FolderLock {
    /// Locks a folder at once. Returns `None` if another process has locked it.
    pub(crate) fn at_once(folder: &Path) -> io::Result<Option<FolderLock>> {
        let file = File::open(folder)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(FolderLock { _file: Some(file) })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(_)) => Ok(Some(FolderLock { _file: None })),
        }
    }

    /// Waits up to [`LOCK_TIMEOUT`] for the lock of a folder.
    pub(crate) fn wait(folder: &Path) -> io::Result<FolderLock> {
        let deadline = Instant::now() + LOCK_TIMEOUT;
        loop {
            if let Some(lock) = FolderLock::at_once(folder)? {
                return Ok(lock);
            }
            if Instant::now() >= deadline {
                return Err(io::Error::other("another command is changing it; try again later"));
            }
            std::thread::sleep(LOCK_POLL_PERIOD);
        }
    }
}

/// Writes a file that only its owner can read, regardless of the umask, and puts it on disk. The
/// name of the file must not be a link, because another user may have made it.
pub(crate) fn write(file: &Path, text: &str, owner: Option<FolderOwner>) -> io::Result<()> {
    let mut options = OpenOptions::new();
    let options = options.create(true).truncate(true).write(true).mode(FILE_MODE);
    let mut file = options.custom_flags(libc::O_NOFOLLOW).open(file)?;
    if let Some(FolderOwner { user, group }) = owner {
        fchown(&file, Some(user), Some(group))?;
    }
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

/// Gives a file, a folder or a link to `owner`, if there is one.
pub(crate) fn give(path: &Path, owner: Option<FolderOwner>) -> io::Result<()> {
    match owner {
        Some(FolderOwner { user, group }) => lchown(path, Some(user), Some(group)),
        None => Ok(()),
    }
}

/// Copies a folder with all its contents; links are copied as links. Only `owner`, or this user if
/// there is none, can write to the copy.
pub(crate) fn copy(from: &Path, to: &Path, owner: Option<FolderOwner>) -> Result<(), CopyFailure> {
    DirBuilder::new().mode(FOLDER_MODE).create(to).map_err(refused("make", to))?;
    for entry in fs::read_dir(from).map_err(refused("read", from))? {
        let entry = entry.map_err(refused("read", from))?;
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        let about = fs::symlink_metadata(&path).map_err(refused("read", &path))?;
        if about.is_dir() {
            copy(&path, &to, owner)?;
        } else if about.is_symlink() || about.is_file() {
            copy_file(&path, &to, &about)
                .and_then(|()| give(&to, owner))
                .map_err(refused("copy", &path))?;
        }
    }
    // The folder comes last: until then, only this user can change what is in it.
    give(to, owner).map_err(refused("give away", to))
}

fn refused(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> CopyFailure {
    let path = path.to_owned();
    move |source| CopyFailure { doing, path, source }
}

fn copy_file(path: &Path, to: &Path, about: &fs::Metadata) -> io::Result<()> {
    if about.is_symlink() {
        return symlink(fs::read_link(path)?, to);
    }
    fs::copy(path, to)?;
    let mode = about.mode() & COPIED_MODE & !OTHERS_WRITE;
    fs::set_permissions(to, Permissions::from_mode(mode))
}

/// Puts all files below a folder on disk.
pub(crate) fn sync_all_in(folder: &Path) -> io::Result<()> {
    Ok(syncfs(File::open(folder)?)?)
}

/// Puts the names in a folder on disk.
pub(crate) fn sync_names_in(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Exchanges two folders by one rename. A file system that cannot do so exchanges them in steps by
/// `swap`.
pub(crate) fn exchange(one: &Path, other: &Path, swap: &Path) -> io::Result<()> {
    match renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE) {
        Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => exchange_in_steps(one, other, swap),
        done => Ok(done?),
    }
}

/// Exchanges two folders by three renames. If the process ends in the middle, `swap` is the former
/// `other`.
pub(crate) fn exchange_in_steps(one: &Path, other: &Path, swap: &Path) -> io::Result<()> {
    fs::rename(other, swap)?;
    if let Err(error) = fs::rename(one, other) {
        fs::rename(swap, other)?;
        return Err(error);
    }
    fs::rename(swap, one)
}
