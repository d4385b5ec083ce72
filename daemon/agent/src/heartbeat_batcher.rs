//! Batching of heartbeats: those that the agents of one daemon send at about the same moment go out
//! in one message.
//!
//! If an agent sends an announcement or heartbeat at once, its waiting heartbeat is withdrawn,
//! because it is older.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::AgentId;
use bytes::Bytes;

/// How long the first heartbeat of a batch waits for others. The heartbeat timers of one daemon
/// expire at the same moment, and a hundred agents have sent a few milliseconds later. The delay is
/// small beside a heartbeat period of a second.
pub(crate) const GATHERED_WITHIN: Duration = Duration::from_millis(5);

/// Heartbeats that wait for the next batch, one per agent.
#[derive(Default)]
pub(crate) struct HeartbeatBatcher(Mutex<BTreeMap<AgentId, Bytes>>);

impl HeartbeatBatcher {
    /// Queues a heartbeat for the next batch. Returns `true` if the batch was empty, in which case
    /// the caller must schedule the flush.
    pub(crate) fn add(&self, sender: &AgentId, payload: Bytes) -> bool {
        let mut waiting = self.waiting();
        let is_first = waiting.is_empty();
        waiting.insert(sender.clone(), payload);
        is_first
    }

    /// Removes the waiting heartbeat of this agent.
    pub(crate) fn withdraw(&self, sender: &AgentId) {
        self.waiting().remove(sender);
    }

    /// Takes all waiting heartbeats.
    pub(crate) fn take(&self) -> Vec<(AgentId, Bytes)> {
        std::mem::take(&mut *self.waiting()).into_iter().collect()
    }

    fn waiting(&self) -> MutexGuard<'_, BTreeMap<AgentId, Bytes>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
