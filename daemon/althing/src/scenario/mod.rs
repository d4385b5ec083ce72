//! The scenarios of the paper (“Demonstrations”, and Figure 1), played against the simulated
//! building and judged by the building's own truth.
//!
//! - `setting` writes the ecosystem of a seed, as the files that a user would write.
//! - `stage` launches its agents: in this process, or in several.
//! - `scenario_run` has the steps that all scenarios share: requesting goals, receiving reports,
//!   waiting for the building's truth.
//! - One file per scenario plays it: `temperatures` (1), `maintenance` (2), `access` (3), `meeting`
//!   (Figure 1).

mod access;
mod launched;
mod maintenance;
mod meeting;
mod readiness;
mod scenario_run;
mod setting;
mod temperatures;

use std::collections::BTreeMap;
use std::time::Duration;

use ::building::VisitOutcome;
use agent::Mode;

use crate::hosting::DaemonNode;

pub(crate) use launched::ScenarioSubstrate;

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
pub(crate) struct ScenarioOptions {
    pub(crate) scenario: Scenario,
    pub(crate) seed: u64,
    pub(crate) mode: Mode,
    pub(crate) stage: ScenarioSubstrate,
    /// Whether plans are repaired; `false` only in tests, to show that the check can fail.
    pub(crate) replanning: bool,
    /// In scenario 1, whether the agent of the dying sensor dies with it. If not, the sensor hangs
    /// and its agent has to notice that.
    pub(crate) kills: bool,
    /// Launches additional agents in scenario 1, which are not part of the building.
    pub(crate) guests: Option<fn(&DaemonNode)>,
}

/// A line of output.
#[derive(Clone, Debug)]
pub(crate) struct ScenarioEvent {
    /// Time since the performance began.
    pub(crate) at: Duration,
    pub(crate) text: String,
}

/// The result of a performance.
#[derive(Clone, Debug, Default)]
pub(crate) struct ScenarioResult {
    /// The requirements that the building's truth does not meet; empty on success.
    pub(crate) problems: Vec<String>,
    /// The text to print on success.
    pub(crate) verdict: String,
    /// The temperature of each room that the user was told last, in °C.
    pub(crate) told: BTreeMap<String, f64>,
    /// The result of each visit in scenario 3: the questions that were asked, and whether the
    /// visitor was let in.
    pub(crate) admissions: Vec<VisitOutcome>,
}

impl ScenarioOptions {
    /// Creates a script with default settings.
    pub(crate) fn new(
        scenario: Scenario,
        seed: u64,
        mode: Mode,
        stage: ScenarioSubstrate,
    ) -> ScenarioOptions {
        ScenarioOptions { scenario, seed, mode, stage, replanning: true, kills: true, guests: None }
    }
}

/// Plays a script; `tell` is called with each line of output. The error is a message for the user:
/// the scenario could not be started.
pub(crate) async fn play(
    script: &ScenarioOptions,
    mut tell: impl FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
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
