//! The folders of the sockets, the state and the packages of daemons.

use std::fs::Permissions;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, PermissionsExt as _, chown};
use std::path::{Path, PathBuf};
use std::{fs, io};

use acl::{DaemonId, EcosystemId};
use rustix::fs::Mode;
use rustix::process::{geteuid, umask};

/// Maximum length of the path of a Unix socket, in bytes; a longer path is an error. `sockaddr_un`
/// holds 108 bytes with the final zero, and Zenoh creates a lock file with a longer name beside the
/// socket.
const SOCKET_PATH_BYTES_MAX: usize = 100;

/// The folders of the sockets and of the state of a packaged daemon, which runs as a user of its own.
/// Only root can make them.
const SERVICE_RUNTIME: &str = "/run/althing";
const SERVICE_STATE: &str = "/var/lib/althing";

/// The permission bits of a file that give access to users other than the owner.
const OTHERS: u32 = 0o077;

/// The reason why a folder cannot be used. The message completes the sentence “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum FolderError {
    /// The folder cannot be created or read.
    #[error("use the folder {}: {source}", path.display())]
    Io {
        /// Path of the folder that cannot be created or read.
        path: PathBuf,
        /// The error that the operating system reports.
        #[source]
        source: io::Error,
    },
    /// Other users can write in the folder, so that they could impersonate a daemon.
    #[error("use the folder {}: it must belong to you alone (mode 700)", path.display())]
    Shared {
        /// Path of the folder that other users can write in.
        path: PathBuf,
    },
    /// The path of the folder is so long that the paths of sockets in it would be too long.
    #[error(
        "use the folder {}: the path of a socket in it is too long; set ALTHING_RUNTIME_DIR to a \
         shorter one",
        path.display()
    )]
    TooLong {
        /// Path of the folder that is too long.
        path: PathBuf,
    },
}

/// Returns the folder with the sockets of an ecosystem's daemons on this machine, and creates the
/// folder if it is missing. The folder is in `$ALTHING_RUNTIME_DIR`; if that is not set, in that of
/// the packaged daemon, if this user runs it or is root; otherwise in `althing` in
/// `$XDG_RUNTIME_DIR`; if that is not set either, in a folder of this user in the temporary folder.
///
/// # Errors
///
/// Returns an error if the folder cannot be created, or if other users can write in it.
pub(crate) fn runtime_folder(ecosystem: &EcosystemId) -> Result<PathBuf, FolderError> {
    let base = runtime_base();
    private(&base)?;
    let folder = base.join(ecosystem.as_str());
    private(&folder)?;
    Ok(folder)
}

/// Returns the names of the ecosystems that have a runtime folder on this machine.
pub(crate) fn running_ecosystems() -> Vec<EcosystemId> {
    let Ok(entries) = fs::read_dir(runtime_base()) else { return Vec::new() };
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut ecosystems: Vec<_> = names.filter_map(|name| EcosystemId::new(&name).ok()).collect();
    ecosystems.sort();
    ecosystems
}

/// Returns the sockets of an ecosystem's daemons on this machine, sorted.
pub(crate) fn daemon_sockets(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.flatten().map(|entry| entry.path());
    let mut sockets: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|extension| extension == "sock"))
        .collect();
    sockets.sort();
    sockets
}

/// Returns the folder that contains the runtime folders of all ecosystems, see [`runtime_folder`].
/// Creates nothing.
pub(crate) fn runtime_base() -> PathBuf {
    let named = variable("ALTHING_RUNTIME_DIR").or_else(|| service_folder(SERVICE_RUNTIME));
    match (named, variable("XDG_RUNTIME_DIR")) {
        (Some(folder), _) => folder,
        (None, Some(folder)) => folder.join("althing"),
        (None, None) => {
            let user = fs::metadata("/proc/self").map_or(0, |process| process.uid());
            std::env::temp_dir().join(format!("althing-{user}"))
        }
    }
}

/// Returns the folder in which a daemon's agents store what must survive a restart, and creates the
/// folder if it is missing. The folder is in the first of these that is set: `$ALTHING_STATE_DIR`,
/// systemd's `$STATE_DIRECTORY`, that of the packaged daemon, if this user runs it or is root,
/// `althing` in `$XDG_STATE_HOME`, `.local/state/althing` in `$HOME`; otherwise in
/// `/var/lib/althing`.
///
/// # Errors
///
/// Returns an error if the folder cannot be created.
pub(crate) fn state_folder(
    ecosystem: &EcosystemId,
    daemon: &DaemonId,
) -> Result<PathBuf, FolderError> {
    let folder = state_base().join(ecosystem.as_str()).join(daemon.as_str());
    let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder);
    let base = folder.parent().unwrap_or(&folder);
    made.and_then(|()| give_to_service(base))
        .and_then(|()| give_to_service(&folder))
        .and_then(|()| remove_access(&folder))
        .map_err(|source| FolderError::Io { path: folder.clone(), source })?;
    Ok(folder)
}

/// Returns the folder that contains the state folders of all ecosystems, see [`state_folder`].
/// Creates nothing.
pub(crate) fn state_base() -> PathBuf {
    let home = || variable("HOME").map(|home| home.join(".local/state"));
    variable("ALTHING_STATE_DIR")
        .or_else(|| variable("STATE_DIRECTORY"))
        .or_else(|| service_folder(SERVICE_STATE))
        .or_else(|| Some(variable("XDG_STATE_HOME").or_else(home)?.join("althing")))
        .unwrap_or_else(|| PathBuf::from(SERVICE_STATE))
}

