//! A queue for Dijkstra's algorithm over costs that are mostly small.
//!
//! Small costs have a bucket each, large ones share a heap. Costs never fall below the last one
//! taken out.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Costs below this have buckets: relaxed plans of a hundred thousand steps are rare.
const BUCKETS_MAX: u64 = 100_000;

#[derive(Debug, Default)]
pub(super) struct CostQueue {
    buckets: Vec<Vec<u32>>,
    current: usize,
    large: BinaryHeap<Reverse<(u64, u32)>>,
}

// === impl CostQueue ===

impl CostQueue {
    pub(super) fn clear(&mut self) {
        self.buckets.iter_mut().for_each(Vec::clear);
        self.current = 0;
        self.large.clear();
    }

    pub(super) fn push(&mut self, cost: u64, item: u32) {
        if cost >= BUCKETS_MAX {
            self.large.push(Reverse((cost, item)));
            return;
        }
        let bucket = cost as usize;
        if bucket >= self.buckets.len() {
            self.buckets.resize_with(bucket + 1, Vec::new);
        }
        self.buckets[bucket].push(item);
    }

    pub(super) fn pop(&mut self) -> Option<(u64, u32)> {
        while let Some(bucket) = self.buckets.get_mut(self.current) {
            if let Some(item) = bucket.pop() {
                return Some((self.current as u64, item));
            }
            self.current += 1;
        }
        self.large.pop().map(|Reverse(entry)| entry)
    }
}
