//! Rate limit of one daemon: a token bucket.

use std::time::Instant;

/// A bucket of permits, each for sending one message.
#[derive(Debug)]
pub(crate) struct TokenBucket {
    permits: f64,
    refilled_at: Instant,
}

impl TokenBucket {
    /// Returns a full bucket, to which `per_second` permits are added per second.
    pub(crate) fn new(per_second: u32, now: Instant) -> TokenBucket {
        TokenBucket { permits: burst(per_second), refilled_at: now }
    }

    /// Takes one permit; returns `false` if the bucket has none.
    pub(crate) fn take(&mut self, per_second: u32, now: Instant) -> bool {
        self.take_up_to(1, per_second, now) == 1
    }

    /// Takes up to `count` permits; returns the number of permits taken.
    pub(crate) fn take_up_to(&mut self, count: u32, per_second: u32, now: Instant) -> u32 {
        let passed = now.saturating_duration_since(self.refilled_at).as_secs_f64();
        self.refilled_at = now;
        self.permits = (self.permits + passed * f64::from(per_second)).min(burst(per_second));
        let taken = self.permits.floor().min(f64::from(count));
        self.permits -= taken;
        // The value is between zero and `count`.
        taken as u32
    }
}

/// Returns the capacity of a bucket: the permits of two seconds, because all agents of a daemon
/// answer a call for proposals at the same instant.
fn burst(per_second: u32) -> f64 {
    2.0 * f64::from(per_second)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_burst_passes_and_then_the_rate_applies() {
        let began = Instant::now();
        let mut rate = TokenBucket::new(10, began);
        let taken = |rate: &mut TokenBucket, now| (0..100).filter(|_| rate.take(10, now)).count();
        assert_eq!(taken(&mut rate, began), 20);
        assert_eq!(taken(&mut rate, began + Duration::from_millis(1_000)), 10);
        assert_eq!(taken(&mut rate, began + Duration::from_millis(1_500)), 5);
        assert_eq!(taken(&mut rate, began + Duration::from_secs(3_600)), 20);
        let later = began + Duration::from_secs(7_200);
        let taken = [15, 15, 15].map(|count| rate.take_up_to(count, 10, later));
        assert_eq!(taken, [15, 5, 0]);
    }
}
