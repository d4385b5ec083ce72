//! The scenarios of the paper (“Demonstrations”, and Figure 1), played against the simulated
//! building and judged by the building's own truth.
//!
//! - `setting` writes the ecosystem of a seed, as the files that a user would write.
//! - `stage` launches its agents: in this process, or in several.
//! - `performance` has the steps that all scenarios share: requesting goals, receiving reports,
//!   waiting for the building's truth.
//! - One file per scenario plays it: `temperatures` (1), `maintenance` (2), `access` (3), `meeting`
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

/// A scenario of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scenario {
    /// Scenario 1: all temperatures are measured, and a sensor dies.
    Temperatures,
    /// Scenario 2: all temperatures are kept known; another sensor dies, and a new one comes.
    Maintenance,
    /// Scenario 3: a person that enters is validated.
    Access,
    /// Figure 1: a screen fails in a meeting, and a robot takes over.
    Meeting,
}

/// The parameters of one performance of a scenario.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    pub(crate) scenario: Scenario,
    pub(crate) seed: u64,
    pub(crate) mode: Mode,
    pub(crate) stage: Stage,
    /// Whether plans are repaired; `false` only in tests, to show that the check can fail.
    pub(crate) replanning: bool,
    /// In scenario 1, whether the agent of the dying sensor dies with it. If not, the sensor hangs
    /// and its agent has to notice that.
    pub(crate) kills: bool,
    /// Launches additional agents in scenario 1, which are not part of the building.
    pub(crate) guests: Option<fn(&Node)>,
}

/// A line of output.
#[derive(Clone, Debug)]
pub(crate) struct Event {
    /// Time since the performance began.
    pub(crate) at: Duration,
    pub(crate) text: String,
}

/// The result of a performance.
#[derive(Clone, Debug, Default)]
pub(crate) struct Played {
    /// The requirements that the building's truth does not meet; empty on success.
    pub(crate) problems: Vec<String>,
    /// The text to print on success.
    pub(crate) verdict: String,
    /// The temperature of each room that the user was told last, in °C.
    pub(crate) told: BTreeMap<String, f64>,
    /// The result of each visit in scenario 3: the questions that were asked, and whether the
    /// visitor was let in.
    pub(crate) admissions: Vec<Admission>,
}

impl Script {
    /// Creates a script with default settings.
    pub(crate) fn new(scenario: Scenario, seed: u64, mode: Mode, stage: Stage) -> Script {
        Script { scenario, seed, mode, stage, replanning: true, kills: true, guests: None }
    }
}

/// Plays a script; `tell` is called with each line of output. The error is a message for the user:
/// the scenario could not be started.
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
