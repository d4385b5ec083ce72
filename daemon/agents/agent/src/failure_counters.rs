//! Counters of failures since a daemon started, for its operator.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

use acl::DaemonId;
use acl::content::{MailboxStatus, Mailboxes};

/// Counters of failures since the daemon started.
#[derive(Debug, Default)]
pub struct FailureCounters {
    unknown_receiver: AtomicU64,
    unreadable: AtomicU64,
    not_sent: AtomicU64,
    not_persisted: AtomicU64,
}

impl FailureCounters {
    /// Counts a record that could not be written to the disk of this machine. The caller logs the
    /// record and the reason.
    pub fn count_not_persisted(&self) {
        self.not_persisted.fetch_add(1, Ordering::Relaxed);
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

    /// Returns the report of a daemon about its mailboxes, with these counters.
    pub(crate) fn report(
        &self,
        daemon: DaemonId,
        mailboxes: Vec<MailboxStatus>,
        rejected: BTreeMap<String, u64>,
    ) -> Mailboxes {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Mailboxes {
            daemon,
            mailboxes,
            unknown_receiver: count(&self.unknown_receiver),
            unreadable: count(&self.unreadable),
            not_sent: count(&self.not_sent),
            not_persisted: count(&self.not_persisted),
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
        counters.count_not_persisted();
        assert_eq!(report(), [1, 1, 1, 1]);
    }
}
