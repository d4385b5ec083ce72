//! The preferred operators of the states of a search.

use crate::arena;
use crate::state::StateId;
use crate::task::OperatorId;

/// Preferred operators of every evaluated state.
#[derive(Debug, Default)]
pub(super) struct Preferred {
    /// Per state: where its operators begin in `operators`, where those of the relaxed plan before
    /// deficits were covered end, and where all end.
    ranges: Vec<(u32, u32, u32)>,
    operators: Vec<OperatorId>,
}

// === impl Preferred ===

impl Preferred {
    /// Stores the preferred operators of a state. The first `plain_count` are those of its
    /// relaxed plan before deficits were covered.
    pub(super) fn set(&mut self, state: StateId, operators: &[OperatorId], plain_count: usize) {
        let start = self.operators.len();
        arena::make_room(&mut self.operators, operators.len());
        self.operators.extend_from_slice(operators);
        let index = state.0 as usize;
        if index >= self.ranges.len() {
            let more = index + 1 - self.ranges.len();
            arena::make_room(&mut self.ranges, more);
            self.ranges.resize(index + 1, (0, 0, 0));
        }
        let ends = (start + plain_count, self.operators.len());
        self.ranges[index] = (start as u32, ends.0 as u32, ends.1 as u32);
    }

    /// Returns those of the relaxed plan before deficits were covered.
    pub(super) fn plain(&self, state: StateId) -> &[OperatorId] {
        let (start, end, _) = self.ranges[state.0 as usize];
        &self.operators[start as usize..end as usize]
    }

    /// Returns all preferred operators of a state.
    pub(super) fn all(&self, state: StateId) -> &[OperatorId] {
        let (start, _, end) = self.ranges[state.0 as usize];
        &self.operators[start as usize..end as usize]
    }

    /// Returns the number of bytes, including the growth that the next state may cause.
    pub(super) fn bytes(&self) -> usize {
        arena::bytes(&self.ranges, 1) + arena::bytes(&self.operators, 1)
    }
}
