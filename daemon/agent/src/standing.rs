//! Whether one of several agents of a name acts or stands by (design, “No single point of failure”).
//!
//! The directory says who is first; everybody's says the same, once news have spread. Who has just
//! come waits a moment before it believes that nobody else is there: links take time.

use std::time::Duration;

use tokio::time::Instant;

use crate::mailbox::Letter;

/// How long a newcomer looks around before it acts. A daemon of the same machine is seen in a
/// tenth of that, one that has to be found in half.
const LOOKING_AROUND: Duration = Duration::from_millis(400);

/// Letters kept while it looks around; more are declined.
const KEPT_MAX: usize = 64;

/// Where an agent stands among those of its name.
pub(crate) struct Standing {
    is_leading: bool,
    /// Whether it is first as far as it knows.
    is_called: bool,
    /// Until when it looks around.
    until: Option<Instant>,
    /// What came for it meanwhile.
    kept: Vec<Letter>,
}

// === impl Standing ===

impl Standing {
    pub(crate) fn new(now: Instant) -> Standing {
        let until = Some(now + LOOKING_AROUND);
        Standing { is_leading: false, is_called: false, until, kept: Vec::new() }
    }

    /// Whether it acts.
    pub(crate) fn is_leading(&self) -> bool {
        self.is_leading
    }

    /// Whether it will act if nobody turns up.
    pub(crate) fn is_about_to_act(&self) -> bool {
        self.is_called && !self.is_leading
    }

    /// When there is something to decide, whatever happens.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.until
    }

    /// Takes who is first, as of `now`; yields whether it acts, where that is news.
    pub(crate) fn take(&mut self, is_first: bool, now: Instant) -> Option<bool> {
        self.is_called = is_first;
        self.until = self.until.filter(|until| *until > now);
        let is_leading = is_first && self.until.is_none();
        let was_leading = std::mem::replace(&mut self.is_leading, is_leading);
        (was_leading != is_leading).then_some(is_leading)
    }

    /// Keeps a letter until it is clear who acts; gives it back where there are too many.
    pub(crate) fn keep(&mut self, letter: Letter) -> Option<Letter> {
        if self.kept.len() >= KEPT_MAX {
            return Some(letter);
        }
        self.kept.push(letter);
        None
    }

    /// What was kept, once it is clear who acts.
    pub(crate) fn kept(&mut self) -> Vec<Letter> {
        std::mem::take(&mut self.kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_newcomer_looks_around_and_who_takes_over_does_not() {
        let now = Instant::now();
        let mut standing = Standing::new(now);
        assert_eq!(standing.take(true, now), None, "it has just come");
        assert!(standing.is_about_to_act());
        let later = now + LOOKING_AROUND;
        assert_eq!(standing.take(false, later), None, "another replica is the leader");
        assert_eq!(standing.due(), None);
        assert_eq!(standing.take(true, later), Some(true), "it has left");
        assert_eq!(standing.take(true, later), None);
        assert_eq!(standing.take(false, later), Some(false), "it has come back");
    }

    #[tokio::test(start_paused = true)]
    async fn letters_are_kept_within_a_bound() {
        let mut standing = Standing::new(Instant::now());
        let letter = || Letter::Direct(bytes::Bytes::from_static(b"{}"));
        for _ in 0..KEPT_MAX {
            assert!(standing.keep(letter()).is_none());
        }
        assert!(standing.keep(letter()).is_some());
        assert_eq!(standing.kept().len(), KEPT_MAX);
        assert!(standing.kept().is_empty());
    }
}
