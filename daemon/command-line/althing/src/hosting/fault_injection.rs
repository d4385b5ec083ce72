//! A network that loses some messages and duplicates others. The seed decides which.
//!
//! The fault of a message depends on its sender, its receiver, its kind, and the number of such
//! messages before it, but not on the order in which threads send. Queries and presence are never
//! lost: a network that loses those is down, which is a different fault.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use acl::fnv::Fnv64;
use acl::{AgentId, Performative};
use bytes::Bytes;
use substrate::{AgentAddress, ForwardingSubstrate, SendError, Subject, Substrate};

/// The probabilities of faults, and counters of the faults that have been injected.
#[derive(Debug, Default)]
pub(crate) struct FaultInjector {
    /// The share of messages that are lost, from 0 to 1. The field `duplicate` is the share of the
    /// other messages that are duplicated, also from 0 to 1.
    pub(crate) lose: f64,
    pub(crate) duplicate: f64,
    pub(crate) seed: u64,
    said: Mutex<BTreeMap<String, u64>>,
    pub(crate) lost: AtomicU64,
    pub(crate) doubled: AtomicU64,
    pub(crate) all: AtomicU64,
}

/// The fault that is injected into one message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MessageFault {
    None,
    Lost,
    Doubled,
}

/// Wraps a reliable substrate in one that loses and duplicates messages.
pub(super) fn make_unreliable(
    reliable: Arc<dyn Substrate>,
    mishaps: Arc<FaultInjector>,
) -> Arc<dyn Substrate> {
    Arc::new(UnreliableSubstrate { reliable, mishaps })
}

struct UnreliableSubstrate {
    reliable: Arc<dyn Substrate>,
    mishaps: Arc<FaultInjector>,
}

// === impl FaultInjector ===

impl FaultInjector {
    /// Creates an injector that loses the share `lose` of all messages, and duplicates the share
    /// `duplicate` of the others. `seed` decides which.
    pub(crate) fn new(lose: f64, duplicate: f64, seed: u64) -> FaultInjector {
        FaultInjector { lose, duplicate, seed, ..FaultInjector::default() }
    }

    /// Draws the fault of the next message on the route `route`. Counts the message and its fault.
    fn next(&self, route: String) -> MessageFault {
        self.all.fetch_add(1, Ordering::Relaxed);
        let number = {
            let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
            let count = said.entry(route.clone()).or_default();
            *count += 1;
            *count
        };
        let drawn = share_of(draw(self.seed, &route, number));
        if drawn < self.lose {
            self.lost.fetch_add(1, Ordering::Relaxed);
            MessageFault::Lost
        } else if drawn < self.lose + (1.0 - self.lose) * self.duplicate {
            self.doubled.fetch_add(1, Ordering::Relaxed);
            MessageFault::Doubled
        } else {
            MessageFault::None
        }
    }
}

/// Returns a pseudo-random number that depends on all three arguments. It is computed by FNV-1a and
/// then by the finaliser of SplitMix64.
fn draw(seed: u64, route: &str, number: u64) -> u64 {
    let hash = Fnv64::default().with(route.as_bytes());
    let hash = hash.with(&number.to_le_bytes()).with(&seed.to_le_bytes()).value();
    let mixed = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}

/// Maps a number of 64 bits to the range from 0 (inclusive) to 1 (exclusive).
fn share_of(number: u64) -> f64 {
    (number >> 11) as f64 / (1_u64 << 53) as f64
}

// === impl UnreliableSubstrate ===

impl UnreliableSubstrate {
    fn pass(
        &self,
        route: String,
        payload: Bytes,
        send: impl Fn(Bytes) -> Result<(), SendError>,
    ) -> Result<(), SendError> {
        match self.mishaps.next(route) {
            MessageFault::Lost => Ok(()),
            MessageFault::None => send(payload),
            MessageFault::Doubled => send(payload.clone()).and_then(|()| send(payload)),
        }
    }
}

impl ForwardingSubstrate for UnreliableSubstrate {
    fn inner(&self) -> &dyn Substrate {
        &*self.reliable
    }

    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        let sender = acl::decode(&payload).ok().map(|message| message.sender.to_string());
        let route = format!("{} {} {subject:?}", sender.unwrap_or_default(), to.agent);
        self.pass(route, payload, |payload| self.reliable.send(to, subject, payload))
    }

    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        let route = format!("{sender} all {performative}");
        let reliable = &self.reliable;
        self.pass(route, payload, |payload| reliable.broadcast(sender, performative, payload))
    }

    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        let route = format!("{sender} beat");
        self.pass(route, payload, |payload| self.reliable.broadcast_state(sender, payload))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fates(mishaps: &FaultInjector, route: &str) -> Vec<MessageFault> {
        (0..10_000).map(|_| mishaps.next(route.to_owned())).collect()
    }

    #[test]
    fn the_same_seed_loses_the_same_in_any_order() {
        let (one, other) = (FaultInjector::new(0.1, 0.2, 7), FaultInjector::new(0.1, 0.2, 7));
        let (a, b) = (fates(&one, "a"), fates(&one, "b"));
        assert_eq!((fates(&other, "b"), fates(&other, "a")), (b, a.clone()));
        assert_ne!(a, fates(&FaultInjector::new(0.1, 0.2, 8), "a"));
        let count = |mishap| a.iter().filter(|fate| **fate == mishap).count();
        assert!((850..1_150).contains(&count(MessageFault::Lost)), "{}", count(MessageFault::Lost));
        assert!(
            (1_600..2_000).contains(&count(MessageFault::Doubled)),
            "{}",
            count(MessageFault::Doubled)
        );
        assert!(
            fates(&FaultInjector::new(0.0, 0.0, 7), "a")
                .iter()
                .all(|fate| *fate == MessageFault::None)
        );
        assert!(
            fates(&FaultInjector::new(1.0, 1.0, 7), "a")
                .iter()
                .all(|fate| *fate == MessageFault::Lost)
        );
    }
}
