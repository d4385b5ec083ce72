//! Watchdogs of robots with ROS 2: warns of robots without one, which go on to their goals when their
//! daemon dies, and of watchdogs that would not reach their robots.

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
        for (key, default) in ADDRESS {
            let written = |entry: &AgentEntry| match &entry.config["ros2"][*key] {
                Value::Null => (*default).to_owned(),
                value => value.to_string(),
            };
            let (own, other) = (written(watchdog), written(robot));
            if own != other {
                let message = format!("`{key}` is not that of `{}`", robot.name);
                let help = format!("write {key} = {other}");
                let path = format!("{}.config.ros2", watchdog.path);
                self.about_key(&path, |span| Diagnostic::warning(span, message).with_help(help));
            }
        }
    }
}

fn is_robot(entry: &&AgentEntry) -> bool {
    ROBOTS.contains(&entry.plugin.as_str()) && entry.driver.as_deref() == Some(ROS2)
}
