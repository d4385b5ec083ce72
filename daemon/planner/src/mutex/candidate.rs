//! Candidates for invariants, and how one grows into another.

use rustc_hash::FxHashSet;

use crate::task::{Atoms, FactId, ObjectId};

/// Atoms that share parameters: of all facts that agree on the parameters at most one may be true.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Candidate {
    /// Sorted; at most one of each predicate.
    pub(super) parts: Vec<Part>,
}

/// An atom whose arguments are the parameters, in some order, and perhaps one more.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Part {
    pub(super) predicate: u32,
    /// For each parameter, where it stands.
    places: Vec<usize>,
}

// === impl Candidate ===

impl Candidate {
    /// The candidates of one predicate alone: nothing is counted, or one argument.
    pub(super) fn seeds(predicate: u32, arity: usize) -> impl Iterator<Item = Candidate> {
        (0..=arity).map(move |counted| {
            let places = (0..arity).filter(|place| *place != counted).collect();
            Candidate { parts: vec![Part { predicate, places }] }
        })
    }

    /// The parameters of the instance that a fact belongs to.
    pub(super) fn key(&self, atoms: &Atoms, fact: FactId) -> Vec<ObjectId> {
        let (predicate, arguments) = atoms.get(fact);
        let part = self.parts.iter().find(|part| part.predicate == predicate);
        part.map_or_else(Vec::new, |part| part.key(arguments))
    }

    /// The candidates that cover `fact` as well, in the instance with the parameters `key`.
    pub(super) fn refinements(
        &self,
        atoms: &Atoms,
        key: &[ObjectId],
        fact: FactId,
        refined: &mut FxHashSet<Candidate>,
    ) {
        let (predicate, arguments) = atoms.get(fact);
        let is_known = self.parts.iter().any(|part| part.predicate == predicate);
        // One argument may be counted, no more.
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
            parts.push(Part { predicate, places });
            parts.sort_unstable();
            refined.insert(Candidate { parts });
        }
    }
}

// === impl Part ===

impl Part {
    /// The parameters, given all arguments.
    pub(super) fn key(&self, arguments: &[ObjectId]) -> Vec<ObjectId> {
        self.places.iter().map(|place| arguments[*place]).collect()
    }
}
