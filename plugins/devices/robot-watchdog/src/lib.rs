//! The watchdog of a robot with ROS 2. A robot goes on to its goal when the daemon that drives it is
//! gone; a watchdog on another machine then stops the robot, or sends it to its dock.
//!
//! - The watchdog follows the presence of the robot's agent. It does nothing before it has seen the
//!   agent once, and nothing any more when the agent is back.
//! - It has a link of its own to the robot, and tries again until the robot has confirmed.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use acl::AgentId;
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, LaunchableAgent, PluginEntry, Presence,
    WorkHandle, config_duration,
};
use ros2_link::{Nav2Names, Nav2Robot, RosAddress, RosError, RosLink, VelocityMessage};
use serde::Deserialize;

/// Time limit of one attempt to stop the robot. The link and each answer take some seconds at most.
const STOPPED_WITHIN: Duration = Duration::from_secs(10);

/// Maximum time for which the agent of a robot may be gone.
const AFTER_MAX: Duration = Duration::from_hours(1);

/// Pause before a failed attempt is repeated.
const TRY_AGAIN: Duration = Duration::from_secs(1);

/// The entry of the watchdog in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "robot-watchdog",
    about: "stops a robot with ROS 2, or docks it, when the daemon that drives it is gone",
    drivers: &[],
    has_replicas: false,
    build,
};

/// The `config` of a watchdog's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// Name of the robot's agent.
    robot: AgentId,
    /// What is done when the agent is gone.
    on_loss: OnLoss,
    /// How long the agent may be gone before that: a restart of its daemon takes less.
    #[serde(default = "default_after")]
    after: String,
    /// Address of the robot.
    ros2: RosAddress,
    /// Type of the messages that set the robot's velocity.
    #[serde(default)]
    velocity: VelocityMessage,
}

/// What a watchdog does when the robot's agent is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum OnLoss {
    /// The robot stands still.
    Stop,
    /// The robot stands still, and then docks. It has to be near its dock.
    Dock,
}

fn default_after() -> String {
    "2s".to_owned()
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { robot, on_loss, after, ros2, velocity } = blueprint.config_as()?;
    let problem = |text: String| blueprint.problem(text);
    let after = config_duration("after", &after, Duration::ZERO..=AFTER_MAX).map_err(problem)?;
    ros2.check().map_err(|error| problem(format!("ros2: {error}")))?;
    if robot == blueprint.id {
        return Err(problem("robot: a watchdog watches another agent than itself".to_owned()));
    }
    Ok(Box::new(RobotWatchdog {
        robot,
        on_loss,
        after,
        link: Arc::new(WatchedRobot { address: ros2, velocity, robot: OnceLock::new() }),
        has_seen: false,
        intervention: None,
    }))
}

struct RobotWatchdog {
    robot: AgentId,
    on_loss: OnLoss,
    after: Duration,
    link: Arc<WatchedRobot>,
    /// Whether the robot's agent was present at least once.
    has_seen: bool,
    /// The work that waits, and then stops the robot; `None` while its agent is present.
    intervention: Option<WorkHandle>,
}

/// The robot, with the link that is opened when it is needed first.
struct WatchedRobot {
    address: RosAddress,
    velocity: VelocityMessage,
    robot: OnceLock<Nav2Robot>,
}

impl Agent for RobotWatchdog {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.has_seen = ctx.find(&self.robot).is_some();
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        match presence {
            Presence::Joined(resident) if resident.agent == self.robot => {
                self.has_seen = true;
                self.intervention = None;
            }
            Presence::Left(resident)
                if resident.agent == self.robot && ctx.find(&self.robot).is_none() =>
            {
                self.intervene(ctx);
            }
            Presence::Joined(_) | Presence::Left(_) => (),
        }
    }
}

impl RobotWatchdog {
    /// Stops the robot after a while, unless its agent returns.
    fn intervene(&mut self, ctx: &mut Context<Self>) {
        if !self.has_seen {
            return;
        }
        let RobotWatchdog { robot, on_loss, after, link, .. } = self;
        let (name, on_loss, after) = (robot.to_string(), *on_loss, *after);
        let link = Arc::clone(link);
        let work = async move {
            tokio::time::sleep(after).await;
            tracing::warn!(robot = name, ?on_loss, "its agent is gone: the watchdog intervenes");
            while let Err(error) = link.end(on_loss).await {
                tracing::warn!(robot = name, %error, "it perhaps goes on; it is tried again");
                tokio::time::sleep(TRY_AGAIN).await;
            }
            tracing::warn!(robot = name, ?on_loss, "has confirmed");
        };
        self.intervention = Some(ctx.run(work, |_: &mut Self, (), _| ()));
    }
}

impl WatchedRobot {
    fn robot(&self) -> &Nav2Robot {
        self.robot.get_or_init(|| {
            let interfaces = Arc::new(ros2_link::standard_interfaces());
            let link = RosLink::open(self.address.clone(), interfaces);
            let link = link.expect("invariant: the address was checked when the agent was built");
            Nav2Robot::new(link, Nav2Names::default())
        })
    }

    async fn end(&self, on_loss: OnLoss) -> Result<(), RosError> {
        let still = tokio::time::timeout(STOPPED_WITHIN, self.robot().stand_still(self.velocity));
        still.await.unwrap_or_else(|_| {
            Err(RosError::Robot(format!("see it stand still within {STOPPED_WITHIN:?}")))
        })?;
        match on_loss {
            OnLoss::Stop => Ok(()),
            OnLoss::Dock => self.robot().dock().await,
        }
    }
}
