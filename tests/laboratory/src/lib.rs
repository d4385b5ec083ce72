//! The fault laboratory: whole ecosystems on simulated machines, under faults that a seed decides.
//!
//! A *trial* is one seed: at least five daemons, twenty agents, three goals and thirty faults, on one
//! thread and in simulated time. The same seed plays the same trial again, to the byte. Afterwards
//! the building's truth, the Journals and what people heard are held against what is promised
//! (`docs/reliability.md`). To show that the laboratory sees what it looks for, a *guard* can be
//! taken out: without it some seed fails.
//!
//! - [`script`]: what a seed decides: who lives where, who asks for what, what goes wrong when.
//! - [`machine`]: one daemon on one machine, with a clock and a disk that outlive its processes.
//! - [`city`]: all machines, the wire between them, the building.
//! - [`gates`]: a second ecosystem, and the interfacing nodes between both.
//! - [`endurance`]: a long day, to see what is held.
//! - [`people`]: who asks for goals, and what they hear.
//! - [`checks`]: what must hold afterwards; of [`commands`], that each is obeyed once and in order; of
//!   [`waits`], that they end.
//! - [`effects`]: what went wrong, where it took effect.
//! - [`trial`]: plays a seed.

pub mod checks;
pub mod city;
pub mod commands;
pub mod effects;
pub mod endurance;
pub mod gates;
pub mod machine;
pub mod people;
pub mod script;
pub mod trial;
pub mod waits;

pub use script::Guard;
pub use trial::{Verdict, play};
