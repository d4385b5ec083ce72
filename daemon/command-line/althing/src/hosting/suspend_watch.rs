//! Restarts this process if it was suspended: because a signal stopped it, or because its machine
//! was asleep.
//!
//! When a daemon has been suspended for longer than a lease, the other daemons count it as gone,
//! continue without it, and try to connect again. When the daemon resumes, its state is outdated,
//! and it would answer queries with that state. All its links close and open at once, and Zenoh
//! delivers the presence changes of that moment only seconds later. A process that has just started
//! does not have these problems: all others see it, it queries them before it announces anything,
//! and it reads its state from disk and from the Journals. Therefore the daemon restarts itself,
//! under the same process id. (Without the restart, two of eighteen stops in `tests/faults.rs`
//! ended in goals that no agent pursued.)

use std::thread;
use std::time::Duration;

use super::reexec::restart_process;

/// How often the process reads the clock to notice that it was suspended.
const PERIOD: Duration = Duration::from_millis(250);

/// Restarts this process whenever it was suspended for so long that other daemons may count it as
/// gone. They do that when a lease has passed since its last keep-alive. A process sends four
/// keep-alives per lease, so the last one may be a quarter of a lease older than the suspension.
/// Therefore the process restarts after three quarters of a lease.
pub(crate) fn watch_suspension(lease: Duration) {
    let missed = lease * 3 / 4;
    // A separate thread is used, because a task in a busy runtime would mistake a delay for a
    // suspension.
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

/// Returns the time since the machine was started, including the time in which it was asleep;
/// `None` if `/proc/uptime` cannot be read.
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
