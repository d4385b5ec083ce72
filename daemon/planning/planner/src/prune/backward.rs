//! Backward h²: finds the pairs of literals that can be true together in a state from which the
//! goal is reachable.

use super::fixpoint::{AnalysisDirection, ReachablePairs, extend_to_fixpoint};
use super::operator_views::OperatorView;
use super::pairs::{LiteralPairs, LiteralSet};
use super::{Prune, WorkBudget, WorkExceeded};
use crate::task::Literal;

/// Backward direction of the analysis: regression from the goal, restricted to forward reachable
/// pairs.
pub(super) struct Backward<'a>(pub(super) &'a LiteralPairs);

/// Computes the pairs from which the goal is reachable. Only the forward reachable pairs in
/// `reached` are considered. Returns `None` if the goal is unreachable from the initial state.
pub(super) fn reach(
    prune: &Prune<'_>,
    reached: &LiteralPairs,
    work: &mut WorkBudget<'_>,
) -> Result<Option<ReachablePairs>, WorkExceeded> {
    let view = &prune.view;
    let last = LiteralPairs::among(reached.with_all(&view.goal).iter(), reached);
    let order = (0..prune.is_useful.len()).rev();
    let leading = extend_to_fixpoint(prune, &Backward(reached), last, order, work)?;
    let has_initial = leading.pairs.with_all(&view.initial).contains_all(&view.initial);
    Ok(has_initial.then_some(leading))
}

impl AnalysisDirection for Backward<'_> {
    fn allowed(&self) -> &LiteralPairs {
        self.0
    }

    fn needed<'v>(&self, operator: &OperatorView<'v>) -> &'v [Literal] {
        operator.after
    }

    fn reachable_literals(
        &self,
        operator: &OperatorView<'_>,
        pairs: &LiteralPairs,
    ) -> Option<LiteralSet> {
        let mut before = pairs.with_all(operator.after);
        if !before.contains_all(operator.after) {
            return None;
        }
        // A fact that the operator changes may have had either value before.
        for touched in operator.sure.iter().chain(operator.possible) {
            before.remove(*touched);
            before.remove(touched.negated());
        }
        self.changed(operator).for_each(|old| before.insert(*old));
        before.intersect(&self.0.with_all(operator.preconditions));
        before.contains_all(operator.preconditions).then_some(before)
    }

    fn changed<'v>(&self, operator: &OperatorView<'v>) -> impl Iterator<Item = &'v Literal> {
        operator.preconditions.iter().chain(operator.free)
    }
}
