//! Recognition of heartbeats that repeat the last one that was applied.
//!
//! A daemon without listeners compares texts, before it decodes them (`broadcast_cache`). Where an
//! agent listens to heartbeats, such as the Domain Maintainer, they are decoded, and compared here.

use std::collections::BTreeMap;

use acl::content::Heartbeat;
use acl::{AgentId, Incarnation, Message};
use capability::{DomainChange, Maintainer, RepeatedHeartbeat, Timestamp};

/// The last heartbeat of each agent that was parsed and applied, without facts that expire. Nearly
/// all heartbeats repeat the one before, and need not be parsed then.
#[derive(Default)]
pub(crate) struct AppliedHeartbeats(BTreeMap<AgentId, AppliedHeartbeat>);

struct AppliedHeartbeat {
    incarnation: Incarnation,
    sequence: u64,
    digest: String,
    facts: String,
}

impl AppliedHeartbeats {
    /// Applies a heartbeat without parsing it, if it repeats the last one that was applied. Returns
    /// the change of the domain; `None` if the heartbeat must be parsed.
    pub(crate) fn repeat(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        heartbeat: &Heartbeat,
        now: Timestamp,
    ) -> Option<DomainChange> {
        let last = self.0.get_mut(&message.sender)?;
        let is_repeated = last.incarnation == message.incarnation
            && last.digest == heartbeat.digest
            && last.facts == heartbeat.facts
            && heartbeat.known_for.is_empty();
        if !is_repeated {
            return None;
        }
        let repeated = RepeatedHeartbeat {
            agent: &message.sender,
            incarnation: message.incarnation,
            digest: &heartbeat.digest,
            before: last.sequence,
            sequence: heartbeat.sequence,
            period: heartbeat.period.0,
        };
        let change = maintainer.believe_repeated(&repeated, now)?;
        last.sequence = heartbeat.sequence;
        Some(change)
    }

    /// Keeps a heartbeat that was parsed. A heartbeat that was not applied, or has facts that expire,
    /// cannot be repeated.
    pub(crate) fn note(&mut self, message: &Message, heartbeat: &Heartbeat, is_applied: bool) {
        if !is_applied || !heartbeat.known_for.is_empty() {
            self.0.remove(&message.sender);
            return;
        }
        let applied = AppliedHeartbeat {
            incarnation: message.incarnation,
            sequence: heartbeat.sequence,
            digest: heartbeat.digest.clone(),
            facts: heartbeat.facts.clone(),
        };
        self.0.insert(message.sender.clone(), applied);
    }

    /// Forgets an agent that was removed from the domain.
    pub(crate) fn forget(&mut self, agent: &AgentId) {
        self.0.remove(agent);
    }
}
