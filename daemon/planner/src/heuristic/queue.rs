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
    /// One past the highest bucket that was filled since the queue was cleared.
    filled: usize,
    large: BinaryHeap<Reverse<(u64, u32)>>,
}

// === impl CostQueue ===

impl CostQueue {
    pub(super) fn clear(&mut self) {
        // What lies below was taken out.
        for bucket in self.buckets.iter_mut().take(self.filled).skip(self.current) {
            bucket.clear();
        }
        (self.current, self.filled) = (0, 0);
        self.large.clear();
    }

    #[inline]
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
        self.filled = self.filled.max(bucket + 1);
    }

    #[inline]
    pub(super) fn pop(&mut self) -> Option<(u64, u32)> {
        while self.current < self.filled {
            if let Some(item) = self.buckets[self.current].pop() {
                return Some((self.current as u64, item));
            }
            self.current += 1;
        }
        self.large.pop().map(|Reverse(entry)| entry)
    }
}
