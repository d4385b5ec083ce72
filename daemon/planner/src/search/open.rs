//! Open lists: what to look at next.

use std::collections::VecDeque;

use crate::state::StateId;
use crate::task::OperatorId;

/// An operator to be applied in a state.
pub(super) type Entry = (StateId, OperatorId);

/// Entries by estimate, first in, first out among equals.
#[derive(Debug, Default)]
pub(super) struct BucketQueue {
    buckets: Vec<VecDeque<Entry>>,
    lowest: usize,
    count: usize,
}

/// Takes turns between a queue of all entries and one of preferred entries only.
#[derive(Debug, Default)]
pub(super) struct Alternation {
    /// All entries, then the preferred ones.
    queues: [BucketQueue; 2],
    /// How often each had its turn; the one that had fewer is next.
    turns: [i64; 2],
}

/// Estimates beyond this share a bucket.
const BUCKETS_MAX: usize = 1 << 20;

/// Turns that preferred entries get in advance for each progress.
const BOOST: i64 = 1_000;

// === impl BucketQueue ===

impl BucketQueue {
    fn push(&mut self, estimate: u64, entry: Entry) {
        let bucket = usize::try_from(estimate).unwrap_or(usize::MAX).min(BUCKETS_MAX);
        if bucket >= self.buckets.len() {
            self.buckets.resize_with(bucket + 1, VecDeque::new);
        }
        self.buckets[bucket].push_back(entry);
        self.lowest = self.lowest.min(bucket);
        self.count += 1;
    }

    fn pop(&mut self) -> Option<Entry> {
        while let Some(bucket) = self.buckets.get_mut(self.lowest) {
            if let Some(entry) = bucket.pop_front() {
                self.count -= 1;
                return Some(entry);
            }
            self.lowest += 1;
        }
        None
    }
}

// === impl Alternation ===

impl Alternation {
    pub(super) fn push(&mut self, estimate: u64, entry: Entry, preferred: bool) {
        self.queues[0].push(estimate, entry);
        if preferred {
            self.queues[1].push(estimate, entry);
        }
    }

    pub(super) fn pop(&mut self) -> Option<Entry> {
        let preferred_first = self.turns[1] < self.turns[0];
        let order = if preferred_first { [1, 0] } else { [0, 1] };
        for queue in order {
            if let Some(entry) = self.queues[queue].pop() {
                self.turns[queue] += 1;
                return Some(entry);
            }
        }
        None
    }

    /// Lets preferred entries go first for a while.
    pub(super) fn boost(&mut self) {
        self.turns[1] -= BOOST;
    }

    /// Bytes taken.
    pub(super) fn bytes(&self) -> usize {
        self.queues.iter().map(|queue| queue.count * size_of::<Entry>()).sum()
    }
}
