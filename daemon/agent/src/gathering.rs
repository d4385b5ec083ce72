//! What the agents of one daemon say of themselves at one moment, gathered for a little, to go out
//! together.
//!
//! An agent that says something at once takes back what of it still waits here: that is older.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::AgentId;
use bytes::Bytes;

/// How long the first waits for the others. All timers of one daemon run out at the same moment, and
/// a hundred agents have spoken a few milliseconds later; of a heartbeat's second that is nothing.
pub(crate) const GATHERED_WITHIN: Duration = Duration::from_millis(5);

/// What waits to go out, one word per agent.
#[derive(Default)]
pub(crate) struct Gathering(Mutex<BTreeMap<AgentId, Bytes>>);

impl Gathering {
    /// Takes an agent's word in; `true` if it is the first, and somebody has to send it in a while.
    pub(crate) fn add(&self, sender: &AgentId, payload: Bytes) -> bool {
        let mut waiting = self.waiting();
        let is_first = waiting.is_empty();
        waiting.insert(sender.clone(), payload);
        is_first
    }

    /// The word of this agent is not to go out any more.
    pub(crate) fn withdraw(&self, sender: &AgentId) {
        self.waiting().remove(sender);
    }

    /// All that waits.
    pub(crate) fn take(&self) -> Vec<(AgentId, Bytes)> {
        std::mem::take(&mut *self.waiting()).into_iter().collect()
    }

    fn waiting(&self) -> MutexGuard<'_, BTreeMap<AgentId, Bytes>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
