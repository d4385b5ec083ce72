//! Robots with ROS 2 and their watchdogs: warns of robots without a watchdog, which go on to their goals
//! when their daemon dies, of watchdogs that would not reach their robots, and of domains without effect.

use mobile_base::{RosDialect, ros_address};
use pddl::Diagnostic;
use serde_json::Value;

use super::Interpreter;
use crate::config::ecosystem::AgentEntry;

/// The plugins of robots, and the driver with which a robot goes on by itself.
const ROBOTS: &[&str] = &["cleaning-robot", "turtlebot", "video-robot"];
const ROS2: &str = "ros2";

const WATCHDOG: &str = "robot-watchdog";

/// Keys of a robot's address, each with the value that it has if it is left out, as JSON.
const ADDRESS: &[(&str, &str)] =
    &[("endpoint", "\"\""), ("dialect", "\"ros2dds\""), ("namespace", "\"\""), ("domain-id", "0")];

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Warns of each robot that no watchdog on another machine can stop, and of each watchdog that
    /// watches something else than a robot, or has another address than the robot.
    pub(super) fn warn_unwatched_robots(&mut self, agents: &[AgentEntry]) {
        for watchdog in agents.iter().filter(|entry| entry.plugin == WATCHDOG) {
            self.check_watchdog(watchdog, agents);
        }
        for robot in agents.iter().filter(is_robot) {
            let of_it = |entry: &&AgentEntry| {
                entry.plugin == WATCHDOG && entry.config["robot"] == robot.name.as_str()
            };
            let is_apart = |watchdog: &AgentEntry| {
                !watchdog.daemons.iter().any(|daemon| robot.daemons.contains(daemon))
                    && watchdog.daemons != robot.daemons
            };
            let watchdogs: Vec<&AgentEntry> = agents.iter().filter(of_it).collect();
            let name = &robot.name;
            let help = match watchdogs.as_slice() {
                [] => format!(
                    "an agent with plugin = \"{WATCHDOG}\" and robot = \"{name}\", on another \
                     daemon, can stop it or dock it"
                ),
                some if some.iter().any(|watchdog| is_apart(watchdog)) => continue,
                [one, ..] => format!("give `{}` another daemon than `{name}` has", one.name),
            };
            let message = format!("if the daemon of `{name}` dies, the robot finishes its goal");
            self.about_key(&robot.path, |span| Diagnostic::warning(span, message).with_help(help));
        }
    }

    fn check_watchdog(&mut self, watchdog: &AgentEntry, agents: &[AgentEntry]) {
        // An agent that the file does not name is reported already.
        let watched = |entry: &&AgentEntry| watchdog.config["robot"] == entry.name.as_str();
        let Some(robot) = agents.iter().find(watched) else { return };
        if !is_robot(&robot) {
            let message = format!("`{}` is no robot with driver = \"{ROS2}\"", robot.name);
            let help = "a watchdog can stop robots with Nav2 only";
            let path = format!("{}.config.robot", watchdog.path);
            return self
                .about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
        }
        // An address that is missing or refused is reported already, and says nothing of the other.
        let addresses = (ros_address(&watchdog.config), ros_address(&robot.config));
        let (Some(own), Some(other)) = addresses else { return };
        let differs = |key: &str| match key {
            "endpoint" => own.endpoint != other.endpoint,
            "dialect" => own.dialect != other.dialect,
            "namespace" => own.namespace != other.namespace,
            _ => other.dialect.has_domain() && own.domain_id != other.domain_id,
        };
        for (key, default) in ADDRESS.iter().filter(|(key, _)| differs(key)) {
            let right = match &robot.config["ros2"][*key] {
                Value::Null => (*default).to_owned(),
                value => value.to_string(),
            };
            let message = format!("`{key}` is not that of `{}`", robot.name);
            let help = format!("write {key} = {right}");
            let path = format!("{}.config.ros2", watchdog.path);
            self.about_key(&path, |span| Diagnostic::warning(span, message).with_help(help));
        }
    }

    /// Warns of each ROS domain that has no effect, because a bridge names the domain by itself.
    pub(super) fn warn_idle_domains(&mut self, agents: &[AgentEntry]) {
        for entry in agents {
            let table = &entry.config["ros2"];
            let dialect = match &table["dialect"] {
                Value::Null => Some(RosDialect::default()),
                value => value.as_str().and_then(|text| text.parse().ok()),
            };
            let is_idle = dialect.is_some_and(|dialect| !dialect.has_domain());
            let Some(domain) = table["domain-id"].as_u64().filter(|id| *id > 0 && is_idle) else {
                continue;
            };
            let message = "`domain-id` has no effect with dialect = \"ros2dds\"";
            let help = format!(
                "leave it out, and give the domain to the bridge: zenoh-bridge-ros2dds -d {domain}"
            );
            let path = format!("{}.config.ros2.domain-id", entry.path);
            self.about_key(&path, |span| Diagnostic::warning(span, message).with_help(help));
        }
    }
}

fn is_robot(entry: &&AgentEntry) -> bool {
    ROBOTS.contains(&entry.plugin.as_str()) && entry.driver.as_deref() == Some(ROS2)
}
