//! Daemons: whether each answers, and what it says about itself.

use std::collections::BTreeMap;

use acl::{AgentId, DaemonId};
use serde::Serialize;

use crate::moment::Moment;

/// One daemon.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DaemonRow {
    /// The daemon.
    pub daemon: DaemonId,
    /// Whether the daemon answers; `None` if it was not asked yet.
    pub is_reached: Option<bool>,
    /// Moment at which anything of the daemon was last observed; `None` if nothing was.
    pub seen_at: Option<Moment>,
    /// Time of the last query to its answer, in microseconds; `None` if none was measured.
    pub round_trip_micros: Option<u64>,
    /// Median of the last round trips, in microseconds.
    pub usual_round_trip_micros: Option<u64>,
    /// Number of agents that the daemon hosts.
    pub agents: u64,
    /// The agents of the daemon that lead, among replicas of the same name.
    pub leads: Vec<AgentId>,
    /// The agents of the daemon that stand by.
    pub stands_by: Vec<AgentId>,
    /// Time since the daemon started, in milliseconds; `None` if it has not said so.
    pub uptime_ms: Option<u64>,
    /// Version of the daemon's program; `None` if it has not said so.
    pub version: Option<String>,
    /// Days until the daemon's certificate ends, 0 on the last day and after it; `None` if there is
    /// none.
    pub certificate_days_left: Option<u64>,
    /// Memory that the daemon's process uses, in bytes; `None` if it is not known.
    pub memory_bytes: Option<u64>,
    /// Number of files that the daemon's process has open; `None` if it is not known.
    pub open_files: Option<u64>,
    /// Maximum number of files that the daemon's process may have open.
    pub open_files_max: Option<u64>,
    /// Counters of the daemon's mailboxes; `None` if it has not said so.
    pub mailboxes: Option<MailboxSums>,
    /// Problems of the daemon, each as one sentence.
    pub problems: Vec<String>,
}

/// Counters of all mailboxes of one daemon.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MailboxSums {
    /// Messages that wait now.
    pub waiting: u64,
    /// The largest number of messages that have waited in one mailbox.
    pub waiting_max: u64,
    /// Messages that were put into mailboxes.
    pub received: u64,
    /// Messages that did not fit.
    pub overflowed: u64,
    /// Messages for agents that the daemon does not host.
    pub unknown_receiver: u64,
    /// Messages that could not be parsed.
    pub unreadable: u64,
    /// Messages that could not be sent.
    pub not_sent: u64,
    /// Records that could not be stored.
    pub not_persisted: u64,
    /// Rejected messages, by the kind of rule that they broke.
    pub rejected: BTreeMap<String, u64>,
}
