//! Counters of failures since a daemon started, for its operator.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use acl::DaemonId;
use acl::content::{MailboxStatus, Mailboxes};
use tokio::time::Instant;

use crate::daemon_figures::FailureCounts;

/// Counters of failures since the daemon started.
#[derive(Debug, Default)]
pub struct FailureCounters {
    unknown_receiver: AtomicU64,
    unreadable: AtomicU64,
    not_sent: AtomicU64,
    not_persisted: AtomicU64,
    /// Time of the last record that could not be written.
    last_not_persisted: Mutex<Option<Instant>>,
}

impl FailureCounters {
    /// Counts a record that could not be written to the disk of this machine. The caller logs the
    /// record and the reason.
    pub fn count_not_persisted(&self) {
        self.not_persisted.fetch_add(1, Ordering::Relaxed);
        let last = self.last_not_persisted.lock();
        *last.unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }

    /// Counts a message to an agent that this daemon does not host.
    pub(crate) fn count_unknown_receiver(&self) {
        self.unknown_receiver.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a broadcast that could not be decoded, or that names another sender than the address
    /// under which it arrived.
    pub(crate) fn count_unreadable(&self) {
        self.unreadable.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a message that the substrate did not accept.
    pub(crate) fn count_not_sent(&self) {
        self.not_sent.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the present counts.
    pub(crate) fn counts(&self) -> FailureCounts {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let last = *self.last_not_persisted.lock().unwrap_or_else(PoisonError::into_inner);
        FailureCounts {
            unknown_receiver: count(&self.unknown_receiver),
            unreadable: count(&self.unreadable),
            not_sent: count(&self.not_sent),
            not_persisted: count(&self.not_persisted),
            not_persisted_ago: last.map(|last| last.elapsed()),
        }
    }

    /// Returns the report of a daemon about its mailboxes, with these counters.
    pub(crate) fn report(
        &self,
        daemon: DaemonId,
        mailboxes: Vec<MailboxStatus>,
        rejected: BTreeMap<String, u64>,
    ) -> Mailboxes {
        let FailureCounts { unknown_receiver, unreadable, not_sent, not_persisted, .. } =
            self.counts();
        Mailboxes {
            daemon,
            mailboxes,
            unknown_receiver,
            unreadable,
            not_sent,
            not_persisted,
            rejected,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_failure_is_reported_under_its_name() {
        let counters = FailureCounters::default();
        let report = || {
            let daemon = DaemonId::new("d").expect("a name");
            let report = counters.report(daemon, Vec::new(), BTreeMap::new());
            let Mailboxes { unknown_receiver, unreadable, not_sent, not_persisted, .. } = report;
            [unknown_receiver, unreadable, not_sent, not_persisted]
        };
        counters.count_unknown_receiver();
        assert_eq!(report(), [1, 0, 0, 0]);
        counters.count_unreadable();
        assert_eq!(report(), [1, 1, 0, 0]);
        counters.count_not_sent();
        assert_eq!(report(), [1, 1, 1, 0]);
        assert_eq!(counters.counts().not_persisted_ago, None);
        counters.count_not_persisted();
        assert_eq!(report(), [1, 1, 1, 1]);
        assert!(counters.counts().not_persisted_ago.is_some());
    }
}
