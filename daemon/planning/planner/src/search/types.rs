//! Type-based exploration: states are grouped by type. A random type is drawn first, and then a
//! random state of this type (Xie, Müller, Holte and Imai, 2014). All parts of the known state
//! space are explored, even if the heuristics mislead.

use rustc_hash::FxHashMap;

use super::open::OpenEntry;
use crate::state::StateId;
use crate::task::OperatorId;

/// States grouped by type. The type of a state is the pair of its heuristic estimate and the weight
/// of its path.
#[derive(Debug)]
pub(super) struct TypeList {
    of_type: FxHashMap<(u32, u32), usize>,
    /// Per type: its states. Each entry is the state and the number of its operators that have been
    /// returned.
    types: Vec<Vec<(StateId, u32)>>,
    /// Types with at least one state.
    open: Vec<usize>,
    count: usize,
    random: u64,
    operators: Vec<OperatorId>,
}

impl Default for TypeList {
    fn default() -> TypeList {
        TypeList {
            of_type: FxHashMap::default(),
            types: Vec::new(),
            open: Vec::new(),
            count: 0,
            // The seed is any constant number except zero, so that the same plan is found in every
            // run.
            random: 0x9E37_79B9_7F4A_7C15,
            operators: Vec::new(),
        }
    }
}

// === impl TypeList ===

impl TypeList {
    pub(super) fn push(&mut self, kind: (u32, u32), state: StateId) {
        let next = self.types.len();
        let index = *self.of_type.entry(kind).or_insert(next);
        if index == next {
            self.types.push(Vec::new());
        }
        if self.types[index].is_empty() {
            self.open.push(index);
        }
        self.types[index].push((state, 0));
        self.count += 1;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.open.is_empty()
    }

    /// Returns the next operator of a random state of a random type; `None` if no state is left.
    pub(super) fn pop(
        &mut self,
        mut operators: impl FnMut(StateId, &mut Vec<OperatorId>),
    ) -> Option<OpenEntry> {
        while !self.open.is_empty() {
            let place = self.draw(self.open.len());
            let index = self.open[place];
            let position = self.draw(self.types[index].len());
            let (state, done) = &mut self.types[index][position];
            let state = *state;
            self.operators.clear();
            operators(state, &mut self.operators);
            let entry = self.operators.get(*done as usize).map(|operator| (state, *operator));
            *done += 1;
            if *done as usize >= self.operators.len() {
                self.types[index].swap_remove(position);
                self.count -= 1;
                if self.types[index].is_empty() {
                    self.open.swap_remove(place);
                }
            }
            if entry.is_some() {
                return entry;
            }
        }
        None
    }

    /// Returns the number of bytes of the list.
    pub(super) fn bytes(&self) -> usize {
        self.count * size_of::<(StateId, u32)>() + self.types.len() * 64
    }

    /// Returns a pseudo-random number below `end`, by Marsaglia's xorshift (2003).
    fn draw(&mut self, end: usize) -> usize {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random % end.max(1) as u64) as usize
    }
}
