//! Test that the simulated building continues when the process that served it is gone.

use std::collections::BTreeMap;

use building::BuildingHandle;

use super::*;
use crate::hosting::building_takeover::{record_robots, serve};

const ROBOT: &str = r#"{ start = "corridor", dock = "corridor", battery = { range = 900.0 } }"#;

/// After a take-over the robot stands where it was last seen, with the charge that it had left, and
/// all processes see the same new building.
#[tokio::test]
async fn a_building_takeover_keeps_the_robots_in_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let entries = entry("turtlebot-1", "turtlebot", ROBOT) + "[building]\ntime-scale = 0.001\n";
    let ecosystem = ecosystem(&folder, &entries, Mode::Decentralized);
    let socket = folder.path().join("building");
    let first = simulate(&ecosystem).expect("a building");
    let server = ::building::serve(first.handle(), &socket).await.expect("it is served");
    let used = BuildingHandle::connect(&socket).await.expect("it is served");
    used.navigate("turtlebot-1", "office1").await.expect("it drives");
    let charge = used.charge_of("turtlebot-1").await.expect("it is there").expect("a battery");
    assert!(charge < 900.0, "it drove: {charge}");

    let mut seen = BTreeMap::new();
    assert!(record_robots(&ecosystem, &used, &mut seen).await);
    let early = serve(&ecosystem, &seen, &socket).await;
    assert!(early.expect("it can be looked at").is_none(), "it is served already");
    drop(server);
    assert!(!record_robots(&ecosystem, &used, &mut seen).await);

    let _served = serve(&ecosystem, &seen, &socket).await.expect("it can be").expect("it is free");
    assert_eq!(used.place_of("turtlebot-1").await.expect("it is there"), "office1");
    let left = used.charge_of("turtlebot-1").await.expect("it is there").expect("a battery");
    assert!((left - charge).abs() < 1e-6, "{left} of {charge}");
}
