//! The scenarios of the paper (“Demonstrations”), played against the simulated building and
//! judged by the building's own truth.
//!
//! - `files` writes the ecosystem of a seed: the same files a person would write.
//! - `stage` puts its agents on a wire: in this process, or in several.
//! - `play` asks for the goal, lets the sensor die, waits for the building to plan anew.

mod files;
mod play;
mod stage;

#[cfg(test)]
mod tests;

pub(crate) use play::{Event, Played, Script, play};
pub(crate) use stage::Stage;
