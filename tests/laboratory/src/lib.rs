//! The fault laboratory: whole ecosystems on simulated machines, under faults that a seed decides.
//!
//! A *trial* is one seed: at least five daemons, twenty agents, three goals and thirty faults, on
//! one thread and in simulated time. The same seed plays the same trial again, to the byte.
//! Afterwards the building's truth, the Journals and the reports to people are checked against the
//! promises of `docs/reliability.md`. To show that the laboratory can detect failures, a *guard*
//! can be taken out: without it some seed fails.
//!
//! - [`script`]: the choices of a seed: agents and their daemons, goals, faults and their times.
//! - [`machine`]: one daemon on one machine, with a clock and a disk that outlive its processes.
//! - [`cluster`]: all machines, the network between them, the building.
//! - [`annex_nodes`]: a second ecosystem, and the interfacing nodes between both.
//! - [`endurance`]: a long run, to measure the memory in use.
//! - [`people`]: persons at terminals, the goals that they request, and the reports that they
//!   receive.
//! - [`checks`]: the promises that must hold afterwards; [`commands`]: that each command is
//!   executed once and in order; [`open_exchanges`]: that exchanges end.
//! - [`chains`]: the history of a trial, and whether its chains of causes are complete.
//! - [`stops`]: a stop in the midst of the faults.
//! - [`fault_effects`]: counters of the faults that took effect.
//! - [`trial`]: plays a seed; [`trial_context`]: the state that all machines of a trial share;
//!   [`trial_error`]: the reason why a trial cannot be played.

pub mod annex_nodes;
pub mod chains;
pub mod checks;
pub mod cluster;
pub mod commands;
pub mod endurance;
pub mod fault_effects;
pub mod machine;
pub mod open_exchanges;
pub mod people;
pub mod script;
pub mod stops;
pub mod trial;
pub mod trial_context;
pub mod trial_error;

pub use script::Safeguard;
pub use trial::{TrialResult, play, play_with_history, play_with_stop};
pub use trial_error::TrialError;
