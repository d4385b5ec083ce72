//! Open lists: what to look at next.
//!
//! With deferred evaluation all successors of a state wait under the same key, so a list holds
//! states, not successors. Which operators a state offers is asked when its turn comes, and asked
//! again should something better have come between.

use std::collections::{BTreeMap, VecDeque};

use crate::state::StateId;
use crate::task::OperatorId;

/// An operator to be applied in a state.
pub(super) type Entry = (StateId, OperatorId);

/// The keys by which a list is sorted, the lowest first.
pub(super) type Key = (u32, u32, u32);

/// A state, and how many of its operators had their turn.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    state: StateId,
    done: u32,
}

/// States by key, first in, first out among equals.
#[derive(Debug, Default)]
pub(super) struct OpenList {
    buckets: BTreeMap<Key, VecDeque<Waiting>>,
    count: usize,
    current: Option<Current>,
    /// The operators of the current state.
    operators: Vec<OperatorId>,
}

/// The state whose operators are having their turn.
#[derive(Clone, Copy, Debug)]
struct Current {
    key: Key,
    waiting: Waiting,
}

// === impl OpenList ===

impl OpenList {
    pub(super) fn push(&mut self, key: Key, state: StateId) {
        self.buckets.entry(key).or_default().push_back(Waiting { state, done: 0 });
        self.count += 1;
    }

    /// The next operator of the best state; `operators` tells which ones a state offers, the same
    /// ones whenever it is asked.
    pub(super) fn pop(
        &mut self,
        mut operators: impl FnMut(StateId, &mut Vec<OperatorId>),
    ) -> Option<Entry> {
        self.give_way();
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

    /// Puts the current state back in front where a better one has come.
    fn give_way(&mut self) {
        let Some(Current { key, waiting }) = self.current else { return };
        let best = self.buckets.first_key_value().map(|(key, _)| *key);
        if best.is_some_and(|best| best < key) {
            self.buckets.entry(key).or_default().push_front(waiting);
            self.count += 1;
            self.current = None;
        }
    }

    fn take(&mut self) -> Option<Current> {
        let mut first = self.buckets.first_entry()?;
        let key = *first.key();
        let waiting = first.get_mut().pop_front();
        if first.get().is_empty() {
            first.remove();
        }
        self.count -= 1;
        waiting.map(|waiting| Current { key, waiting })
    }

    /// Bytes taken.
    pub(super) fn bytes(&self) -> usize {
        self.count * size_of::<Waiting>() + self.operators.len() * size_of::<OperatorId>()
    }
}
