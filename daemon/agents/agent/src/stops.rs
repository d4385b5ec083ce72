//! The stops that are in force at one daemon, for all its actuators.
//!
//! - A stop is latched: it is on disk before it is confirmed, and holds after a restart. It ends
//!   only when it is released by its identifier. A released stop does not come back, although
//!   actuators elsewhere may still repeat it in their heartbeats.
//! - Stops spread with heartbeats, and releases do not: an actuator that missed a release stays
//!   stopped until it receives one. So no daemon can start the actuators of others.
//! - A stop is never dropped because of its number or length. Too many stops become one stop of
//!   everything, and a stop of too many names becomes one of everything. A file that cannot be read
//!   counts as a stop of everything.

use std::collections::VecDeque;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use acl::AgentId;
use acl::content::{STOP_ID_BYTES_MAX, STOP_NAMES_MAX, Stop};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

use crate::stored_file::replace_file;

/// Maximum number of stops in force; beyond it, all become one stop of everything. People stop
/// parts of a building one by one, and each heartbeat repeats all stops.
const STOPS_MAX: usize = 32;

/// Number of released stops that are remembered; the oldest are forgotten. A machine that was away
/// for months may still have one of the stops in force.
const RELEASED_MAX: usize = 1_024;

/// Identifier of the stop of everything that is in force when the file cannot be read.
const UNREADABLE: &str = "unreadable-file";

/// Name of the file in the daemon's folder.
const FILE: &str = "stops.json";

/// The stops in force at a daemon. All its actuators share one value.
#[derive(Debug)]
pub struct StopRegistry {
    state: watch::Sender<Latched>,
    /// File of the stops; `None` if the daemon keeps nothing.
    file: Option<PathBuf>,
    /// The state that was last written to the file.
    written: Mutex<Latched>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Latched {
    /// Stops in force, the oldest first.
    stops: Vec<Stop>,
    /// Identifiers of released stops, the oldest first.
    released: VecDeque<String>,
}

impl Default for StopRegistry {
    /// Returns a registry without stops and without a file.
    fn default() -> StopRegistry {
        StopRegistry::of(Latched::default(), None)
    }
}

impl StopRegistry {
    /// Reads the stops in the folder of a daemon.
    pub fn open(folder: &Path) -> StopRegistry {
        let file = folder.join(FILE);
        let read = match fs::read(&file) {
            Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| error.to_string()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Latched::default()),
            Err(error) => Err(error.to_string()),
        };
        let state = read.unwrap_or_else(|problem| {
            tracing::error!(file = %file.display(), problem, "stops cannot be read; all is stopped");
            let by = daemon_name();
            let why = format!("{} cannot be read: {problem}", file.display());
            let stop = Stop { id: UNREADABLE.to_owned(), scope: Vec::new(), by, why };
            Latched { stops: vec![stop], released: VecDeque::new() }
        });
        StopRegistry::of(state, Some(file))
    }

    fn of(state: Latched, file: Option<PathBuf>) -> StopRegistry {
        let written = Mutex::new(state.clone());
        StopRegistry { state: watch::Sender::new(state), file, written }
    }

    /// Returns the stops in force, the oldest first.
    pub fn in_force(&self) -> Vec<Stop> {
        self.state.borrow().stops.clone()
    }

    /// Returns the first stop in force for which `concerns` is true.
    pub fn find(&self, concerns: impl Fn(&Stop) -> bool) -> Option<Stop> {
        self.state.borrow().stops.iter().find(|stop| concerns(stop)).cloned()
    }

    /// Whether a stop with this identifier is in force, or was released.
    pub(crate) fn remembers(&self, id: &str) -> bool {
        let state = self.state.borrow();
        state.stops.iter().any(|stop| stop.id == id) || state.released.iter().any(|it| it == id)
    }

    /// Adds a stop, and returns whether it is new: `false` if it is in force already, was released,
    /// or has no usable identifier. The stop holds at once; [`StopRegistry::save`] latches it.
    pub fn add(&self, stop: &Stop) -> bool {
        let Some(stop) = bounded(stop) else { return false };
        self.state.send_if_modified(|state| {
            let is_known = state.stops.iter().any(|known| known.id == stop.id)
                || state.released.contains(&stop.id);
            if is_known {
                return false;
            }
            if state.stops.len() >= STOPS_MAX {
                // Not in the name of the last one: a hardware stop releases its own stops by itself,
                // and would release those of people with them.
                let why = "there were too many stops to keep apart".to_owned();
                state.stops = vec![Stop { scope: Vec::new(), by: daemon_name(), why, ..stop }];
            } else {
                state.stops.push(stop);
            }
            true
        })
    }

    /// Ends the stops with these identifiers, and returns those that were in force.
    pub fn release(&self, ids: &[String]) -> Vec<String> {
        let mut ended = Vec::new();
        self.state.send_if_modified(|state| {
            for id in ids.iter().filter(|id| id.len() <= STOP_ID_BYTES_MAX) {
                let before = state.stops.len();
                state.stops.retain(|stop| stop.id != *id);
                if state.stops.len() < before {
                    ended.push(id.clone());
                }
                if !state.released.contains(id) {
                    state.released.push_back(id.clone());
                }
            }
            let surplus = state.released.len().saturating_sub(RELEASED_MAX);
            state.released.drain(..surplus);
            !ended.is_empty()
        });
        ended
    }

