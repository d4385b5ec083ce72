//! A daemon whose socket is deleted under it, with its folder or alone, can be reached by no command
//! and no daemon that comes later. Zenoh does not listen anew while a session lives, so the daemon
//! begins anew, under its process id: that makes the folder and the socket again.

use std::path::PathBuf;
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
            let is_missing = std::fs::symlink_metadata(&socket).is_err();
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

impl Drop for SocketWatch {
    fn drop(&mut self) {
        self.0.abort();
    }
}
