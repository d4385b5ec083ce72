//! Finds landmarks: facts that every plan makes true on its way.
//!
//! Backchaining (Porteous, Sebastia and Hoffmann, 2001; Richter and Westphal, 2010): what all first
//! achievers of a landmark ask for is a landmark, and where they ask for different facts of one
//! predicate, one of these. In addition, every fact of one relaxed plan is left out of the
//! relaxation; where the goal is then out of reach, the fact is a landmark (Hoffmann, Porteous and
//! Sebastia, 2004). As every landmark of the relaxation is in every relaxed plan, none is missed
//! that is a single fact, while work lasts.

use rustc_hash::FxHashMap;

use super::super::relaxation::Relaxation;
use super::{Graph, Landmark};
use crate::limits::Cancel;
use crate::state::State;
use crate::task::Atoms;

/// Facts in a disjunctive landmark.
const DISJUNCTS_MAX: usize = 4;

/// Edges of the relaxation to walk while testing the facts of a relaxed plan: about half a second.
const TEST_WORK_MAX: usize = 60_000_000;

/// Edges to walk in all; then what is found is all there is.
const WORK_MAX: usize = 200_000_000;

/// Finds the landmarks of a task, seen from its initial state.
pub(super) struct Discovery<'r> {
    relaxation: &'r Relaxation,
    adding: crate::rows::Rows,
    atoms: &'r Atoms,
    initial: Vec<bool>,
    initially: Vec<u32>,
    graph: Graph,
    /// By proposition: the simple landmark it is.
    simple: FxHashMap<u32, u32>,
    /// By proposition: a disjunctive landmark it is part of.
    part_of: FxHashMap<u32, u32>,
    /// Landmarks whose achievers were not looked at.
    waiting: Vec<u32>,
    reached: Vec<bool>,
    missing: Vec<u32>,
    stack: Vec<u32>,
    work: usize,
}

// === impl Discovery ===

impl<'r> Discovery<'r> {
    pub(super) fn new(relaxation: &'r Relaxation, atoms: &'r Atoms, state: &State) -> Self {
        let mut initially = Vec::new();
        relaxation.initial(state, &mut initially);
        let mut initial = vec![false; relaxation.proposition_count()];
        initially.iter().for_each(|proposition| initial[*proposition as usize] = true);
        Discovery {
            relaxation,
            adding: relaxation.adding(),
            atoms,
            initial,
            initially,
            graph: Graph::default(),
            simple: FxHashMap::default(),
            part_of: FxHashMap::default(),
            waiting: Vec::new(),
            reached: vec![false; relaxation.proposition_count()],
            missing: Vec::new(),
            stack: Vec::new(),
            work: 0,
        }
    }

    /// Finds landmarks; `candidates` are the propositions of a relaxed plan.
    pub(super) fn run(mut self, candidates: &[u32], cancel: &Cancel) -> Graph {
        for &goal in self.relaxation.goal() {
            let landmark = self.simple_landmark(goal);
            self.graph.landmarks[landmark as usize].is_goal = true;
        }
        self.backchain(cancel);
        for &candidate in candidates {
            if self.work > TEST_WORK_MAX || cancel.is_set() {
                break;
            }
            let is_open = !self.simple.contains_key(&candidate)
                && !self.initial[candidate as usize]
                && self.relaxation.is_literal(candidate);
            if !is_open {
                continue;
            }
            self.reach_without(&[candidate]);
            if self.relaxation.goal().iter().any(|goal| !self.reached[*goal as usize]) {
                self.simple_landmark(candidate);
                self.backchain(cancel);
            }
        }
        self.graph
    }

    fn backchain(&mut self, cancel: &Cancel) {
        while let Some(landmark) = self.waiting.pop() {
            if self.work > WORK_MAX || cancel.is_set() {
                return;
            }
            let propositions = self.graph.landmarks[landmark as usize].propositions.clone();
            self.reach_without(&propositions);
            let achievers = self.first_achievers(&propositions);
            self.shared_preconditions(landmark, &achievers);
            self.disjunctions(landmark, &achievers);
        }
    }

    /// What can be reached while some propositions never hold.
    fn reach_without(&mut self, excluded: &[u32]) {
        let Discovery { relaxation, reached, missing, stack, .. } = self;
        reached.fill(false);
        missing.clear();
        missing.extend_from_slice(relaxation.missing());
        self.work += missing.len() / 8;
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
            self.work += fire(relaxed, reached, stack);
        }
        while let Some(proposition) = stack.pop() {
            self.work += relaxation.asking(proposition).len();
            for &relaxed in relaxation.asking(proposition) {
                let missing = &mut missing[relaxed as usize];
                *missing -= 1;
                if *missing == 0 {
                    self.work += fire(relaxed, reached, stack);
                }
            }
        }
    }

    /// Relaxed operators that can be the first to achieve one of the propositions.
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

    /// What all achievers ask for comes before what they achieve.
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

    /// Where every achiever asks for a fact of the same predicate, one of these comes before.
    fn disjunctions(&mut self, landmark: u32, achievers: &[u32]) {
        let Some(first) = achievers.first() else { return };
        let predicate = |one: u32| {
            let fact = self.relaxation.positive(one)?;
            // What is derived has no first achievers among operators.
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
        index
    }

    fn disjunctive_landmark(&mut self, facts: Vec<u32>, landmark: u32) {
        if facts.iter().any(|one| self.simple.contains_key(one)) {
            return;
        }
        let known = self.part_of.get(&facts[0]).copied();
        let before = match known {
            Some(known) if self.graph.landmarks[known as usize].propositions == facts => known,
            // One that overlaps another is mostly the same said twice.
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
        // What holds at first has no first achiever.
        let is_initial = propositions.iter().any(|one| self.initial[*one as usize]);
        self.graph.landmarks.push(Landmark::new(propositions));
        if !is_initial {
            self.waiting.push(index);
        }
        index
    }
}
