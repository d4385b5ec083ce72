//! How large a problem is: what it is made of once it is ground, without a search.
//!
//! [`prepare`], then [`Prepared::ground`], then what one wants to know: each takes its own time, and
//! whoever has a clock can tell which.

use pddl::{Domain, Problem};

use crate::ground::ground;
use crate::limits::{Budget, Cancel};
use crate::mutex::MutexGroups;
use crate::normalize::lifted::Lifted;
use crate::normalize::{normalize, split_wide};
use crate::outcome::{PlanError, StopReason};
use crate::plan::refuse_mistakes;
use crate::task::Task;

/// A domain and a problem whose names have become numbers: all that grounding reads.
#[derive(Clone, Debug)]
pub struct Prepared(Lifted);

/// A problem once it is ground.
#[derive(Clone, Debug)]
pub struct Ground {
    task: Result<Task, StopReason>,
    join_steps: u64,
}

/// What mutex groups say of a problem. Counts, not times: they repeat exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Groups {
    /// Sets of facts, two or more, of which at most one is ever true.
    pub groups: usize,
    /// Variables that suffice for all facts, if each stands for one of a group.
    pub variables: usize,
}

/// What a ground problem is made of. Counts, not times: they repeat exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extent {
    /// Facts that operators change; those that cannot change or cannot matter are gone.
    pub facts: usize,
    /// Facts that follow from axioms.
    pub derived: usize,
    /// Facts that follow from numbers.
    pub comparisons: usize,
    /// Numbers that operators change.
    pub fluents: usize,
    /// Ground actions.
    pub operators: usize,
    /// Conditional effects of all of them.
    pub conditional_effects: usize,
    /// Ground axioms.
    pub axioms: usize,
    /// Candidate tuples that grounding looked at.
    pub join_steps: u64,
    /// Why grounding ended without a ground problem, if it did: a cap, or a proof that no plan
    /// exists.
    pub stop_reason: Option<StopReason>,
}

/// Checks a domain and a problem and numbers their names.
pub fn prepare(domain: &Domain, problem: &Problem) -> Result<Prepared, PlanError> {
    refuse_mistakes(domain, problem)?;
    let mut lifted = normalize(domain, problem)?;
    split_wide(&mut lifted);
    Ok(Prepared(lifted))
}

// === impl Prepared ===

impl Prepared {
    /// Grounds the problem.
    pub fn ground(&self, budget: Budget, cancel: &Cancel) -> Result<Ground, PlanError> {
        let mut join_steps = 0;
        let task = match ground(&self.0, budget, cancel, &mut join_steps) {
            Ok(grounded) => grounded.task.ok_or(StopReason::Unsolvable { before_search: true }),
            Err(reason) => Err(reason),
        };
        Ok(Ground { task, join_steps })
    }
}

// === impl Ground ===

impl Ground {
    /// What it is made of.
    pub fn extent(&self) -> Extent {
        let extent = match &self.task {
            Ok(task) => Extent::of(task),
            Err(reason) => Extent { stop_reason: Some(*reason), ..Extent::default() },
        };
        Extent { join_steps: self.join_steps, ..extent }
    }

    /// Its mutex groups, as far as `work_max` goes; one unit takes some ten nanoseconds.
    pub fn groups(&self, work_max: u64, cancel: &Cancel) -> Groups {
        let Ok(task) = &self.task else { return Groups::default() };
        let found = MutexGroups::find(task, work_max, cancel);
        Groups { groups: found.groups().len(), variables: found.variables().len() }
    }
}

// === impl Extent ===

impl Extent {
    fn of(task: &Task) -> Extent {
        Extent {
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
            ..Extent::default()
        }
    }
}
