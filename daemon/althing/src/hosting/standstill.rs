//! What becomes of a process that stood still: stopped, or its machine asleep.
//!
//! After a lease the others count it as gone, go on without it, and call it again. When it wakes it
//! believes what was so before, to its own agents and to whoever asks first; all its links close and
//! open at once, and what Zenoh forgets to tell then is told again only seconds later. As a process
//! that has just begun it is seen by all and asks before it says anything; what it was at is known
//! from disk and from the Journals, as after any death. So it begins anew, under its process id.
//! (Without this, two of eighteen stops in `tests/faults.rs` ended in goals that nobody began.)

use std::thread;
use std::time::Duration;

use super::anew::begin_anew;

/// How often it looks at the clock.
const PERIOD: Duration = Duration::from_millis(250);

/// Begins anew whenever this process has stood still for as long as others may have taken it for
/// gone: their lease counts from its last sign of life, of which there are four per lease.
pub(crate) fn watch_standstill(lease: Duration) {
    let missed = lease * 3 / 4;
    // A thread of its own: one that waits for others would take a busy runtime for a standstill.
    thread::spawn(move || {
        let Some(mut last) = uptime() else { return };
        loop {
            thread::sleep(PERIOD);
            let Some(now) = uptime() else { return };
            let stood_still = now.saturating_sub(last).saturating_sub(PERIOD);
            if stood_still > missed {
                tracing::warn!(?stood_still, "stood still, and was counted as gone: begins anew");
                begin_anew();
            }
            last = now;
        }
    });
}

/// Time since the machine was started, asleep or not.
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
