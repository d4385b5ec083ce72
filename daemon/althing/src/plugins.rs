//! The plugins that are built in: to add one, add its line.

use agent::PluginEntry;

/// All of them, in the order in which they are listed for people.
pub(crate) const PLUGINS: &[PluginEntry] = &[
    domain_maintainer::PLUGIN,
    plan_requester::PLUGIN,
    planning_agent::PLUGIN,
    plan_executor::PLUGIN,
    journal::PLUGIN,
    keyboard::PLUGIN,
    sensor::TEMPERATURE_SENSOR,
    sensor::PLUGIN,
    mqtt::PLUGIN,
    ir_temperature_sensor::PLUGIN,
    turtlebot::PLUGIN,
    cleaning_robot::PLUGIN,
    ptz_camera::PLUGIN,
    screen::PLUGIN,
    video_robot::PLUGIN,
];

/// The plugin of this name.
pub(crate) fn find(name: &str) -> Option<&'static PluginEntry> {
    PLUGINS.iter().find(|plugin| plugin.name == name)
}

/// Their names and drivers, for the ecosystem file.
pub(crate) fn known() -> Vec<crate::config::KnownPlugin> {
    let known = |plugin: &PluginEntry| crate::config::KnownPlugin {
        name: plugin.name,
        drivers: plugin.drivers,
        stands_by: plugin.stands_by,
    };
    PLUGINS.iter().map(known).collect()
}
