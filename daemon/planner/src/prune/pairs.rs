//! Sets of literals, and of pairs of literals, as bits.

use crate::task::{FactId, Literal};

/// A set of literals.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Set(Vec<u64>);

/// A symmetric set of pairs. A literal is paired with itself where it can be true at all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pairs {
    /// Words of a row.
    width: usize,
    words: Vec<u64>,
}

fn place(literal: Literal) -> (usize, u64) {
    (literal.index() / 64, 1 << (literal.index() % 64))
}

fn literals(word: usize, mut bits: u64) -> impl Iterator<Item = Literal> {
    std::iter::from_fn(move || {
        if bits == 0 {
            return None;
        }
        let bit = bits.trailing_zeros() as usize;
        bits &= bits - 1;
        Some(Literal::from_index(word * 64 + bit))
    })
}

// === impl Set ===

impl Set {
    pub(super) fn contains(&self, literal: Literal) -> bool {
        let (word, bit) = place(literal);
        self.0[word] & bit != 0
    }

    pub(super) fn contains_all(&self, literals: &[Literal]) -> bool {
        literals.iter().all(|literal| self.contains(*literal))
    }

    pub(super) fn insert(&mut self, literal: Literal) {
        let (word, bit) = place(literal);
        self.0[word] |= bit;
    }

    pub(super) fn remove(&mut self, literal: Literal) {
        let (word, bit) = place(literal);
        self.0[word] &= !bit;
    }

    pub(super) fn intersect(&mut self, other: &Set) {
        self.0.iter_mut().zip(&other.0).for_each(|(own, other)| *own &= other);
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = Literal> + '_ {
        self.0.iter().enumerate().flat_map(|(word, bits)| literals(word, *bits))
    }

    /// Those that are not in the other set.
    pub(super) fn without(&self, other: &Set) -> impl Iterator<Item = Literal> {
        let words = self.0.iter().zip(&other.0).map(|(own, other)| own & !other);
        words.enumerate().flat_map(|(word, bits)| literals(word, bits))
    }
}

// === impl Pairs ===

impl Pairs {
    /// How many words the pairs of so many facts take.
    pub(super) fn words(fact_count: usize) -> u64 {
        let count = 2 * fact_count as u64;
        count * count.div_ceil(64)
    }

    pub(super) fn empty(fact_count: usize) -> Pairs {
        let width = (2 * fact_count).div_ceil(64);
        Pairs { width, words: vec![0; width * 2 * fact_count] }
    }

    /// All pairs but those of a literal and its negation.
    pub(super) fn full(fact_count: usize) -> Pairs {
        let mut pairs = Pairs::empty(fact_count);
        let all = Pairs::everything(fact_count);
        for literal in all.iter() {
            let mut row = all.clone();
            row.remove(literal.negated());
            pairs.row_mut(literal).copy_from_slice(&row.0);
        }
        pairs
    }

    fn everything(fact_count: usize) -> Set {
        let mut all = Set(vec![0; (2 * fact_count).div_ceil(64)]);
        (0..2 * fact_count).for_each(|index| all.insert(Literal::from_index(index)));
        all
    }

    /// The empty set.
    pub(super) fn none(&self) -> Set {
        Set(vec![0; self.width])
    }

    /// Words of one row: what it takes to look at it.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// How many pairs there are, each counted twice.
    pub(super) fn count(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    fn contains(&self, left: Literal, right: Literal) -> bool {
        let (word, bit) = place(right);
        self.row(left)[word] & bit != 0
    }

    fn row(&self, literal: Literal) -> &[u64] {
        let start = literal.index() * self.width;
        &self.words[start..start + self.width]
    }

    fn row_mut(&mut self, literal: Literal) -> &mut [u64] {
        let start = literal.index() * self.width;
        &mut self.words[start..start + self.width]
    }

    /// The literals that can be true at all.
    pub(super) fn possible(&self) -> Set {
        let count = self.words.len().checked_div(self.width).unwrap_or(0);
        let mut possible = self.none();
        let each = (0..count).map(Literal::from_index);
        each.filter(|one| self.contains(*one, *one)).for_each(|one| possible.insert(one));
        possible
    }

    /// The literals that can be true with each of these, these included.
    pub(super) fn with_all(&self, literals: &[Literal]) -> Set {
        let Some((first, rest)) = literals.split_first() else { return self.possible() };
        let mut with = Set(self.row(*first).to_vec());
        for literal in rest {
            with.0.iter_mut().zip(self.row(*literal)).for_each(|(own, other)| *own &= other);
        }
        with
    }

    /// Adds the pairs of a literal and a set, as far as they are `allowed`. Calls `changed` for
    /// each literal that has a new partner.
    pub(super) fn insert(
        &mut self,
        literal: Literal,
        set: &Set,
        allowed: &Pairs,
        changed: &mut impl FnMut(Literal),
    ) {
        let mut is_new = false;
        let start = literal.index() * self.width;
        for word in 0..self.width {
            let at = start + word;
            let new = set.0[word] & allowed.words[at] & !self.words[at];
            if new == 0 {
                continue;
            }
            is_new = true;
            self.words[at] |= new;
            for other in literals(word, new) {
                let (word, bit) = place(literal);
                self.row_mut(other)[word] |= bit;
                changed(other);
            }
        }
        if is_new {
            changed(literal);
        }
    }
}

/// The positive literals of so many facts.
pub(super) fn facts(fact_count: usize) -> impl Iterator<Item = Literal> {
    (0..fact_count).map(|index| Literal::new(FactId::from_index(index), true))
}
