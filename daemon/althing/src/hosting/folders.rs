//! Where a daemon keeps its sockets and what it must not forget.

use std::fs::Permissions;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::{fs, io};

use acl::{DaemonId, EcosystemId};
use rustix::fs::Mode;
use rustix::process::umask;

/// Longest path of a Unix socket: `sockaddr_un` holds 108 bytes with its final zero, and Zenoh
/// keeps a lock beside it.
const SOCKET_PATH_BYTES_MAX: usize = 100;

/// What users other than the owner may do.
const OTHERS: u32 = 0o077;

/// Why a folder cannot be used. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum FolderError {
    /// It cannot be made or looked at.
    #[error("use the folder {}: {source}", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// Others could write in it, and so put themselves in a daemon's place.
    #[error("use the folder {}: it must belong to you alone (mode 700)", path.display())]
    Shared {
        /// The folder.
        path: PathBuf,
    },
    /// Its sockets would have too long a path.
    #[error(
        "use the folder {}: the path of a socket in it is too long; set ALTHING_RUNTIME_DIR to a \
         shorter one",
        path.display()
    )]
    TooLong {
        /// The folder.
        path: PathBuf,
    },
}

/// The folder in which the daemons of an ecosystem on this machine meet: `$ALTHING_RUNTIME_DIR`,
/// or `althing` in `$XDG_RUNTIME_DIR`, or a folder of this user's in the temporary one.
///
/// # Errors
///
/// If it cannot be made, or others could write in it.
pub(crate) fn runtime_folder(ecosystem: &EcosystemId) -> Result<PathBuf, FolderError> {
    let base = runtime_base();
    private(&base)?;
    let folder = base.join(ecosystem.as_str());
    private(&folder)?;
    Ok(folder)
}

/// The ecosystems that have a folder where daemons of this machine meet.
pub(crate) fn running_ecosystems() -> Vec<EcosystemId> {
    let Ok(entries) = fs::read_dir(runtime_base()) else { return Vec::new() };
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut ecosystems: Vec<_> = names.filter_map(|name| EcosystemId::new(&name).ok()).collect();
    ecosystems.sort();
    ecosystems
}

fn runtime_base() -> PathBuf {
    match (variable("ALTHING_RUNTIME_DIR"), variable("XDG_RUNTIME_DIR")) {
        (Some(folder), _) => folder,
        (None, Some(folder)) => folder.join("althing"),
        (None, None) => {
            let user = fs::metadata("/proc/self").map_or(0, |process| process.uid());
            std::env::temp_dir().join(format!("althing-{user}"))
        }
    }
}

/// The folder in which a daemon's agents keep what they must not forget: `$ALTHING_STATE_DIR`,
/// or systemd's `$STATE_DIRECTORY`, or `althing` in `$XDG_STATE_HOME` or `~/.local/state`.
///
/// # Errors
///
/// If it cannot be made.
pub(crate) fn state_folder(
    ecosystem: &EcosystemId,
    daemon: &DaemonId,
) -> Result<PathBuf, FolderError> {
    let home = || variable("HOME").map(|home| home.join(".local/state"));
    let base = variable("ALTHING_STATE_DIR")
        .or_else(|| variable("STATE_DIRECTORY"))
        .or_else(|| Some(variable("XDG_STATE_HOME").or_else(home)?.join("althing")))
        .unwrap_or_else(|| PathBuf::from("/var/lib/althing"));
    let folder = base.join(ecosystem.as_str()).join(daemon.as_str());
    let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder);
    made.and_then(|()| close(&folder))
        .map_err(|source| FolderError::Io { path: folder.clone(), source })?;
    Ok(folder)
}

/// Lets no other user read what this process makes from now on, whatever the umask it was started with.
pub(crate) fn keep_to_oneself() {
    let before = umask(Mode::from_raw_mode(OTHERS));
    umask(before | Mode::from_raw_mode(OTHERS));
}

/// Takes a folder and the files in it from other users: an older version, or a person, made them with
/// another umask.
fn close(folder: &Path) -> io::Result<()> {
    let files = fs::read_dir(folder)?.filter_map(Result::ok).map(|entry| entry.path());
    for path in files.chain([folder.to_owned()]) {
        // A link leads elsewhere, and what has gone meanwhile needs nothing.
        let Ok(about) = fs::symlink_metadata(&path) else { continue };
        let mode = about.mode() & 0o7777;
        if (about.is_file() || about.is_dir()) && mode & OTHERS != 0 {
            let closed = fs::set_permissions(&path, Permissions::from_mode(mode & !OTHERS));
            let _ = closed.inspect_err(|error| {
                tracing::warn!(path = %path.display(), %error, "others can read it");
            });
        }
    }
    Ok(())
}

/// The socket of a daemon in the folder where they meet.
///
/// # Errors
///
/// If its path would be too long for a socket.
pub(crate) fn socket_in(folder: &Path, daemon: &str) -> Result<PathBuf, FolderError> {
    let path = folder.join(format!("{daemon}.sock"));
    if path.as_os_str().len() > SOCKET_PATH_BYTES_MAX {
        return Err(FolderError::TooLong { path: folder.to_owned() });
    }
    Ok(path)
}

/// The folder of this machine's packages of plugins: `$ALTHING_PLUGINS_DIR`, or what the ecosystem's
/// file says, or `plugins` in systemd's `$STATE_DIRECTORY`, or `althing/plugins` in `$XDG_DATA_HOME` or
/// `~/.local/share`.
pub(crate) fn plugins_folder(said: Option<&Path>) -> PathBuf {
    let home = || variable("HOME").map(|home| home.join(".local/share"));
    variable("ALTHING_PLUGINS_DIR")
        .or_else(|| said.map(Path::to_owned))
        .or_else(|| Some(variable("STATE_DIRECTORY")?.join("plugins")))
        .or_else(|| Some(variable("XDG_DATA_HOME").or_else(home)?.join("althing/plugins")))
        .unwrap_or_else(|| PathBuf::from("/var/lib/althing/plugins"))
}

fn variable(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// Makes a folder that belongs to this user alone, or sees to it that it does.
fn private(folder: &Path) -> Result<(), FolderError> {
    let failed = |source| FolderError::Io { path: folder.to_owned(), source };
    match fs::DirBuilder::new().mode(0o700).recursive(true).create(folder) {
        Ok(()) => (),
        Err(error) => return Err(failed(error)),
    }
    let metadata = fs::symlink_metadata(folder).map_err(failed)?;
    let user = fs::metadata("/proc/self").map_err(failed)?.uid();
    let is_own = metadata.is_dir() && metadata.uid() == user && metadata.mode() & 0o022 == 0;
    if is_own { Ok(()) } else { Err(FolderError::Shared { path: folder.to_owned() }) }
}
