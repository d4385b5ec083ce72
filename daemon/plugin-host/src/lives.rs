//! When a plugin that has ended is started again, and when it is given up. No clock of its own.

use std::time::Duration;

use tokio::time::Instant;

/// First wait, doubled up to the last. The very first time there is none: whoever was killed is back
/// before anybody plans without him.
const WAIT_FIRST: Duration = Duration::from_millis(500);
const WAIT_LAST: Duration = Duration::from_secs(30);

/// Who has worked for so long begins with a clean slate.
const STEADY: Duration = Duration::from_secs(30);

/// Ends in a row after which a person has to look.
const ENDS_MAX: u32 = 6;

/// The lives of a plugin so far.
#[derive(Debug, Default)]
pub(crate) struct Lives {
    ends: u32,
}

impl Lives {
    /// A life has ended that was ready since `ready`, if it ever was: how long to wait for the next;
    /// `None` if there is none.
    pub(crate) fn after(&mut self, ready: Option<Instant>, now: Instant) -> Option<Duration> {
        if ready.is_some_and(|ready| now.saturating_duration_since(ready) >= STEADY) {
            self.ends = 0;
        }
        // What has worked is tried at once; what has not will not by itself.
        let at_once = self.ends == 0 && ready.is_some();
        self.ends += 1;
        if self.ends >= ENDS_MAX {
            return None;
        }
        let doubled = WAIT_FIRST.saturating_mul(1 << (self.ends - 1).min(16));
        Some(if at_once { Duration::ZERO } else { doubled.min(WAIT_LAST) })
    }

    /// How often in a row it has ended.
    pub(crate) fn ends(&self) -> u32 {
        self.ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_restart_is_at_once_then_ever_later_then_never() {
        let (mut lives, now) = (Lives::default(), Instant::now());
        let waits: Vec<_> =
            (0..6).map(|_| lives.after(Some(now), now).map(|wait| wait.as_millis())).collect();
        assert_eq!(waits, [Some(0), Some(1_000), Some(2_000), Some(4_000), Some(8_000), None]);
    }

    #[test]
    fn who_was_never_ready_waits_and_who_was_steady_is_forgiven() {
        let (mut lives, now) = (Lives::default(), Instant::now());
        assert_eq!(lives.after(None, now), Some(WAIT_FIRST));
        assert_eq!(lives.after(None, now), Some(WAIT_FIRST * 2));
        let later = now + STEADY;
        assert_eq!(lives.after(Some(now), later), Some(Duration::ZERO));
        assert_eq!(lives.ends(), 1);
    }
}
