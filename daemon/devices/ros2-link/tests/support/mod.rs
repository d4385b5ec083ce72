//! A router of Zenoh that stands for a robot, and a link to it.

use std::sync::Arc;
use std::time::Duration;

use ros_messages::Interfaces;
use ros2_link::{RosAddress, RosDialect, RosLink};
use serde_json::json;
use zenoh::Session;

/// How long a step may take, on a loaded machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(30);

/// Opens the router of a robot. Returns it with its endpoint.
pub(crate) async fn robot() -> (Session, String) {
    let settings = json!({
        "mode": "router",
        "listen": { "endpoints": ["tcp/127.0.0.1:0"] },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
    });
    let config = zenoh::Config::from_json5(&settings.to_string()).expect("a config");
    let session = zenoh::open(config).await.expect("a router");
    let endpoint = session.info().locators().await.first().expect("an endpoint").to_string();
    (session, endpoint)
}

/// Returns a link to the robot, whose keys are names of ROS.
pub(crate) fn link(endpoint: &str) -> RosLink {
    let address = RosAddress {
        endpoint: endpoint.to_owned(),
        dialect: RosDialect::Ros2Dds,
        namespace: String::new(),
        domain_id: 0,
    };
    RosLink::open(address, Arc::new(Interfaces::standard())).expect("an address")
}
