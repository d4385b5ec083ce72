//! How the process is told to stop.

use tokio::signal::unix::{SignalKind, signal};

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
