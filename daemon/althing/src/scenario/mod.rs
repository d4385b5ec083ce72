//! The scenarios of the paper (“Demonstrations”, and Figure 1), played against the simulated
//! building and judged by the building's own truth.
//!
//! - `setting` writes the ecosystem of a seed: the same files a person would write.
//! - `stage` puts its agents on a wire: in this process, or in several.
//! - `performance` is what every play does: ask, hear, wait for the building's truth.
//! - One file each plays a scenario: `temperatures` (1), `maintenance` (2), `access` (3), `meeting`
//!   (Figure 1).

mod access;
mod maintenance;
mod meeting;
mod performance;
mod setting;
mod stage;
mod temperatures;
mod usher;

use std::collections::BTreeMap;
use std::time::Duration;

use ::building::Admission;
use agent::Mode;

use crate::hosting::Node;

pub(crate) use stage::Stage;

/// Which scenario of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scenario {
    /// Scenario 1: all temperatures, and a sensor that dies.
    Temperatures,
    /// Scenario 2: they are to be kept known; another dies, a new one comes.
    Maintenance,
    /// Scenario 3: who comes in is validated.
    Access,
    /// Figure 1: a screen, a meeting, a robot that takes over.
    Meeting,
}

/// What is to be played.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    pub(crate) scenario: Scenario,
    pub(crate) seed: u64,
    pub(crate) mode: Mode,
    pub(crate) stage: Stage,
    /// Off only to show that the check can fail.
    pub(crate) replanning: bool,
    /// In scenario 1, whether the agent of the dying sensor dies with it. If not, the sensor hangs
    /// and its agent has to notice.
    pub(crate) kills: bool,
    /// Lets others into scenario 1, whom no building knows.
    pub(crate) guests: Option<fn(&Node)>,
}

/// A line of the play.
#[derive(Clone, Debug)]
pub(crate) struct Event {
    /// Since the stage was set.
    pub(crate) at: Duration,
    pub(crate) text: String,
}

/// How it went.
#[derive(Clone, Debug, Default)]
pub(crate) struct Played {
    /// Every way in which it failed; none, if the building's truth is what the scenario wants.
    pub(crate) problems: Vec<String>,
    /// What the truth says where it holds.
    pub(crate) verdict: String,
    /// What the user was told last of each room, in °C.
    pub(crate) told: BTreeMap<String, f64>,
    /// Who was let in.
    pub(crate) admissions: Vec<Admission>,
}

impl Script {
    /// A scenario as it is played where nothing else is said.
    pub(crate) fn new(scenario: Scenario, seed: u64, mode: Mode, stage: Stage) -> Script {
        Script { scenario, seed, mode, stage, replanning: true, kills: true, guests: None }
    }
}

/// Plays a script; `tell` hears every line as it happens. The error is for a person: the stage
/// could not even be set.
pub(crate) async fn play(script: &Script, mut tell: impl FnMut(Event)) -> Result<Played, String> {
    let tell = &mut tell;
    match script.scenario {
        Scenario::Temperatures => temperatures::play(script, tell).await,
        Scenario::Maintenance => maintenance::play(script, tell).await,
        Scenario::Access => access::play(script, tell).await,
        Scenario::Meeting => meeting::play(script, tell).await,
    }
}

#[cfg(test)]
mod tests;
