//! A smaller task with the same plans: operators that no plan can use are left out, and what they
//! take for granted is written into their preconditions.
//!
//! 1. [`forward`]: which pairs of literals can be true together in a state that can be reached: the
//!    fixpoint of h² (Haslum and Geffner, “Admissible Heuristics for Optimal Planning”, 2000).
//! 2. [`backward`]: which of them can be true in a state from which the goal can be reached.
//! 3. Again, each with what the other has found, until nothing more goes.
//!
//! After Alcázar and Torralba, “A Reminder about the Importance of Computing and Exploiting
//! Invariants in Planning” (2015). Literals take the place of their variables' values: that `f` is
//! implied is that `not f` cannot be.
//!
//! What derives from axioms and numbers is not looked at, and a conditional effect counts as one
//! that may happen or not: less is found, nothing wrong.

mod backward;
mod fixpoint;
mod forward;
mod pairs;
mod view;

use crate::limits::Cancel;
use crate::task::{Literal, OperatorId, Operators, Task};

use self::backward::Backward;
use self::fixpoint::Direction as _;
use self::pairs::{Pairs, Set};
use self::view::View;

/// How often both directions are looked at. The second time around usually finds the last.
const ROUNDS_MAX: usize = 8;

/// What is left of a task.
#[derive(Debug)]
pub(crate) enum Pruned {
    /// As much as there was, or there was too much to look at.
    Everything,
    /// A task with the same plans.
    Smaller(Box<Smaller>),
    /// No plan exists.
    Nothing,
}

/// A task with the same plans as another, which has more operators or weaker ones.
#[derive(Debug)]
pub(crate) struct Smaller {
    pub(crate) task: Task,
    /// For each operator, what it is in the other task.
    origins: Vec<OperatorId>,
}

/// How much has been done, in words of 64 pairs, and how much may be.
#[derive(Debug)]
pub(super) struct Work<'c> {
    left: u64,
    cancel: &'c Cancel,
}

/// The work was more than was allowed.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Exceeded;

/// How many sets of pairs there are at once, at most.
const SETS: u64 = 4;

/// Looks for what is superfluous, in `bytes_max` of memory. `work_max` counts words of 64 pairs; one
/// takes a nanosecond or two.
pub(crate) fn prune(task: &Task, work_max: u64, bytes_max: usize, cancel: &Cancel) -> Pruned {
    let words = Pairs::words(task.basic_count).saturating_mul(SETS);
    if words > work_max / 2 || words.saturating_mul(8) > bytes_max as u64 {
        return Pruned::Everything;
    }
    let mut work = Work { left: work_max, cancel };
    Prune::new(task).run(&mut work).unwrap_or(Pruned::Everything)
}

/// The state of the work on one task.
struct Prune<'t> {
    task: &'t Task,
    view: View,
    /// By operator: whether a plan may use it, as far as is known.
    is_useful: Vec<bool>,
    /// Pairs that are true together in a state on the way to the goal, as far as is known.
    alive: Pairs,
}

// === impl Smaller ===

impl Smaller {
    /// The steps as operators of the other task.
    pub(crate) fn original(&self, plan: &[OperatorId]) -> Vec<OperatorId> {
        plan.iter().map(|id| self.origins[id.index()]).collect()
    }

    /// A plan of the other task in terms of this one, if it has all its steps.
    pub(crate) fn translate(&self, plan: &[OperatorId]) -> Option<Vec<OperatorId>> {
        let place = |id: &OperatorId| self.origins.binary_search(id).ok();
        plan.iter().map(|id| place(id).map(|place| OperatorId(place as u32))).collect()
    }
}

// === impl Work ===

impl Work<'_> {
    /// Notes work to be done now.
    fn spend(&mut self, words: u64) -> Result<(), Exceeded> {
        let left = self.left.checked_sub(words).filter(|_| !self.cancel.is_set());
        self.left = left.ok_or(Exceeded)?;
        Ok(())
    }
}

// === impl Prune ===

impl<'t> Prune<'t> {
    fn new(task: &'t Task) -> Prune<'t> {
        let view = View::of(task);
        let is_useful = vec![true; task.operator_count()];
        Prune { task, view, is_useful, alive: Pairs::full(task.basic_count) }
    }

    fn run(mut self, work: &mut Work<'_>) -> Result<Pruned, Exceeded> {
        let mut first = None;
        for _ in 0..ROUNDS_MAX {
            let before = (self.alive.count(), self.useful());
            let Some(forward) = forward::reach(&self, work)? else { return Ok(Pruned::Nothing) };
            self.is_useful = forward.fired;
            let reached = forward.pairs;
            let Some(backward) = backward::reach(&self, &reached, work)? else {
                return Ok(Pruned::Nothing);
            };
            (self.is_useful, self.alive) = (backward.fired, backward.pairs);
            first.get_or_insert(reached);
            if (self.alive.count(), self.useful()) == before {
                break;
            }
        }
        Ok(first.map_or(Pruned::Everything, |reached| self.smaller(&reached)))
    }

    fn useful(&self) -> usize {
        self.is_useful.iter().filter(|is_useful| **is_useful).count()
    }

    /// The task of what is left, given what could be `reached` at first.
    fn smaller(&self, reached: &Pairs) -> Pruned {
        let alive = self.alive.possible();
        let mut operators = Operators::default();
        let (mut origins, mut is_stronger) = (Vec::new(), false);
        for (index, operator) in self.task.operators.iter().enumerate() {
            if !self.is_useful[index] {
                continue;
            }
            let implied = self.implied(index, reached, &alive);
            is_stronger |= !implied.is_empty();
            let mut preconditions = operator.preconditions.to_vec();
            preconditions.extend(implied);
            preconditions.sort_unstable();
            operators.push_with(operator, preconditions);
            origins.push(OperatorId(index as u32));
        }
        if !is_stronger && origins.len() == self.task.operator_count() {
            return Pruned::Everything;
        }
        let task = self.task.with_operators(operators);
        Pruned::Smaller(Box::new(Smaller { task, origins }))
    }

    /// The facts that are true whenever a plan uses an operator, beyond what it asks for and what
    /// follows from that in any state.
    fn implied(&self, operator: usize, reached: &Pairs, alive: &Set) -> Vec<Literal> {
        let view = self.view.operator(operator);
        let Some(mut before) = Backward(reached).beyond(&view, &self.alive) else {
            return Vec::new();
        };
        before.intersect(&self.alive.with_all(view.preconditions));
        let with = reached.with_all(view.preconditions);
        // What is always true on the way to the goal need not be asked.
        let is_news = |not: &Literal| !not.is_positive() && alive.contains(*not);
        let gone = with.without(&before).filter(is_news);
        gone.map(Literal::negated).filter(|fact| before.contains(*fact)).collect()
    }
}

#[cfg(test)]
mod tests;
