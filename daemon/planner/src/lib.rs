//! Planning: from PDDL texts to validated plans, in-process.
//!
//! Start reading at [`plan()`], then `task`, then `search`.
//!
//! - `normalize` numbers names and refuses what is not supported; `ground` makes the `task`;
//!   `state`, `successors`, `heuristic` and `search` solve it.
//! - [`mod@validate`] checks plans on the texts themselves and shares nothing with the above.
//! - [`order`] says which steps of a plan must wait for which; [`goal`] takes goals apart,
//!   and [`explain`] says what is missing where there is no plan.
//!
//! Leaves to others: composing domains (`capability`), carrying plans out (the Plan Executor), other
//! planners (adapters).
//!
//! **Invariants:** no async function, no clock, no randomness, no environment, no logging. The same
//! texts and budget give the same answer everywhere. No plan leaves without having passed the
//! validator, and nothing is called unsolvable without a proof.

mod plan;

mod replan;

mod solve;

mod configuration;

mod limits;

mod outcome;

mod normalize;

mod ground;

mod operators;

mod task;

mod mutex;

mod prune;

#[cfg(test)]
mod small_tasks;

mod state;

mod successors;

mod heuristic;

mod search;

pub mod validate;

pub mod order;

pub mod goal;

pub mod explain;

mod extent;

mod id_table;

mod rows;

mod arena;

mod axioms;

pub use configuration::{CONFIGURATIONS, Configuration, configuration};
pub use extent::{Extent, Ground, Groups, Prepared, prepare};
pub use heuristic::{HEURISTICS, Heuristic};
pub use limits::{Budget, Cancel, Effort, Options};
pub use normalize::refuse_nonclassical;
pub use outcome::{
    News, Outcome, PlanError, Statistics, StopReason, Text, Unprovable, Unsupported,
};
pub use plan::{plan, plan_and_tell};
pub use replan::{Course, Grounding, Replanned, Replanner};
pub use validate::{Fault, FaultReason, Place, Verdict, World, rest_reaches, validate};
