//! Size of a planning problem: the numbers of facts, operators and axioms after grounding. They are
//! determined without a search.
//!
//! The steps are [`prepare`], [`NormalizedProblem::ground`], then [`GroundProblem::extent`] or
//! [`GroundProblem::groups`]. They are separate calls, so that a caller with a clock can measure
//! the time of each.

use pddl::{Domain, Problem};

use crate::ground::ground;
use crate::limits::{Budget, Cancel};
use crate::mutex::MutexGroups;
use crate::normalize::lifted::Lifted;
use crate::normalize::{normalize, split_wide};
use crate::outcome::{PlanError, StopReason};
use crate::plan::refuse_mistakes;
use crate::task::Task;

/// A domain and a problem after normalization, with numbers instead of names: the input of
/// grounding.
#[derive(Clone, Debug)]
pub struct NormalizedProblem(Lifted);

/// A ground problem, or the reason why grounding ended without one.
#[derive(Clone, Debug)]
pub struct GroundProblem {
    task: Result<Task, StopReason>,
    join_steps: u64,
}

/// Numbers of the mutex groups of a problem. All values are counts, not times, and are the same in
/// every run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MutexGroupCounts {
    /// Number of mutex groups: sets of two or more facts, at most one of which is true in any
    /// reachable state.
    pub groups: usize,
    /// Number of finite-domain variables that are sufficient to encode all facts, if each variable
    /// encodes the facts of one mutex group.
    pub variables: usize,
}

/// Size of a ground problem. All values are counts, not times, and are the same in every run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProblemSize {
    /// Number of basic facts, which operators change. Facts that cannot change or are irrelevant
    /// are not counted.
    pub facts: usize,
    /// Number of derived facts, which follow from axioms.
    pub derived: usize,
    /// Number of comparison facts, which follow from the values of numeric fluents.
    pub comparisons: usize,
    /// Number of numeric fluents that operators change.
    pub fluents: usize,
    /// Number of ground actions.
    pub operators: usize,
    /// Number of conditional effects of all operators together.
    pub conditional_effects: usize,
    /// Number of ground axioms.
    pub axioms: usize,
    /// Number of join steps: candidate tuples that grounding visited.
    pub join_steps: u64,
    /// Reason why grounding ended without a ground problem: a limit, or a proof that no plan
    /// exists. `None` if there is a ground problem.
    pub stop_reason: Option<StopReason>,
}

/// Checks a domain and a problem, and replaces their names by numbers.
///
/// # Errors
///
/// Returns [`PlanError::BadInput`] if the texts contain mistakes, and [`PlanError::Unsupported`] if
/// they use a feature that this planner does not support.
pub fn prepare(domain: &Domain, problem: &Problem) -> Result<NormalizedProblem, PlanError> {
    refuse_mistakes(domain, problem)?;
    let mut lifted = normalize(domain, problem)?;
    split_wide(&mut lifted);
    Ok(NormalizedProblem(lifted))
}

// === impl NormalizedProblem ===

impl NormalizedProblem {
    /// Grounds the problem within `budget`. A reached limit and a proof of unsolvability are not
    /// errors: they are returned as [`ProblemSize::stop_reason`].
    pub fn ground(&self, budget: Budget, cancel: &Cancel) -> GroundProblem {
        let mut join_steps = 0;
        let task = match ground(&self.0, budget, cancel, &mut join_steps) {
            Ok(grounded) => grounded.task.ok_or(StopReason::Unsolvable { before_search: true }),
            Err(reason) => Err(reason),
        };
        GroundProblem { task, join_steps }
    }
}

// === impl GroundProblem ===

impl GroundProblem {
    /// Returns the size of the ground problem.
    pub fn extent(&self) -> ProblemSize {
        let extent = match &self.task {
            Ok(task) => ProblemSize::of(task),
            Err(reason) => ProblemSize { stop_reason: Some(*reason), ..ProblemSize::default() },
        };
        ProblemSize { join_steps: self.join_steps, ..extent }
    }

    /// Searches for mutex groups with at most `work_max` units of work, and returns their numbers.
    /// A unit takes about ten nanoseconds.
    pub fn groups(&self, work_max: u64, cancel: &Cancel) -> MutexGroupCounts {
        let Ok(task) = &self.task else { return MutexGroupCounts::default() };
        let found = MutexGroups::find(task, work_max, cancel);
        MutexGroupCounts { groups: found.groups().len(), variables: found.variables().len() }
    }
}

// === impl ProblemSize ===

impl ProblemSize {
    fn of(task: &Task) -> ProblemSize {
        ProblemSize {
            facts: task.basic_count,
            derived: task.fact_count - task.basic_count - task.comparisons.len(),
            comparisons: task.comparisons.len(),
            fluents: task.values.len(),
            operators: task.operator_count(),
            conditional_effects: task
                .operators
                .iter()
                .map(|one| one.conditional.iter().len())
                .sum(),
            axioms: task.axioms.len(),
            ..ProblemSize::default()
        }
    }
}
