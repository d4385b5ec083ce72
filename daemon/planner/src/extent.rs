//! How large a problem is: what it is made of once it is ground, without a search.

use pddl::{Domain, Problem};

use crate::ground::{GroundError, ground};
use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::Lifted;
use crate::normalize::normalize;
use crate::outcome::{PlanError, StopReason};
use crate::plan::refuse_mistakes;
use crate::task::Task;

/// A domain and a problem whose names have become numbers: all that grounding reads.
#[derive(Clone, Debug)]
pub struct Prepared(Lifted);

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
    Ok(Prepared(normalize(domain, problem)?))
}

// === impl Prepared ===

impl Prepared {
    /// Grounds the problem and tells what it is made of.
    pub fn extent(&self, budget: Budget, cancel: &Cancel) -> Result<Extent, PlanError> {
        let mut join_steps = 0;
        let grounded = ground(&self.0, budget, cancel, &mut join_steps);
        let extent = match grounded {
            Ok(grounded) => grounded.task.map_or_else(
                || stopped(StopReason::Unsolvable { before_search: true }),
                |task| Extent::of(&task),
            ),
            Err(GroundError::Unsupported(unsupported)) => return Err(unsupported.into()),
            Err(GroundError::Stopped(reason)) => stopped(reason),
        };
        Ok(Extent { join_steps, ..extent })
    }
}

fn stopped(reason: StopReason) -> Extent {
    Extent { stop_reason: Some(reason), ..Extent::default() }
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
