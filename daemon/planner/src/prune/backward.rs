//! Which pairs of literals can be true together in a state from which the goal can be reached.

use super::forward::{Clock, Reached};
use super::pairs::{Pairs, Set};
use super::view::OperatorView;
use super::{Exceeded, Prune, Work};

/// What leads to the goal, among the pairs that can be `reached`; `None` if the initial state does
/// not.
pub(super) fn reach(
    prune: &Prune<'_>,
    reached: &Pairs,
    work: &mut Work<'_>,
) -> Result<Option<Reached>, Exceeded> {
    let (task, view) = (prune.task, &prune.view);
    let mut pairs = Pairs::empty(task.basic_count);
    work.spend(pairs.width() * 2 * task.basic_count)?;
    let at_goal = reached.with_all(&view.goal);
    for literal in at_goal.iter() {
        pairs.insert(literal, &at_goal, reached, &mut |_| ());
    }
    let mut clock = Clock::new(task.operator_count(), 2 * task.basic_count);
    let mut fired = vec![false; task.operator_count()];
    loop {
        let begun = clock.now();
        for (index, fired) in fired.iter_mut().enumerate().rev() {
            let operator = view.operator(index);
            if !prune.is_useful[index] || !clock.must_look(index, operator.after) {
                continue;
            }
            work.spend(pairs.width() * operator.size())?;
            let before = before(&operator, reached, &pairs);
            let with_after = pairs.with_all(operator.after);
            let leads_on = with_after.contains_all(operator.after);
            if !leads_on || !before.contains_all(operator.preconditions) {
                continue;
            }
            *fired = true;
            for old in operator.preconditions.iter().chain(operator.free) {
                if before.contains(*old) {
                    pairs.insert(*old, &before, reached, &mut |one| clock.change(one));
                }
            }
        }
        if clock.now() == begun {
            break;
        }
    }
    let with_initial = pairs.with_all(&view.initial);
    Ok(with_initial.contains_all(&view.initial).then_some(Reached { pairs, fired }))
}

/// The literals that may be true before an operator, if one that leads on may be true after it.
pub(super) fn before(operator: &OperatorView<'_>, reached: &Pairs, pairs: &Pairs) -> Set {
    let mut before = pairs.with_all(operator.after);
    // What it touches may have been different before.
    for touched in operator.sure.iter().chain(operator.possible) {
        before.remove(*touched);
        before.remove(touched.negated());
    }
    for old in operator.preconditions.iter().chain(operator.free) {
        before.insert(*old);
    }
    before.intersect(&reached.with_all(operator.preconditions));
    before
}
