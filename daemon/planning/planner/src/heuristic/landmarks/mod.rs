//! Landmark counting: the heuristic is the number of landmarks that must still be achieved, or must
//! be achieved again (Richter and Westphal, 2010).
//!
//! The achieved landmarks depend on the path to a state. Every state therefore has a *status* with
//! one bit per landmark.

mod discovery;
mod orders;

use self::discovery::LandmarkDiscovery;
use super::relaxation::Relaxation;
use crate::arena;
use crate::limits::Cancel;
use crate::mutex::MutexGroups;
use crate::state::{State, holds};
use crate::task::{Literal, Task};

/// A landmark: a fact, or a disjunction of facts, that is true at some time in every plan.
#[derive(Clone, Debug)]
struct Landmark {
    /// The landmark's propositions in the relaxation in which it was found.
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

/// A landmark as it is counted. Its numbers are those of the task, not of a relaxation, so that
/// searches that number their operators and propositions differently can share it.
#[derive(Debug)]
struct CountedLandmark {
    /// The landmark holds if one of these literals holds.
    literals: Vec<Literal>,
    is_goal: bool,
    parents: Vec<u32>,
    needed_for: Vec<u32>,
}

/// The landmark-count heuristic of a task.
#[derive(Debug, Default)]
pub(crate) struct LandmarkCount {
    landmarks: Vec<CountedLandmark>,
    words: usize,
}

// === impl Landmark ===

impl Landmark {
    fn new(propositions: Vec<u32>) -> Landmark {
        Landmark { propositions, is_goal: false, parents: Vec::new(), needed_for: Vec::new() }
    }

    /// Returns the landmark as it is counted. All propositions of landmarks are literals.
    fn counted(self, relaxation: &Relaxation) -> CountedLandmark {
        let Landmark { propositions, is_goal, parents, needed_for } = self;
        let literals = propositions.into_iter().filter_map(|one| relaxation.literal(one));
        CountedLandmark { literals: literals.collect(), is_goal, parents, needed_for }
    }
}

// === impl CountedLandmark ===

impl CountedLandmark {
    fn holds(&self, state: &State) -> bool {
        self.literals.iter().any(|literal| holds(state, *literal))
    }
}

// === impl LandmarkGraph ===

impl LandmarkGraph {
    /// Removes the landmarks that are not marked in `kept`, with their orders.
    fn keep(&mut self, kept: &[bool]) {
        let mut next = 0;
        let mut number = |is_kept: &bool| {
            next += u32::from(*is_kept);
            is_kept.then(|| next - 1)
        };
        let numbers: Vec<Option<u32>> = kept.iter().map(&mut number).collect();
        let renumbered =
            |all: &[u32]| all.iter().filter_map(|one| numbers[*one as usize]).collect();
        let mut is_kept = kept.iter();
        self.landmarks.retain(|_| is_kept.next() == Some(&true));
        for landmark in &mut self.landmarks {
            landmark.parents = renumbered(&landmark.parents);
            landmark.needed_for = renumbered(&landmark.needed_for);
        }
    }

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
        let counted = graph.landmarks.into_iter().map(|one| one.counted(relaxation));
        LandmarkCount { landmarks: counted.collect(), words }
    }

    /// Returns the number of words of a status.
    pub(crate) fn words(&self) -> usize {
        self.words
    }

    /// Appends the status of the initial state to `statuses`. Returns the landmark count of the
    /// initial state.
    pub(crate) fn start(&self, state: &State, statuses: &mut Vec<u64>) -> u32 {
        let start = statuses.len();
        statuses.resize(start + self.words, 0);
        for (index, landmark) in self.landmarks.iter().enumerate() {
            // A landmark with predecessors is not yet achieved in the required order.
            if landmark.parents.is_empty() && landmark.holds(state) {
                statuses[start + index / 64] |= 1 << (index % 64);
            }
        }
        self.count(state, &statuses[start..])
    }

    /// Appends the status of a state to `statuses`. Returns the landmark count of the state.
    /// `parent` is the number of the parent state's status.
    pub(crate) fn progress(&self, state: &State, parent: usize, statuses: &mut Vec<u64>) -> u32 {
        let (from, to) = (parent * self.words, statuses.len());
        arena::make_room(statuses, self.words);
        statuses.extend_from_within(from..from + self.words);
        let (before, after) = statuses.split_at_mut(to);
        self.achieve(state, &before[from..from + self.words], after);
        self.count(state, after)
    }

    /// Updates the status of a known state that was reached from a further parent: a landmark is
    /// achieved if it is achieved on every known path. Returns the new landmark count. `known` and
    /// `parent` are the numbers of the statuses.
    pub(crate) fn progress_again(
        &self,
        state: &State,
        known: usize,
        parent: usize,
        statuses: &mut [u64],
    ) -> u32 {
        let (from, to) = (parent * self.words, known * self.words);
        let before = statuses[from..from + self.words].to_vec();
        let mut after = before.clone();
        self.achieve(state, &before, &mut after);
        let known = &mut statuses[to..to + self.words];
        known.iter_mut().zip(&after).for_each(|(known, also)| *known &= also);
        self.count(state, known)
    }

