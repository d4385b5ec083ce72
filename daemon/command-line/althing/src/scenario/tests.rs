//! Tests of the scenarios in both planning modes, in many buildings; scenario 1 on both substrates.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ::building::{ArmScenario, BuildingEvent, DeathTime, Layout, TableScenario, Truth};
use acl::content::Keep;
use agent::{AgentSettings, Mode};
use keyboard::UserEvent;

use super::scenario_run::{ScenarioRun, with_time_limit};
use super::setting::Setting;
use super::{Scenario, ScenarioEvent, ScenarioOptions, ScenarioSubstrate, ScenarioTap, play};
use crate::hosting::DaemonNode;

mod asking;
mod changes;
mod explanations;
mod goals;
mod guests;
mod robots;
mod sensors;

const MODES: [Mode; 2] = [Mode::Centralized, Mode::Decentralized];

fn script(seed: u64, mode: Mode, stage: ScenarioSubstrate) -> ScenarioOptions {
    ScenarioOptions::new(Scenario::Temperatures, seed, mode, stage)
}

/// Plays a scenario once. Returns the requirements that the true state of the building does not
/// meet, and the output.
async fn problems(script: &ScenarioOptions) -> Vec<String> {
    let mut lines = Vec::new();
    let played = play(script, |event| lines.push(format!("{:?} {}", event.at, event.text)));
    let problems = played.await.map_or_else(|problem| vec![problem], |played| played.problems);
    if problems.is_empty() { problems } else { [problems, lines].concat() }
}

/// Checks that scenario 1 meets all requirements in the buildings of these seeds.
async fn check(seeds: std::ops::Range<u64>, mode: Mode, stage: ScenarioSubstrate) {
    for seed in seeds {
        let problems = problems(&script(seed, mode, stage)).await;
        assert!(problems.is_empty(), "seed {seed} {mode:?} {stage:?}: {problems:#?}");
    }
}

// In memory, time is paused: waiting for a lease costs no real time, and every run is the same.

