//! Landmark discovery: finds facts that are true at some time in every plan.
//!
//! 1. Backchaining (Porteous, Sebastia and Hoffmann, 2001; Richter and Westphal, 2010): a
//!    precondition that all first achievers of a landmark have is a landmark. If the first
//!    achievers have different preconditions of one predicate, the disjunction of these
//!    preconditions is a landmark.
//! 2. Test of the facts of one relaxed plan: if the goal is unreachable in the relaxation without a
//!    fact, this fact is a landmark (Hoffmann, Porteous and Sebastia, 2004). Every relaxed plan
//!    contains all landmarks of the relaxation, so all landmarks that are single facts are found,
//!    unless the limit on work is reached.

use rustc_hash::FxHashMap;

use super::super::relaxation::Relaxation;
use super::{Landmark, LandmarkGraph};
use crate::limits::Cancel;
use crate::state::State;
use crate::task::Atoms;

/// Maximum number of facts in a disjunctive landmark. A larger set of facts does not become a
/// landmark.
const DISJUNCTS_MAX: usize = 4;

/// Limit on the work of testing the facts of a relaxed plan, in visited edges of the relaxation.
/// When it is exceeded, the remaining facts are not tested. This many edges take about half a
/// second.
const TEST_WORK_MAX: usize = 60_000_000;

/// Limit on the work of backchaining, in visited edges of the relaxation. When it is reached, the
/// landmarks found so far are used.
const BACKCHAINING_WORK_MAX: usize = 140_000_000;

/// Discovery of the landmarks of a task, from its initial state.
pub(super) struct LandmarkDiscovery<'r> {
    relaxation: &'r Relaxation,
    adding: crate::rows::Rows,
    atoms: &'r Atoms,
    initial: Vec<bool>,
    initially: Vec<u32>,
    graph: LandmarkGraph,
    /// For a proposition: the landmark that consists of this proposition only.
    simple: FxHashMap<u32, u32>,
    /// For a proposition: the disjunctive landmark that contains it.
    part_of: FxHashMap<u32, u32>,
    /// Per landmark: whether it is kept at the end.
    is_kept: Vec<bool>,
    /// Landmarks that backchaining has not processed. The newest is next. Of disjunctions that overlap,
    /// only the first that is found counts, so the order of processing decides which are found. With
    /// those of the newest first, searches are shorter than with those of the oldest first (barman:
    /// half the time).
    waiting: Vec<u32>,
    reached: Vec<bool>,
    missing: Vec<u32>,
    stack: Vec<u32>,
    backchaining_work: usize,
    test_work: usize,
}

// === impl LandmarkDiscovery ===

impl<'r> LandmarkDiscovery<'r> {
    pub(super) fn new(relaxation: &'r Relaxation, atoms: &'r Atoms, state: &State) -> Self {
        let mut initially = Vec::new();
        relaxation.initial(state, &mut initially);
        let mut initial = vec![false; relaxation.proposition_count()];
        initially.iter().for_each(|proposition| initial[*proposition as usize] = true);
        LandmarkDiscovery {
            relaxation,
            adding: relaxation.adding(),
            atoms,
            initial,
            initially,
            graph: LandmarkGraph::default(),
            simple: FxHashMap::default(),
            part_of: FxHashMap::default(),
            is_kept: Vec::new(),
            waiting: Vec::new(),
            reached: vec![false; relaxation.proposition_count()],
            missing: Vec::new(),
            stack: Vec::new(),
            backchaining_work: 0,
            test_work: 0,
        }
    }

    /// Runs the discovery, and returns the landmarks. `candidates` are the propositions of a
    /// relaxed plan.
    pub(super) fn run(mut self, candidates: &[u32], cancel: &Cancel) -> LandmarkGraph {
        for &goal in self.relaxation.goal() {
            let landmark = self.simple_landmark(goal);
            self.graph.landmarks[landmark as usize].is_goal = true;
        }
        self.backchain(cancel);
        for &candidate in candidates {
            if self.test_work > TEST_WORK_MAX || cancel.is_set() {
                break;
            }
            let is_open = !self.simple.contains_key(&candidate)
                && !self.initial[candidate as usize]
                && self.relaxation.is_literal(candidate);
            if !is_open {
                continue;
            }
            self.test_work += self.reach_without(&[candidate]);
            if self.relaxation.goal().iter().any(|goal| !self.reached[*goal as usize]) {
                self.simple_landmark(candidate);
                self.backchain(cancel);
            }
        }
        self.graph.keep(&self.is_kept);
        self.graph
    }

    fn backchain(&mut self, cancel: &Cancel) {
        while let Some(landmark) = self.waiting.pop() {
            if self.backchaining_work > BACKCHAINING_WORK_MAX || cancel.is_set() {
                return;
            }
            let propositions = self.graph.landmarks[landmark as usize].propositions.clone();
            self.backchaining_work += self.reach_without(&propositions);
            let achievers = self.first_achievers(&propositions);
            self.shared_preconditions(landmark, &achievers);
            self.disjunctions(landmark, &achievers);
        }
    }

