//! Sets of objects that variables may be bound to. Equal sets are stored once.

use rustc_hash::FxHashMap;

use crate::normalize::lifted::{Lifted, TypeIndex, TypeSet};

/// Store of object sets: first the sets of all types, with their type numbers, then the smaller
/// sets that result from narrowing by static facts.
#[derive(Debug)]
pub(super) struct ObjectSets {
    sets: Vec<TypeSet>,
    known: FxHashMap<Vec<u64>, TypeIndex>,
}

// === impl ObjectSets ===

impl ObjectSets {
    pub(super) fn new(lifted: &Lifted) -> ObjectSets {
        ObjectSets::of(lifted.types.clone())
    }

    /// Creates a store with these sets, numbered in the given order.
    pub(super) fn of(sets: Vec<TypeSet>) -> ObjectSets {
        let known = sets.iter().enumerate().map(|(index, set)| (set.bits().to_vec(), index));
        ObjectSets { known: known.collect(), sets }
    }

    #[inline]
    pub(super) fn get(&self, index: TypeIndex) -> &TypeSet {
        &self.sets[index]
    }

    /// Returns the number of the set with these bits, which is added if it is new.
    pub(super) fn intern(&mut self, bits: Vec<u64>) -> TypeIndex {
        if let Some(&known) = self.known.get(&bits) {
            return known;
        }
        self.sets.push(TypeSet::from_bits(bits.clone()));
        self.known.insert(bits, self.sets.len() - 1);
        self.sets.len() - 1
    }

    /// Returns the number of the intersection of two sets, which is added if it is new.
    pub(super) fn both(&mut self, left: TypeIndex, right: TypeIndex) -> TypeIndex {
        let (left, right) = (self.get(left).bits(), self.get(right).bits());
        let bits = left.iter().zip(right).map(|(left, right)| left & right).collect();
        self.intern(bits)
    }
}
