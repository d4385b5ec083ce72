//! The embedded planner: computes validated plans for PDDL texts, in the process of the caller.
//!
//! Start reading at [`plan()`], then `task`, then `search`.
//!
//! - `normalize` replaces names by numbers and rejects unsupported features. `ground` builds the
//!   `task`. `state`, `successors`, `heuristic` and `search` solve it.
//! - [`mod@validate`] checks plans against the PDDL texts. It shares no code with the modules
//!   above.
//! - [`order`] computes which steps of a plan must wait for which others. [`goal`] splits goals
//!   into conjuncts. [`explain`] computes the missing capabilities if there is no plan.
//!
//! Other crates compose domains (`capability`), execute plans (the Plan Executor) and run other
//! planners (`engines`).
//!
//! **Invariants:** This crate has no async function, and uses no clock, randomness, environment
//! variable or log. The same texts and budget give the same answer on every machine. Every returned
//! plan has passed the validator, and a problem is called unsolvable only with a proof.

mod plan;

mod replan;

mod solve;

mod configuration;

mod limits;

mod options;

mod outcome;

mod normalize;

mod ground;

mod operators;

mod ground_terms;
mod task;

mod mutex;

mod prune;

#[cfg(test)]
mod test_tasks;

mod progression;
mod state;

mod successors;

mod heuristic;

mod search;

pub mod validate;

pub mod order;

pub mod merge;

pub mod goal;

pub mod explain;

mod problem_size;

mod id_table;

mod rows;

mod arena;

mod axioms;

pub use configuration::{CONFIGURATIONS, Configuration, configuration};
pub use heuristic::{HEURISTICS, Heuristic};
pub use limits::{Budget, Cancel};
pub use normalize::refuse_nonclassical;
pub use options::{Effort, Options};
pub use outcome::{
    InputText, PlanError, PlanningOutcome, PlanningProgress, Statistics, StopReason, Unprovable,
    Unsupported,
};
pub use plan::{plan, plan_with_progress};
pub use problem_size::{GroundProblem, MutexGroupCounts, NormalizedProblem, ProblemSize, prepare};
pub use replan::{GroundingReuse, PlanReuse, Replanned, Replanner};
pub use validate::{Fault, FaultPlace, FaultReason, Verdict, World, rest_reaches, validate};
