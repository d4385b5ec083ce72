//! Restarts this process if a thread of Zenoh has panicked.
//!
//! Such a thread may hold a lock of Zenoh's routing tables, which is then poisoned. The daemon
//! would send and receive nothing any more, and would still look alive to its service manager. (A
//! thread of Zenoh 1.10.2 can panic if a link closes and opens again while its machine is busy:
//! `unregister_subscriber` in `net/routing/hat/router/pubsub.rs` expects a context that is gone;
//! eclipse-zenoh/zenoh#2624 is a similar panic.) As after any crash, the next incarnation reads its
//! state from disk and from the Journals.

use std::sync::OnceLock;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use super::reexec::restart_process;

/// Names of Zenoh's threads, without the numbers that follow them.
const ZENOH_THREADS: [&str; 5] = ["app", "acc", "tx", "rx", "net"];

/// Shortest time from the start of a process to its restart because of a panic. It bounds the rate
/// of restarts if each incarnation panics at once.
const UPTIME_MIN: Duration = Duration::from_secs(10);

/// Channel that wakes the thread of [`watch_zenoh_panics`]. Empty in a process that does not watch.
static ZENOH_PANICKED: OnceLock<SyncSender<()>> = OnceLock::new();

/// Notes that a thread of this name has panicked. The panic hook of the program calls this
/// function.
pub(crate) fn note_panic(thread: &str) {
    if is_zenoh_thread(thread)
        && let Some(panicked) = ZENOH_PANICKED.get()
    {
        // A full channel means that a restart is under way.
        let _ = panicked.try_send(());
    }
}

/// Restarts this process once a thread of Zenoh has panicked.
pub(crate) fn watch_zenoh_panics() {
    let began = Instant::now();
    watch(move || {
        tracing::error!(
            "a thread of Zenoh has panicked: restarts, because no message may arrive any more"
        );
        thread::sleep(UPTIME_MIN.saturating_sub(began.elapsed()));
        restart_process();
    });
}

/// Calls `restart` in a thread of its own when a thread of Zenoh has panicked.
fn watch(restart: impl FnOnce() + Send + 'static) {
    let (panicked, panics) = sync_channel(1);
    if ZENOH_PANICKED.set(panicked).is_ok() {
        thread::spawn(move || panics.recv().map(|()| restart()));
    }
}

fn is_zenoh_thread(name: &str) -> bool {
    name.split_once('-').is_some_and(|(name, number)| {
        ZENOH_THREADS.contains(&name) && number.chars().all(|digit| digit.is_ascii_digit())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_a_zenoh_thread_alone_causes_a_restart() {
        let (restart, restarts) = sync_channel(1);
        watch(move || restart.send(()).expect("the test waits"));
        for other in ["main", "tokio-runtime-worker", "rx", "rx-a", "unnamed"] {
            note_panic(other);
            assert!(!is_zenoh_thread(other), "{other}");
        }
        assert!(restarts.try_recv().is_err());
        note_panic("rx-0");
        restarts.recv().expect("it restarts");
        note_panic("net-12");
    }
}
