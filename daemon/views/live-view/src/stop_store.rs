//! The stops in force, and the positions of hardware stops.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use acl::content::{ButtonPosition, STOP_ID_BYTES_MAX, STOP_NAMES_MAX, Stop, StopState};

use crate::bounded::BoundedMap;
use crate::moment::Moment;
use crate::rows::StopRow;
use crate::text::cut;

/// Maximum number of stops that are kept.
const STOPS_MAX: usize = 256;

/// Maximum number of hardware stops that are kept.
const BUTTONS_MAX: usize = 256;

/// Time for which a requested stop counts as in force before an actuator repeats it.
const REQUESTED_MS: u64 = 5_000;

#[derive(Clone, Debug)]
struct StopRecord {
    stop: Stop,
    at: Moment,
    /// The actuators that repeat the stop.
    holders: BTreeSet<AgentId>,
}

#[derive(Clone, Debug)]
pub(crate) struct StopStore {
    stops: BoundedMap<String, StopRecord>,
    /// The stops that each actuator repeats.
    held: BTreeMap<AgentId, BTreeSet<String>>,
    released: BoundedMap<String, ()>,
    buttons: BTreeMap<AgentId, ButtonPosition>,
    holders_max: usize,
    text_bytes: usize,
}

impl StopStore {
    pub(crate) fn new(holders_max: usize, text_bytes: usize) -> StopStore {
        StopStore {
            stops: BoundedMap::new(STOPS_MAX),
            held: BTreeMap::new(),
            released: BoundedMap::new(STOPS_MAX),
            buttons: BTreeMap::new(),
            holders_max,
            text_bytes,
        }
    }

    /// Takes the request for a stop. Returns whether it is new: the same stop is requested of each
    /// actuator.
    pub(crate) fn requested(&mut self, at: Moment, stop: &Stop) -> bool {
        let is_known = self.released.contains(&stop.id) || self.stops.contains(&stop.id);
        let is_new = !is_known && is_valid(stop);
        if is_new {
            self.add(at, stop);
        }
        is_new
    }

    fn add(&mut self, at: Moment, stop: &Stop) {
        let record = StopRecord { stop: self.kept(stop), at, holders: BTreeSet::new() };
        self.stops.insert(stop.id.clone(), record);
    }

    fn kept(&self, stop: &Stop) -> Stop {
        let names = stop.scope.iter().take(STOP_NAMES_MAX);
        Stop {
            id: cut(&stop.id, self.text_bytes),
            scope: names.map(|name| cut(name, self.text_bytes)).collect(),
            by: stop.by.clone(),
            why: cut(&stop.why, self.text_bytes),
        }
    }

    /// Takes the release of stops. Returns whether one of them was in force.
    pub(crate) fn released(&mut self, ids: &[String]) -> bool {
        let mut is_news = false;
        for id in ids.iter().take(STOPS_MAX) {
            let Some(record) = self.stops.remove(id) else { continue };
            is_news = true;
            for holder in record.holders {
                if let Some(held) = self.held.get_mut(&holder) {
                    held.remove(id);
                }
            }
            self.released.insert(id.clone(), ());
        }
        is_news
    }

    /// Takes the stops that an actuator repeats: all that it knows. Returns whether one of them is
    /// new.
    pub(crate) fn repeated(&mut self, at: Moment, holder: &AgentId, stops: &[Stop]) -> bool {
        if stops.is_empty() && !self.held.contains_key(holder) {
            return false;
        }
        let mut is_news = false;
        let mut now = BTreeSet::new();
        let in_force = stops.iter().take(STOPS_MAX).filter(|stop| is_valid(stop));
        let in_force = in_force.filter(|stop| !self.released.contains(&stop.id));
        for stop in in_force.collect::<Vec<_>>() {
            if !self.stops.contains(&stop.id) {
                self.add(at, stop);
                is_news = true;
            }
            if let Some(record) = self.stops.get_mut(&stop.id)
                && record.holders.len() < self.holders_max
            {
                record.holders.insert(holder.clone());
                now.insert(stop.id.clone());
            }
        }
        let former = self.held.remove(holder).unwrap_or_default();
        for id in former.difference(&now) {
            let Some(record) = self.stops.get_mut(id) else { continue };
            record.holders.remove(holder);
            if record.holders.is_empty() {
                self.stops.remove(id);
            }
        }
        if !now.is_empty() {
            self.held.insert(holder.clone(), now);
        }
        is_news
    }

