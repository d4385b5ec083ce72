//! Candidates for lifted invariants, and their refinement.

use rustc_hash::FxHashSet;

use crate::task::{Atoms, FactId, ObjectId};

/// A candidate for a lifted invariant: several atoms with common parameters. The candidate claims
/// that, for each choice of objects for the parameters, at most one of the matching facts is true.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct InvariantCandidate {
    /// Atoms of the candidate, sorted; at most one per predicate.
    pub(super) parts: Vec<InvariantAtom>,
}

/// An atom of a candidate invariant. Its arguments are the parameters in some order, and at most
/// one counted argument, which may be any object.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct InvariantAtom {
    pub(super) predicate: u32,
    /// Per parameter: the position of its argument.
    places: Vec<usize>,
}

// === impl InvariantCandidate ===

impl InvariantCandidate {
    /// Returns the initial candidates for one predicate: one without a counted argument, and one
    /// for each argument as the counted argument.
    pub(super) fn seeds(predicate: u32, arity: usize) -> impl Iterator<Item = InvariantCandidate> {
        (0..=arity).map(move |counted| {
            let places = (0..arity).filter(|place| *place != counted).collect();
            InvariantCandidate { parts: vec![InvariantAtom { predicate, places }] }
        })
    }

    /// Returns the objects of the parameters in the instance that contains `fact`; empty if the
    /// candidate has no atom for the fact.
    pub(super) fn key(&self, atoms: &Atoms, fact: FactId) -> Vec<ObjectId> {
        let (predicate, arguments) = atoms.get(fact);
        let part = self.parts.iter().find(|part| part.predicate == predicate);
        part.map_or_else(Vec::new, |part| part.key(arguments))
    }

    /// Adds refined candidates to `refined`. Each has one more atom, so that its instance with the
    /// parameters `key` also contains `fact`.
    pub(super) fn refinements(
        &self,
        atoms: &Atoms,
        key: &[ObjectId],
        fact: FactId,
        refined: &mut FxHashSet<InvariantCandidate>,
    ) {
        let (predicate, arguments) = atoms.get(fact);
        let is_known = self.parts.iter().any(|part| part.predicate == predicate);
        // At most one argument may be counted.
        if is_known || arguments.len() < key.len() || arguments.len() > key.len() + 1 {
            return;
        }
        let mut all = vec![Vec::new()];
        for object in key {
            let mut longer = Vec::new();
            for places in &all {
                for place in (0..arguments.len()).filter(|place| arguments[*place] == *object) {
                    if !places.contains(&place) {
                        longer.push([places.as_slice(), &[place]].concat());
                    }
                }
            }
            all = longer;
        }
        for places in all {
            let mut parts = self.parts.clone();
            parts.push(InvariantAtom { predicate, places });
            parts.sort_unstable();
            refined.insert(InvariantCandidate { parts });
        }
    }
}

// === impl InvariantAtom ===

impl InvariantAtom {
    /// Returns the objects of the parameters from all arguments of a fact that matches the atom.
    pub(super) fn key(&self, arguments: &[ObjectId]) -> Vec<ObjectId> {
        self.places.iter().map(|place| arguments[*place]).collect()
    }
}
