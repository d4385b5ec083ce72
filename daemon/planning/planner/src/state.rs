//! States, stored as packed bits and numbers in one arena.
//!
//! A state is a sequence of words: one bit per fact, then one word per numeric fluent. Comparisons
//! and derived facts follow from the basic facts and the numbers. They are also stored, so that
//! they are computed only once.

use crate::arena;
use crate::id_table::{IdTable, hash_words};
use crate::task::{FactId, Literal, OperatorId};

/// Index of a state in its [`StateSpace`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct StateId(pub(crate) u32);

/// The words of one state: the bits of its facts, then its numbers.
pub(crate) type State = [u64];

/// All states that a search has generated. Each is stored once, with the transition to it.
#[derive(Debug)]
pub(crate) struct StateSpace {
    width: usize,
    words: Vec<u64>,
    ids: IdTable,
    ways: Vec<Transition>,
}

/// The transition to a state: the state before it, and the operator. The values of the initial
/// state have no meaning.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Transition {
    pub(crate) parent: StateId,
    pub(crate) operator: OperatorId,
}

/// Whether a fact is true in a state.
pub(crate) fn is_true(state: &State, fact: FactId) -> bool {
    state[fact.index() / 64] >> (fact.index() % 64) & 1 == 1
}

/// Whether a literal holds in a state.
pub(crate) fn holds(state: &State, literal: Literal) -> bool {
    is_true(state, literal.fact()) == literal.is_positive()
}

/// Whether all literals hold in a state.
pub(crate) fn all_hold(state: &State, literals: &[Literal]) -> bool {
    literals.iter().all(|literal| holds(state, *literal))
}

/// Iterates over the true facts of a state, in ascending order.
pub(crate) fn true_facts(state: &State, fact_count: usize) -> impl Iterator<Item = FactId> + '_ {
    let words = state[..fact_count.div_ceil(64)].iter().enumerate();
    words.flat_map(|(index, word)| {
        let mut rest = *word;
        std::iter::from_fn(move || {
            if rest == 0 {
                return None;
            }
            let bit = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            Some(FactId::from_index(index * 64 + bit))
        })
    })
}

pub(crate) fn set(state: &mut State, fact: FactId, truth: bool) {
    let (word, bit) = (&mut state[fact.index() / 64], 1 << (fact.index() % 64));
    if truth { *word |= bit } else { *word &= !bit }
}

// === impl StateSpace ===

impl StateSpace {
    /// Creates a space that contains the initial state only.
    pub(crate) fn new(initial: &State) -> StateSpace {
        let mut space = StateSpace {
            width: initial.len(),
            words: Vec::new(),
            ids: IdTable::default(),
            ways: Vec::new(),
        };
        space.insert(initial, StateId(0), OperatorId(0));
        space
    }

    /// Returns the number of states.
    pub(crate) fn len(&self) -> usize {
        self.ways.len()
    }

    pub(crate) fn state(&self, id: StateId) -> &State {
        let start = id.0 as usize * self.width;
        &self.words[start..start + self.width]
    }

    /// Inserts a state unless the space contains it. Returns the id of the state, and whether it is
    /// new.
    pub(crate) fn insert(
        &mut self,
        state: &State,
        parent: StateId,
        operator: OperatorId,
    ) -> (StateId, bool) {
        let hash = hash_words(state.iter().copied());
        let found = self.ids.find(hash, |id| self.state(StateId(id)) == state);
        if let Some(id) = found {
            return (StateId(id), false);
        }
        let id = self.ways.len() as u32;
        let StateSpace { width, words, ids, ways } = self;
        ids.insert(hash, id, |id| {
            let start = id as usize * *width;
            hash_words(words[start..start + *width].iter().copied())
        });
        arena::make_room(words, *width);
        arena::make_room(ways, 1);
        words.extend_from_slice(state);
        ways.push(Transition { parent, operator });
        (StateId(id), true)
    }

    /// Replaces the transition to a state.
    pub(crate) fn reparent(&mut self, id: StateId, parent: StateId, operator: OperatorId) {
        self.ways[id.0 as usize] = Transition { parent, operator };
    }

    /// Returns the transition to a state; `None` for the initial state.
    pub(crate) fn transition(&self, id: StateId) -> Option<Transition> {
        (id.0 != 0).then(|| self.ways[id.0 as usize])
    }

    /// Returns the operators of the path from the initial state to this state.
    pub(crate) fn path(&self, mut id: StateId) -> Vec<OperatorId> {
        let mut path = Vec::new();
        while id.0 != 0 {
            let node = self.ways[id.0 as usize];
            path.push(node.operator);
            id = node.parent;
        }
        path.reverse();
        path
    }

    /// Returns the number of bytes of the space, including the growth that the next state may
    /// cause.
    pub(crate) fn bytes(&self) -> usize {
        arena::bytes(&self.words, self.width) + arena::bytes(&self.ways, 1) + self.ids.bytes()
    }
}

// === impl Progression ===
