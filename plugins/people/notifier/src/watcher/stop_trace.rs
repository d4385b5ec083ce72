//! The stops in force, as requests and heartbeats tell them.

use std::collections::BTreeSet;

use acl::AgentId;
use acl::content::{STOP_ID_BYTES_MAX, STOP_NAMES_MAX, Stop};

use crate::recent_table::RecentTable;

/// Maximum number of stops that are remembered.
const STOPS_MAX: usize = 256;

/// Maximum number of actuators per stop that are remembered.
const HOLDERS_MAX: usize = 4_096;

/// Maximum number of names in the scope of a stop that are told.
pub(super) const NAMES_MAX: usize = STOP_NAMES_MAX;

/// The stops in force.
#[derive(Debug)]
pub(super) struct StopTrace {
    /// The actuators that repeat each stop.
    stops: RecentTable<String, BTreeSet<AgentId>>,
    released: RecentTable<String, ()>,
}

// === impl StopTrace ===

impl StopTrace {
    pub(super) fn new() -> StopTrace {
        StopTrace { stops: RecentTable::new(STOPS_MAX), released: RecentTable::new(STOPS_MAX) }
    }

    /// Takes the request for a stop. Returns whether it is new: the same stop is requested of each
    /// actuator.
    pub(super) fn requested(&mut self, stop: &Stop) -> bool {
        let is_known = self.stops.contains(&stop.id) || self.released.contains(&stop.id);
        let is_new = !is_known && stop.id.len() <= STOP_ID_BYTES_MAX;
        if is_new {
            self.stops.insert(stop.id.clone(), BTreeSet::new());
        }
        is_new
    }

    /// Takes a release. Returns the stops that were in force until now.
    pub(super) fn released(&mut self, ids: &[String]) -> Vec<String> {
        let known = ids.iter().take(STOPS_MAX).filter(|id| self.stops.remove(id).is_some());
        let released: Vec<_> = known.cloned().collect();
        for id in &released {
            self.released.insert(id.clone(), ());
        }
        released
    }

    /// Takes the stops that an actuator repeats: all that it knows. Returns those that are new, and
    /// those that no actuator repeats any more.
    pub(super) fn repeated(
        &mut self,
        holder: &AgentId,
        stops: &[Stop],
    ) -> (Vec<Stop>, Vec<String>) {
        let mut new = Vec::new();
        for stop in stops.iter().take(STOPS_MAX) {
            if self.released.contains(&stop.id) {
                continue;
            }
            if self.requested(stop) {
                new.push(stop.clone());
            }
            if let Some(holders) = self.stops.get_mut(&stop.id)
                && holders.len() < HOLDERS_MAX
            {
                holders.insert(holder.clone());
            }
        }
        let is_dropped = |(id, holders): &(&String, &BTreeSet<AgentId>)| {
            holders.contains(holder) && !stops.iter().any(|stop| stop.id == **id)
        };
        let dropped: Vec<_> =
            self.stops.iter().filter(is_dropped).map(|(id, _)| id.clone()).collect();
        let mut gone = Vec::new();
        for id in dropped {
            let Some(holders) = self.stops.get_mut(&id) else { continue };
            holders.remove(holder);
            if holders.is_empty() {
                gone.push(id);
            }
        }
        (new, self.released(&gone))
    }
}
