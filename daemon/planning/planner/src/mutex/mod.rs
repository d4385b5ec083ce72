//! Mutex groups: sets of facts with at most one true fact in any state that is reachable from the
//! initial state.
//!
//! Candidates are lifted invariants (Helmert, 2009): atoms with common parameters, each with at
//! most one counted argument. Helmert's synthesis proves a candidate on the schemas, for all
//! instances at once. In contrast, [`balance`] proves each instance on the ground operators, so
//! that a failing instance does not invalidate the others, and static facts are used. If an
//! operator adds a fact of an instance without deleting another one, its other deletes suggest an
//! atom to add to the candidate.
//!
//! Groups hold only for states that are reachable from the initial state. A state from another
//! source, such as a report from outside, may violate them.

mod balance;
mod candidate;

use std::collections::VecDeque;

use rustc_hash::{FxHashMap, FxHashSet};

use self::balance::{BalanceCheck, BalanceResult};
use self::candidate::InvariantCandidate;
use crate::limits::Cancel;
use crate::task::{FactId, Task};

/// Mutex groups of a task.
#[derive(Clone, Debug, Default)]
pub(crate) struct MutexGroups {
    /// All known mutex groups. No group is a subset of another.
    groups: Vec<Vec<FactId>>,
    /// A partition of the basic facts into subsets of mutex groups. The subsets are chosen
    /// greedily, the largest first; each remaining fact is a group of its own.
    variables: Vec<Vec<FactId>>,
}

/// Maximum number of candidate invariants to check. After it, the groups found so far are used.
const CANDIDATES_MAX: usize = 2_000;

/// Maximum number of atoms in one candidate invariant. A candidate of this size is not refined by
/// further atoms.
const PARTS_MAX: usize = 16;

/// Value for facts in no instance of the candidate.
const NONE: u32 = u32::MAX;

// === impl MutexGroups ===

impl MutexGroups {
    /// Searches for mutex groups until all candidates are checked or `work_max` effect parts have
    /// been visited. A visit takes about ten nanoseconds. The groups that are found before the
    /// limit are valid.
    pub(crate) fn find(task: &Task, work_max: u64, cancel: &Cancel) -> MutexGroups {
        let mut finder = MutexGroupSearch::new(task, work_max, cancel);
        finder.search();
        let groups = without_parts(finder.groups, task.basic_count);
        let variables = cover(&groups, task.basic_count);
        MutexGroups { groups, variables }
    }

    /// Returns all known mutex groups. Each group is sorted, and no group is a subset of another.
    pub(crate) fn groups(&self) -> &[Vec<FactId>] {
        &self.groups
    }

    /// Returns a partition of the basic facts into sorted mutex groups. Many of them have one fact
    /// only.
    pub(crate) fn variables(&self) -> &[Vec<FactId>] {
        &self.variables
    }
}

/// State of a search for mutex groups.
struct MutexGroupSearch<'t> {
    task: &'t Task,
    cancel: &'t Cancel,
    balance: BalanceCheck<'t>,
    /// Per predicate: the basic facts with this predicate.
    facts: FxHashMap<u32, Vec<FactId>>,
    is_initial: Vec<bool>,
    waiting: VecDeque<InvariantCandidate>,
    seen: FxHashSet<InvariantCandidate>,
    groups: Vec<Vec<FactId>>,
    work_max: u64,
}

// === impl MutexGroupSearch ===

