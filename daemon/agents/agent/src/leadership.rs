//! Leadership among replicas: whether this agent is the leader or a standby (docs/design.md,
//! “Fail-over”).
//!
//! The replica that holds the name in the directory is the leader; the directories of all daemons
//! agree once presence changes have spread. A replica that has just started waits a moment before
//! it becomes the leader, because connecting to other daemons takes time.

use std::time::Duration;

use tokio::time::Instant;

use crate::mailbox::MailboxItem;

/// How long a new replica waits for other replicas to appear before it may become the leader. A
/// daemon on the same machine is seen in a tenth of this time, a daemon that has to be found on the
/// network in half of it.
const LOOKING_AROUND: Duration = Duration::from_millis(400);

/// Maximum number of messages kept during the initial wait of a new replica; further messages are
/// declined.
const KEPT_MAX: usize = 64;

/// Leadership of an agent that may have replicas.
pub(crate) struct Leadership {
    is_leading: bool,
    /// Whether this agent is the oldest present agent of its name, according to the daemon's
    /// directory of agents.
    is_called: bool,
    /// End of the initial wait; `None` once the wait is over.
    until: Option<Instant>,
    /// Messages that arrived before leadership was decided.
    kept: Vec<MailboxItem>,
}

// === impl Leadership ===

impl Leadership {
    pub(crate) fn new(now: Instant) -> Leadership {
        let until = Some(now + LOOKING_AROUND);
        Leadership { is_leading: false, is_called: false, until, kept: Vec::new() }
    }

    /// Whether this agent is the leader.
    pub(crate) fn is_leading(&self) -> bool {
        self.is_leading
    }

    /// Whether this agent will become the leader unless an older replica appears.
    pub(crate) fn is_candidate(&self) -> bool {
        self.is_called && !self.is_leading
    }

    /// Returns the end of the initial wait, at which leadership must be decided even if no event
    /// occurs; `None` once the wait is over.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.until
    }

    /// Updates leadership at the time `now`; `is_first` states whether this agent is the oldest
    /// present agent of its name. Returns whether the agent is the leader; `None` if that has not
    /// changed.
    pub(crate) fn take(&mut self, is_first: bool, now: Instant) -> Option<bool> {
        self.is_called = is_first;
        self.until = self.until.filter(|until| *until > now);
        let is_leading = is_first && self.until.is_none();
        let was_leading = std::mem::replace(&mut self.is_leading, is_leading);
        (was_leading != is_leading).then_some(is_leading)
    }

    /// Keeps a message until leadership is decided. Returns the message if the maximum number is
    /// kept already.
    pub(crate) fn keep(&mut self, letter: MailboxItem) -> Option<MailboxItem> {
        if self.kept.len() >= KEPT_MAX {
            return Some(letter);
        }
        self.kept.push(letter);
        None
    }

    /// Removes and returns the kept messages, once leadership is decided.
    pub(crate) fn kept(&mut self) -> Vec<MailboxItem> {
        std::mem::take(&mut self.kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_new_replica_waits_before_it_leads_and_a_standby_does_not() {
        let now = Instant::now();
        let mut standing = Leadership::new(now);
        assert_eq!(standing.take(true, now), None, "it has just come");
        assert!(standing.is_candidate());
        let later = now + LOOKING_AROUND;
        assert_eq!(standing.take(false, later), None, "another replica is the leader");
        assert_eq!(standing.due(), None);
        assert_eq!(standing.take(true, later), Some(true), "it has left");
        assert_eq!(standing.take(true, later), None);
        assert_eq!(standing.take(false, later), Some(false), "it has come back");
    }

    #[tokio::test(start_paused = true)]
    async fn early_messages_are_kept_within_a_bound() {
        let mut standing = Leadership::new(Instant::now());
        let letter = || MailboxItem::Direct(bytes::Bytes::from_static(b"{}"));
        for _ in 0..KEPT_MAX {
            assert!(standing.keep(letter()).is_none());
        }
        assert!(standing.keep(letter()).is_some());
        assert_eq!(standing.kept().len(), KEPT_MAX);
        assert!(standing.kept().is_empty());
    }
}
