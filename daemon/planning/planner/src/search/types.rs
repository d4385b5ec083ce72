//! Type-based exploration: states are grouped by type. A random type is drawn first, and then a
//! random state of this type (Xie, Müller, Holte and Imai, 2014). All parts of the known state
//! space are explored, even if the heuristics mislead.

use rustc_hash::FxHashMap;

use super::open::OpenEntry;
use crate::state::StateId;
use crate::task::OperatorId;

/// Maximum number of operators that are kept, for 16 MiB. Beyond it the operators of a state are
/// computed each time that the state is drawn.
const KEPT_MAX: usize = 4 << 20;

/// States grouped by type. The type of a state is the pair of its heuristic estimate and the weight
/// of its path.
#[derive(Debug)]
pub(super) struct TypeList {
    of_type: FxHashMap<(u64, u64), usize>,
    /// Per type: its states. Each entry is the state and the number of its operators that have been
    /// returned.
    types: Vec<Vec<(StateId, u32)>>,
    /// Types with at least one state.
    open: Vec<usize>,
    /// Sum of the capacities of the lists in `types`.
    room: usize,
    random: u64,
    /// The operators of states that were drawn and have some left.
    kept: FxHashMap<StateId, Box<[OperatorId]>>,
    kept_count: usize,
    /// Scratch space for the operators of one state.
    applicable: Vec<OperatorId>,
}

impl Default for TypeList {
    fn default() -> TypeList {
        TypeList {
            of_type: FxHashMap::default(),
            types: Vec::new(),
            open: Vec::new(),
            room: 0,
            // The seed is any constant number except zero, so that the same plan is found in every
            // run.
            random: 0x9E37_79B9_7F4A_7C15,
            kept: FxHashMap::default(),
            kept_count: 0,
            applicable: Vec::new(),
        }
    }
}

// === impl TypeList ===

impl TypeList {
    pub(super) fn push(&mut self, kind: (u64, u64), state: StateId) {
        let next = self.types.len();
        let index = *self.of_type.entry(kind).or_insert(next);
        if index == next {
            self.types.push(Vec::new());
        }
        if self.types[index].is_empty() {
            self.open.push(index);
        }
        let states = &mut self.types[index];
        self.room -= states.capacity();
        states.push((state, 0));
        self.room += states.capacity();
    }

    pub(super) fn is_empty(&self) -> bool {
        self.open.is_empty()
    }

    /// Returns the next operator of a random state of a random type; `None` if no state is left.
    /// `operators` computes the operators of a state, and must return the same ones each time.
    pub(super) fn pop(
        &mut self,
        mut operators: impl FnMut(StateId, &mut Vec<OperatorId>),
    ) -> Option<OpenEntry> {
        while !self.open.is_empty() {
            let place = self.draw(self.open.len());
            let index = self.open[place];
            let position = self.draw(self.types[index].len());
            let (state, done) = self.types[index][position];
            self.applicable.clear();
            match self.kept.get(&state) {
                Some(kept) => self.applicable.extend_from_slice(kept),
                None => operators(state, &mut self.applicable),
            }
            let all = self.applicable.len();
            if done as usize + 1 < all {
                self.types[index][position].1 = done + 1;
                self.keep(state);
            } else {
                self.kept_count -= self.kept.remove(&state).map_or(0, |kept| kept.len());
                self.remove(place, index, position);
            }
            if let Some(operator) = self.applicable.get(done as usize) {
                return Some((state, *operator));
            }
        }
        None
    }

    /// Keeps the operators of a state for its next draw, if there is room.
    fn keep(&mut self, state: StateId) {
        let count = self.applicable.len();
        if self.kept_count + count <= KEPT_MAX && !self.kept.contains_key(&state) {
            self.kept.insert(state, self.applicable.as_slice().into());
            self.kept_count += count;
        }
    }

    /// Removes a state without operators left, and gives the room of many removed states back.
    fn remove(&mut self, place: usize, index: usize, position: usize) {
        let states = &mut self.types[index];
        self.room -= states.capacity();
        states.swap_remove(position);
        if states.len() < states.capacity() / 4 {
            states.shrink_to(states.len() * 2);
        }
        self.room += states.capacity();
        if states.is_empty() {
            self.open.swap_remove(place);
        }
    }

    /// Returns the number of bytes of the list.
    pub(super) fn bytes(&self) -> usize {
        let per_type = size_of::<Vec<(StateId, u32)>>() + 2 * size_of::<((u64, u64), usize)>();
        let per_kept = 2 * size_of::<(StateId, Box<[OperatorId]>)>();
        self.room * size_of::<(StateId, u32)>()
            + self.types.len() * per_type
            + self.kept.len() * per_kept
            + self.kept_count * size_of::<OperatorId>()
    }

    /// Returns a pseudo-random number below `end`, by Marsaglia's xorshift (2003).
    fn draw(&mut self, end: usize) -> usize {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random % end.max(1) as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_operators_of_all_states_come_once_and_each_state_is_asked_once() {
        let mut list = TypeList::default();
        let kinds = [(3, 0), (3, 0), (3, 1), (2, 1), (2, 1)];
        for (kind, index) in kinds.into_iter().zip(0..) {
            list.push(kind, StateId(index));
        }
        // The state with the number zero has no operators.
        let mut asked = Vec::new();
        let mut returned = Vec::new();
        while let Some((state, operator)) = list.pop(|state, found| {
            asked.push(state.0);
            found.extend((0..2 * state.0).map(|one| OperatorId(10 * state.0 + one)));
        }) {
            returned.push((state.0, operator.0));
        }
        assert!(list.is_empty());
        asked.sort_unstable();
        returned.sort_unstable();
        assert_eq!(asked, [0, 1, 2, 3, 4]);
        let all =
            (0..5u32).flat_map(|state| (0..2 * state).map(move |one| (state, 10 * state + one)));
        assert_eq!(returned, all.collect::<Vec<_>>());
    }
}
