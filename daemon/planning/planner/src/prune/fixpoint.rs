//! Fixpoint iteration: applies operators repeatedly until none of them adds a pair of literals.

use super::operator_views::OperatorView;
use super::pairs::{LiteralPairs, LiteralSet};
use super::{Prune, WorkBudget, WorkExceeded};
use crate::task::Literal;

/// Result of the reachability analysis in one direction.
pub(super) struct ReachablePairs {
    pub(super) pairs: LiteralPairs,
    /// Per operator: whether a plan may use it, according to this direction.
    pub(super) fired: Vec<bool>,
}

/// Direction of the analysis: forward or backward.
pub(super) trait AnalysisDirection {
    /// Returns the pairs of literals that the analysis may add.
    fn allowed(&self) -> &LiteralPairs;

    /// Returns the literals that an operator requires in this direction. The operator can add no
    /// new pair until the pairs of one of these literals change.
    fn needed<'v>(&self, operator: &OperatorView<'v>) -> &'v [Literal];

    /// Returns the literals that may be true on the other side of an operator: after it in the
    /// forward direction, before it in the backward direction. Returns `None` if no plan can use
    /// the operator.
    fn reachable_literals(
        &self,
        operator: &OperatorView<'_>,
        pairs: &LiteralPairs,
    ) -> Option<LiteralSet>;

    /// Returns the literals that an operator may change in this direction. Only pairs with one of
    /// these literals are added.
    fn changed<'v>(&self, operator: &OperatorView<'v>) -> impl Iterator<Item = &'v Literal>;
}

/// Logical clock: the last time at which the pairs of each literal changed, and at which each
/// operator was applied.
struct Clock {
    now: u64,
    changed: Vec<u64>,
    looked: Vec<Option<u64>>,
}

/// Extends `pairs` to the fixpoint under all useful operators, which are applied in the order
/// `order`.
pub(super) fn extend_to_fixpoint(
    prune: &Prune<'_>,
    direction: &impl AnalysisDirection,
    mut pairs: LiteralPairs,
    order: impl Iterator<Item = usize> + Clone,
    work: &mut WorkBudget<'_>,
) -> Result<ReachablePairs, WorkExceeded> {
    let (operators, literals) = (prune.is_useful.len(), 2 * prune.task.basic_count);
    let mut clock = Clock { now: 0, changed: vec![0; literals], looked: vec![None; operators] };
    let mut fired = vec![false; operators];
    loop {
        let begun = clock.now;
        for index in order.clone() {
            let operator = prune.view.operator(index);
            if !prune.is_useful[index] || !clock.must_reapply(index, direction.needed(&operator)) {
                continue;
            }
            let before = clock.now;
            if let Some(beyond) = direction.reachable_literals(&operator, &pairs) {
                fired[index] = true;
                for literal in direction.changed(&operator).filter(|one| beyond.contains(**one)) {
                    let allowed = direction.allowed();
                    pairs.insert(*literal, &beyond, allowed, |one| clock.change(one));
                }
            }
            // The work is that of reading the rows, and of writing each new pair into two of them.
            work.spend((pairs.width() * operator.size()) as u64 + clock.now - before)?;
        }
        if clock.now == begun {
            return Ok(ReachablePairs { pairs, fired });
        }
    }
}

// === impl Clock ===

impl Clock {
    /// Whether `operator` must be applied again, because the pairs of one of `literals` have
    /// changed since its last application. Without literals, a change of any pair is enough. If so,
    /// records the present application.
    fn must_reapply(&mut self, operator: usize, literals: &[Literal]) -> bool {
        let changed = literals.iter().map(|one| self.changed[one.index()]).max();
        let changed = changed.unwrap_or(self.now);
        let must = self.looked[operator].is_none_or(|looked| looked < changed);
        if must {
            self.looked[operator] = Some(self.now);
        }
        must
    }

    /// Records that a literal is in a new pair.
    fn change(&mut self, literal: Literal) {
        self.now += 1;
        self.changed[literal.index()] = self.now;
    }
}
