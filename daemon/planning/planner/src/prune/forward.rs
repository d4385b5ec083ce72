//! Forward h²: finds the pairs of literals that can be true together in a reachable state.

use super::fixpoint::{AnalysisDirection, ReachablePairs, extend_to_fixpoint};
use super::operator_views::OperatorView;
use super::pairs::{LiteralPairs, LiteralSet};
use super::{Prune, WorkBudget, WorkExceeded};
use crate::task::Literal;

/// Forward direction of the analysis: progression from the initial state, restricted to pairs that
/// are alive (that may be true together in a state from which the goal is reachable).
struct Forward<'a>(&'a LiteralPairs);

/// Computes the pairs that are reachable through alive pairs. Returns `None` if the goal is
/// unreachable.
pub(super) fn reach(
    prune: &Prune<'_>,
    work: &mut WorkBudget<'_>,
) -> Result<Option<ReachablePairs>, WorkExceeded> {
    let view = &prune.view;
    let first = LiteralPairs::among(view.initial.iter().copied(), &prune.alive);
    let order = 0..prune.is_useful.len();
    let reached = extend_to_fixpoint(prune, &Forward(&prune.alive), first, order, work)?;
    let has_goal = reached.pairs.with_all(&view.goal).contains_all(&view.goal);
    Ok(has_goal.then_some(reached))
}

impl AnalysisDirection for Forward<'_> {
    fn allowed(&self) -> &LiteralPairs {
        self.0
    }

    fn needed<'v>(&self, operator: &OperatorView<'v>) -> &'v [Literal] {
        operator.preconditions
    }

    fn reachable_literals(
        &self,
        operator: &OperatorView<'_>,
        pairs: &LiteralPairs,
    ) -> Option<LiteralSet> {
        let mut after = pairs.with_all(operator.preconditions);
        if !after.contains_all(operator.preconditions) {
            return None;
        }
        operator.sure.iter().for_each(|made| after.remove(made.negated()));
        self.changed(operator).for_each(|made| after.insert(*made));
        // Literals from which the goal is unreachable after the operator are removed.
        after.intersect(&self.0.with_all(operator.after));
        after.contains_all(operator.after).then_some(after)
    }

    fn changed<'v>(&self, operator: &OperatorView<'v>) -> impl Iterator<Item = &'v Literal> {
        operator.sure.iter().chain(operator.possible)
    }
}
