//! Ground conditions as trees. They are simplified while they are built, and then expanded into
//! conjunctions of literals.
//!
//! A disjunction is multiplied out if the result is small. Otherwise it becomes an auxiliary fact,
//! which one axiom per alternative derives. Equal disjunctions share one fact.

use rustc_hash::FxHashMap;

use crate::task::{FactId, Literal};

/// A ground condition. `And` and `Or` have at least two parts. No part of an `And` is an `And`, and
/// no part of an `Or` is an `Or`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum GroundFormula {
    True,
    False,
    Literal(Literal),
    And(Vec<GroundFormula>),
    Or(Vec<GroundFormula>),
}

/// A ground axiom, with raw fact numbers.
#[derive(Clone, Debug)]
pub(super) struct RawAxiom {
    pub(super) head: FactId,
    pub(super) body: Vec<Literal>,
    pub(super) stratum: usize,
}

/// Auxiliary facts, which represent disjunctions, and the axioms that derive them.
#[derive(Debug)]
pub(super) struct Auxiliaries {
    known: FxHashMap<(usize, Vec<GroundFormula>), FactId>,
    next: usize,
    pub(super) axioms: Vec<RawAxiom>,
}

// === impl GroundFormula ===

impl GroundFormula {
    pub(super) fn and(parts: impl IntoIterator<Item = GroundFormula>) -> GroundFormula {
        let mut flat = Vec::new();
        for part in parts {
            match part {
                GroundFormula::True => (),
                GroundFormula::False => return GroundFormula::False,
                GroundFormula::And(inner) => flat.extend(inner),
                other => flat.push(other),
            }
        }
        GroundFormula::tidy(flat, GroundFormula::True, GroundFormula::And)
    }

    pub(super) fn or(parts: impl IntoIterator<Item = GroundFormula>) -> GroundFormula {
        let mut flat = Vec::new();
        for part in parts {
            match part {
                GroundFormula::False => (),
                GroundFormula::True => return GroundFormula::True,
                GroundFormula::Or(inner) => flat.extend(inner),
                other => flat.push(other),
            }
        }
        GroundFormula::tidy(flat, GroundFormula::False, GroundFormula::Or)
    }

    /// Returns the negation of the condition.
    pub(super) fn negated(&self) -> GroundFormula {
        match self {
            GroundFormula::True => GroundFormula::False,
            GroundFormula::False => GroundFormula::True,
            GroundFormula::Literal(literal) => GroundFormula::Literal(literal.negated()),
            GroundFormula::And(parts) => {
                GroundFormula::or(parts.iter().map(GroundFormula::negated))
            }
            GroundFormula::Or(parts) => {
                GroundFormula::and(parts.iter().map(GroundFormula::negated))
            }
        }
    }

    fn tidy(
        mut flat: Vec<GroundFormula>,
        empty: GroundFormula,
        many: impl Fn(Vec<GroundFormula>) -> GroundFormula,
    ) -> GroundFormula {
        if flat.len() <= FEW_PARTS {
            let mut position = 1;
            while position < flat.len() {
                if flat[..position].contains(&flat[position]) {
                    flat.remove(position);
                } else {
                    position += 1;
                }
            }
        } else {
            let mut seen = rustc_hash::FxHashSet::default();
            flat.retain(|part| seen.insert(part.clone()));
        }
        match flat.len() {
            0 => empty,
            1 => flat.swap_remove(0),
            _ => many(flat),
        }
    }
}

// === impl Auxiliaries ===

impl Auxiliaries {
    /// Creates an empty set of auxiliary facts. `next` is the number of the first fact that is
    /// added.
    pub(super) fn new(next: usize) -> Auxiliaries {
        Auxiliaries { known: FxHashMap::default(), next, axioms: Vec::new() }
    }

    /// Returns the number of auxiliary facts.
    pub(super) fn len(&self) -> usize {
        self.known.len()
    }

    /// Returns the number after that of the last auxiliary fact.
    pub(super) fn end(&self) -> usize {
        self.next
    }

    /// Sorts the axioms by the facts that they derive, and removes duplicates.
    pub(super) fn tidy(&mut self) {
        let key = |axiom: &RawAxiom| (axiom.head, axiom.stratum);
        self.axioms.sort_by(|left, right| {
            key(left).cmp(&key(right)).then_with(|| left.body.cmp(&right.body))
        });
        self.axioms.dedup_by(|left, right| key(left) == key(right) && left.body == right.body);
    }

