//! Restarts a daemon if its socket has been deleted, alone or with its folder. Without the socket,
//! commands and daemons that start later could not reach the daemon. Zenoh does not listen again
//! during a session. Therefore the daemon restarts itself, under the same process id, and creates
//! the folder and the socket again.

use std::fs::DirBuilder;
use std::io::ErrorKind;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::task::AbortHandle;
use tokio::time::sleep;

use super::reexec::restart_process;

/// How often the daemon checks whether its socket exists.
const PERIOD: Duration = Duration::from_secs(2);

/// The task that watches a daemon's socket. The task ends when this value is dropped. It must be
/// dropped before the daemon itself removes the socket.
#[must_use]
pub(crate) struct SocketWatch(AbortHandle);

/// Watches the socket at `socket`, and restarts the process when the socket is missing at two
/// checks in a row.
pub(crate) fn watch_socket(socket: PathBuf) -> SocketWatch {
    let watch = tokio::spawn(async move {
        let mut was_missing = false;
        loop {
            sleep(PERIOD).await;
            let found = std::fs::symlink_metadata(&socket);
            let is_missing = found.is_err_and(|error| error.kind() == ErrorKind::NotFound);
            if is_missing && was_missing && !can_be_made(&socket) {
                return tracing::error!(
                    socket = %socket.display(),
                    "this daemon's socket, by which commands reach it, was deleted, and its \
                     folder cannot be made again: no command reaches it until it is restarted"
                );
            }
            if is_missing && was_missing {
                tracing::warn!(
                    socket = %socket.display(),
                    "this daemon's socket, by which commands reach it, was deleted: restarts \
                     to make it again"
                );
                restart_process();
            }
            was_missing = is_missing;
        }
    });
    SocketWatch(watch.abort_handle())
}

/// Creates the folder of a socket if it is missing, and returns whether this process may write in
/// it. Otherwise the restarted daemon would exit at once.
fn can_be_made(socket: &Path) -> bool {
    let folder = socket.parent().unwrap_or(socket);
    let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
    made.is_ok() && rustix::fs::access(folder, rustix::fs::Access::WRITE_OK).is_ok()
}

impl Drop for SocketWatch {
    fn drop(&mut self) {
        self.0.abort();
    }
}
