//! The scenarios in both flows, over many buildings; scenario 1 on both substrates.

use std::time::Duration;

use ::building::{DeathTime, Layout};
use agent::{AgentSettings, Mode};

use super::{Scenario, ScenarioOptions, ScenarioSubstrate, play};
use crate::hosting::DaemonNode;

mod asking;
mod changes;
mod explanations;
mod goals;
mod guests;
mod sensors;

const MODES: [Mode; 2] = [Mode::Centralized, Mode::Decentralized];

fn script(seed: u64, mode: Mode, stage: ScenarioSubstrate) -> ScenarioOptions {
    ScenarioOptions::new(Scenario::Temperatures, seed, mode, stage)
}

/// Plays one script. Returns the requirements that the truth does not meet, and the output.
async fn problems(script: &ScenarioOptions) -> Vec<String> {
    let mut lines = Vec::new();
    let played = play(script, |event| lines.push(format!("{:?} {}", event.at, event.text)));
    let problems = played.await.map_or_else(|problem| vec![problem], |played| played.problems);
    if problems.is_empty() { problems } else { [problems, lines].concat() }
}

/// Checks that these seeds meet all requirements.
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

/// A plan that needs a dead agent is repaired after the grace, without waiting for an answer of
/// that agent.
#[tokio::test(start_paused = true)]
async fn nobody_waits_for_the_dead() {
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

/// The check can fail: without replanning no sensor measures the dead sensor's room, and the truth
/// shows that.
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

/// The other scenarios, in as many buildings as fit into a minute.
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
async fn who_comes_is_validated_in_ten_buildings() {
    check_all(Scenario::Access, 0..10, ScenarioSubstrate::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn a_meeting_goes_on_in_thirty_buildings() {
    check_all(Scenario::Meeting, 0..30, ScenarioSubstrate::Memory).await;
}

/// The check can fail: no plan is repaired, and the truth shows that.
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

/// A sensor hangs while its agent runs: the agent notices, reports that it failed, and offers
/// nothing for a while.
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

/// A guest announces that it can measure office1 at less cost than the robot, which is not true.
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
async fn an_actuator_whose_model_is_garbage_disturbs_nobody() {
    check_guest(guests::one_with_a_broken_model).await;
}
