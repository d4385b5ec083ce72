//! Which pairs of literals can be true together in a state that can be reached.

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

/// When rows have changed, and when operators have last looked at them.
pub(super) struct Clock {
    now: u32,
    changed: Vec<u32>,
    looked: Vec<Option<u32>>,
}

/// What can be reached through what is alive; `None` if the goal cannot.
pub(super) fn reach(prune: &Prune<'_>, work: &mut Work<'_>) -> Result<Option<Reached>, Exceeded> {
    let (task, view) = (prune.task, &prune.view);
    let mut pairs = Pairs::empty(task.basic_count);
    work.spend(pairs.width() * view.initial.len())?;
    let mut initial = pairs.none();
    view.initial.iter().for_each(|literal| initial.insert(*literal));
    for literal in &view.initial {
        pairs.insert(*literal, &initial, &prune.alive, &mut |_| ());
    }
    let mut clock = Clock::new(task.operator_count(), 2 * task.basic_count);
    let mut fired = vec![false; task.operator_count()];
    loop {
        let begun = clock.now;
        for (index, fired) in fired.iter_mut().enumerate() {
            let operator = view.operator(index);
            if !prune.is_useful[index] || !clock.must_look(index, operator.preconditions) {
                continue;
            }
            work.spend(pairs.width() * operator.size())?;
            let Some(after) = after(&operator, &pairs, &prune.alive) else { continue };
            *fired = true;
            for new in operator.sure.iter().chain(operator.possible) {
                pairs.insert(*new, &after, &prune.alive, &mut |one| clock.change(one));
            }
        }
        if clock.now == begun {
            break;
        }
    }
    let with_goal = pairs.with_all(&view.goal);
    Ok(with_goal.contains_all(&view.goal).then_some(Reached { pairs, fired }))
}

/// The literals that may be true after an operator; `None` if it cannot be used.
fn after(operator: &OperatorView<'_>, pairs: &Pairs, alive: &Pairs) -> Option<Set> {
    let mut after = pairs.with_all(operator.preconditions);
    if !after.contains_all(operator.preconditions) {
        return None;
    }
    for made in operator.sure {
        after.remove(made.negated());
    }
    for made in operator.sure.iter().chain(operator.possible) {
        after.insert(*made);
    }
    // What cannot be after it, because no way leads on from there.
    after.intersect(&alive.with_all(operator.after));
    after.contains_all(operator.after).then_some(after)
}

// === impl Clock ===

impl Clock {
    pub(super) fn now(&self) -> u32 {
        self.now
    }

    pub(super) fn new(operators: usize, literals: usize) -> Clock {
        Clock { now: 0, changed: vec![0; literals], looked: vec![None; operators] }
    }

    /// Whether an operator has something new to look at, among the partners of `literals`; without
    /// any, among all. It then looks.
    pub(super) fn must_look(&mut self, operator: usize, literals: &[Literal]) -> bool {
        let changed = match literals {
            [] => self.now,
            _ => literals.iter().map(|one| self.changed[one.index()]).max().unwrap_or(0),
        };
        let must = self.looked[operator].is_none_or(|looked| looked < changed);
        if must {
            self.looked[operator] = Some(self.now);
        }
        must
    }

    /// Notes that a literal has a new partner.
    pub(super) fn change(&mut self, literal: Literal) {
        self.now += 1;
        self.changed[literal.index()] = self.now;
    }
}