impl<'t> MutexGroupSearch<'t> {
    fn new(task: &'t Task, work_max: u64, cancel: &'t Cancel) -> MutexGroupSearch<'t> {
        let mut finder = MutexGroupSearch {
            task,
            cancel,
            balance: BalanceCheck::new(task),
            facts: FxHashMap::default(),
            is_initial: vec![false; task.basic_count],
            waiting: VecDeque::new(),
            seen: FxHashSet::default(),
            groups: Vec::new(),
            work_max,
        };
        for fact in &task.initial {
            finder.is_initial[fact.index()] = true;
        }
        for index in 0..task.basic_count {
            let fact = FactId::from_index(index);
            let (predicate, arguments) = task.atoms.get(fact);
            let facts = finder.facts.entry(predicate).or_default();
            if facts.is_empty() {
                for candidate in InvariantCandidate::seeds(predicate, arguments.len()) {
                    finder.waiting.push_back(candidate);
                }
            }
            facts.push(fact);
        }
        finder
    }

    fn search(&mut self) {
        while let Some(candidate) = self.waiting.pop_front() {
            let is_over = self.balance.work > self.work_max || self.cancel.is_set();
            if is_over || self.seen.len() >= CANDIDATES_MAX {
                return;
            }
            if self.seen.insert(candidate.clone()) {
                self.examine(&candidate);
            }
        }
    }

    /// Stores the instances of a candidate that are proved, and queues refined candidates for the
    /// other instances.
    fn examine(&mut self, candidate: &InvariantCandidate) {
        let mut keys = FxHashMap::default();
        let mut instances: Vec<Vec<FactId>> = Vec::new();
        let mut instance_of = vec![NONE; self.task.basic_count];
        for part in &candidate.parts {
            for &fact in self.facts.get(&part.predicate).into_iter().flatten() {
                let key = part.key(self.task.atoms.get(fact).1);
                let instance = *keys.entry(key).or_insert_with(|| {
                    instances.push(Vec::new());
                    instances.len() as u32 - 1
                });
                instances[instance as usize].push(fact);
                instance_of[fact.index()] = instance;
            }
        }
        let mut refined = FxHashSet::default();
        for (instance, mut facts) in instances.into_iter().enumerate() {
            if self.balance.work > self.work_max || self.cancel.is_set() {
                return;
            }
            let weight = facts.iter().filter(|fact| self.is_initial[fact.index()]).count();
            if weight > 1 {
                continue;
            }
            match self.balance.check(&facts, &instance_of, instance as u32) {
                BalanceResult::Holds if facts.len() > 1 => {
                    facts.sort_unstable();
                    self.groups.push(facts);
                }
                BalanceResult::Holds | BalanceResult::TooHeavy => (),
                BalanceResult::Unbalanced { deleted } if candidate.parts.len() < PARTS_MAX => {
                    let key = candidate.key(&self.task.atoms, facts[0]);
                    for fact in deleted {
                        candidate.refinements(&self.task.atoms, &key, fact, &mut refined);
                    }
                }
                BalanceResult::Unbalanced { .. } => (),
            }
        }
        // The candidates are sorted, so that the limit selects the same ones in every run.
        let mut refined: Vec<InvariantCandidate> = refined.into_iter().collect();
        refined.sort_unstable();
        self.waiting.extend(refined);
    }
}

/// Removes mutex groups that are subsets of other groups.
fn without_parts(mut groups: Vec<Vec<FactId>>, facts: usize) -> Vec<Vec<FactId>> {
    groups.sort_unstable_by(|left, right| right.len().cmp(&left.len()).then(left.cmp(right)));
    groups.dedup();
    let mut of: Vec<Vec<u32>> = vec![Vec::new(); facts];
    let mut kept: Vec<Vec<FactId>> = Vec::new();
    for group in groups {
        let is_part = of[group[0].index()].iter().any(|other| {
            let other = &kept[*other as usize];
            group.iter().all(|fact| other.binary_search(fact).is_ok())
        });
        if !is_part {
            group.iter().for_each(|fact| of[fact.index()].push(kept.len() as u32));
            kept.push(group);
        }
    }
    kept
}

/// Partitions the facts greedily: repeatedly takes the mutex group with the most facts outside all
/// previous parts.
fn cover(groups: &[Vec<FactId>], facts: usize) -> Vec<Vec<FactId>> {
    let mut of: Vec<Vec<usize>> = vec![Vec::new(); facts];
    for (index, group) in groups.iter().enumerate() {
        group.iter().for_each(|fact| of[fact.index()].push(index));
    }
    let mut left: Vec<usize> = groups.iter().map(Vec::len).collect();
    let longest = left.iter().copied().max().unwrap_or(0);
    let mut by_size: Vec<VecDeque<usize>> = vec![VecDeque::new(); longest + 1];
    left.iter().enumerate().for_each(|(index, size)| by_size[*size].push_back(index));
    let mut is_taken = vec![false; facts];
    let mut variables = Vec::new();
    for size in (2..=longest).rev() {
        while let Some(index) = by_size[size].pop_front() {
            if left[index] < size {
                by_size[left[index]].push_back(index);
                continue;
            }
            let free = groups[index].iter().filter(|fact| !is_taken[fact.index()]);
            let variable: Vec<FactId> = free.copied().collect();
            for fact in &variable {
                is_taken[fact.index()] = true;
                of[fact.index()].iter().for_each(|group| left[*group] -= 1);
            }
            variables.push(variable);
        }
    }
    let single = (0..facts).filter(|index| !is_taken[*index]);
    variables.extend(single.map(|index| vec![FactId::from_index(index)]));
    variables
}

#[cfg(test)]
mod tests;
