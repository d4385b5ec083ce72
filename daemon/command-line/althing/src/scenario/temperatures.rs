//! Scenario 1 of the paper, from the request of the goal to the verdict by the true state of the
//! building.
//!
//! “When the temperature sensor in office2 goes down, the system detects this and re-evaluates
//! its capabilities automatically and dispatches the TurtleBot to office2 instead.”

use ::building::{DeathTime, DeviceFault, Layout, SeededScenario, check_scenario_1};
use acl::content::Keep;

use super::scenario_run::{ScenarioRun, with_time_limit};
use super::setting::{GOAL, Setting};
use super::{ScenarioEvent, ScenarioOptions, ScenarioResult};

/// Returns the setting of scenario 1, with the building that a seed generated.
pub(crate) fn setting(scenario: &SeededScenario) -> Setting {
    Setting::new("scenario-1", &scenario.layout)
}

pub(super) async fn play(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let scenario = Layout::seeded(script.seed);
    let setting = setting(&scenario).replanning(script.replanning);
    let mut performance = ScenarioRun::open(&setting, script, tell).await?;
    if let Some(guests) = script.guests {
        guests(&performance.set.node);
    }
    // The occurrence in the building's log at which the sensor died, once it has.
    let mut death = None;
    let acts = acts(&mut performance, &setting, &scenario, script.kills, &mut death);
    let ended = with_time_limit(acts).await;
    let ScenarioRun { set, told, building, .. } = performance;
    let mut problems: Vec<_> = ended.err().into_iter().collect();
    match death {
        Some(death) => {
            let checked = check_scenario_1(&scenario, &building.truth(), death, &told);
            problems.extend(checked.err().unwrap_or_default());
        }
        None => problems.push(format!("`{}` never died", scenario.dying_sensor)),
    }
    set.shut_down().await;
    let verdict = format!(
        "every room was measured, a robot stood in {} after {} died, and what the user was told \
         is true",
        scenario.dying_room(),
        scenario.dying_sensor
    );
    Ok(ScenarioResult { problems, verdict, told, ..ScenarioResult::default() })
}

async fn acts(
    performance: &mut ScenarioRun<'_>,
    setting: &Setting,
    scenario: &SeededScenario,
    kills: bool,
    death: &mut Option<u64>,
) -> Result<(), String> {
    performance.await_agents(setting).await?;
    let (building, fault) = (performance.building.clone(), DeviceFault::Hangs);
    scenario.arm(&building, fault).map_err(|error| error.to_string())?;
    let goal = performance.set.ecosystem.find_goal(GOAL)?.goal;
    performance.ask(&goal, Keep::Maintain).await?;
    if scenario.dies == DeathTime::AfterReport {
        performance.until_it_holds().await?;
    }
    let died = scenario.death(&building, fault).await.map_err(|error| error.to_string())?;
    *death = Some(died);
    if kills {
        performance.kill(&scenario.dying_sensor).await?;
    } else {
        performance.say(format!("✗ {} hangs", scenario.dying_sensor));
    }
    performance.until_it_holds().await
}
