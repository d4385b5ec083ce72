//! Limits of how often one session may ask for something, so that a program that runs wild in the
//! name of a person cannot flood the ecosystem.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::caller_key::CallerKey;

/// Number of acts that a session may ask for at once: a person who answers a row of questions.
const ACTS_AT_ONCE: u32 = 20;

/// Time after which a session may ask for one more act.
const ACT_EVERY: Duration = Duration::from_millis(500);

/// Maximum number of sessions whose acts are counted.
const SESSIONS_MAX: usize = 4_096;

/// A kind of requests, which is counted apart: whatever a session has asked for before, it can still stop
/// things.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum ActKind {
    Stop,
    /// Looking at what the daemon has to fetch: the history, the picture of a camera.
    Fetch,
    Other,
}

/// The acts of all sessions, by when each would have used up its right again.
#[derive(Default)]
pub(crate) struct ActLimits {
    /// The moment at which each session may ask for [`ACTS_AT_ONCE`] acts again.
    full_at: Mutex<HashMap<(CallerKey, ActKind), Instant>>,
}

impl ActLimits {
    /// Counts one act.
    ///
    /// # Errors
    ///
    /// Returns the time after which the session may ask again, if it has asked too often.
    pub(crate) fn take(&self, of: CallerKey, kind: ActKind, now: Instant) -> Result<(), Duration> {
        let mut full_at = self.full_at.lock().unwrap_or_else(PoisonError::into_inner);
        if full_at.len() >= SESSIONS_MAX {
            full_at.retain(|_, at| *at > now);
        }
        if full_at.len() >= SESSIONS_MAX && !full_at.contains_key(&(of.clone(), kind)) {
            return Err(ACT_EVERY);
        }
        let at = full_at.entry((of, kind)).or_insert(now);
        let next = (*at).max(now) + ACT_EVERY;
        let over = next.saturating_duration_since(now + ACT_EVERY * ACTS_AT_ONCE);
        if over > Duration::ZERO {
            return Err(over);
        }
        *at = next;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_that_asks_too_often_waits() {
        let (limits, now) = (ActLimits::default(), Instant::now());
        let take = |session, kind, at| limits.take(CallerKey::Session(session), kind, at);
        for _ in 0..ACTS_AT_ONCE {
            assert_eq!(take(1, ActKind::Other, now), Ok(()));
        }
        assert_eq!(take(1, ActKind::Other, now), Err(ACT_EVERY));
        assert_eq!(take(1, ActKind::Stop, now), Ok(()), "stops are counted apart");
        assert_eq!(take(2, ActKind::Other, now), Ok(()), "and so are others");
        assert_eq!(take(1, ActKind::Other, now + ACT_EVERY), Ok(()));
        assert!(take(1, ActKind::Other, now + ACT_EVERY).is_err());
    }
}
