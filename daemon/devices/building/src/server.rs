//! The server of the building's socket: lets drivers in other processes use the devices.
//!
//! The server binds the socket in such a way that no other user can connect, and accepts clients;
//! `session` handles their requests. No client can make the server wait, grow without bound, or
//! panic. The operations of tests and scenarios are not offered over the socket.

use std::fs::{self, File, Permissions, TryLockError};
use std::io;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::net::{UnixListener, UnixStream};
use tokio::task::{AbortHandle, JoinSet};
use tracing::Instrument as _;

use crate::error::ServeError;
use crate::handle::BuildingHandle;
use crate::session::Session;

/// Maximum number of clients that are connected at the same time; further clients are turned away.
/// A client is a daemon, one per machine; a building that is simulated on one machine has a handful
/// of clients.
const CLIENTS_MAX: usize = 64;

/// Pause after a failed `accept`. The usual reason is that the process has no file descriptors
/// left, and an immediate retry would only waste processor time.
const ACCEPT_RETRY_WAIT: Duration = Duration::from_millis(100);

/// Time limit for locking the folder of the socket, while another process binds its own socket
/// there.
const LOCK_TIME_MAX: Duration = Duration::from_secs(2);
const LOCK_RETRY_WAIT: Duration = Duration::from_millis(5);

/// A building that is served at a socket. Dropping the server ends all connections, cancels the
/// operations under way, and removes the socket.
#[derive(Debug)]
pub struct Server {
    accepting: AbortHandle,
    path: PathBuf,
    /// Device and inode of this server's socket file, so that the socket of a successor is not
    /// removed.
    inode: (u64, u64),
}

/// Serves the devices of a building at a Unix socket that only this user can use.
///
/// The socket of a server that has ended is replaced.
///
/// # Errors
///
/// Returns an error if a server still listens at the path, if another file has the path, or if the
/// system refuses the socket.
pub async fn serve(
    building: BuildingHandle,
    socket_path: impl AsRef<Path>,
) -> Result<Server, ServeError> {
    let path = socket_path.as_ref().to_owned();
    let failed = |source| ServeError::Io { path: path.clone(), source };
    let turn = lock_folder(folder_of(&path)).await.map_err(failed)?;
    refuse_occupied(&path).await?;
    let listener = bind_private(&path).map_err(failed)?;
    drop(turn);
    let metadata = fs::symlink_metadata(&path).map_err(failed)?;
    let span = tracing::info_span!("building", socket = %path.display());
    let accepting = tokio::spawn(accept(building, listener).instrument(span)).abort_handle();
    Ok(Server { accepting, path, inode: (metadata.dev(), metadata.ino()) })
}

impl Drop for Server {
    fn drop(&mut self) {
        self.accepting.abort();
        let inode = fs::symlink_metadata(&self.path).map(|file| (file.dev(), file.ino()));
        if inode.is_ok_and(|inode| inode == self.inode) {
            // A socket that stays behind is harmless: the next server replaces it.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Returns the folder of the socket at `path`.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Locks the folder until the returned file is dropped. If two processes find the socket of a dead
/// server at the same time, one of them waits for the lock, and then finds the new socket of the
/// other.
async fn lock_folder(folder: &Path) -> io::Result<File> {
    let folder = File::open(folder)?;
    let locked = async {
        loop {
            match folder.try_lock() {
                Ok(()) => return Ok(()),
                Err(TryLockError::WouldBlock) => tokio::time::sleep(LOCK_RETRY_WAIT).await,
                Err(TryLockError::Error(error)) => return Err(error),
            }
        }
    };
    let locked = tokio::time::timeout(LOCK_TIME_MAX, locked).await;
    locked.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into())).map(|()| folder)
}

async fn refuse_occupied(path: &Path) -> Result<(), ServeError> {
    let Ok(metadata) = fs::symlink_metadata(path) else { return Ok(()) };
    if !metadata.file_type().is_socket() {
        return Err(ServeError::NotASocket { path: path.to_owned() });
    }
    match UnixStream::connect(path).await {
        // No process listens, so the socket was left by a dead server.
        Err(err)
            if matches!(err.kind(), io::ErrorKind::ConnectionRefused | io::ErrorKind::NotFound) =>
        {
            Ok(())
        }
        // The queue of a stopped server may be full, so that connecting fails; such a server still
        // counts as a server.
        Ok(_) | Err(_) => Err(ServeError::InUse { path: path.to_owned() }),
    }
}

/// Binds the socket in a folder that only this user can enter, and moves it to `path` after its
/// mode is set. Therefore no other user can connect at any moment.
fn bind_private(path: &Path) -> io::Result<UnixListener> {
    let nest = create_private_folder(folder_of(path))?;
    let bound = fs::set_permissions(&nest, Permissions::from_mode(0o700)).and_then(|()| {
        let listener = UnixListener::bind(nest.join("s"))?;
        fs::set_permissions(nest.join("s"), Permissions::from_mode(0o600))?;
        fs::rename(nest.join("s"), path)?;
        Ok(listener)
    });
    let swept = fs::remove_dir_all(&nest);
    bound.and_then(|listener| swept.map(|()| listener))
}

/// Creates a folder that no other process uses. The name of the folder is short, because the path
/// of a socket is limited to 107 bytes.
fn create_private_folder(parent: &Path) -> io::Result<PathBuf> {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    loop {
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let nest = parent.join(format!(".b{}-{number}", std::process::id()));
        match fs::create_dir(&nest) {
            Ok(()) => return Ok(nest),
            // The folder was left by a dead process that had the same process id.
            Err(err) if err.kind() == io::ErrorKind::AlreadyExists => (),
            Err(err) => return Err(err),
        }
    }
}

async fn accept(building: BuildingHandle, listener: UnixListener) {
    let mut clients = JoinSet::new();
    loop {
        tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) if clients.len() < CLIENTS_MAX => {
                    clients.spawn(Session::new(building.clone(), stream).run().in_current_span());
                }
                Ok(_) => tracing::warn!(CLIENTS_MAX, "too many clients; one is turned away"),
                Err(err) => {
                    tracing::warn!(%err, "failed to accept a client");
                    tokio::time::sleep(ACCEPT_RETRY_WAIT).await;
                }
            },
            Some(_) = clients.join_next() => (),
        }
    }
}

#[cfg(test)]
mod tests;
