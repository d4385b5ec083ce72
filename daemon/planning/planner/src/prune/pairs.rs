//! Sets of literals, and sets of pairs of literals, as bit sets.

use fixedbitset::FixedBitSet;

use crate::task::Literal;

/// A set of literals.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LiteralSet(FixedBitSet);

/// A symmetric set of pairs of literals. Each literal has a set of partners. A literal that can be
/// true is its own partner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LiteralPairs(Vec<LiteralSet>);

// === impl LiteralSet ===

impl LiteralSet {
    /// Returns the empty set for literals with indices below `count`.
    fn none(count: usize) -> LiteralSet {
        LiteralSet(FixedBitSet::with_capacity(count))
    }

    /// Returns the set of `literals`, which must have indices below `count`.
    fn of(literals: impl IntoIterator<Item = Literal>, count: usize) -> LiteralSet {
        let mut set = LiteralSet::none(count);
        literals.into_iter().for_each(|literal| set.insert(literal));
        set
    }

    pub(super) fn contains(&self, literal: Literal) -> bool {
        self.0.contains(literal.index())
    }

    pub(super) fn contains_all(&self, literals: &[Literal]) -> bool {
        literals.iter().all(|literal| self.contains(*literal))
    }

    pub(super) fn insert(&mut self, literal: Literal) {
        self.0.insert(literal.index());
    }

    pub(super) fn remove(&mut self, literal: Literal) {
        self.0.remove(literal.index());
    }

    pub(super) fn intersect(&mut self, other: &LiteralSet) {
        self.0.intersect_with(&other.0);
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = Literal> + '_ {
        self.0.ones().map(Literal::from_index)
    }

    /// Returns the literals of this set that are not in `other`.
    pub(super) fn without<'s>(
        &'s self,
        other: &'s LiteralSet,
    ) -> impl Iterator<Item = Literal> + 's {
        self.0.difference(&other.0).map(Literal::from_index)
    }
}

// === impl LiteralPairs ===

impl LiteralPairs {
    /// Returns the size of a set of pairs of the literals of `fact_count` facts, in words of 64
    /// pairs.
    pub(super) fn words(fact_count: usize) -> u64 {
        let count = 2 * fact_count as u64;
        count * count.div_ceil(64)
    }

    /// Returns all pairs of the literals of `fact_count` facts, except each literal with its own
    /// negation.
    pub(super) fn full(fact_count: usize) -> LiteralPairs {
        let count = 2 * fact_count;
        let all = (0..count).map(Literal::from_index);
        let rows = all.clone().map(|literal| {
            let mut row = LiteralSet::of(all.clone(), count);
            row.remove(literal.negated());
            row
        });
        LiteralPairs(rows.collect())
    }

    /// Returns those pairs of the given literals that are in `allowed`.
    pub(super) fn among(
        literals: impl IntoIterator<Item = Literal>,
        allowed: &LiteralPairs,
    ) -> LiteralPairs {
        let count = allowed.0.len();
        let set = LiteralSet::of(literals, count);
        let mut pairs = LiteralPairs(vec![LiteralSet::none(count); count]);
        for literal in set.iter() {
            let row = &mut pairs.0[literal.index()];
            row.clone_from(&set);
            row.intersect(&allowed.0[literal.index()]);
        }
        pairs
    }

    /// Returns the number of words in one row, which is the work of reading the row.
    pub(super) fn width(&self) -> usize {
        self.0.len().div_ceil(64)
    }

    /// Returns the number of pairs. A pair of two different literals is counted twice.
    pub(super) fn count(&self) -> usize {
        self.0.iter().map(|row| row.0.count_ones(..)).sum()
    }

    /// Returns the literals that can be true: they are their own partners.
    pub(super) fn possible(&self) -> LiteralSet {
        let all = (0..self.0.len()).map(Literal::from_index);
        LiteralSet::of(all.filter(|one| self.0[one.index()].contains(*one)), self.0.len())
    }

    /// Returns the literals that are partners of all `literals`. The result includes `literals`
    /// themselves if they can all be true together.
    pub(super) fn with_all(&self, literals: &[Literal]) -> LiteralSet {
        let Some((first, rest)) = literals.split_first() else { return self.possible() };
        let mut with = self.0[first.index()].clone();
        rest.iter().for_each(|literal| with.intersect(&self.0[literal.index()]));
        with
    }

    /// Adds the pairs of `literal` with the literals of a set, if they are in `allowed`. Calls
    /// `changed` for each literal with a new partner.
    pub(super) fn insert(
        &mut self,
        literal: Literal,
        set: &LiteralSet,
        allowed: &LiteralPairs,
        mut changed: impl FnMut(Literal),
    ) {
        let mut new = set.clone();
        new.intersect(&allowed.0[literal.index()]);
        new.0.difference_with(&self.0[literal.index()].0);
        if new.0.is_clear() {
            return;
        }
        self.0[literal.index()].0.union_with(&new.0);
        changed(literal);
        for other in new.iter() {
            self.0[other.index()].insert(literal);
            changed(other);
        }
    }
}
