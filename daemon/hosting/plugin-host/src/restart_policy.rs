//! Restart policy of a plugin: the wait before a process that has ended is restarted, and the
//! condition for giving the plugin up. The time is a parameter; there is no clock here.

use std::time::Duration;

use tokio::time::Instant;

/// Base of the wait before a restart. The wait doubles with each further end, up to `WAIT_LAST`.
/// The first restart of a plugin that was ready has no wait, so that a killed process is back
/// before the ecosystem plans without the plugin's agents.
const WAIT_FIRST: Duration = Duration::from_millis(500);
const WAIT_LAST: Duration = Duration::from_secs(30);

/// Time for which an incarnation must have been ready for the count of ends to restart from zero.
const STEADY: Duration = Duration::from_secs(30);

/// Number of successive ends at which the plugin is given up; afterwards a person has to intervene.
const ENDS_MAX: u32 = 6;

/// Restart policy of one plugin, with the number of its incarnations that have ended in a row.
#[derive(Debug, Default)]
pub(crate) struct RestartPolicy {
    ends: u32,
}

impl RestartPolicy {
    /// Records the end of an incarnation and returns the wait before the next one; `None` if the
    /// plugin is given up. `ready` is the time at which the incarnation became ready; `None` if it
    /// never was.
    pub(crate) fn after(&mut self, ready: Option<Instant>, now: Instant) -> Option<Duration> {
        if ready.is_some_and(|ready| now.saturating_duration_since(ready) >= STEADY) {
            self.ends = 0;
        }
        // A process that was ready is restarted at once. A process that was never ready will hardly
        // succeed without a change.
        let at_once = self.ends == 0 && ready.is_some();
        self.ends += 1;
        if self.ends >= ENDS_MAX {
            return None;
        }
        let doubled = WAIT_FIRST.saturating_mul(1 << (self.ends - 1).min(16));
        Some(if at_once { Duration::ZERO } else { doubled.min(WAIT_LAST) })
    }

    /// Returns the number of times that the process of the plugin has ended in a row.
    pub(crate) fn ends(&self) -> u32 {
        self.ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wait_before_a_restart_doubles_until_the_plugin_is_given_up() {
        let (mut lives, now) = (RestartPolicy::default(), Instant::now());
        let waits: Vec<_> =
            (0..6).map(|_| lives.after(Some(now), now).map(|wait| wait.as_millis())).collect();
        assert_eq!(waits, [Some(0), Some(1_000), Some(2_000), Some(4_000), Some(8_000), None]);
    }

    #[test]
    fn a_plugin_that_was_never_ready_waits_and_a_steady_one_starts_at_zero() {
        let (mut lives, now) = (RestartPolicy::default(), Instant::now());
        assert_eq!(lives.after(None, now), Some(WAIT_FIRST));
        assert_eq!(lives.after(None, now), Some(WAIT_FIRST * 2));
        let later = now + STEADY;
        assert_eq!(lives.after(Some(now), later), Some(Duration::ZERO));
        assert_eq!(lives.ends(), 1);
    }
}
