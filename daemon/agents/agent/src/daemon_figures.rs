//! Figures of a daemon at one moment, for its operator: what it hosts, what it has counted, what has
//! failed.

use std::time::Duration;

use substrate::ViolationKind;

use crate::activity_counters::ActivityCounts;

/// Figures of a daemon at one moment. No field has a value per agent, so the figures of ten thousand
/// agents are no longer than those of one.
#[derive(Clone, Debug, Default)]
pub struct DaemonFigures {
    /// How long the daemon has been running.
    pub uptime: Duration,
    /// How long the daemon's certificate is still valid; `None` if the daemon has no certificate.
    pub certificate_left: Option<Duration>,
    /// Number of agents that the daemon hosts.
    pub agents_hosted: usize,
    /// Number of agents that the daemon sees in the whole ecosystem. Replicas count once.
    pub agents_present: usize,
    /// Number of daemons with these agents.
    pub daemons_present: usize,
    /// State of the mailboxes of the daemon's agents, all together.
    pub mailboxes: MailboxTotals,
    /// Counters of failures.
    pub failures: FailureCounts,
    /// Number of rejected messages, for each kind of violation.
    pub rejected: Vec<(ViolationKind, u64)>,
    /// Counters of what the agents have done.
    pub activity: ActivityCounts,
}

/// State of all mailboxes of a daemon.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MailboxTotals {
    /// Number of messages that wait, in all mailboxes together.
    pub waiting: u64,
    /// How full the fullest mailbox is, from 0 to 1.
    pub fullest: f64,
    /// Number of messages that have found a full mailbox since the daemon started.
    pub overflowed: u64,
}

/// Counts of failures since a daemon started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FailureCounts {
    /// Number of messages to agents that the daemon does not host.
    pub unknown_receiver: u64,
    /// Number of broadcasts that could not be decoded, or that named another sender.
    pub unreadable: u64,
    /// Number of messages that the substrate did not accept.
    pub not_sent: u64,
    /// Number of records that could not be written to the disk.
    pub not_persisted: u64,
    /// Time since the last record that could not be written; `None` if there is none.
    pub not_persisted_ago: Option<Duration>,
}
