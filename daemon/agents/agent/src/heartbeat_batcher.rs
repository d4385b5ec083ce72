//! Batching of heartbeats: the heartbeats that the agents of one daemon send at about the same
//! moment are sent in one message.
//!
//! If an agent sends an announcement or a heartbeat without batching, its heartbeat that waits for
//! a batch is withdrawn, because that heartbeat is older.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::AgentId;
use bytes::Bytes;

/// How long the first heartbeat of a batch waits for others. The heartbeat timers of one daemon
/// expire at the same moment, and a hundred agents have all sent their heartbeats a few
/// milliseconds later. The delay is small compared with a heartbeat period of a second.
pub(crate) const GATHERED_WITHIN: Duration = Duration::from_millis(5);

/// Heartbeats that wait for the next batch, one per agent.
#[derive(Default)]
pub(crate) struct HeartbeatBatcher(Mutex<BTreeMap<AgentId, Bytes>>);

impl HeartbeatBatcher {
    /// Queues a heartbeat for the next batch. Returns `true` if the batch was empty; the caller
    /// must then schedule sending the batch.
    pub(crate) fn add(&self, sender: &AgentId, payload: Bytes) -> bool {
        let mut waiting = self.waiting();
        let is_first = waiting.is_empty();
        waiting.insert(sender.clone(), payload);
        is_first
    }

    /// Removes the heartbeat of the agent `sender` that waits for the next batch.
    pub(crate) fn withdraw(&self, sender: &AgentId) {
        self.waiting().remove(sender);
    }

    /// Removes and returns all heartbeats that wait for the next batch, each as its sender and its
    /// encoded message.
    pub(crate) fn take(&self) -> Vec<(AgentId, Bytes)> {
        std::mem::take(&mut *self.waiting()).into_iter().collect()
    }

    fn waiting(&self) -> MutexGuard<'_, BTreeMap<AgentId, Bytes>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
