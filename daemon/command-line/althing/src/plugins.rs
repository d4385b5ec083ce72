//! The table of the plugins that are built in. A new plugin needs one more line in it.

use std::sync::Arc;

use acl::{AgentId, DaemonId};
use agent::PluginEntry;
use serde_json::Value;

use crate::config::AgentEntry;

/// All built-in plugins, in the order in which they are listed for users.
pub(crate) const PLUGINS: &[PluginEntry] = &[
    domain_maintainer::PLUGIN,
    plan_requester::PLUGIN,
    planning_agent::PLUGIN,
    plan_executor::PLUGIN,
    factored_agent::PLUGIN,
    journal::PLUGIN,
    history::PLUGIN,
    traces::PLUGIN,
    keyboard::PLUGIN,
    notifier::PLUGIN,
    doorkeeper::PLUGIN,
    sensor::TEMPERATURE_SENSOR,
    sensor::PLUGIN,
    sensor::BOARD,
    command::PLUGIN,
    ros2::PLUGIN,
    switch::PLUGIN,
    mqtt::PLUGIN,
    ir_temperature_sensor::PLUGIN,
    turtlebot::PLUGIN,
    cleaning_robot::PLUGIN,
    arm::PLUGIN,
    mover::PLUGIN,
    courier::PLUGIN,
    door::PLUGIN,
    lift::PLUGIN,
    tag_reader::PLUGIN,
    ptz_camera::PLUGIN,
    ptz_camera::FINDER,
    screen::PLUGIN,
    screen::FINDER,
    video_robot::PLUGIN,
    robot_watchdog::PLUGIN,
];

/// Returns the built-in plugin named `name`.
pub(crate) fn find(name: &str) -> Option<&'static PluginEntry> {
    PLUGINS.iter().find(|plugin| plugin.name == name)
}

/// Returns the entry of the agent that asks the people at a daemon whether new agents are admitted.
/// The agent is needed if the ecosystem file requires their consent.
pub(crate) fn doorkeeper(daemon: &DaemonId) -> AgentEntry {
    // The daemon's name is cut, because a name has a maximum length.
    let daemon_name: String = daemon.as_str().chars().take(48).collect();
    let name = AgentId::new(&format!("doorkeeper-{daemon_name}"));
    AgentEntry {
        path: String::new(),
        name: name.expect("invariant: names of daemons and of agents are of the same symbols"),
        plugin: doorkeeper::PLUGIN.name.to_owned(),
        package: None,
        daemons: vec![daemon.clone()],
        driver: None,
        config: Arc::new(Value::Null),
    }
}

/// Returns the names and drivers of all built-in plugins, for checking ecosystem files.
pub(crate) fn known() -> Vec<crate::config::KnownPlugin> {
    let known = |plugin: &PluginEntry| crate::config::KnownPlugin {
        name: plugin.name,
        drivers: plugin.drivers,
        stands_by: plugin.has_replicas,
    };
    PLUGINS.iter().map(known).collect()
}
