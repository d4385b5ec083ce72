//! Scenario 2 of the paper: “Now the sensor in confroom goes down, and the system adapts and
//! replans accordingly. This again shows how the system responds not only to evolving capabilities
//! but also to changing environment and (maintenance) goals.”
//!
//! A temperature counts as known only for a while, so that the work of keeping the goal never ends.
//! Two robots share the work according to cost and map. A sensor that is plugged in later takes
//! over a room from them.

use ::building::{BuildingDevice, BuildingEvent as Occurred, MaintenanceScenario, Truth};
use acl::content::Keep;

use super::scenario_run::{ScenarioRun, with_time_limit};
use super::setting::{GOAL, Setting};
use super::{ScenarioEvent, ScenarioOptions, ScenarioResult};

/// How long a temperature counts as known. Robots need a fifth of this time to visit all rooms.
const KNOWN_FOR: &str = "3s";

fn setting(scenario: &MaintenanceScenario) -> Setting {
    let measures = |device: &BuildingDevice| {
        matches!(device, BuildingDevice::FixedSensor { .. } | BuildingDevice::MountedSensor { .. })
    };
    let more = move |device: &BuildingDevice| match measures(device) {
        true => format!(", valid-for = \"{KNOWN_FOR}\""),
        false => String::new(),
    };
    Setting::new("scenario-2", &scenario.layout).at_first(scenario.initial_layout()).more(more)
}

pub(super) async fn play(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let scenario = MaintenanceScenario::seeded(script.seed);
    let setting = setting(&scenario).replanning(script.replanning);
    let mut performance = ScenarioRun::open(&setting, script, tell).await?;
    let ended = with_time_limit(acts(&mut performance, &setting, &scenario)).await;
    let ScenarioRun { set, told, building, .. } = performance;
    let mut problems: Vec<_> = ended.err().into_iter().collect();
    problems.extend(scenario.check(&building.truth(), &told).err().unwrap_or_default());
    set.shut_down().await;
    let [first, second] = &scenario.deaths;
    let verdict = format!(
        "after {} and {} had died, both robots kept measuring, none where the other was nearer; \
         since {} came, no robot measured {}; and what the user was told is true",
        first.sensor,
        second.sensor,
        scenario.latecomer,
        scenario.late_room()
    );
    Ok(ScenarioResult { problems, verdict, told, ..ScenarioResult::default() })
}

async fn acts(
    performance: &mut ScenarioRun<'_>,
    setting: &Setting,
    scenario: &MaintenanceScenario,
) -> Result<(), String> {
    performance.await_agents(setting).await?;
    let goal = performance.set.ecosystem.find_goal(GOAL)?.goal;
    performance.ask(&goal, Keep::Maintain).await?;
    performance.until_it_holds().await?;

    let building = performance.building.clone();
    let [first, second] = &scenario.deaths;
    let died = first.trigger(&building).map_err(|error| error.to_string())?;
    performance.kill(&first.sensor).await?;
    performance.until(|truth| by_robot(truth, &first.room, died)).await?;
    let died = second.trigger(&building).map_err(|error| error.to_string())?;
    performance.kill(&second.sensor).await?;
    let kept = |truth: &Truth| {
        by_robot(truth, &first.room, died)
            && by_robot(truth, &second.room, died)
            && scenario.layout.rooms().all(|room| !readings(truth, room, died).is_empty())
    };
    performance.until(kept).await?;

    let plugged = building.truth().next_sequence();
    scenario.plug_in(&building).map_err(|error| error.to_string())?;
    performance.plug_in(&scenario.latecomer).await?;
    let kept = |truth: &Truth| {
        let by_it: Vec<_> = { readings(truth, scenario.late_room(), plugged).into_iter() }
            .filter(|(_, sensor)| *sensor == scenario.latecomer)
            .collect();
        let [(first_reading, _), _, ..] = by_it.as_slice() else { return false };
        by_robot(truth, &first.room, *first_reading)
            && by_robot(truth, &second.room, *first_reading)
    };
    performance.until(kept).await?;
    let truth = building.truth();
    let is_true = |(room, celsius): (&String, &f64)| truth.temperature(room) == Some(*celsius);
    let all = scenario.layout.rooms().count();
    performance.until_told(|told| told.len() == all && told.iter().all(is_true)).await
}

/// Returns the measurements in a room since the occurrence with the sequence number `since`. For
/// each, returns its sequence number and the name of the sensor.
fn readings<'a>(truth: &'a Truth, room: &str, since: u64) -> Vec<(u64, &'a str)> {
    let measured = truth.occurrences().filter(|occurrence| occurrence.sequence >= since);
    let by = measured.filter_map(|occurrence| match &occurrence.event {
        Occurred::Read { sensor, location, .. } if location == room => {
            Some((occurrence.sequence, sensor.as_str()))
        }
        _ => None,
    });
    by.collect()
}

/// Whether a robot has measured in a room since the occurrence with the sequence number `since`.
fn by_robot(truth: &Truth, room: &str, since: u64) -> bool {
    let is_mounted = |sensor: &str| {
        matches!(truth.layout().device(sensor), Some(BuildingDevice::MountedSensor { .. }))
    };
    readings(truth, room, since).into_iter().any(|(_, sensor)| is_mounted(sensor))
}
