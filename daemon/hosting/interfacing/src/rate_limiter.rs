//! Limit on the rate of messages in one direction of an interface: a token bucket.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

/// Capacity of a token bucket, as the number of seconds in which it fills: enough for a plan of a
/// few steps and the reports about it.
const BURST_SECONDS: f64 = 2.0;

/// Resolution of the timer. Each wait for a token is longer by this time, so that the token has
/// arrived when the wait ends.
const TIMER_STEP: Duration = Duration::from_millis(1);

/// Token bucket that limits the number of messages per second.
#[derive(Debug)]
pub(super) struct RateLimiter {
    per_second: f64,
    state: Mutex<BucketState>,
}

#[derive(Debug)]
struct BucketState {
    tokens: f64,
    filled: Instant,
}

impl RateLimiter {
    /// Returns a full bucket that allows `per_second` messages per second.
    pub(super) fn new(per_second: f64) -> RateLimiter {
        let tokens = RateLimiter::burst_capacity(per_second);
        RateLimiter {
            per_second,
            state: Mutex::new(BucketState { tokens, filled: Instant::now() }),
        }
    }

    /// Returns the number of messages per second that the bucket allows.
    pub(super) fn per_second(&self) -> f64 {
        self.per_second
    }

    fn burst_capacity(per_second: f64) -> f64 {
        (per_second * BURST_SECONDS).max(1.0)
    }

    /// Takes one token from the bucket; returns `false` if the bucket is empty.
    pub(super) fn try_acquire(&self) -> bool {
        let mut state = self.refill();
        let is_enough = state.tokens >= 1.0;
        if is_enough {
            state.tokens -= 1.0;
        }
        is_enough
    }

    /// Waits until the bucket has a token, and takes it.
    pub(super) async fn acquire(&self) {
        loop {
            let missing = {
                let mut state = self.refill();
                if state.tokens >= 1.0 {
                    state.tokens -= 1.0;
                    return;
                }
                1.0 - state.tokens
            };
            let wait = Duration::from_secs_f64(missing / self.per_second);
            tokio::time::sleep(wait + TIMER_STEP).await;
        }
    }

    fn refill(&self) -> MutexGuard<'_, BucketState> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        let came = now.duration_since(state.filled).as_secs_f64() * self.per_second;
        state.tokens = (state.tokens + came).min(RateLimiter::burst_capacity(self.per_second));
        state.filled = now;
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_burst_passes_and_then_the_rate_is_limited() {
        let bucket = RateLimiter::new(5.0);
        let passed = (0..100).filter(|_| bucket.try_acquire()).count();
        assert_eq!(passed, 10, "two seconds' worth");
        tokio::time::advance(Duration::from_secs(1)).await;
        assert_eq!((0..100).filter(|_| bucket.try_acquire()).count(), 5);
        let began = Instant::now();
        bucket.acquire().await;
        assert!(began.elapsed() >= Duration::from_millis(200), "{:?}", began.elapsed());
    }
}