/// Sets the umask so that no other user has access to files that this process creates from now on.
pub(crate) fn restrict_umask() {
    let before = umask(Mode::from_raw_mode(OTHERS));
    umask(before | Mode::from_raw_mode(OTHERS));
}

/// Removes the access of other users to a folder and to the files in it: an older version of this
/// program, or a person, may have created them with another umask.
fn remove_access(folder: &Path) -> io::Result<()> {
    let files = fs::read_dir(folder)?.filter_map(Result::ok).map(|entry| entry.path());
    for path in files.chain([folder.to_owned()]) {
        // Symbolic links are skipped, and so are files that have been removed meanwhile.
        let Ok(about) = fs::symlink_metadata(&path) else { continue };
        let mode = about.mode() & 0o7777;
        if (about.is_file() || about.is_dir()) && mode & OTHERS != 0 {
            let closed = fs::set_permissions(&path, Permissions::from_mode(mode & !OTHERS));
            let _ = closed.inspect_err(|error| {
                tracing::warn!(path = %path.display(), %error, "other users can read this path");
            });
        }
    }
    Ok(())
}

/// Returns the path of the socket of the daemon `daemon` in the folder `folder`.
///
/// # Errors
///
/// Returns an error if the path is too long for a socket.
pub(crate) fn socket_in(folder: &Path, daemon: &str) -> Result<PathBuf, FolderError> {
    let path = folder.join(format!("{daemon}.sock"));
    if path.as_os_str().len() > SOCKET_PATH_BYTES_MAX {
        return Err(FolderError::TooLong { path: folder.to_owned() });
    }
    Ok(path)
}

/// Returns the folder of this machine's packages. This is the first of these that is set:
/// `$ALTHING_PLUGINS_DIR`, the folder `said` from the ecosystem file, `plugins` in systemd's
/// `$STATE_DIRECTORY`, `plugins` in the state folder of the packaged daemon, if this user runs it or
/// is root, `althing/plugins` in `$XDG_DATA_HOME`, `.local/share/althing/plugins` in `$HOME`;
/// otherwise `/var/lib/althing/plugins`.
pub(crate) fn plugins_folder(said: Option<&Path>) -> PathBuf {
    let home = || variable("HOME").map(|home| home.join(".local/share"));
    variable("ALTHING_PLUGINS_DIR")
        .or_else(|| said.map(Path::to_owned))
        .or_else(|| Some(variable("STATE_DIRECTORY")?.join("plugins")))
        .or_else(|| Some(service_folder(SERVICE_STATE)?.join("plugins")))
        .or_else(|| Some(variable("XDG_DATA_HOME").or_else(home)?.join("althing/plugins")))
        .unwrap_or_else(|| PathBuf::from("/var/lib/althing/plugins"))
}

/// Returns the folder of the packaged daemon, if it exists and belongs to this user. For root it may
/// belong to any user: only root can make a folder there.
fn service_folder(path: &str) -> Option<PathBuf> {
    let about = fs::metadata(path).ok().filter(fs::Metadata::is_dir)?;
    (geteuid().is_root() || about.uid() == geteuid().as_raw()).then(|| PathBuf::from(path))
}

/// Whether this process runs as root, and a folder is that of the packaged daemon or below it: it
/// belongs to another user, and root may use it.
pub(crate) fn is_for_root(folder: &Path) -> bool {
    let is_below = |service: &&str| folder.starts_with(service);
    geteuid().is_root() && [SERVICE_RUNTIME, SERVICE_STATE].iter().any(is_below)
}

/// Gives a file or folder below that of the packaged daemon to the daemon's user. Otherwise the
/// daemon could not use what a command of root has made there before it.
pub(super) fn give_to_service(folder: &Path) -> io::Result<()> {
    match service_owner(folder) {
        Some((user, _)) if fs::metadata(folder)?.uid() == user => Ok(()),
        Some((user, group)) => chown(folder, Some(user), Some(group)),
        None => Ok(()),
    }
}

/// Returns the numbers of the user and the group of the packaged daemon, if this process runs as
/// root, and `path` is below the folders of that daemon.
pub(super) fn service_owner(path: &Path) -> Option<(u32, u32)> {
    let services = [SERVICE_RUNTIME, SERVICE_STATE].map(Path::new);
    let service = services.into_iter().find(|service| path.starts_with(service))?;
    let about = fs::metadata(service).ok().filter(|_| geteuid().is_root() && path != service)?;
    Some((about.uid(), about.gid()))
}

fn variable(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// Creates a folder that only this user can access. If the folder exists, checks that it belongs to
/// this user and that no other user can write in it.
fn private(folder: &Path) -> Result<(), FolderError> {
    let failed = |source| FolderError::Io { path: folder.to_owned(), source };
    match fs::DirBuilder::new().mode(0o700).recursive(true).create(folder) {
        Ok(()) => (),
        Err(error) => return Err(failed(error)),
    }
    give_to_service(folder).map_err(failed)?;
    let metadata = fs::symlink_metadata(folder).map_err(failed)?;
    let user = fs::metadata("/proc/self").map_err(failed)?.uid();
    let is_ours = metadata.uid() == user || is_for_root(folder);
    let is_own = metadata.is_dir() && is_ours && metadata.mode() & 0o022 == 0;
    if is_own { Ok(()) } else { Err(FolderError::Shared { path: folder.to_owned() }) }
}
