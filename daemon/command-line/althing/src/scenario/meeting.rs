//! Figure 1 of the paper: “When the TV screen in the conference room is plugged in for the first
//! time, the office should detect the addition of this new component, and complete the setup … the
//! screen is incapable of displaying anymore. The smart office may now deploy a video collaboration
//! robot to resume the interrupted meeting.”

use ::building::{BuildingDevice, BuildingEvent as Occurred, DeviceFault, MeetingScenario, Truth};
use acl::content::Keep;

use super::scenario_run::{ScenarioRun, with_time_limit};
use super::setting::Setting;
use super::{ScenarioEvent, ScenarioOptions, ScenarioResult};

/// The name of the medium that the screens show, as plans write it.
const MEDIUM: &str = "slides";

fn setting(meeting: &MeetingScenario) -> Setting {
    let text = meeting.text.clone();
    let more = move |device: &BuildingDevice| match device {
        BuildingDevice::Screen { .. } | BuildingDevice::Robot { .. } => {
            format!(", media = {{ {MEDIUM} = {text:?} }}")
        }
        _ => String::new(),
    };
    Setting::new("scenario-4", &meeting.layout).at_first(meeting.initial_layout()).more(more)
}

pub(super) async fn play(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let meeting = MeetingScenario::seeded(script.seed);
    let setting = setting(&meeting);
    let mut performance = ScenarioRun::open(&setting, script, tell).await?;
    let ended = with_time_limit(acts(&mut performance, &setting, &meeting)).await;
    let ScenarioRun { set, building, .. } = performance;
    let mut problems: Vec<_> = ended.err().into_iter().collect();
    problems.extend(meeting.check(&building.truth()).err().unwrap_or_default());
    set.shut_down().await;
    let verdict = format!(
        "{} was given a channel by itself and showed “{}” in {} until it failed; then {} \
         came and shows it there",
        meeting.screen(),
        meeting.text,
        meeting.room,
        meeting.robot()
    );
    Ok(ScenarioResult { problems, verdict, ..ScenarioResult::default() })
}

async fn acts(
    performance: &mut ScenarioRun<'_>,
    setting: &Setting,
    meeting: &MeetingScenario,
) -> Result<(), String> {
    performance.await_agents(setting).await?;
    let building = performance.building.clone();
    let (screen, room) = (meeting.screen(), &meeting.room);
    meeting.plug_in(&building).map_err(|error| error.to_string())?;
    performance.plug_in(screen).await?;
    performance.until(|truth| truth.channel_of(screen).is_some()).await?;
    // Otherwise the robot may be planned with, which presents wherever it stands.
    performance.await_action(screen, "present").await?;
    performance.say(format!("{screen} has a channel; no goal asked for it"));
    performance.ask(&format!("(can-present {room})"), Keep::Achieve).await?;
    performance.until_it_holds().await?;
    performance.ask(&format!("(presented {MEDIUM} {room})"), Keep::Maintain).await?;
    performance.until_it_holds().await?;

    let broken = building.break_device(screen, DeviceFault::Fails);
    let broken = broken.map_err(|error| error.to_string())?;
    performance.say(format!("✗ {screen} shows nothing any more"));
    let robot = meeting.robot();
    let takes_over = |truth: &Truth| {
        let is_there = truth.place_of(robot) == Some(room);
        let shown = truth.occurrences().any(|occurrence| {
            occurrence.sequence > broken && matches!(occurrence.event, Occurred::Shown { .. })
        });
        is_there && shown
    };
    performance.until(takes_over).await?;
    performance.until_it_holds().await
}
