//! Open lists: sorted queues of states to expand.
//!
//! With deferred evaluation, all successors of a state have the same key, so a list stores the
//! state instead of its successors. The operators of a state are computed when it is removed from
//! the list, and again after a better state was expanded in between.

use std::collections::{BTreeMap, VecDeque};

use crate::state::StateId;
use crate::task::OperatorId;

/// Entry of an open list: the state to expand, and the operator to apply in it.
pub(super) type OpenEntry = (StateId, OperatorId);

/// Sort key of a state in an open list. Keys are compared by their first number, then by the
/// second, then by the third; the lowest key comes first. Lists that need fewer numbers set the
/// others to zero.
pub(super) type SortKey = (u64, u32, u64);

/// A state in an open list, with the number of its operators that the list has returned so far.
#[derive(Clone, Copy, Debug)]
struct QueuedState {
    state: StateId,
    done: u32,
}

/// An open list: states sorted by key. States with equal keys have the order of their addition.
#[derive(Debug, Default)]
pub(super) struct OpenList {
    buckets: BTreeMap<SortKey, VecDeque<QueuedState>>,
    count: usize,
    /// Sum of the capacities of the buckets.
    room: usize,
    current: Option<Current>,
    /// Operators of the state that is being expanded.
    operators: Vec<OperatorId>,
}

/// The state of an open list that is being expanded. Its operators are returned one by one.
#[derive(Clone, Copy, Debug)]
struct Current {
    key: SortKey,
    waiting: QueuedState,
}

// === impl OpenList ===

impl OpenList {
    pub(super) fn push(&mut self, key: SortKey, state: StateId) {
        self.add(key, |bucket| bucket.push_back(QueuedState { state, done: 0 }));
    }

    /// Returns the next operator of the best state; `None` if the list is empty. `operators`
    /// computes the operators of a state, and must return the same operators each time.
    pub(super) fn pop(
        &mut self,
        mut operators: impl FnMut(StateId, &mut Vec<OperatorId>),
    ) -> Option<OpenEntry> {
        self.requeue_current();
        loop {
            if self.current.is_none() {
                self.current = Some(self.take()?);
                self.operators.clear();
                if let Some(Current { waiting, .. }) = self.current {
                    operators(waiting.state, &mut self.operators);
                }
            }
            if let Some(Current { waiting, .. }) = &mut self.current {
                if let Some(operator) = self.operators.get(waiting.done as usize) {
                    waiting.done += 1;
                    return Some((waiting.state, *operator));
                }
                self.current = None;
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0 && self.current.is_none()
    }

    /// Moves the state that is being expanded back to the front of its bucket, if a better state
    /// was added.
    fn requeue_current(&mut self) {
        let Some(Current { key, waiting }) = self.current else { return };
        let best = self.buckets.first_key_value().map(|(key, _)| *key);
        if best.is_some_and(|best| best < key) {
            self.add(key, |bucket| bucket.push_front(waiting));
            self.current = None;
        }
    }

    /// Adds one state to the bucket of `key` by `push`.
    fn add(&mut self, key: SortKey, push: impl FnOnce(&mut VecDeque<QueuedState>)) {
        let bucket = self.buckets.entry(key).or_default();
        self.room -= bucket.capacity();
        push(bucket);
        self.room += bucket.capacity();
        self.count += 1;
    }

    fn take(&mut self) -> Option<Current> {
        let mut first = self.buckets.first_entry()?;
        let key = *first.key();
        let bucket = first.get_mut();
        self.room -= bucket.capacity();
        let waiting = bucket.pop_front();
        if bucket.is_empty() {
            first.remove();
        } else {
            // A queue does not give the room of removed states back by itself.
            if bucket.len() < bucket.capacity() / 4 {
                bucket.shrink_to(bucket.len() * 2);
            }
            self.room += bucket.capacity();
        }
        self.count -= 1;
        waiting.map(|waiting| Current { key, waiting })
    }

    /// Returns the number of bytes of the list.
    pub(super) fn bytes(&self) -> usize {
        // A node of the tree may have twice the room that it needs.
        let per_bucket = 2 * size_of::<(SortKey, VecDeque<QueuedState>)>();
        self.room * size_of::<QueuedState>()
            + self.buckets.len() * per_bucket
            + self.operators.capacity() * size_of::<OperatorId>()
    }
}
