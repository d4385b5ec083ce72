//! Scenario 1 in both flows on both substrates, over a hundred buildings.

use agent::Mode;

use super::{Script, Stage, play};

const MODES: [Mode; 2] = [Mode::Centralized, Mode::Decentralized];

/// Plays one script; what the truth has against it.
async fn problems(seed: u64, mode: Mode, stage: Stage, replanning: bool) -> Vec<String> {
    let script = Script { seed, mode, stage, replanning };
    let mut lines = Vec::new();
    let played = play(&script, |event| lines.push(format!("{:?} {}", event.at, event.text)));
    let problems = played.await.map_or_else(|problem| vec![problem], |played| played.problems);
    if problems.is_empty() { problems } else { [problems, lines].concat() }
}

/// Holds these seeds against the truth.
async fn check(seeds: std::ops::Range<u64>, mode: Mode, stage: Stage) {
    for seed in seeds {
        let problems = problems(seed, mode, stage, true).await;
        assert!(problems.is_empty(), "seed {seed} {mode:?} {stage:?}: {problems:#?}");
    }
}

// In memory, time is paused: waiting for a lease costs nothing, and happens alike on every run.

#[tokio::test(start_paused = true)]
async fn a_hundred_buildings_in_memory_centralized() {
    check(0..100, Mode::Centralized, Stage::Memory).await;
}

#[tokio::test(start_paused = true)]
async fn a_hundred_buildings_in_memory_decentralized() {
    check(0..100, Mode::Decentralized, Stage::Memory).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ten_buildings_on_zenoh_centralized() {
    check(0..10, Mode::Centralized, Stage::Zenoh).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ten_buildings_on_zenoh_decentralized() {
    check(0..10, Mode::Decentralized, Stage::Zenoh).await;
}

/// The check is worth something: without replanning the dead sensor's room is measured by nobody,
/// and the building says so.
#[tokio::test(start_paused = true)]
async fn without_replanning_no_building_holds() {
    for seed in 0..10 {
        for mode in MODES {
            let problems = problems(seed, mode, Stage::Memory, false).await;
            let nobody = |problem: &String| problem.starts_with("no robot measured");
            assert!(problems.iter().any(nobody), "seed {seed} {mode:?}: {problems:#?}");
        }
    }
}
