//! Four buildings in which agents need each other (the paper leaves such goals to its future work): a
//! parcel behind closed doors (scenario 5), one that changes the floor (scenario 6), one on a shelf that
//! only an arm reaches, which keeps to itself where it lies (scenario 7), and a table for two (scenario
//! 8).

use ::building::{ArmScenario, FloorsScenario, ParcelScenario, TableScenario, Truth};
use acl::content::Keep;

use super::scenario_run::{ScenarioRun, with_time_limit};
use super::setting::Setting;
use super::{ScenarioEvent, ScenarioOptions, ScenarioResult};

/// A goal about a thing that is to be brought into a room.
struct DeliveryGoal {
    goal: String,
    verdict: String,
}

/// Plays scenario 5: a parcel behind closed doors.
pub(super) async fn play_doors(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let scenario = ParcelScenario::seeded(script.seed);
    let (parcel, robot, room) = (scenario.parcel(), scenario.robot(), scenario.target.clone());
    let verdict = format!("{robot} has brought {parcel} to {room}, through a door that was opened");
    let setting = Setting::new("scenario-5", &scenario.layout);
    let delivery = DeliveryGoal { goal: format!("(parcel-at {parcel} {room})"), verdict };
    play(script, (setting, delivery), |truth| scenario.check(truth), tell).await
}

/// Plays scenario 6: a parcel that changes the floor.
pub(super) async fn play_floors(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let scenario = FloorsScenario::seeded(script.seed);
    let (parcel, lift, room) = (scenario.parcel(), scenario.lift(), scenario.target.clone());
    let verdict = format!("two robots and {lift} have brought {parcel} to {room}");
    let setting = Setting::new("scenario-6", &scenario.layout);
    let delivery = DeliveryGoal { goal: format!("(parcel-at {parcel} {room})"), verdict };
    play(script, (setting, delivery), |truth| scenario.check(truth), tell).await
}

/// Plays scenario 7: a parcel on a shelf of an arm, which keeps to itself where it lies.
pub(super) async fn play_arm(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let scenario = ArmScenario::seeded(script.seed);
    let (parcel, arm, room) = (scenario.parcel.clone(), scenario.arm(), scenario.target.clone());
    let verdict = format!("{arm} has loaded {parcel} on a robot that brought it to {room}");
    let setting = Setting::new("scenario-7", &scenario.layout).confidential();
    let delivery = DeliveryGoal { goal: format!("(parcel-at {parcel} {room})"), verdict };
    play(script, (setting, delivery), |truth| scenario.check(truth), tell).await
}

/// Plays scenario 8: a table that two robots carry together.
pub(super) async fn play_table(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let scenario = TableScenario::seeded(script.seed);
    let (table, room) = (scenario.table(), scenario.target.clone());
    let verdict = format!("two robots have carried {table} to {room} together");
    let setting = Setting::new("scenario-8", &scenario.layout);
    let delivery = DeliveryGoal { goal: format!("(table-at {table} {room})"), verdict };
    play(script, (setting, delivery), |truth| scenario.check(truth), tell).await
}

async fn play(
    script: &ScenarioOptions,
    (setting, delivery): (Setting, DeliveryGoal),
    check: impl Fn(&Truth) -> Result<(), Vec<String>>,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let mut performance = ScenarioRun::open(&setting, script, tell).await?;
    let ended = with_time_limit(acts(&mut performance, &setting, &delivery)).await;
    let ScenarioRun { set, building, .. } = performance;
    let mut problems: Vec<_> = ended.err().into_iter().collect();
    problems.extend(check(&building.truth()).err().unwrap_or_default());
    set.shut_down().await;
    Ok(ScenarioResult { problems, verdict: delivery.verdict, ..ScenarioResult::default() })
}

async fn acts(
    performance: &mut ScenarioRun<'_>,
    setting: &Setting,
    delivery: &DeliveryGoal,
) -> Result<(), String> {
    performance.await_agents(setting).await?;
    performance.ask(&delivery.goal, Keep::Achieve).await?;
    performance.until_it_holds().await
}