    /// Computes the propositions that are reachable without the propositions in `excluded`. Returns
    /// the work, in visited edges of the relaxation.
    fn reach_without(&mut self, excluded: &[u32]) -> usize {
        let LandmarkDiscovery { relaxation, reached, missing, stack, .. } = self;
        reached.fill(false);
        missing.clear();
        missing.extend_from_slice(relaxation.missing());
        let mut work = missing.len() / 8;
        for &proposition in &self.initially {
            if !excluded.contains(&proposition) {
                reached[proposition as usize] = true;
                stack.push(proposition);
            }
        }
        let fire = |relaxed: u32, reached: &mut Vec<bool>, stack: &mut Vec<u32>| {
            for &added in relaxation.adds(relaxed) {
                if !reached[added as usize] && !excluded.contains(&added) {
                    reached[added as usize] = true;
                    stack.push(added);
                }
            }
            relaxation.adds(relaxed).len()
        };
        for &relaxed in relaxation.free() {
            work += fire(relaxed, reached, stack);
        }
        while let Some(proposition) = stack.pop() {
            work += relaxation.asking(proposition).len();
            for &relaxed in relaxation.asking(proposition) {
                let missing = &mut missing[relaxed as usize];
                *missing -= 1;
                if *missing == 0 {
                    work += fire(relaxed, reached, stack);
                }
            }
        }
        work
    }

    /// Returns the first achievers: the relaxed operators that can be the first to make one of
    /// `propositions` true.
    fn first_achievers(&self, propositions: &[u32]) -> Vec<u32> {
        let all = propositions.iter().flat_map(|proposition| self.adding.row(*proposition));
        let is_first = |relaxed: &&u32| {
            let preconditions = self.relaxation.preconditions(**relaxed);
            preconditions.iter().all(|one| self.reached[*one as usize])
        };
        let mut achievers: Vec<u32> = all.filter(is_first).copied().collect();
        achievers.sort_unstable();
        achievers.dedup();
        achievers
    }

    /// Adds the preconditions that all `achievers` have in common as landmarks, ordered before
    /// `landmark`.
    fn shared_preconditions(&mut self, landmark: u32, achievers: &[u32]) {
        let Some((first, rest)) = achievers.split_first() else { return };
        let mut shared = self.relaxation.preconditions(*first).to_vec();
        for achiever in rest {
            let preconditions = self.relaxation.preconditions(*achiever);
            shared.retain(|one| preconditions.binary_search(one).is_ok());
            if shared.is_empty() {
                return;
            }
        }
        for proposition in shared.into_iter().filter(|one| self.relaxation.is_literal(*one)) {
            let before = self.simple_landmark(proposition);
            self.graph.order_greedy_necessary(before, landmark);
        }
    }

    /// Adds disjunctive landmarks, ordered before `landmark`. If every achiever has a precondition
    /// of the same predicate, one of these preconditions must be true before `landmark`.
    fn disjunctions(&mut self, landmark: u32, achievers: &[u32]) {
        let Some(first) = achievers.first() else { return };
        let predicate = |one: u32| {
            let fact = self.relaxation.positive(one)?;
            // Only basic facts are used, because comparisons and derived facts have no operators as
            // first achievers.
            (fact.index() < self.atoms.len()).then(|| self.atoms.get(fact).0)
        };
        let mut candidates: Vec<u32> = self
            .relaxation
            .preconditions(*first)
            .iter()
            .filter_map(|one| predicate(*one))
            .collect();
        candidates.sort_unstable();
        candidates.dedup();
        for candidate in candidates {
            let mut facts = Vec::new();
            let all = achievers.iter().all(|achiever| {
                let preconditions = self.relaxation.preconditions(*achiever).iter();
                let before = facts.len();
                facts.extend(preconditions.filter(|one| predicate(**one) == Some(candidate)));
                facts.len() > before && facts.len() < 1_000
            });
            facts.sort_unstable();
            facts.dedup();
            let is_small = facts.len() > 1 && facts.len() <= DISJUNCTS_MAX;
            if all && is_small && !facts.iter().any(|one| self.initial[*one as usize]) {
                self.disjunctive_landmark(facts, landmark);
            }
        }
    }

    fn simple_landmark(&mut self, proposition: u32) -> u32 {
        if let Some(&known) = self.simple.get(&proposition) {
            return known;
        }
        let index = self.add(vec![proposition]);
        self.simple.insert(proposition, index);
        self.drop_disjunction(proposition);
        index
    }

    /// Drops the disjunctive landmark that contains `proposition`, because `proposition` alone is a
    /// landmark now: it must be achieved anyway. Others of the facts may be parts of later
    /// disjunctions.
    fn drop_disjunction(&mut self, proposition: u32) {
        let Some(&dropped) = self.part_of.get(&proposition) else { return };
        self.is_kept[dropped as usize] = false;
        self.part_of.retain(|_, landmark| *landmark != dropped);
    }

    fn disjunctive_landmark(&mut self, facts: Vec<u32>, landmark: u32) {
        if facts.iter().any(|one| self.simple.contains_key(one)) {
            return;
        }
        let known = self.part_of.get(&facts[0]).copied();
        let before = match known {
            Some(known) if self.graph.landmarks[known as usize].propositions == facts => known,
            // Overlapping disjunctive landmarks usually repeat the same information.
            _ if facts.iter().any(|one| self.part_of.contains_key(one)) => return,
            _ => {
                let index = self.add(facts.clone());
                facts.iter().for_each(|one| {
                    self.part_of.insert(*one, index);
                });
                index
            }
        };
        self.graph.order_greedy_necessary(before, landmark);
    }

    fn add(&mut self, propositions: Vec<u32>) -> u32 {
        let index = self.graph.landmarks.len() as u32;
        // A landmark that holds initially has no first achiever.
        let is_initial = propositions.iter().any(|one| self.initial[*one as usize]);
        self.graph.landmarks.push(Landmark::new(propositions));
        self.is_kept.push(true);
        if !is_initial {
            self.waiting.push(index);
        }
        index
    }
}
