//! Landmark counting: the heuristic is the number of landmarks that must still be achieved, or must
//! be achieved again (Richter and Westphal, 2010).
//!
//! The achieved landmarks depend on the path to a state. Every state therefore has a *status* with
//! one bit per landmark.

mod discovery;
mod orders;

use self::discovery::LandmarkDiscovery;
use super::relaxation::Relaxation;
use crate::limits::Cancel;
use crate::mutex::MutexGroups;
use crate::state::State;
use crate::task::Task;

/// A landmark: a fact, or a disjunction of facts, that is true at some time in every plan.
#[derive(Clone, Debug)]
struct Landmark {
    propositions: Vec<u32>,
    is_goal: bool,
    /// Landmarks that must be achieved before this landmark (greedy-necessary orders), or should be
    /// achieved before it (reasonable orders).
    parents: Vec<u32>,
    /// Landmarks that require this landmark immediately before they are first achieved.
    needed_for: Vec<u32>,
}

/// Landmark graph: the landmarks and their orders.
#[derive(Clone, Debug, Default)]
struct LandmarkGraph {
    landmarks: Vec<Landmark>,
}

/// The landmark-count heuristic of a task.
#[derive(Debug, Default)]
pub(crate) struct LandmarkCount {
    landmarks: Vec<Landmark>,
    words: usize,
}

// === impl Landmark ===

impl Landmark {
    fn new(propositions: Vec<u32>) -> Landmark {
        Landmark { propositions, is_goal: false, parents: Vec::new(), needed_for: Vec::new() }
    }

    fn holds(&self, relaxation: &Relaxation, state: &State) -> bool {
        self.propositions.iter().any(|proposition| relaxation.holds(state, *proposition))
    }
}

// === impl LandmarkGraph ===

impl LandmarkGraph {
    fn order_greedy_necessary(&mut self, before: u32, after: u32) {
        if before == after {
            return;
        }
        let needed_for = &mut self.landmarks[before as usize].needed_for;
        if !needed_for.contains(&after) {
            needed_for.push(after);
            self.landmarks[after as usize].parents.push(before);
        }
    }
}

// === impl LandmarkCount ===

impl LandmarkCount {
    /// Finds the landmarks of a task. `candidates` are the propositions of a relaxed plan.
    pub(crate) fn new(
        task: &Task,
        relaxation: &Relaxation,
        state: &State,
        candidates: &[u32],
        mutex: &MutexGroups,
        cancel: &Cancel,
    ) -> LandmarkCount {
        let discovery = LandmarkDiscovery::new(relaxation, &task.atoms, state);
        let mut graph = discovery.run(candidates, cancel);
        orders::add_reasonable(&mut graph, task, relaxation, mutex);
        let words = graph.landmarks.len().div_ceil(64);
        LandmarkCount { landmarks: graph.landmarks, words }
    }

    /// Appends the status of the initial state to `statuses`. Returns the landmark count of the
    /// initial state.
    pub(crate) fn start(
        &self,
        relaxation: &Relaxation,
        state: &State,
        statuses: &mut Vec<u64>,
    ) -> u32 {
        let start = statuses.len();
        statuses.resize(start + self.words, 0);
        for (index, landmark) in self.landmarks.iter().enumerate() {
            // A landmark with predecessors is not yet achieved in the required order.
            if landmark.parents.is_empty() && landmark.holds(relaxation, state) {
                statuses[start + index / 64] |= 1 << (index % 64);
            }
        }
        self.count(relaxation, state, &statuses[start..])
    }

    /// Appends the status of a state to `statuses`. Returns the landmark count of the state.
    /// `parent` is the number of the parent state's status.
    pub(crate) fn progress(
        &self,
        relaxation: &Relaxation,
        state: &State,
        parent: usize,
        statuses: &mut Vec<u64>,
    ) -> u32 {
        let (from, to) = (parent * self.words, statuses.len());
        statuses.extend_from_within(from..from + self.words);
        let (before, after) = statuses.split_at_mut(to);
        let before = &before[from..from + self.words];
        let is_past = |index: u32| before[index as usize / 64] >> (index % 64) & 1 == 1;
        for word in 0..self.words {
            let mut open = !before[word];
            while open != 0 {
                let index = word * 64 + open.trailing_zeros() as usize;
                open &= open - 1;
                let Some(landmark) = self.landmarks.get(index) else { break };
                if landmark.holds(relaxation, state)
                    && landmark.parents.iter().all(|parent| is_past(*parent))
                {
                    after[word] |= 1 << (index % 64);
                }
            }
        }
        self.count(relaxation, state, after)
    }

    /// Returns the number of landmarks that are not achieved, plus the number of achieved ones that
    /// do not hold now and are required again.
    fn count(&self, relaxation: &Relaxation, state: &State, status: &[u64]) -> u32 {
        let is_past = |index: usize| status[index / 64] >> (index % 64) & 1 == 1;
        let mut count = 0;
        for (index, landmark) in self.landmarks.iter().enumerate() {
            let is_needed = || {
                landmark.is_goal
                    || landmark.needed_for.iter().any(|later| !is_past(*later as usize))
            };
            if !is_past(index) || (!landmark.holds(relaxation, state) && is_needed()) {
                count += 1;
            }
        }
        count
    }
}
