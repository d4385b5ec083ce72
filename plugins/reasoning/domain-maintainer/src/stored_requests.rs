//! Record of the requested changes, which outlives the restart of all replicas.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::Millis;
use acl::content::Requested;
use serde::{Deserialize, Serialize};

/// Requested changes in the form in which a replica stores them, with the replica's wall-clock
/// time.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct StoredRequests {
    /// Wall-clock time at which the changes were stored, in milliseconds since the Unix epoch.
    at_ms: u64,
    requested: Requested,
}

// === impl StoredRequests ===

impl StoredRequests {
    pub(crate) fn new(requested: Requested, now: SystemTime) -> StoredRequests {
        StoredRequests { at_ms: milliseconds(now), requested }
    }

    /// Returns the stored changes that are in force `now`, with the remaining times of their facts.
    /// If the clock shows an earlier time than the stored one, the remaining times are unknown, and
    /// facts with a time limit are dropped.
    pub(crate) fn in_force_at(self, now: SystemTime) -> Requested {
        let passed = milliseconds(now).checked_sub(self.at_ms).map(Duration::from_millis);
        let mut requested = self.requested;
        requested.facts.retain_mut(|fact| match fact.known_for {
            None => true,
            Some(Millis(all)) => {
                let left = passed.and_then(|passed| all.checked_sub(passed));
                fact.known_for = left.map(Millis);
                left.is_some_and(|left| !left.is_zero())
            }
        });
        requested
    }
}

fn milliseconds(time: SystemTime) -> u64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
    u64::try_from(since).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use acl::AgentId;
    use acl::content::RequestedFact;

    use super::*;

    #[test]
    fn a_restored_fact_keeps_its_remaining_time() {
        let fact = |fact: &str, seconds: Option<u64>| RequestedFact {
            fact: fact.to_owned(),
            owner: AgentId::new("ann").expect("a name"),
            known_for: seconds.map(|seconds| Millis(Duration::from_secs(seconds))),
        };
        let facts = vec![fact("(a)", None), fact("(b)", Some(60)), fact("(c)", Some(5))];
        let requested = Requested { facts, ..Requested::default() };
        let then = UNIX_EPOCH + Duration::from_secs(1_000_000);
        let later = StoredRequests::new(requested.clone(), then);
        let left = later.in_force_at(then + Duration::from_secs(10)).facts;
        assert_eq!(left, [fact("(a)", None), fact("(b)", Some(50))]);
        let back = StoredRequests::new(requested, then);
        let left = back.in_force_at(then - Duration::from_secs(10)).facts;
        assert_eq!(left, [fact("(a)", None)], "the clock has gone back");
    }
}