#[tokio::test(start_paused = true)]
async fn a_hundred_buildings_in_memory_centralized() {
    check(0..100, Mode::Centralized, ScenarioSubstrate::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn a_hundred_buildings_in_memory_decentralized() {
    check(0..100, Mode::Decentralized, ScenarioSubstrate::Memory).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ten_buildings_on_zenoh_centralized() {
    check(0..10, Mode::Centralized, ScenarioSubstrate::Zenoh).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ten_buildings_on_zenoh_decentralized() {
    check(0..10, Mode::Decentralized, ScenarioSubstrate::Zenoh).await;
}

/// A plan that needs a dead agent is repaired as soon as the grace has passed; no agent waits for
/// an answer of the dead one.
#[tokio::test(start_paused = true)]
async fn a_dead_agent_delays_no_plan() {
    let seed = (0..).find(|seed| Layout::seeded(*seed).dies == DeathTime::BeforeReport);
    for mode in MODES {
        let mut events = Vec::new();
        let script = script(seed.expect("there are many"), mode, ScenarioSubstrate::Memory);
        play(&script, |event| events.push(event)).await.expect("a stage");
        let at = |word: &str| {
            let event = events.iter().find(|event| event.text.contains(word));
            event.unwrap_or_else(|| panic!("{mode}: `{word}` was not said: {events:#?}")).at
        };
        let bearable = AgentSettings::default().grace + Duration::from_millis(100);
        assert!(at("planning anew") - at("is gone") < bearable, "{mode}: {events:#?}");
    }
}

/// Shows that the check of scenario 1 can fail: without replanning no sensor measures in the room
/// of the dead sensor, and the true state of the building shows that.
#[tokio::test(start_paused = true)]
async fn without_replanning_no_building_holds() {
    for seed in 0..10 {
        for mode in MODES {
            let script = ScenarioOptions {
                replanning: false,
                ..script(seed, mode, ScenarioSubstrate::Memory)
            };
            let problems = problems(&script).await;
            let nobody = |problem: &String| problem.starts_with("no robot measured");
            assert!(problems.iter().any(nobody), "seed {seed} {mode:?}: {problems:#?}");
        }
    }
}

/// Checks that a scenario meets all requirements in the buildings of these seeds, in both planning
/// modes.
async fn check_all(scenario: Scenario, seeds: std::ops::Range<u64>, stage: ScenarioSubstrate) {
    for seed in seeds {
        for mode in MODES {
            let problems = problems(&ScenarioOptions::new(scenario, seed, mode, stage)).await;
            assert!(problems.is_empty(), "{scenario:?} {seed} {mode:?}: {problems:#?}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn temperatures_are_kept_known_in_thirty_buildings() {
    check_all(Scenario::Maintenance, 0..30, ScenarioSubstrate::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn visitors_are_validated_in_ten_buildings() {
    check_all(Scenario::Access, 0..10, ScenarioSubstrate::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn a_meeting_goes_on_in_thirty_buildings() {
    check_all(Scenario::Meeting, 0..30, ScenarioSubstrate::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn parcels_pass_doors_that_another_agent_opens_in_thirty_buildings() {
    check_all(Scenario::Parcel, 0..30, ScenarioSubstrate::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn parcels_change_the_floor_in_thirty_buildings() {
    check_all(Scenario::Floors, 0..30, ScenarioSubstrate::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn two_robots_carry_a_table_in_thirty_buildings() {
    check_all(Scenario::Table, 0..30, ScenarioSubstrate::Memory).await;
}

/// One of two robots dies with the table in its hands, on the second part of the way. The other one lets
/// go, and a third one takes its place.
#[tokio::test(start_paused = true)]
async fn a_table_arrives_although_one_of_its_robots_dies() {
    let mut layout = Layout::new();
    layout.add_room("store", 18.0).and_then(|it| it.add_room("lab", 21.5)).expect("rooms");
    layout.add_corridor("hall", 19.0).expect("a place");
    layout
        .connect("hall", "store", 5.0)
        .and_then(|it| it.connect("hall", "lab", 7.0))
        .expect("ways");
    for robot in ["mover-1", "mover-2", "mover-3"] {
        layout.add_robot(robot, "store", 0.05).expect("a robot");
    }
    layout.add_table("table-1", "store").expect("a table");
    layout.add_tag_reader("tag-reader", "store").expect("a reader");
    let scenario = TableScenario { seed: 0, layout, target: "lab".to_owned() };
    let setting = Setting::new("scenario-8", &scenario.layout);
    for mode in MODES {
        let mut lines = Vec::new();
        let mut tell = |event: ScenarioEvent| lines.push(event.text);
        let script = ScenarioOptions::new(Scenario::Table, 0, mode, ScenarioSubstrate::Memory);
        let mut run = ScenarioRun::open(&setting, &script, &mut tell).await.expect("a stage");
        let played = async {
            run.await_agents(&setting).await?;
            run.ask("(table-at table-1 lab)", Keep::Achieve).await?;
            let on_the_way = |event: &BuildingEvent| match event {
                BuildingEvent::TableCarried { robots, .. } => Some(robots.clone()),
                _ => None,
            };
            run.until(|truth| truth.any(|event| on_the_way(event).is_some())).await?;
            let truth = run.building.truth();
            let carrying = truth.occurrences().find_map(|it| on_the_way(&it.event));
            let [victim, _] = carrying.expect("it was awaited");
            let departed = truth.next_sequence();
            let departs = |truth: &Truth| {
                let mut later = truth.occurrences().filter(|it| it.sequence >= departed);
                later.any(|it| matches!(&it.event, BuildingEvent::Departed { robot, from, .. } if *robot == victim && from == "hall"))
            };
            run.until(departs).await?;
            run.kill(&victim).await?;
            run.until_it_holds().await
        };
        let played = with_time_limit(played).await;
        let truth = run.building.truth();
        let checked = scenario.check(&truth);
        run.set.shut_down().await;
        assert!(played.is_ok() && checked.is_ok(), "{mode}: {played:?} {checked:?} {lines:#?}");
        let stayed =
            truth.any(|event| matches!(event, BuildingEvent::Stayed { at, .. } if at == "hall"));
        assert!(stayed, "{mode}: nobody has let go {lines:#?}");
    }
}

/// A robot that stands still is loaded by an arm. Where the arm keeps its parcels, and what it has
/// gripped, is in no message.
#[tokio::test(start_paused = true)]
async fn an_arm_loads_parcels_and_tells_no_shelf_in_thirty_buildings() {
    for seed in 0..30 {
        for mode in MODES {
            let (said, count) =
                (Arc::new(Mutex::new(String::new())), Arc::new(AtomicUsize::new(0)));
            let (writer, counter) = (Arc::clone(&said), Arc::clone(&count));
            let listen = move |key: &str, payload: bytes::Bytes| {
                let text = String::from_utf8_lossy(&payload).into_owned();
                counter.fetch_add(usize::from(text.contains("(stored parcel-")), Ordering::Relaxed);
                let secret = [
                    "shelf-1", "shelf-2", "shelf-3", "shelf-4", "on-shelf", "gripp", "(grip",
                    "put-back",
                ];
                if secret.iter().any(|word| text.contains(word)) {
                    writer
                        .lock()
                        .expect("no panic while it is held")
                        .push_str(&(key.to_owned() + &text));
                }
            };
            let script = ScenarioOptions::new(Scenario::Arm, seed, mode, ScenarioSubstrate::Memory);
            let script = ScenarioOptions { listener: Some(ScenarioTap::new(listen)), ..script };
            let problems = problems(&script).await;
            assert!(problems.is_empty(), "{seed} {mode:?}: {problems:#?}");
            assert!(
                count.load(Ordering::Relaxed) > 1,
                "{seed} {mode:?}: nothing is heard of the arm"
            );
            let said = said.lock().expect("no panic while it is held");
            assert!(said.is_empty(), "{seed} {mode:?}: {said}");
        }
    }
}

/// An arm dies when it has loaded the parcel, or when it has gripped it, and comes back then. The robot
/// is so slow that a dead arm has long left the domain when the parcel is delivered; the goal is then
/// kept by what the robot tells alone.
#[tokio::test(start_paused = true)]
async fn a_parcel_is_delivered_although_the_arm_dies() {
    let mut layout = Layout::new();
    layout.add_room("bay", 18.0).and_then(|it| it.add_room("lab", 21.5)).expect("places");
    layout.connect("bay", "lab", 7.0).expect("a way");
    layout.add_arm("arm-1", "bay", &["shelf-1"], &[("parcel-1", "shelf-1")]).expect("an arm");
    layout.add_robot("courier-1", "bay", 0.02).expect("a robot");
    let (parcel, target) = ("parcel-1".to_owned(), "lab".to_owned());
    let scenario = ArmScenario { seed: 0, layout, parcel, target };
    let setting = Setting::new("scenario-7", &scenario.layout).confidential();
    for (mode, comes_back) in MODES.into_iter().flat_map(|mode| [(mode, false), (mode, true)]) {
        let mut lines = Vec::new();
        let mut tell = |event: ScenarioEvent| lines.push(event.text);
        let script = ScenarioOptions::new(Scenario::Arm, 0, mode, ScenarioSubstrate::Memory);
        let mut run = ScenarioRun::open(&setting, &script, &mut tell).await.expect("a stage");
        let played = async {
            run.await_agents(&setting).await?;
            run.ask("(parcel-at parcel-1 lab)", Keep::Maintain).await?;
            let is_time = |event: &BuildingEvent| match comes_back {
                true => matches!(event, BuildingEvent::Gripped { .. }),
                false => matches!(event, BuildingEvent::Loaded { .. }),
            };
            run.until(|truth| truth.any(is_time)).await?;
            run.kill("arm-1").await?;
            if comes_back {
                run.plug_in("arm-1").await?;
            }
            run.until_it_holds().await?;
            tokio::time::sleep(AgentSettings::default().removal * 3).await;
            match run.user.events.try_recv() {
                Ok(UserEvent::Report(_, report)) => Err(report.detail),
                _ => Ok(()),
            }
        };
        let played = with_time_limit(played).await;
        let checked = scenario.check(&run.building.truth());
        run.set.shut_down().await;
        assert!(played.is_ok() && checked.is_ok(), "{mode}: {played:?} {checked:?} {lines:#?}");
    }
}

/// The user is told why no agent suffices, and who acts for whom.
#[tokio::test(start_paused = true)]
async fn it_is_explained_who_does_what_for_whom() {
    for (scenario, told) in [
        (Scenario::Parcel, "so that `courier-1` can `(move courier-1 hall lab)`"),
        (
            Scenario::Floors,
            "so that `courier-1` can `(take-out courier-1 parcel-1 lift-1 landing-1)`",
        ),
        (Scenario::Arm, "so that `arm-1` can `(load arm-1 parcel-1 courier-1 bay)`"),
        (Scenario::Table, "table-1 store hall)` takes both at the same time"),
    ] {
        let mut events = Vec::new();
        let script =
            ScenarioOptions::new(scenario, 0, Mode::Decentralized, ScenarioSubstrate::Memory);
        play(&script, |event| events.push(event.text)).await.expect("a stage");
        let explained = |text: &String| {
            text.starts_with("no agent reaches `(")
                && text.contains(" by itself; ")
                && text.contains(told)
        };
        assert!(events.iter().any(explained), "{events:#?}");
    }
}

/// Shows that the check of scenario 2 can fail: if no plan is repaired, the true state of the
/// building shows that.
#[tokio::test(start_paused = true)]
async fn without_replanning_no_temperature_is_kept_known() {
    for seed in 0..5 {
        for mode in MODES {
            let script =
                ScenarioOptions::new(Scenario::Maintenance, seed, mode, ScenarioSubstrate::Memory);
            let problems = problems(&ScenarioOptions { replanning: false, ..script }).await;
            assert!(!problems.is_empty(), "seed {seed} {mode:?}");
        }
    }
}

/// A sensor hangs while its agent runs. The agent notices that, reports that the sensor failed, and
/// offers no actions for a while.
#[tokio::test(start_paused = true)]
async fn a_sensor_that_hangs_is_replaced() {
    let dies_before_reporting = |seed: &u64| Layout::seeded(*seed).dies == DeathTime::BeforeReport;
    for seed in (0..20).filter(dies_before_reporting) {
        for mode in MODES {
            let script =
                ScenarioOptions { kills: false, ..script(seed, mode, ScenarioSubstrate::Memory) };
            let problems = problems(&script).await;
            assert!(problems.is_empty(), "seed {seed} {mode:?}: {problems:#?}");
        }
    }
}

/// Checks that scenario 1 succeeds although a guest announces, falsely, that it can measure in
/// office1 at less cost than the robot.
async fn check_guest(guests: fn(&DaemonNode)) {
    for mode in MODES {
        let script =
            ScenarioOptions { guests: Some(guests), ..script(0, mode, ScenarioSubstrate::Memory) };
        let problems = problems(&script).await;
        assert!(problems.is_empty(), "{mode:?}: {problems:#?}");
    }
}

#[tokio::test(start_paused = true)]
async fn an_actuator_that_refuses_is_done_without() {
    check_guest(guests::one_that_refuses).await;
}

#[tokio::test(start_paused = true)]
async fn an_actuator_that_never_answers_is_done_without() {
    check_guest(guests::one_that_is_silent).await;
}

#[tokio::test(start_paused = true)]
async fn an_actuator_that_agrees_and_falls_silent_is_done_without() {
    check_guest(guests::one_that_agrees_and_is_silent).await;
}

#[tokio::test(start_paused = true)]
async fn an_actuator_with_an_invalid_model_is_ignored() {
    check_guest(guests::one_with_a_broken_model).await;
}
