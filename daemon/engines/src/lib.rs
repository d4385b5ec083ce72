//! External engines: Fast Downward and Metric-FF, as processes of their own.
//!
//! Start reading at [`plan()`], then `lower`, then `process`.
//!
//! - [`Installation`] is where an engine was found, or why it was not and how to get it.
//! - `lower` says a task in the engine's own dialect of PDDL, under names that every engine can
//!   read, and refuses by name and place what the engine cannot do.
//! - `process` runs it within limits of time and memory, and sees that nothing of it is left.
//! - `fast_downward` and `metric_ff` know the command lines, what an ending means, and the traps.
//!
//! Leaves to others: planning in-process and judging plans (`planner`), drawing mistakes (the
//! binary). No engine is ever needed: the embedded planner stands alone.
//!
//! **Invariants:** No plan leaves without having passed the validator, and its cost is the
//! validator's: what an engine claims of it is not read. Nothing is called unsolvable that the
//! engine has not proven. Whatever happens to this process, SIGKILL included, the engine's processes
//! end with it.

mod planning;

mod outcome;

mod find;

mod lower;

mod process;

mod fast_downward;
mod metric_ff;

pub use find::Installation;
pub use outcome::{Ending, EngineError, Outcome};
pub use planning::{Aim, Engine, Options, plan};
