//! Pacing of a device's events: a few follow each other at once, and many follow at a fixed rate.

use std::time::Duration;

use tokio::time::Instant;

/// Interval between two events of a device that has many, so that a loose contact does not flood the
/// ecosystem.
const EVENT_INTERVAL: Duration = Duration::from_millis(100);

/// Number of events that follow each other without a pause, such as the opening and the closing of a
/// door. Each is announced at once.
const BURST: u32 = 4;

/// The times at which a device may report events.
#[derive(Default)]
pub(crate) struct EventPacing {
    /// Time until which the events so far are paid for, if each costs [`EVENT_INTERVAL`].
    paid_until: Option<Instant>,
}

impl EventPacing {
    /// Notes an event at `now`. Returns the pause before the next event.
    pub(crate) fn pause_after_event(&mut self, now: Instant) -> Duration {
        let begins = self.paid_until.map_or(now, |until| until.max(now));
        let paid_until = begins + EVENT_INTERVAL;
        self.paid_until = Some(paid_until);
        (paid_until - now).saturating_sub(EVENT_INTERVAL * (BURST - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_events_have_no_pause_and_many_come_at_the_rate() {
        let began = Instant::now();
        let (mut pacing, mut now, mut pauses) = (EventPacing::default(), began, Vec::new());
        for _ in 0..10 {
            let pause = pacing.pause_after_event(now);
            pauses.push(pause);
            now += pause;
        }
        let (burst, others) = pauses.split_at(BURST as usize - 1);
        assert!(burst.iter().all(Duration::is_zero), "{pauses:?}");
        assert!(others.iter().all(|pause| *pause == EVENT_INTERVAL), "{pauses:?}");
    }

    #[test]
    fn a_quiet_time_allows_a_few_events_again() {
        let mut now = Instant::now();
        let mut pacing = EventPacing::default();
        (0..20).for_each(|_| now += pacing.pause_after_event(now));
        now += EVENT_INTERVAL * BURST;
        assert_eq!(pacing.pause_after_event(now), Duration::ZERO);
        assert_eq!(pacing.pause_after_event(now), Duration::ZERO);
    }
}
