//! Ground conditions: simplified as they grow, then flattened into conjunctions of literals.
//!
//! A disjunction is multiplied out while it stays small; beyond that it becomes a fact of its own,
//! derived by one axiom per alternative. Equal disjunctions share that fact.

use rustc_hash::FxHashMap;

use crate::task::{FactId, Literal};

/// A ground condition. `And` and `Or` hold at least two parts, none of which is of the same kind.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Tree {
    True,
    False,
    Literal(Literal),
    And(Vec<Tree>),
    Or(Vec<Tree>),
}

/// An axiom over raw facts.
#[derive(Clone, Debug)]
pub(super) struct RawAxiom {
    pub(super) head: FactId,
    pub(super) body: Vec<Literal>,
    pub(super) stratum: usize,
}

/// Facts that stand for disjunctions, and the axioms that derive them.
#[derive(Debug)]
pub(super) struct Auxiliaries {
    known: FxHashMap<(usize, Vec<Tree>), FactId>,
    next: usize,
    pub(super) axioms: Vec<RawAxiom>,
}

// === impl Tree ===

impl Tree {
    pub(super) fn and(parts: impl IntoIterator<Item = Tree>) -> Tree {
        let mut flat = Vec::new();
        for part in parts {
            match part {
                Tree::True => (),
                Tree::False => return Tree::False,
                Tree::And(inner) => flat.extend(inner),
                other => flat.push(other),
            }
        }
        Tree::tidy(flat, Tree::True, Tree::And)
    }

    pub(super) fn or(parts: impl IntoIterator<Item = Tree>) -> Tree {
        let mut flat = Vec::new();
        for part in parts {
            match part {
                Tree::False => (),
                Tree::True => return Tree::True,
                Tree::Or(inner) => flat.extend(inner),
                other => flat.push(other),
            }
        }
        Tree::tidy(flat, Tree::False, Tree::Or)
    }

    /// The opposite.
    pub(super) fn negated(&self) -> Tree {
        match self {
            Tree::True => Tree::False,
            Tree::False => Tree::True,
            Tree::Literal(literal) => Tree::Literal(literal.negated()),
            Tree::And(parts) => Tree::or(parts.iter().map(Tree::negated)),
            Tree::Or(parts) => Tree::and(parts.iter().map(Tree::negated)),
        }
    }

    fn tidy(mut flat: Vec<Tree>, empty: Tree, many: impl Fn(Vec<Tree>) -> Tree) -> Tree {
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
    /// Numbers new facts from `next`.
    pub(super) fn new(next: usize) -> Auxiliaries {
        Auxiliaries { known: FxHashMap::default(), next, axioms: Vec::new() }
    }

    /// How many facts there are.
    pub(super) fn len(&self) -> usize {
        self.known.len()
    }

    /// One past the last fact.
    pub(super) fn end(&self) -> usize {
        self.next
    }

    /// Sorts the axioms by what they derive, each once.
    pub(super) fn tidy(&mut self) {
        let key = |axiom: &RawAxiom| (axiom.head, axiom.stratum);
        self.axioms.sort_by(|left, right| {
            key(left).cmp(&key(right)).then_with(|| left.body.cmp(&right.body))
        });
        self.axioms.dedup_by(|left, right| key(left) == key(right) && left.body == right.body);
    }

    /// Conjunctions of which at least one holds exactly where the tree does, at most
    /// `alternatives_max` of them; `stratum` is that of axioms made on the way.
    pub(super) fn conjunctions(
        &mut self,
        tree: &Tree,
        alternatives_max: usize,
        stratum: usize,
    ) -> Vec<Vec<Literal>> {
        let mut all = self.expand(tree, alternatives_max, stratum);
        for literals in &mut all {
            literals.sort_unstable();
            literals.dedup();
        }
        // Literals of one fact are neighbors, the positive one first.
        all.retain(|literals| !literals.windows(2).any(|pair| pair[0].negated() == pair[1]));
        all
    }

    fn expand(&mut self, tree: &Tree, max: usize, stratum: usize) -> Vec<Vec<Literal>> {
        match tree {
            Tree::True => vec![Vec::new()],
            Tree::False => Vec::new(),
            Tree::Literal(literal) => vec![vec![*literal]],
            Tree::And(parts) => {
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
            Tree::Or(parts) => {
                if parts.len() > max {
                    return vec![vec![self.fact(parts, stratum)]];
                }
                let all: Vec<Vec<Literal>> =
                    parts.iter().flat_map(|part| self.expand(part, max, stratum)).collect();
                if all.len() > max { vec![vec![self.fact(parts, stratum)]] } else { all }
            }
        }
    }

    /// The fact that stands for a disjunction.
    fn fact(&mut self, parts: &[Tree], stratum: usize) -> Literal {
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

/// So many parts are compared with each other; more are hashed.
const FEW_PARTS: usize = 8;

/// Alternatives of one part of a disjunction before it, too, gets a fact of its own.
const AUXILIARY_ALTERNATIVES_MAX: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    fn literal(fact: usize) -> Tree {
        Tree::Literal(Literal::new(FactId::from_index(fact), true))
    }

    /// `(a0 or b0) and (a1 or b1) and …`
    fn pairs(count: usize) -> Tree {
        Tree::and((0..count).map(|index| Tree::or([literal(2 * index), literal(2 * index + 1)])))
    }

    #[track_caller]
    fn check(tree: &Tree, conjunctions: usize, axioms: usize) {
        let mut auxiliaries = Auxiliaries::new(1_000);
        let all = auxiliaries.conjunctions(tree, 8, 0);
        assert_eq!((all.len(), auxiliaries.axioms.len()), (conjunctions, axioms));
    }

    #[test]
    fn small_disjunctions_are_multiplied_out() {
        check(&pairs(3), 8, 0);
    }

    #[test]
    fn large_ones_become_facts_that_equal_ones_share() {
        check(&pairs(10), 8, 14);
        check(&Tree::and([pairs(10), pairs(10)]), 8, 14);
    }

    #[test]
    fn contradictions_and_tautologies_vanish() {
        check(&Tree::and([literal(1), literal(1).negated()]), 0, 0);
        check(&Tree::or([Tree::True, literal(1)]), 1, 0);
        check(&Tree::or([Tree::False, literal(1)]), 1, 0);
    }
}
