//! Restarts a process that was suspended: stopped by a signal, or on a machine that was asleep.
//!
//! After a lease the other daemons count it as gone, go on without it, and try to connect again.
//! When it resumes, its state is outdated, and both its own agents and the first agents that ask
//! would get that state. All its links close and open at once, and presence changes that Zenoh
//! misses then arrive only seconds later. A process that has just started is seen by all, and
//! queries the others before it announces anything; its state is read from disk and from the
//! Journals, as after any crash. So the process restarts itself, under its process id. (Without
//! this, two of eighteen stops in `tests/faults.rs` ended in goals that no agent pursued.)

use std::thread;
use std::time::Duration;

use super::reexec::restart_process;

/// How often the clock is checked.
const PERIOD: Duration = Duration::from_millis(250);

/// Restarts this process whenever it was suspended for so long that other daemons may count it as
/// gone. Their lease starts at its last keep-alive, of which there are four per lease; so three
/// quarters of a lease are enough.
pub(crate) fn watch_suspension(lease: Duration) {
    let missed = lease * 3 / 4;
    // A thread of its own, because a task in a busy runtime would mistake a delay for a suspension.
    thread::spawn(move || {
        let Some(mut last) = uptime() else { return };
        loop {
            thread::sleep(PERIOD);
            let Some(now) = uptime() else { return };
            let stood_still = now.saturating_sub(last).saturating_sub(PERIOD);
            if stood_still > missed {
                tracing::warn!(?stood_still, "was suspended, and counted as gone: restarts");
                restart_process();
            }
            last = now;
        }
    });
}

/// Returns the time since the machine was started, including time asleep; `None` if `/proc/uptime`
/// cannot be read.
fn uptime() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/uptime").ok()?;
    let seconds: f64 = text.split_whitespace().next()?.parse().ok()?;
    Duration::try_from_secs_f64(seconds).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_is_read() {
        let before = uptime().expect("there is such a file");
        thread::sleep(Duration::from_millis(30));
        assert!(uptime().expect("still") > before);
    }
}