    /// Adds the landmarks that a state achieves to `after`. `before` is the status of its parent.
    fn achieve(&self, state: &State, before: &[u64], after: &mut [u64]) {
        let is_past = |index: u32| before[index as usize / 64] >> (index % 64) & 1 == 1;
        for (word, past) in before.iter().enumerate() {
            let mut open = !past;
            while open != 0 {
                let index = word * 64 + open.trailing_zeros() as usize;
                open &= open - 1;
                let Some(landmark) = self.landmarks.get(index) else { break };
                if landmark.holds(state) && landmark.parents.iter().all(|parent| is_past(*parent)) {
                    after[word] |= 1 << (index % 64);
                }
            }
        }
    }

    /// Returns the number of landmarks that are not achieved, plus the number of achieved ones that
    /// do not hold now and are required again.
    fn count(&self, state: &State, status: &[u64]) -> u32 {
        let is_past = |index: usize| status[index / 64] >> (index % 64) & 1 == 1;
        let mut count = 0;
        for (index, landmark) in self.landmarks.iter().enumerate() {
            let is_needed = || {
                landmark.is_goal
                    || landmark.needed_for.iter().any(|later| !is_past(*later as usize))
            };
            if !is_past(index) || (!landmark.holds(state) && is_needed()) {
                count += 1;
            }
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heuristic::{Evaluator, FastForward, Weights};
    use crate::progression::Progression;
    use crate::task::FactId;
    use crate::test_tasks::task;

    /// Returns the landmark counts of the initial state, and of the state after the first operator of
    /// the action schema with the name `action`.
    fn counts(domain: &str, problem: &str, action: &str) -> (u32, u32) {
        let (task, cancel) = (task(domain, problem), Cancel::new());
        let mut progression = Progression::new(&task);
        let (state, mut next) = (progression.initial(), Vec::new());
        let mut ff = FastForward::new(&task, Weights::Unit);
        ff.evaluate(&state).expect("a goal in reach");
        let candidates = ff.relaxed_propositions();
        let mutex = MutexGroups::find(&task, u64::MAX, &cancel);
        let relaxation = ff.relaxation();
        let landmarks = LandmarkCount::new(&task, relaxation, &state, &candidates, &mutex, &cancel);
        let mut statuses = Vec::new();
        let before = landmarks.start(&state, &mut statuses);
        let is_meant = |schema: u32| task.schema_names[schema as usize].as_str() == action;
        let operator = task.operators.iter().find(|it| is_meant(it.schema)).expect("an operator");
        assert!(progression.apply(operator, &state, &mut next));
        (before, landmarks.progress(&next, 0, &mut statuses))
    }

    #[test]
    fn a_landmark_is_achieved_if_it_is_achieved_on_every_known_path() {
        let literals = vec![Literal::new(FactId(0), true)];
        let (parents, needed_for) = (Vec::new(), Vec::new());
        let landmark = CountedLandmark { literals, is_goal: false, parents, needed_for };
        let landmarks = LandmarkCount { landmarks: vec![landmark], words: 1 };
        // The path to the first parent has achieved the landmark, that to the second one has not.
        let mut statuses = vec![1, 0];
        let without_the_fact = [0];
        assert_eq!(landmarks.progress(&without_the_fact, 0, &mut statuses), 0);
        assert_eq!(landmarks.progress_again(&without_the_fact, 2, 1, &mut statuses), 1);
        assert_eq!(statuses, [1, 0, 0]);
    }

    #[test]
    fn facts_that_one_step_achieves_do_not_wait_for_each_other() {
        let domain = "(define (domain bar)
            (:predicates (raw) (mixed) (has-a) (has-b) (served-a) (served-b))
            (:action mix-a :precondition (raw) :effect (and (not (raw)) (mixed) (has-a)))
            (:action mix-b :precondition (raw) :effect (and (not (raw)) (mixed) (has-b)))
            (:action serve-a :precondition (and (mixed) (has-a))
              :effect (and (not (mixed)) (not (has-a)) (raw) (served-a)))
            (:action serve-b :precondition (and (mixed) (has-b))
              :effect (and (not (mixed)) (not (has-b)) (raw) (served-b))))";
        let problem = "(define (problem p) (:domain bar) (:init (raw))
            (:goal (and (served-a) (served-b))))";
        // At first: both servings, both mixtures, and something mixed. Then the first mixture and
        // something mixed are achieved, and raw material is needed again.
        assert_eq!(counts(domain, problem, "mix-a"), (5, 4));
    }

    #[test]
    fn a_fact_that_is_needed_replaces_the_choice_that_contains_it() {
        for (either, certain) in [("g", "h"), ("h", "g")] {
            let domain = format!(
                "(define (domain d) (:constants a b) (:predicates (s) (p ?x) (g) (h))
                (:action get :parameters (?x) :precondition (s) :effect (p ?x))
                (:action by-a :precondition (p a) :effect ({either}))
                (:action by-b :precondition (p b) :effect ({either}))
                (:action only-by-a :precondition (p a) :effect ({certain})))"
            );
            let problem = "(define (problem p) (:domain d) (:init (s)) (:goal (and (g) (h))))";
            // Both goals and `(p a)`; the choice of `(p a)` and `(p b)` says less.
            assert_eq!(counts(&domain, problem, "get"), (3, 2));
        }
    }
}