    /// Returns a receiver that is notified of changes.
    pub fn changes(&self) -> StopChanges {
        StopChanges(self.state.subscribe())
    }

    /// Whether the stops are on disk as they are now, or are not to be kept. Does not wait for a
    /// write that is under way.
    pub fn is_saved(&self) -> bool {
        self.file.is_none()
            || self.written.try_lock().is_ok_and(|written| *written == *self.state.borrow())
    }

    /// Writes the stops to disk, if they have changed since they were last written. Waits for the
    /// disk.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
    pub fn save(&self) -> io::Result<()> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let state = self.state.borrow().clone();
        let Some(file) = self.file.as_ref().filter(|_| *written != state) else { return Ok(()) };
        let json = serde_json::to_vec(&state).map_err(io::Error::other)?;
        replace_file(file, &json)?;
        *written = state;
        Ok(())
    }
}

/// Notifications of changes of a [`StopRegistry`].
#[derive(Debug)]
pub struct StopChanges(watch::Receiver<Latched>);

impl StopChanges {
    /// Waits for a change since the last call, or since [`StopRegistry::changes`]. If the registry
    /// is gone, waits for ever.
    pub async fn next(&mut self) {
        if self.0.changed().await.is_err() {
            std::future::pending().await
        }
    }
}

/// Returns the name in which a daemon itself stops everything.
fn daemon_name() -> AgentId {
    AgentId::new("althing").expect("invariant: it is a name")
}

/// Returns the stop within the limits of a stop: too many names become a stop of everything, and a
/// long reason is cut off. Returns `None` if the identifier is empty or too long.
fn bounded(stop: &Stop) -> Option<Stop> {
    /// Longest reason that is kept, in characters.
    const WHY_CHARS_MAX: usize = 200;
    if stop.id.is_empty() || stop.id.len() > STOP_ID_BYTES_MAX {
        return None;
    }
    let mut stop = stop.clone();
    if stop.scope.len() > STOP_NAMES_MAX {
        stop.scope.clear();
    }
    stop.why = stop.why.chars().filter(|letter| !letter.is_control()).take(WHY_CHARS_MAX).collect();
    Some(stop)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stop(id: &str, scope: &[&str]) -> Stop {
        let scope = scope.iter().map(|name| (*name).to_owned()).collect();
        let by = AgentId::new("ann").expect("a name");
        Stop { id: id.to_owned(), scope, by, why: String::new() }
    }

    fn ids(registry: &StopRegistry) -> Vec<String> {
        registry.in_force().into_iter().map(|stop| stop.id).collect()
    }

    #[test]
    fn a_stop_holds_after_a_restart_until_it_is_released() {
        let folder = tempfile::tempdir().expect("a folder");
        let registry = StopRegistry::open(folder.path());
        assert!(registry.add(&stop("one", &[])));
        assert!(registry.add(&stop("two", &["hall"])));
        assert!(!registry.is_saved());
        registry.save().expect("saved");
        assert!(registry.is_saved());
        let registry = StopRegistry::open(folder.path());
        assert_eq!(ids(&registry), ["one", "two"]);
        assert_eq!(registry.release(&["one".to_owned(), "none".to_owned()]), ["one"]);
        registry.save().expect("saved");
        let registry = StopRegistry::open(folder.path());
        assert_eq!(ids(&registry), ["two"]);
        assert!(!registry.add(&stop("one", &[])), "it was released, and is heard again");
        assert!(!registry.add(&stop("none", &[])), "its release came before it");
        assert_eq!(ids(&registry), ["two"]);
    }

    #[test]
    fn a_file_that_cannot_be_read_stops_everything() {
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join(FILE), b"{\"stops\": [").expect("written");
        let registry = StopRegistry::open(folder.path());
        assert!(registry.find(Stop::is_of_everything).is_some());
        assert_eq!(registry.release(&[UNREADABLE.to_owned()]), [UNREADABLE]);
        registry.save().expect("saved");
        assert_eq!(ids(&StopRegistry::open(folder.path())), [""; 0]);
    }

    #[test]
    fn too_many_stops_become_one_of_everything() {
        let registry = StopRegistry::default();
        for number in 0..STOPS_MAX {
            assert!(registry.add(&stop(&number.to_string(), &["hall"])));
        }
        assert!(registry.find(Stop::is_of_everything).is_none());
        assert!(registry.add(&stop("last", &["lab"])));
        assert_eq!(ids(&registry), ["last"]);
        assert!(registry.find(|stop| stop.by.as_str() == "ann").is_none(), "it is none of hers");
        assert!(registry.find(Stop::is_of_everything).is_some());
        let many: Vec<&str> = vec!["hall"; STOP_NAMES_MAX + 1];
        assert!(registry.add(&stop("wide", &many)));
        assert!(registry.in_force().iter().all(Stop::is_of_everything));
        assert!(!registry.add(&stop(&"x".repeat(STOP_ID_BYTES_MAX + 1), &[])));
    }

    #[tokio::test]
    async fn each_change_is_notified_once() {
        let registry = StopRegistry::default();
        let mut changes = registry.changes();
        registry.add(&stop("one", &[]));
        changes.next().await;
        registry.add(&stop("one", &[]));
        registry.release(&["other".to_owned()]);
        let none = tokio::time::timeout(std::time::Duration::ZERO, changes.next()).await;
        assert!(none.is_err(), "nothing has changed");
        registry.release(&["one".to_owned()]);
        changes.next().await;
    }
}
