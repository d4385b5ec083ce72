//! Looking at operators again and again, until none of them has anything new to say.

use super::pairs::{Pairs, Set};
use super::view::OperatorView;
use super::{Exceeded, Prune, Work};
use crate::task::Literal;

/// What can be reached, in one direction.
pub(super) struct Reached {
    pub(super) pairs: Pairs,
    /// By operator: whether it can be used.
    pub(super) fired: Vec<bool>,
}

/// The direction in which operators are looked at.
pub(super) trait Direction {
    /// The pairs that may be added.
    fn allowed(&self) -> &Pairs;

    /// What an operator needs of the pairs: it has nothing new to say until these have.
    fn needed<'v>(&self, operator: &OperatorView<'v>) -> &'v [Literal];

    /// What may be true together on the other side of an operator; `None` if it cannot be used.
    fn beyond(&self, operator: &OperatorView<'_>, pairs: &Pairs) -> Option<Set>;

    /// The literals that an operator may change: those of which it says something.
    fn changed<'v>(&self, operator: &OperatorView<'v>) -> impl Iterator<Item = &'v Literal>;
}

/// When the partners of literals have changed, and when operators have last looked at them.
struct Clock {
    now: u64,
    changed: Vec<u64>,
    looked: Vec<Option<u64>>,
}

/// Adds to `pairs` all that useful operators, looked at in this `order`, say in a direction.
pub(super) fn settle(
    prune: &Prune<'_>,
    direction: &impl Direction,
    mut pairs: Pairs,
    order: impl Iterator<Item = usize> + Clone,
    work: &mut Work<'_>,
) -> Result<Reached, Exceeded> {
    let (operators, literals) = (prune.is_useful.len(), 2 * prune.task.basic_count);
    let mut clock = Clock { now: 0, changed: vec![0; literals], looked: vec![None; operators] };
    let mut fired = vec![false; operators];
    loop {
        let begun = clock.now;
        for index in order.clone() {
            let operator = prune.view.operator(index);
            if !prune.is_useful[index] || !clock.must_look(index, direction.needed(&operator)) {
                continue;
            }
            let before = clock.now;
            if let Some(beyond) = direction.beyond(&operator, &pairs) {
                fired[index] = true;
                for literal in direction.changed(&operator).filter(|one| beyond.contains(**one)) {
                    let allowed = direction.allowed();
                    pairs.insert(*literal, &beyond, allowed, |one| clock.change(one));
                }
            }
            // Rows are read, and each new pair is written in two of them.
            work.spend((pairs.width() * operator.size()) as u64 + clock.now - before)?;
        }
        if clock.now == begun {
            return Ok(Reached { pairs, fired });
        }
    }
}

// === impl Clock ===

impl Clock {
    /// Whether an operator has something new to look at, among the partners of `literals`; without
    /// any, among all. It then looks.
    fn must_look(&mut self, operator: usize, literals: &[Literal]) -> bool {
        let changed = literals.iter().map(|one| self.changed[one.index()]).max();
        let changed = changed.unwrap_or(self.now);
        let must = self.looked[operator].is_none_or(|looked| looked < changed);
        if must {
            self.looked[operator] = Some(self.now);
        }
        must
    }

    /// Notes that a literal has a new partner.
    fn change(&mut self, literal: Literal) {
        self.now += 1;
        self.changed[literal.index()] = self.now;
    }
}
