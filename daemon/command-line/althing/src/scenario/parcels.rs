//! Two buildings in which agents need each other (the paper leaves such goals to its future work): a
//! parcel behind closed doors (scenario 5), and one that changes the floor (scenario 6).

use ::building::{FloorsScenario, Layout, ParcelScenario, Truth};
use acl::content::Keep;

use super::scenario_run::{ScenarioRun, with_time_limit};
use super::setting::Setting;
use super::{ScenarioEvent, ScenarioOptions, ScenarioResult};

/// A parcel that is to be brought into a room.
struct ParcelErrand {
    layout: Layout,
    parcel: &'static str,
    room: String,
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
    let delivery = ParcelErrand { layout: scenario.layout.clone(), parcel, room, verdict };
    play(script, ("scenario-5", delivery), |truth| scenario.check(truth), tell).await
}

/// Plays scenario 6: a parcel that changes the floor.
pub(super) async fn play_floors(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let scenario = FloorsScenario::seeded(script.seed);
    let (parcel, lift, room) = (scenario.parcel(), scenario.lift(), scenario.target.clone());
    let verdict = format!("two robots and {lift} have brought {parcel} to {room}");
    let delivery = ParcelErrand { layout: scenario.layout.clone(), parcel, room, verdict };
    play(script, ("scenario-6", delivery), |truth| scenario.check(truth), tell).await
}

async fn play(
    script: &ScenarioOptions,
    (name, delivery): (&'static str, ParcelErrand),
    check: impl Fn(&Truth) -> Result<(), Vec<String>>,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let setting = Setting::new(name, &delivery.layout);
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
    delivery: &ParcelErrand,
) -> Result<(), String> {
    performance.await_agents(setting).await?;
    let ParcelErrand { parcel, room, .. } = delivery;
    performance.ask(&format!("(parcel-at {parcel} {room})"), Keep::Achieve).await?;
    performance.until_it_holds().await
}
