//! Robots with ROS 2 without a watchdog: they go on to their goals when their daemon dies, and the
//! file says so.

use pddl::Diagnostic;

use super::Interpreter;
use crate::config::ecosystem::AgentEntry;

/// The plugins of robots, and the driver with which a robot goes on by itself.
const ROBOTS: &[&str] = &["cleaning-robot", "turtlebot", "video-robot"];
const ROS2: &str = "ros2";

const WATCHDOG: &str = "robot-watchdog";

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Warns of each robot that no watchdog on another machine can stop.
    pub(super) fn warn_unwatched_robots(&mut self, agents: &[AgentEntry]) {
        let is_robot = |entry: &&AgentEntry| {
            ROBOTS.contains(&entry.plugin.as_str()) && entry.driver.as_deref() == Some(ROS2)
        };
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
}
