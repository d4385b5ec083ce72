//! Pruning: computes a smaller task with the same plans. Operators that no plan can use are
//! removed. Facts that always hold when a plan uses an operator are added to the operator's
//! precondition.
//!
//! 1. [`forward`] computes the pairs of literals that can be true together in a reachable state.
//!    They are the fixpoint of h² (Haslum and Geffner, “Admissible Heuristics for Optimal
//!    Planning”, 2000).
//! 2. [`backward`] computes those of these pairs from which the goal is reachable.
//!
//! The method is that of Alcázar and Torralba, “A Reminder about the Importance of Computing and
//! Exploiting Invariants in Planning” (2015), with literals instead of finite-domain values. A fact
//! `f` is implied if `not f` is impossible.
//!
//! Derived facts and comparisons are not analysed, and a conditional effect is assumed to be
//! optional. Less is pruned for these reasons, but the result is sound.

mod backward;
mod fixpoint;
mod forward;
mod operator_views;
mod pairs;

use crate::limits::Cancel;
use crate::task::{Literal, OperatorId, OperatorTable, Task};

use self::backward::Backward;
use self::fixpoint::AnalysisDirection as _;
use self::operator_views::OperatorViews;
use self::pairs::{LiteralPairs, LiteralSet};

/// Maximum number of rounds of forward and backward analysis; the result of the last round is used.
/// The second round usually finds the last changes.
const ROUNDS_MAX: usize = 8;

/// Result of pruning a task.
#[derive(Debug)]
pub(crate) enum Pruned {
    /// The whole task remains: no part was pruned, or the task is too large for the limits.
    Everything,
    /// A smaller task with the same plans.
    Smaller(Box<PrunedTask>),
    /// No plan exists, which is proved.
    Nothing,
}

/// A task with the same plans as the original task, but with fewer operators or stronger
/// preconditions.
#[derive(Debug)]
pub(crate) struct PrunedTask {
    pub(crate) task: Task,
    /// Per operator of this task: its number in the original task.
    origins: Vec<OperatorId>,
}

/// Remaining work of pruning, in words of 64 pairs of literals.
#[derive(Debug)]
pub(super) struct WorkBudget<'c> {
    left: u64,
    cancel: &'c Cancel,
}

/// Error of a call that exceeded the limit on work or was cancelled.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct WorkExceeded;

/// Maximum number of sets of pairs that pruning has in memory at one time. A task for which this
/// many sets are too large is not pruned.
const SETS: u64 = 4;

/// Prunes a task, with at most `bytes_max` bytes of memory and `work_max` units of work. A unit is
/// a word of 64 pairs, and takes one or two nanoseconds.
pub(crate) fn prune(task: &Task, work_max: u64, bytes_max: usize, cancel: &Cancel) -> Pruned {
    let words = LiteralPairs::words(task.basic_count).saturating_mul(SETS);
    if words > work_max / 2 || words.saturating_mul(8) > bytes_max as u64 {
        return Pruned::Everything;
    }
    let mut work = WorkBudget { left: work_max, cancel };
    Prune::new(task).run(&mut work).unwrap_or(Pruned::Everything)
}

/// State of the pruning of one task.
struct Prune<'t> {
    task: &'t Task,
    view: OperatorViews,
    /// Per operator: whether a plan may use it, according to the analysis so far.
    is_useful: Vec<bool>,
    /// Pairs of literals that may be true together in a reachable state from which the goal is
    /// reachable, according to the analysis so far.
    alive: LiteralPairs,
}

// === impl PrunedTask ===

impl PrunedTask {
    /// Translates a plan of this task to operators of the original task.
    pub(crate) fn original(&self, plan: &[OperatorId]) -> Vec<OperatorId> {
        plan.iter().map(|id| self.origins[id.index()]).collect()
    }

    /// Translates a plan of the original task to operators of this task; `None` if this task lacks
    /// one of them.
    pub(crate) fn translate(&self, plan: &[OperatorId]) -> Option<Vec<OperatorId>> {
        let place = |id: &OperatorId| self.origins.binary_search(id).ok();
        plan.iter().map(|id| place(id).map(|place| OperatorId(place as u32))).collect()
    }
}

// === impl WorkBudget ===

impl WorkBudget<'_> {
    /// Subtracts the work of `words` words from the budget; called before that work is done.
    /// Returns an error if the budget is too small or the call is cancelled.
    fn spend(&mut self, words: u64) -> Result<(), WorkExceeded> {
        let left = self.left.checked_sub(words).filter(|_| !self.cancel.is_set());
        self.left = left.ok_or(WorkExceeded)?;
        Ok(())
    }
}

// === impl Prune ===

impl<'t> Prune<'t> {
    fn new(task: &'t Task) -> Prune<'t> {
        let view = OperatorViews::of(task);
        let is_useful = vec![true; task.operator_count()];
        Prune { task, view, is_useful, alive: LiteralPairs::full(task.basic_count) }
    }

    fn run(mut self, work: &mut WorkBudget<'_>) -> Result<Pruned, WorkExceeded> {
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

    /// Builds the smaller task. `reached` contains the pairs of the first forward analysis.
    fn smaller(&self, reached: &LiteralPairs) -> Pruned {
        let alive = self.alive.possible();
        let mut operators = OperatorTable::default();
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
        Pruned::Smaller(Box::new(PrunedTask { task, origins }))
    }

    /// Returns the facts that are true whenever a plan uses the operator. Its preconditions, and
    /// facts that these imply in every reachable state, are omitted.
    fn implied(&self, operator: usize, reached: &LiteralPairs, alive: &LiteralSet) -> Vec<Literal> {
        let view = self.view.operator(operator);
        let Some(mut before) = Backward(reached).reachable_literals(&view, &self.alive) else {
            return Vec::new();
        };
        before.intersect(&self.alive.with_all(view.preconditions));
        let with = reached.with_all(view.preconditions);
        // A fact that is true in all states that matter is omitted.
        let is_news = |not: &Literal| !not.is_positive() && alive.contains(*not);
        let gone = with.without(&before).filter(is_news);
        gone.map(Literal::negated).filter(|fact| before.contains(*fact)).collect()
    }
}

#[cfg(test)]
mod tests;