    /// Expands a tree into at most `alternatives_max` conjunctions. The tree holds exactly if at
    /// least one of the conjunctions holds. Auxiliary axioms that the expansion needs get the
    /// stratum `stratum`.
    pub(super) fn conjunctions(
        &mut self,
        tree: &GroundFormula,
        alternatives_max: usize,
        stratum: usize,
    ) -> Vec<Vec<Literal>> {
        let mut all = self.expand(tree, alternatives_max, stratum);
        for literals in &mut all {
            literals.sort_unstable();
            literals.dedup();
        }
        // The literals of one fact are next to each other, the positive one first.
        all.retain(|literals| !literals.windows(2).any(|pair| pair[0].negated() == pair[1]));
        all
    }

    fn expand(&mut self, tree: &GroundFormula, max: usize, stratum: usize) -> Vec<Vec<Literal>> {
        match tree {
            GroundFormula::True => vec![Vec::new()],
            GroundFormula::False => Vec::new(),
            GroundFormula::Literal(literal) => vec![vec![*literal]],
            GroundFormula::And(parts) => {
                let mut whole = vec![Vec::new()];
                for part in parts {
                    let alternatives = self.expand(part, max / whole.len(), stratum);
                    let pairs = whole.iter().flat_map(|left: &Vec<Literal>| {
                        alternatives.iter().map(move |right| [left.as_slice(), right].concat())
                    });
                    whole = pairs.collect();
                    if whole.is_empty() {
                        break;
                    }
                }
                whole
            }
            GroundFormula::Or(parts) => {
                if parts.len() > max {
                    return vec![vec![self.fact(parts, stratum)]];
                }
                let all: Vec<Vec<Literal>> =
                    parts.iter().flat_map(|part| self.expand(part, max, stratum)).collect();
                if all.len() > max { vec![vec![self.fact(parts, stratum)]] } else { all }
            }
        }
    }

    /// Returns the auxiliary fact of a disjunction, which is created if there is none.
    fn fact(&mut self, parts: &[GroundFormula], stratum: usize) -> Literal {
        let key = (stratum, parts.to_vec());
        if let Some(&fact) = self.known.get(&key) {
            return Literal::new(fact, true);
        }
        let head = FactId::from_index(self.next);
        self.next += 1;
        self.known.insert(key, head);
        for part in parts {
            for body in self.conjunctions(part, AUXILIARY_ALTERNATIVES_MAX, stratum) {
                self.axioms.push(RawAxiom { head, body, stratum });
            }
        }
        Literal::new(head, true)
    }
}

/// Maximum number of parts of a formula that are compared pairwise to find duplicates. Above it, a
/// hash table is used.
const FEW_PARTS: usize = 8;

/// Maximum number of conjunctions that one part of a disjunction is expanded into. If there would
/// be more, disjunctions inside that part get auxiliary facts of their own.
const AUXILIARY_ALTERNATIVES_MAX: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    fn literal(fact: usize) -> GroundFormula {
        GroundFormula::Literal(Literal::new(FactId::from_index(fact), true))
    }

    /// Builds the conjunction `(a0 or b0) and (a1 or b1) and …` of `count` disjunctions.
    fn pairs(count: usize) -> GroundFormula {
        GroundFormula::and(
            (0..count).map(|index| GroundFormula::or([literal(2 * index), literal(2 * index + 1)])),
        )
    }

    #[track_caller]
    fn check(tree: &GroundFormula, conjunctions: usize, axioms: usize) {
        let mut auxiliaries = Auxiliaries::new(1_000);
        let all = auxiliaries.conjunctions(tree, 8, 0);
        assert_eq!((all.len(), auxiliaries.axioms.len()), (conjunctions, axioms));
    }

    #[test]
    fn small_disjunctions_are_multiplied_out() {
        check(&pairs(3), 8, 0);
    }

    #[test]
    fn large_disjunctions_become_facts_shared_by_equal_ones() {
        check(&pairs(10), 8, 14);
        check(&GroundFormula::and([pairs(10), pairs(10)]), 8, 14);
    }

    #[test]
    fn contradictions_and_tautologies_vanish() {
        check(&GroundFormula::and([literal(1), literal(1).negated()]), 0, 0);
        check(&GroundFormula::or([GroundFormula::True, literal(1)]), 1, 0);
        check(&GroundFormula::or([GroundFormula::False, literal(1)]), 1, 0);
    }
}
