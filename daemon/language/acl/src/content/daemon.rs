//! The report of a daemon about itself: what runs where, and for how long its certificate is valid.

use serde::{Deserialize, Serialize};

use crate::{AgentId, DaemonId, Millis};

/// Maximum number of absent agents in a report.
pub const ABSENT_MAX: usize = 100;

/// An agent that the ecosystem file names and that is not present.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct AbsentAgent {
    /// The agent.
    pub agent: AgentId,
    /// The daemons that host the agent according to the file; empty if the file names none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub daemons: Vec<DaemonId>,
}

/// Answer of a daemon to a query about itself. Guests, such as commands, give no such answer.
///
/// A figure that the machine of the daemon does not report is `None`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DaemonReport {
    /// The daemon that answers.
    pub daemon: DaemonId,
    /// Version of the program that runs the daemon.
    pub version: String,
    /// How long the daemon has been running.
    pub uptime: Millis,
    /// Number of agents that the daemon hosts, discovered ones included.
    pub agents: u64,
    /// Agents of which this daemon hosts the replica that leads, sorted by name. Agents that cannot
    /// have replicas are not listed.
    #[serde(default)]
    pub leads: Vec<AgentId>,
    /// Agents of which this daemon hosts a replica that stands by, sorted by name.
    #[serde(default)]
    pub stands_by: Vec<AgentId>,
    /// Agents that the ecosystem file names and that this daemon does not see, sorted by name; at
    /// most [`ABSENT_MAX`] of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub absent: Vec<AbsentAgent>,
    /// Days until the certificate of the daemon ends, rounded down: 0 on the last day, and after
    /// it. `None` if the ecosystem is not secured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate_days_left: Option<u64>,
    /// Memory that the daemon's process uses, in bytes (its resident set).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory_bytes: Option<u64>,
    /// Number of files that the daemon's process has open, connections included.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub open_files: Option<u64>,
    /// Maximum number of files that the daemon's process may have open.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub open_files_max: Option<u64>,
}
