//! A priority queue for Dijkstra's algorithm with mostly small costs.
//!
//! Each small cost has a bucket; large costs share a heap. A pushed cost must not be smaller than
//! the last popped cost. After `pop` has returned `None`, the queue must be cleared before the next
//! push.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Number of costs with a bucket of their own. Relaxed plans of a hundred thousand steps are rare.
const BUCKETS_MAX: u64 = 100_000;

/// Value used instead of [`BUCKETS_MAX`] for tasks with mostly great costs, because creating and
/// scanning many empty buckets takes time.
const BUCKETS_WHERE_COSTS_ARE_GREAT_MAX: u64 = 1_000;

#[derive(Debug)]
pub(super) struct CostQueue {
    buckets_max: u64,
    buckets: Vec<Vec<u32>>,
    current: usize,
    /// Number of buckets up to the highest filled one since the queue was last cleared.
    filled: usize,
    large: BinaryHeap<Reverse<(u64, u32)>>,
}

impl Default for CostQueue {
    fn default() -> CostQueue {
        CostQueue {
            buckets_max: BUCKETS_MAX,
            buckets: Vec::new(),
            current: 0,
            filled: 0,
            large: BinaryHeap::new(),
        }
    }
}

// === impl CostQueue ===

impl CostQueue {
    /// Creates a queue for mostly great costs.
    pub(super) fn of_great_costs() -> CostQueue {
        CostQueue { buckets_max: BUCKETS_WHERE_COSTS_ARE_GREAT_MAX, ..CostQueue::default() }
    }

    pub(super) fn clear(&mut self) {
        // Buckets below `current` are already empty.
        for bucket in self.buckets.iter_mut().take(self.filled).skip(self.current) {
            bucket.clear();
        }
        (self.current, self.filled) = (0, 0);
        self.large.clear();
    }

    #[inline]
    pub(super) fn push(&mut self, cost: u64, item: u32) {
        if cost >= self.buckets_max {
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Items are popped by ascending cost. Of items with equal costs, the last pushed one is
        /// popped first. This also holds after a non-empty queue was cleared.
        #[test]
        fn items_of_equal_cost_are_popped_last_in_first_out(
            rounds in prop::collection::vec(
                prop::collection::vec((prop::option::weighted(0.6, 0..1_500_u64), 0..9_u32), 0..60),
                1..4,
            )
        ) {
            let mut queue = CostQueue::default();
            for round in rounds {
                queue.clear();
                let (mut stacks, mut last) = (BTreeMap::<u64, Vec<u32>>::new(), 0);
                for (raise, item) in round {
                    if let Some(raise) = raise {
                        queue.push(last + raise, item);
                        stacks.entry(last + raise).or_default().push(item);
                        continue;
                    }
                    let expected = stacks.first_entry().map(|mut lowest| {
                        let item = lowest.get_mut().pop().expect("never empty");
                        let cost = *lowest.key();
                        if lowest.get().is_empty() {
                            lowest.remove();
                        }
                        (cost, item)
                    });
                    prop_assert_eq!(queue.pop(), expected);
                    let Some((cost, _)) = expected else { break };
                    last = cost;
                }
            }
        }
    }

    #[test]
    fn large_costs_are_popped_after_small_ones() {
        for (mut queue, max) in [
            (CostQueue::default(), BUCKETS_MAX),
            (CostQueue::of_great_costs(), BUCKETS_WHERE_COSTS_ARE_GREAT_MAX),
        ] {
            for cost in [max + 5, 7, max, max - 1] {
                queue.push(cost, 1);
            }
            let costs = std::iter::from_fn(|| queue.pop()).map(|(cost, _)| cost);
            assert_eq!(costs.collect::<Vec<_>>(), [7, max - 1, max, max + 5]);
        }
    }
}
