//! Novelty of a state: the size of the smallest set of its facts that no earlier state of the same
//! partition contains (Lipovetzky and Geffner, 2012; partitions: 2017).

use rustc_hash::FxHashMap;

use crate::state::{State, is_true, true_facts};
use crate::task::Task;

/// Maximum number of facts of a task for which pairs of facts are checked, too. In a task with more
/// facts, only single facts are checked, because the table of pairs and the time to check them
/// would be too large.
const PAIR_FACTS_MAX: usize = 700;

/// Limit on the bytes of all tables. When it is reached, new partitions share the last table.
const BYTES_MAX: usize = 256 << 20;

/// Facts and pairs of facts that have occurred so far, per partition.
#[derive(Debug)]
pub(crate) struct Novelty {
    fact_count: usize,
    with_pairs: bool,
    tables: Vec<NoveltyTable>,
    of_partition: FxHashMap<u32, usize>,
    bytes: usize,
    facts: Vec<u32>,
    changed: Vec<u32>,
}

#[derive(Debug)]
struct NoveltyTable {
    /// Facts that have occurred: one bit per fact.
    single: Vec<u64>,
    /// Pairs of facts that have occurred: one bit per pair, with the lower fact first.
    pairs: Vec<u64>,
}

/// Novelty value of a state without a new fact or a new pair.
pub(crate) const NOT_NOVEL: u32 = 3;

// === impl Novelty ===

impl Novelty {
    pub(crate) fn new(task: &Task) -> Novelty {
        Novelty {
            fact_count: task.fact_count,
            with_pairs: task.fact_count <= PAIR_FACTS_MAX,
            tables: Vec::new(),
            of_partition: FxHashMap::default(),
            bytes: 0,
            facts: Vec::new(),
            changed: Vec::new(),
        }
    }

    /// Returns 1 if a fact of the state is new in the partition, 2 if only a pair of facts is new,
    /// and [`NOT_NOVEL`] otherwise. `parent` is the parent state and its partition. If the
    /// partition is the same, only facts that the parent state lacks are checked.
    pub(crate) fn evaluate(
        &mut self,
        state: &State,
        partition: u32,
        parent: Option<(&State, u32)>,
    ) -> u32 {
        let (table, is_new) = self.table(partition);
        self.facts.clear();
        self.facts.extend(true_facts(state, self.fact_count).map(|fact| fact.0));
        let same = parent.filter(|(_, other)| *other == partition && !is_new);
        self.changed.clear();
        match same {
            None => self.changed.extend_from_slice(&self.facts),
            Some((before, _)) => {
                let is_changed = |fact: &&u32| !is_true(before, crate::task::FactId(**fact));
                self.changed.extend(self.facts.iter().filter(is_changed));
            }
        }
        let Novelty { tables, facts, changed, fact_count, with_pairs, .. } = self;
        let table = &mut tables[table];
        let mut novelty = NOT_NOVEL;
        for &fact in changed.iter() {
            if set(&mut table.single, fact as usize) {
                novelty = 1;
            }
        }
        if *with_pairs {
            for &fact in changed.iter() {
                for &other in facts.iter() {
                    let (low, high) = (fact.min(other) as usize, fact.max(other) as usize);
                    if low != high && set(&mut table.pairs, low * *fact_count + high) {
                        novelty = novelty.min(2);
                    }
                }
            }
        }
        novelty
    }

    /// Returns the index of the table of a partition, and whether this call created the table.
    fn table(&mut self, partition: u32) -> (usize, bool) {
        if let Some(&table) = self.of_partition.get(&partition) {
            return (table, false);
        }
        let pairs = if self.with_pairs { self.fact_count * self.fact_count } else { 0 };
        let size = (self.fact_count.div_ceil(64) + pairs.div_ceil(64)) * size_of::<u64>();
        let is_new = self.tables.is_empty() || self.bytes + size <= BYTES_MAX;
        if is_new {
            self.bytes += size;
            self.tables.push(NoveltyTable {
                single: vec![0; self.fact_count.div_ceil(64)],
                pairs: vec![0; pairs.div_ceil(64)],
            });
        }
        let table = self.tables.len() - 1;
        self.of_partition.insert(partition, table);
        (table, is_new)
    }

    /// Returns the number of bytes of the tables.
    pub(crate) fn bytes(&self) -> usize {
        self.bytes
    }
}

/// Sets the bit at `index`. Returns whether it was zero before.
fn set(bits: &mut [u64], index: usize) -> bool {
    let (word, bit) = (&mut bits[index / 64], 1 << (index % 64));
    let is_new = *word & bit == 0;
    *word |= bit;
    is_new
}