    /// Whether no stop is known.
    pub(crate) fn is_empty(&self) -> bool {
        self.stops.iter().next().is_none()
    }

    /// Whether an actuator has said that it knows a stop.
    pub(crate) fn is_held_by(&self, holder: &AgentId) -> bool {
        self.held.contains_key(holder)
    }

    pub(crate) fn state(&mut self, at: Moment, state: &StopState) {
        self.repeated(at, &state.agent, &state.stops);
        for report in &state.buttons {
            if self.buttons.len() < BUTTONS_MAX || self.buttons.contains_key(&report.button) {
                self.buttons.insert(report.button.clone(), report.position);
            }
        }
    }

    /// Iterates over the stops in force.
    pub(crate) fn in_force(&self, now: Moment) -> impl Iterator<Item = &Stop> {
        let holds = move |record: &&StopRecord| {
            !record.holders.is_empty() || now.since(record.at) < REQUESTED_MS
        };
        self.stops.iter().map(|(_, record)| record).filter(holds).map(|record| &record.stop)
    }

    /// Iterates over the hardware stops with their positions.
    /// Returns the stops in force, sorted by their identifiers.
    pub(crate) fn rows(&self, now: Moment) -> Vec<StopRow> {
        let in_force = self.in_force(now).filter_map(|stop| self.stops.get(&stop.id));
        let mut rows: Vec<_> = in_force
            .map(|record| StopRow {
                stop: record.stop.clone(),
                at: record.at,
                holders: u64::try_from(record.holders.len()).unwrap_or(u64::MAX),
            })
            .collect();
        rows.sort_by(|one, other| one.stop.id.cmp(&other.stop.id));
        rows
    }

    pub(crate) fn buttons(&self) -> impl Iterator<Item = (&AgentId, ButtonPosition)> {
        self.buttons.iter().map(|(button, position)| (button, *position))
    }
}

/// Whether actuators accept the identifier of a stop.
fn is_valid(stop: &Stop) -> bool {
    stop.id.len() <= STOP_ID_BYTES_MAX
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> AgentId {
        AgentId::new(text).expect("a name")
    }

    fn stop(id: &str) -> Stop {
        Stop {
            id: id.to_owned(),
            scope: vec!["hall".to_owned()],
            by: name("ann"),
            why: String::new(),
        }
    }

    fn count(store: &StopStore, now: u64) -> usize {
        store.in_force(Moment(now)).count()
    }

    #[test]
    fn rows_tell_since_when_and_by_how_many_a_stop_is_held() {
        let mut store = StopStore::new(10, 100);
        store.repeated(Moment(5), &name("a"), &[stop("2")]);
        store.repeated(Moment(6), &name("b"), &[stop("2"), stop("1")]);
        let rows = store.rows(Moment(60_000));
        let told: Vec<_> = rows.iter().map(|it| (it.stop.id.as_str(), it.at, it.holders)).collect();
        assert_eq!(told, [("1", Moment(6), 1), ("2", Moment(5), 2)]);
    }

    #[test]
    fn a_stop_is_in_force_until_the_last_actuator_drops_it() {
        let mut store = StopStore::new(10, 100);
        assert!(store.repeated(Moment(0), &name("a"), &[stop("1")]));
        assert!(!store.repeated(Moment(0), &name("b"), &[stop("1")]));
        store.repeated(Moment(1), &name("a"), &[]);
        assert_eq!(count(&store, 60_000), 1);
        store.repeated(Moment(2), &name("b"), &[]);
        assert_eq!((count(&store, 2), store.held.len()), (0, 0));
    }

    #[test]
    fn a_released_stop_does_not_come_back() {
        let mut store = StopStore::new(10, 100);
        store.requested(Moment(0), &stop("1"));
        assert_eq!((count(&store, 1), count(&store, REQUESTED_MS)), (1, 0));
        store.repeated(Moment(1), &name("a"), &[stop("1")]);
        store.released(&["1".to_owned()]);
        assert!(!store.repeated(Moment(2), &name("a"), &[stop("1")]));
        assert_eq!(count(&store, 2), 0);
    }
}
