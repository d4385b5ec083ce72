//! The scenarios of the paper (“Demonstrations”, and Figure 1), and four more in which agents need
//! each other. They are played in the simulated building, and judged by its truth, which is its real
//! state.
//!
//! - `setting` writes the ecosystem that follows from a seed, as the files that a user would write.
//! - `launched` launches the agents of that ecosystem: in this process, or in several.
//! - `recorded` passes all its messages to a listener.
//! - `scenario_run` has the steps that all scenarios share: requesting goals, receiving reports,
//!   and waiting for a true state of the building.
//! - One file for each scenario plays it: `temperatures` (scenario 1), `maintenance` (2), `access`
//!   (3), `meeting` (Figure 1), and `parcels` (5 to 8).

mod access;
mod launched;
mod maintenance;
mod meeting;
mod parcels;
mod readiness;
mod recorded;
mod scenario_run;
mod setting;
mod temperatures;

use std::collections::BTreeMap;
use std::time::Duration;

use ::building::VisitOutcome;
use agent::Mode;

use crate::hosting::DaemonNode;

use launched::DeviceReplacement;
pub(crate) use launched::ScenarioSubstrate;
pub(crate) use recorded::ScenarioTap;

/// A scenario of the paper, or one in which agents need each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scenario {
    /// Scenario 1: all temperatures are measured, and a sensor dies.
    Temperatures,
    /// Scenario 2: all temperatures are kept known, while another sensor dies and a new one is
    /// plugged in.
    Maintenance,
    /// Scenario 3: a person entering the office is validated.
    Access,
    /// Figure 1: a screen fails in a meeting, and a robot takes over.
    Meeting,
    /// Scenario 5: a robot carries a parcel through a door that another agent opens.
    Parcel,
    /// Scenario 6: robots on two floors and a lift hand a parcel over.
    Floors,
    /// Scenario 7: an arm loads a parcel on a robot, and keeps to itself where it was.
    Arm,
    /// Scenario 8: two robots carry a table together.
    Table,
}

/// The options with which a scenario is played once.
#[derive(Clone, Debug)]
pub(crate) struct ScenarioOptions {
    pub(crate) scenario: Scenario,
    pub(crate) seed: u64,
    pub(crate) mode: Mode,
    pub(crate) stage: ScenarioSubstrate,
    /// Whether the agents plan again when a plan has failed. `false` is used only in tests, which
    /// show that the scenario fails without replanning.
    pub(crate) replanning: bool,
    /// Whether the agent of the dying sensor in scenario 1 dies together with the sensor. If not,
    /// the sensor hangs, and the agent has to notice that.
    pub(crate) kills: bool,
    /// A function that launches additional agents in scenario 1, which are not part of the
    /// building.
    pub(crate) guests: Option<fn(&DaemonNode)>,
    /// A function that puts other devices in the place of simulated ones; not with agents in several
    /// processes.
    pub(crate) replacement: Option<DeviceReplacement>,
    /// A listener that receives all messages of the scenario; `None` if they are not recorded.
    pub(crate) listener: Option<ScenarioTap>,
}

/// A line of output about an event in a scenario.
#[derive(Clone, Debug)]
pub(crate) struct ScenarioEvent {
    /// Time of the event, counted from the start of the scenario.
    pub(crate) at: Duration,
    pub(crate) text: String,
}

/// The result of playing a scenario.
#[derive(Clone, Debug, Default)]
pub(crate) struct ScenarioResult {
    /// The requirements that the truth of the building does not meet; empty on success.
    pub(crate) problems: Vec<String>,
    /// The text to print on success.
    pub(crate) verdict: String,
    /// The last temperature of each room that was reported to the user, in °C.
    pub(crate) told: BTreeMap<String, f64>,
    /// The result of each visit in scenario 3: which questions were asked, and whether the visitor
    /// was let in.
    pub(crate) admissions: Vec<VisitOutcome>,
}

impl ScenarioOptions {
    /// Creates options with defaults for all settings that are not parameters.
    pub(crate) fn new(
        scenario: Scenario,
        seed: u64,
        mode: Mode,
        stage: ScenarioSubstrate,
    ) -> ScenarioOptions {
        ScenarioOptions {
            scenario,
            seed,
            mode,
            stage,
            replanning: true,
            kills: true,
            guests: None,
            replacement: None,
            listener: None,
        }
    }
}

/// Plays a scenario; `tell` is called with each line of output. If the scenario could not be
/// started, the error is a message for the user.
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
        Scenario::Parcel => parcels::play_doors(script, tell).await,
        Scenario::Floors => parcels::play_floors(script, tell).await,
        Scenario::Arm => parcels::play_arm(script, tell).await,
        Scenario::Table => parcels::play_table(script, tell).await,
    }
}

#[cfg(test)]
mod tests;
