//! All scenarios with robots that are reached as real ones: each robot has a Nav2 of its own that
//! drives in the building of the scenario, and is reached over Zenoh in one of the two dialects. The
//! truth of the building decides, as with simulated robots.

use std::any::Any;
use std::collections::BTreeMap;
use std::sync::Arc;

use ::building::Building;
use serde_json::{Value, json};
use simulated_nav2::{Nav2Settings, RobotWire, SimulatedNav2};
use substrate::BoxFuture;

use super::{MODES, problems};
use crate::config::{AgentEntry, Ecosystem};
use crate::scenario::{Scenario, ScenarioOptions, ScenarioSubstrate};

const ROBOTS: [&str; 2] = ["turtlebot", "video-robot"];

/// Distance of two places on the robots' maps, in meters: far more than the size of a place.
const APART: f64 = 10.0;

/// Gives every robot the driver `ros2`, and a Nav2. Every second robot speaks the other dialect.
fn robots_with_ros(
    building: Building,
    mut ecosystem: Ecosystem,
) -> BoxFuture<(Ecosystem, Box<dyn Any + Send>)> {
    Box::pin(async move {
        let places = building.truth().layout().locations().to_vec();
        let places = places.into_iter().zip(0_u32..);
        let places: BTreeMap<String, (f64, f64)> =
            places.map(|(place, number)| (place.name, (f64::from(number) * APART, 0.0))).collect();
        let mut robots = Vec::new();
        for entry in &mut ecosystem.agents {
            if ROBOTS.contains(&entry.plugin.as_str()) {
                let wire = match robots.len() % 2 {
                    0 => RobotWire::Ros2Dds,
                    _ => RobotWire::RmwZenoh(3),
                };
                robots.push(put_in_place(entry, &building, &places, wire).await);
            }
        }
        assert!(!robots.is_empty(), "the scenario has robots");
        let robots: Box<dyn Any + Send> = Box::new(robots);
        (ecosystem, robots)
    })
}

async fn put_in_place(
    entry: &mut AgentEntry,
    building: &Building,
    places: &BTreeMap<String, (f64, f64)>,
    wire: RobotWire,
) -> SimulatedNav2 {
    let settings = Nav2Settings {
        robot: entry.name.to_string(),
        wire,
        listen: None,
        namespace: "bot".to_owned(),
        places: places.clone(),
        battery_range: None,
    };
    let nav2 = SimulatedNav2::start(building.handle(), settings).await.expect("a robot");
    let dialect = match wire {
        RobotWire::Ros2Dds => "ros2dds",
        RobotWire::RmwZenoh(_) => "rmw-zenoh",
    };
    let poses: BTreeMap<&String, Value> =
        places.iter().map(|(name, (x, y))| (name, json!({ "x": x, "y": y }))).collect();
    let mut config = Value::clone(&entry.config);
    config["ros2"] = json!({
        "endpoint": nav2.endpoint(), "dialect": dialect, "namespace": "bot", "domain-id": 3,
        "places": poses,
    });
    entry.config = Arc::new(config);
    entry.driver = Some("ros2".to_owned());
    nav2
}

async fn check(scenario: Scenario, seeds: std::ops::Range<u64>) {
    for seed in seeds {
        for mode in MODES {
            let options = ScenarioOptions {
                replacement: Some(robots_with_ros),
                ..ScenarioOptions::new(scenario, seed, mode, ScenarioSubstrate::Zenoh)
            };
            let problems = problems(&options).await;
            assert!(problems.is_empty(), "{scenario:?} {seed} {mode:?}: {problems:#?}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn temperatures_are_measured_by_robots_that_speak_ros() {
    // A plan is cancelled here while the robot passes the pose of a third place.
    check(Scenario::Temperatures, 4..5).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn temperatures_are_kept_known_by_robots_that_speak_ros() {
    check(Scenario::Maintenance, 0..1).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn visitors_are_validated_by_robots_that_speak_ros() {
    check(Scenario::Access, 0..1).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_meeting_goes_on_with_robots_that_speak_ros() {
    check(Scenario::Meeting, 0..1).await;
}
