//! The ways in which this process is asked to stop: by a signal, or because the reader of its
//! output is gone.

use std::os::fd::AsFd as _;
use std::os::unix::fs::FileTypeExt as _;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::oneshot;

/// Waits for SIGINT or SIGTERM, and returns the number of the signal. The signal handlers are
/// installed when this function is called, not when the future is first polled: a process that has
/// reported that it is ready must not be killed by a signal that follows at once. If the handlers
/// cannot be installed, the signals end the process as usual, and the future never completes.
///
/// # Panics
///
/// Panics if it is called outside of a Tokio runtime.
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

/// Waits for SIGINT, SIGTERM or SIGHUP as [`interrupted`] does, and returns the number of the
/// signal. SIGHUP means that the terminal has gone away.
///
/// # Panics
///
/// Panics if it is called outside of a Tokio runtime.
pub(crate) fn interrupted_or_hung_up() -> impl Future<Output = i32> {
    let hangup = SignalKind::hangup();
    let (hung_up, interrupted) = (signal(hangup), interrupted());
    async move {
        let Ok(mut hung_up) = hung_up else { return interrupted.await };
        tokio::select! {
            signal = interrupted => signal,
            _ = hung_up.recv() => hangup.as_raw_value(),
        }
    }
}

/// Presses of Ctrl-C (SIGINT). The signal handler is installed when the value is made, so that a
/// Ctrl-C right after the first line of output does not end the process without a word.
pub(crate) struct CtrlC(Option<Signal>);

impl CtrlC {
    /// Installs the signal handler. If it cannot be installed, Ctrl-C ends the process as usual.
    ///
    /// # Panics
    ///
    /// Panics if it is called outside of a Tokio runtime.
    pub(crate) fn listen() -> CtrlC {
        CtrlC(signal(SignalKind::interrupt()).ok())
    }

    /// Waits for the next Ctrl-C.
    pub(crate) async fn pressed(&mut self) {
        match &mut self.0 {
            Some(presses) => {
                presses.recv().await;
            }
            None => std::future::pending().await,
        }
    }
}

/// Waits until the reader of stdout is gone, such as `head` in `althing watch | head`. Writing to
/// stdout would detect that as well, but the next write may be hours away. If stdout is neither a
/// pipe nor a socket, the future never completes.
pub(crate) fn reader_gone() -> impl Future<Output = ()> {
    let (tell, gone) = oneshot::channel();
    if is_pipe() {
        // A separate thread is used, because the poll cannot be cancelled. The thread ends with the
        // process.
        std::thread::spawn(move || {
            let stdout = std::io::stdout();
            let mut watched = [PollFd::from_borrowed_fd(stdout.as_fd(), PollFlags::empty())];
            // The poll is repeated after a signal has interrupted it.
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

/// Whether stdout is a pipe or a socket.
fn is_pipe() -> bool {
    let about = std::fs::metadata("/proc/self/fd/1");
    about.is_ok_and(|about| about.file_type().is_fifo() || about.file_type().is_socket())
}

#[cfg(test)]
mod tests {
    use rustix::process::{Signal as ProcessSignal, getpid, kill_process};

    use super::*;

    #[tokio::test]
    async fn a_signal_before_the_first_poll_is_received() {
        let interrupted = interrupted();
        // Without installed handlers, this would end the tests.
        kill_process(getpid(), ProcessSignal::TERM).expect("our own process");
        assert_eq!(interrupted.await, ProcessSignal::TERM.as_raw());
    }
}
