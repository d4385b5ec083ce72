//! External engines: Fast Downward and Metric-FF, as processes of their own.
//!
//! Start reading at [`plan()`], then `lower`, then `process`.
//!
//! - [`Installation`] is an engine that was found. The error of the search gives the reason and
//!   explains how to install the engine.
//! - `lower` translates a task to the engine's dialect of PDDL, with names that every engine can
//!   read. It refuses a feature that the engine does not support, with its name and place.
//! - `process` runs the engine within limits of time and memory, and leaves no process or file
//!   behind.
//! - `fast_downward` and `metric_ff` have the engines' command lines, the meaning of their exit
//!   codes and outputs, and known pitfalls.
//!
//! The embedded planner and the validator are in `planner`; the binary shows mistakes to the user.
//! No engine is required, because the embedded planner works without any.
//!
//! **Invariants:** Each returned plan has passed the validator, which also computes its cost; the
//! cost that an engine prints is not used. A task is called unsolvable only if the engine has
//! proved it. The engine's processes end when this process ends, even by SIGKILL.

mod planning;

mod engine;

mod job;

mod outcome;

mod find;

mod lower;

mod process;

mod fast_downward;
mod metric_ff;

pub use engine::ExternalEngine;
pub use find::Installation;
pub use job::{EngineOptions, PlanningAim};
pub use outcome::{Ending, EngineError, EngineOutcome};
pub use planning::plan;
