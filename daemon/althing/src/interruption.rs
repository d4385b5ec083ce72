//! How the process is told to stop: by signals, and by whoever read what it prints.

use std::os::fd::AsFd as _;
use std::os::unix::fs::FileTypeExt as _;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::oneshot;

/// Whether the process has been told to stop, by SIGINT or SIGTERM, whose number comes. Listens
/// from the call on, not only from when it is first polled: who has said that he is ready must not
/// die of the answer. Where signals cannot be listened to, they end the process as they always do.
///
/// # Panics
///
/// Outside of a tokio runtime.
pub(crate) fn interrupted() -> impl Future<Output = i32> {
    let (interrupt, terminate) = (SignalKind::interrupt(), SignalKind::terminate());
    let listening = (signal(interrupt), signal(terminate));
    async move {
        let (Ok(mut interrupts), Ok(mut terminations)) = listening else {
            return std::future::pending().await;
        };
        tokio::select! {
            _ = interrupts.recv() => interrupt.as_raw_value(),
            _ = terminations.recv() => terminate.as_raw_value(),
        }
    }
}

/// Waits until nobody reads stdout any more (`althing watch | head`). A write would find out too, and
/// may be hours away. Where stdout is no pipe, that never comes.
pub(crate) fn reader_gone() -> impl Future<Output = ()> {
    let (tell, gone) = oneshot::channel();
    if is_pipe() {
        // A thread of its own, which ends with the process: nothing else wakes it.
        std::thread::spawn(move || {
            let stdout = std::io::stdout();
            let mut watched = [PollFd::from_borrowed_fd(stdout.as_fd(), PollFlags::empty())];
            // A signal interrupts the wait, and no more.
            while matches!(poll(&mut watched, None), Ok(_) | Err(Errno::INTR)) {
                if watched[0].revents().intersects(PollFlags::ERR | PollFlags::HUP) {
                    let _ = tell.send(());
                    return;
                }
            }
        });
    }
    async move {
        if gone.await.is_err() {
            std::future::pending().await
        }
    }
}

/// Whether stdout leads to another process.
fn is_pipe() -> bool {
    let about = std::fs::metadata("/proc/self/fd/1");
    about.is_ok_and(|about| about.file_type().is_fifo() || about.file_type().is_socket())
}

#[cfg(test)]
mod tests {
    use rustix::process::{Signal, getpid, kill_process};

    use super::*;

    #[tokio::test]
    async fn a_signal_that_comes_before_anybody_waits_is_heard() {
        let interrupted = interrupted();
        // Were nobody listening yet, this would end the tests.
        kill_process(getpid(), Signal::TERM).expect("our own process");
        assert_eq!(interrupted.await, Signal::TERM.as_raw());
    }
}
