//! A daemon whose socket is deleted under it, with its folder or alone, can be reached by no command
//! and no daemon that comes later. Zenoh does not listen anew while a session lives, so the daemon
//! begins anew, under its process id: that makes the folder and the socket again.

use std::fs::DirBuilder;
use std::io::ErrorKind;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::task::AbortHandle;
use tokio::time::sleep;

use super::anew::begin_anew;

/// How often it looks for its socket.
const PERIOD: Duration = Duration::from_secs(2);

/// The watch over a daemon's socket; it ends when this is dropped, before the daemon itself takes its
/// socket away.
#[must_use]
pub(crate) struct SocketWatch(AbortHandle);

/// Begins anew when this socket is gone.
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
                    "somebody deleted this daemon's socket, by which commands reach it, and its \
                     folder cannot be made again: no command reaches it until it is restarted"
                );
            }
            if is_missing && was_missing {
                tracing::warn!(
                    socket = %socket.display(),
                    "somebody deleted this daemon's socket, by which commands reach it: begins anew \
                     to make it again"
                );
                begin_anew();
            }
            was_missing = is_missing;
        }
    });
    SocketWatch(watch.abort_handle())
}

/// Whether the folder of a socket is there, or can be made: what begins anew without it would end.
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
