//! External engines: Fast Downward and Metric-FF, as processes of their own.
//!
//! Start reading at [`plan()`], then `lower`, then `process`.
//!
//! - [`Installation`] is an engine that was found; the error says why none was found and how to install
//!   it.
//! - `lower` translates a task to the engine's dialect of PDDL, with names that every engine can read.
//!   A feature that the engine does not support is refused, with its name and place.
//! - `process` runs the engine within limits of time and memory, and leaves no process or file behind.
//! - `fast_downward` and `metric_ff` have the engines' command lines, the meaning of their exit codes
//!   and outputs, and known pitfalls.
//!
//! This crate leaves planning in the own process and validating plans to `planner`, and showing
//! mistakes to the binary. No engine is required: the embedded planner works without any.
//!
//! **Invariants:** Each returned plan has passed the validator, and its cost is computed by the
//! validator: the cost that an engine prints is not read. A task is called unsolvable only if the
//! engine has proved it. Whenever this process ends, also by SIGKILL, the engine's processes end with
//! it.

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
