//! Forward h²: finds the pairs of literals that can be true together in a reachable state.

use super::fixpoint::{Direction, Reached, settle};
use super::pairs::{Pairs, Set};
use super::view::OperatorView;
use super::{Exceeded, Prune, Work};
use crate::task::Literal;

/// Progression from the initial state, through pairs that are alive.
struct Forward<'a>(&'a Pairs);

/// Computes the pairs that are reachable through alive pairs. Returns `None` if the goal is
/// unreachable.
pub(super) fn reach(prune: &Prune<'_>, work: &mut Work<'_>) -> Result<Option<Reached>, Exceeded> {
    let view = &prune.view;
    let first = Pairs::among(view.initial.iter().copied(), &prune.alive);
    let order = 0..prune.is_useful.len();
    let reached = settle(prune, &Forward(&prune.alive), first, order, work)?;
    let has_goal = reached.pairs.with_all(&view.goal).contains_all(&view.goal);
    Ok(has_goal.then_some(reached))
}

impl Direction for Forward<'_> {
    fn allowed(&self) -> &Pairs {
        self.0
    }

    fn needed<'v>(&self, operator: &OperatorView<'v>) -> &'v [Literal] {
        operator.preconditions
    }

    fn beyond(&self, operator: &OperatorView<'_>, pairs: &Pairs) -> Option<Set> {
        let mut after = pairs.with_all(operator.preconditions);
        if !after.contains_all(operator.preconditions) {
            return None;
        }
        operator.sure.iter().for_each(|made| after.remove(made.negated()));
        self.changed(operator).for_each(|made| after.insert(*made));
        // Removes literals that are impossible after the operator, because the goal is unreachable from
        // there.
        after.intersect(&self.0.with_all(operator.after));
        after.contains_all(operator.after).then_some(after)
    }

    fn changed<'v>(&self, operator: &OperatorView<'v>) -> impl Iterator<Item = &'v Literal> {
        operator.sure.iter().chain(operator.possible)
    }
}
