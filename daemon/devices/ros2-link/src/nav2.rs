//! A robot that drives with Nav2, and docks as the iRobot Create 3 (the base of the TurtleBot 4)
//! does.
//!
//! - A goal that Nav2 rejects because it is not active yet is sent again when it is active.
//! - Results are read by their beginning, because each distribution has appended to them: Humble
//!   has an empty result, Iron an error code, Jazzy also a text.
//! - A docked robot is undocked before it drives.

use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::sync::OnceCell;
use tokio::time::Instant;

use crate::action::{ActionClient, GoalEnd, RosGoalStatus};
use crate::error::{RosError, printable};
use crate::link::RosLink;
use crate::pose::MapPose;
use crate::topic::TopicReader;

/// How long each operation awaits a link to the robot. A daemon and its robot often start together.
/// If the robot still boots after this time, the operation fails, and a later plan tries it again.
const LINK_TIMEOUT: Duration = Duration::from_secs(5);

/// How long a service of a robot may take to answer.
const SERVICE_TIMEOUT: Duration = Duration::from_secs(3);

/// How long a drive waits for an inactive Nav2. Nav2 takes some ten seconds to become active after
/// its start.
const ACTIVE_TIMEOUT: Duration = Duration::from_secs(60);

/// Pause between two requests for the state of Nav2.
const ACTIVE_POLL: Duration = Duration::from_millis(500);

/// Time limit of docking and undocking. The Create 3 gives up by itself after less.
const DOCKING_TIMEOUT: Duration = Duration::from_secs(90);

/// Variance of a coordinate, in m², above which a robot does not know where it is. AMCL begins with
/// 0.25 after an initial pose, and is far below 0.1 in a known place.
const LOCALIZED_VARIANCE: f64 = 1.0;

/// Variances of an initial pose, as RViz sends them: the squares of half a meter and of 15 degrees.
const INITIAL_VARIANCE: f64 = 0.25;
const INITIAL_YAW_VARIANCE: f64 = 0.068_5;

/// Share of the battery at which it counts as full. Many batteries never report 100 %.
const FULL: f64 = 0.98;

const DOCK_TYPE: &str = "irobot_create_msgs/action/Dock";
const UNDOCK_TYPE: &str = "irobot_create_msgs/action/Undock";
const POSE_TYPE: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";

/// Names of a robot's topics, services and actions, without its namespace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Nav2Names {
    /// Action of the type `nav2_msgs/action/NavigateToPose`.
    pub navigate: String,
    /// Service of the type `lifecycle_msgs/srv/GetState`, with the answer whether Nav2 is active.
    pub state: String,
    /// Topic of the type `geometry_msgs/msg/PoseWithCovarianceStamped`: the localization.
    pub pose: String,
    /// Topic of the same type that sets the localization.
    pub initial_pose: String,
    /// Topic of the type `sensor_msgs/msg/BatteryState`.
    pub battery: String,
    /// Topic of the type `irobot_create_msgs/msg/DockStatus`.
    pub dock_status: String,
    /// Action of the type `irobot_create_msgs/action/Dock`.
    pub dock: String,
    /// Action of the type `irobot_create_msgs/action/Undock`.
    pub undock: String,
    /// Topic that sets the velocity: see [`crate::VelocityMessage`].
    pub velocity: String,
}

impl Default for Nav2Names {
    /// Returns the names of Nav2 and of the TurtleBot 4.
    fn default() -> Nav2Names {
        let name = str::to_owned;
        Nav2Names {
            navigate: name("navigate_to_pose"),
            state: name("bt_navigator/get_state"),
            pose: name("amcl_pose"),
            initial_pose: name("initialpose"),
            battery: name("battery_state"),
            dock_status: name("dock_status"),
            dock: name("dock"),
            undock: name("undock"),
            velocity: name("cmd_vel"),
        }
    }
}

/// A robot that drives with Nav2.
#[derive(Clone)]
pub struct Nav2Robot {
    link: RosLink,
    names: Arc<Nav2Names>,
    topics: Arc<OnceCell<RobotTopics>>,
    /// Copies of the subscriptions, for [`Nav2Robot::next_message`]: they remember for which
    /// messages it has returned.
    unread: Arc<tokio::sync::Mutex<Option<RobotTopics>>>,
}

/// Subscriptions to a robot, made when it is linked.
#[derive(Clone)]
struct RobotTopics {
    navigation: ActionClient,
    pose: TopicReader,
    battery: TopicReader,
    dock_status: TopicReader,
}

impl Nav2Robot {
    /// Creates a robot at the other end of `link`.
    pub fn new(link: RosLink, names: Nav2Names) -> Nav2Robot {
        Nav2Robot { link, names: Arc::new(names), topics: Arc::default(), unread: Arc::default() }
    }

    pub(crate) fn names(&self) -> &Nav2Names {
        &self.names
    }

    pub(crate) async fn navigation(&self) -> Result<ActionClient, RosError> {
        Ok(self.topics().await?.navigation)
    }

    pub(crate) async fn docking(&self) -> Result<ActionClient, RosError> {
        ActionClient::new(&self.link, &self.names.dock, DOCK_TYPE, LINK_TIMEOUT).await
    }

    pub(crate) async fn undocking(&self) -> Result<ActionClient, RosError> {
        ActionClient::new(&self.link, &self.names.undock, UNDOCK_TYPE, LINK_TIMEOUT).await
    }

    async fn topics(&self) -> Result<RobotTopics, RosError> {
        let topics = self.topics.get_or_try_init(async || {
            let Nav2Names { navigate, pose, battery, dock_status, .. } = &*self.names;
            let topic = |name, type_name| self.link.subscribe(name, type_name, LINK_TIMEOUT);
            let action = "nav2_msgs/action/NavigateToPose";
            Ok(RobotTopics {
                navigation: ActionClient::new(&self.link, navigate, action, LINK_TIMEOUT).await?,
                pose: topic(pose, POSE_TYPE).await?,
                battery: topic(battery, "sensor_msgs/msg/BatteryState").await?,
                dock_status: topic(dock_status, "irobot_create_msgs/msg/DockStatus").await?,
            })
        });
        topics.await.cloned()
    }

    /// Whether this machine is linked to the robot's bridge or router at present.
    pub async fn is_linked(&self) -> bool {
        self.link.is_linked().await
    }

    /// Returns the pose of the robot; `None` if the robot has reported none, or is uncertain of it.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link to the robot, or if its message cannot be read.
    pub async fn pose(&self) -> Result<Option<MapPose>, RosError> {
        let message = self.topics().await?.pose.latest()?;
        Ok(message.as_ref().and_then(localized))
    }

    /// Waits until the robot has reported its pose at least once.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link to the robot, or if its message cannot be read.
    pub async fn first_pose(&self) -> Result<(), RosError> {
        let mut pose = self.topics().await?.pose;
        match pose.latest()? {
            Some(_) => Ok(()),
            None => pose.next().await.map(drop),
        }
    }

    /// Waits for a message of the robot about its pose, its battery or its dock. All messages of
    /// one topic that came before the call count as one.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link to the robot, or if the message cannot be read.
    pub async fn next_message(&self) -> Result<(), RosError> {
        let mut unread = self.unread.lock().await;
        if unread.is_none() {
            *unread = Some(self.topics().await?);
        }
        let Some(RobotTopics { pose, battery, dock_status, .. }) = unread.as_mut() else {
            return Ok(());
        };
        tokio::select! {
            message = pose.next() => message.map(drop),
            message = battery.next() => message.map(drop),
            message = dock_status.next() => message.map(drop),
        }
    }

    /// Whether the robot is docked, according to its last message; `false` if there is none.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link to the robot, or if its message cannot be read.
    pub async fn is_docked(&self) -> Result<bool, RosError> {
        is_docked(&mut self.topics().await?.dock_status)
    }

    /// Tells the robot where it stands.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link to the robot.
    pub async fn set_pose(&self, pose: MapPose) -> Result<(), RosError> {
        let mut covariance = [0.0; 36];
        (covariance[0], covariance[7]) = (INITIAL_VARIANCE, INITIAL_VARIANCE);
        covariance[35] = INITIAL_YAW_VARIANCE;
        let message = json!({
            "header": { "frame_id": "map" },
            "pose": { "pose": pose.to_message(), "covariance": covariance.to_vec() },
        });
        let topic = &self.names.initial_pose;
        self.link.publish(topic, POSE_TYPE, &message, LINK_TIMEOUT).await
    }

    /// Publishes one message on any topic of the robot.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link to the robot, or if the message does not have its type.
    pub async fn publish(
        &self,
        topic: &str,
        type_name: &str,
        message: &Value,
    ) -> Result<(), RosError> {
        self.link.publish(topic, type_name, message, LINK_TIMEOUT).await
    }

    /// Calls any service of the robot.
    ///
    /// # Errors
    ///
    /// Returns an error if no node of the robot answers in time, or if a message does not have its
    /// type.
    pub async fn call(
        &self,
        service: &str,
        type_name: &str,
        request: &Value,
    ) -> Result<Value, RosError> {
        self.link.call(service, type_name, request, SERVICE_TIMEOUT).await
    }

    /// Returns the charge of the battery between 0 and 1; `None` if the robot has not reported it.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link to the robot, or if its message cannot be read.
    pub async fn charge(&self) -> Result<Option<f64>, RosError> {
        let message = self.topics().await?.battery.latest()?;
        Ok(message.as_ref().and_then(charge_of))
    }

    /// Drives to a pose. `on_feedback` is called with the remaining distance in meters. Dropping
    /// the future cancels the goal.
    ///
    /// # Errors
    ///
    /// Returns the reason why the robot did not arrive.
    pub async fn drive(
        &self,
        to: MapPose,
        mut on_feedback: impl FnMut(f64) + Send,
    ) -> Result<(), RosError> {
        let mut topics = self.topics().await?;
        if is_docked(&mut topics.dock_status)? {
            run(&self.undocking().await?).await?;
        }
        let goal = json!({
            "pose": { "header": { "frame_id": "map" }, "pose": to.to_message() },
        });
        let mut sent = match topics.navigation.send(&goal).await {
            Err(RosError::Rejected { .. }) => {
                self.until_active().await?;
                topics.navigation.send(&goal).await?
            }
            other => other?,
        };
        let end = sent
            .end(|feedback| {
                if let Some(meters) = feedback["distance_remaining"].as_f64() {
                    on_feedback(meters);
                }
            })
            .await?;
        arrived(&end)
    }

    /// Waits until Nav2 is active.
    async fn until_active(&self) -> Result<(), RosError> {
        let (service, began, request) = (&self.names.state, Instant::now(), json!({}));
        let mut is_told = false;
        loop {
            let asked =
                self.link.call(service, "lifecycle_msgs/srv/GetState", &request, SERVICE_TIMEOUT);
            let label = match asked.await {
                Ok(answer) => answer["current_state"]["label"].as_str().unwrap_or("").to_owned(),
                Err(RosError::NoAnswer { .. }) => "not running".to_owned(),
                Err(error) => return Err(error),
            };
            if label == "active" {
                return Ok(());
            }
            if began.elapsed() > ACTIVE_TIMEOUT {
                return Err(RosError::Robot(format!(
                    "drive: Nav2 rejected the goal, and is {label} (`{service}`); it is waited for \
                     {ACTIVE_TIMEOUT:?}, until it is active"
                )));
            }
            if !std::mem::replace(&mut is_told, true) {
                tracing::info!(service, state = label, "Nav2 is not active; it is waited for");
            }
            tokio::time::sleep(ACTIVE_POLL).await;
        }
    }

    /// Docks the robot, unless it is docked already.
    ///
    /// # Errors
    ///
    /// Returns the reason why the robot did not dock.
    pub async fn dock(&self) -> Result<(), RosError> {
        match is_docked(&mut self.topics().await?.dock_status)? {
            true => Ok(()),
            false => run(&self.docking().await?).await,
        }
    }

    /// Docks, and waits until the battery is full.
    ///
    /// # Errors
    ///
    /// Returns the reason why the robot did not dock, or an error if it leaves the dock.
    pub async fn recharge(&self) -> Result<(), RosError> {
        let mut topics = self.topics().await?;
        self.dock().await?;
        // The first messages may be older than the end of the docking.
        let mut was_docked = false;
        loop {
            let charge = topics.battery.latest()?.as_ref().and_then(charge_of);
            if charge.is_some_and(|charge| charge >= FULL) {
                return Ok(());
            }
            tokio::select! {
                battery = topics.battery.next() => { battery?; }
                dock = topics.dock_status.next() => {
                    let is_docked = dock?["is_docked"] == json!(true);
                    if was_docked && !is_docked {
                        return Err(RosError::Robot("stay in the dock".to_owned()));
                    }
                    was_docked |= is_docked;
                }
            }
        }
    }
}

/// Runs an action of the dock to its end.
async fn run(client: &ActionClient) -> Result<(), RosError> {
    let name = client.name();
    let mut goal = client.send(&json!({})).await?;
    let ended = tokio::time::timeout(DOCKING_TIMEOUT, goal.end(|_| ())).await;
    match ended {
        Ok(end) => match end?.status {
            RosGoalStatus::Succeeded => Ok(()),
            _ => Err(RosError::Robot(format!("{name}: the robot gave it up"))),
        },
        Err(_) => Err(RosError::Robot(format!("{name} within {DOCKING_TIMEOUT:?}"))),
    }
}

fn is_docked(dock_status: &mut TopicReader) -> Result<bool, RosError> {
    let message = dock_status.latest()?;
    Ok(message.is_some_and(|message| message["is_docked"] == json!(true)))
}

/// Returns the pose in a message of the localization; `None` if it is uncertain, or is not a pose.
fn localized(message: &Value) -> Option<MapPose> {
    let variance = |index: usize| message["pose"]["covariance"][index].as_f64();
    let is_certain = |index| variance(index).is_some_and(|it| it.abs() <= LOCALIZED_VARIANCE);
    let is_known = is_certain(0) && is_certain(7);
    is_known.then(|| MapPose::of_message(&message["pose"]["pose"])).flatten()
}

/// Returns the charge in a message of the battery, between 0 and 1; `None` if it has none. Some
/// robots report percent, although the message is defined otherwise.
fn charge_of(message: &Value) -> Option<f64> {
    let share = message["percentage"].as_f64().filter(|share| *share >= 0.0)?;
    Some(if share > 1.0 { share / 100.0 } else { share }.min(1.0))
}

/// Returns an error if the goal to drive somewhere ended without arrival.
fn arrived(end: &GoalEnd) -> Result<(), RosError> {
    let other = match end.status {
        RosGoalStatus::Succeeded => return Ok(()),
        RosGoalStatus::Canceled => Some("another program cancelled the goal"),
        _ if end.is_replaced => Some("another program's goal took the place of this one"),
        _ => None,
    };
    if let Some(other) = other {
        return Err(RosError::Robot(format!("drive there: {other}")));
    }
    let message = end.result["error_msg"].as_str().unwrap_or_default();
    let code = end.result["error_code"].as_u64().filter(|code| *code != 0);
    let reason = match (message, code) {
        ("", None) => "Nav2 gave up, and gives no reason".to_owned(),
        ("", Some(code)) => format!("Nav2 gave up with error {code}"),
        (message, None) => format!("Nav2 gave up: {}", printable(message)),
        (message, Some(code)) => format!("Nav2 gave up: {} (error {code})", printable(message)),
    };
    Err(RosError::NoWay { reason })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn end(status: RosGoalStatus, result: Value, is_replaced: bool) -> String {
        let end = GoalEnd { status, result, is_replaced };
        arrived(&end).map_or_else(|error| error.to_string(), |()| "arrived".to_owned())
    }

    #[test]
    fn each_end_of_a_goal_has_its_reason() {
        let aborted = |result| end(RosGoalStatus::Aborted, result, false);
        assert_eq!(end(RosGoalStatus::Succeeded, json!({}), false), "arrived");
        assert_eq!(aborted(json!({})), "drive there: Nav2 gave up, and gives no reason");
        assert_eq!(
            aborted(json!({"error_code": 9003})),
            "drive there: Nav2 gave up with error 9003"
        );
        assert_eq!(
            aborted(json!({"error_code": 1, "error_msg": "no\u{1b}[31m path"})),
            "drive there: Nav2 gave up: no [31m path (error 1)"
        );
        assert!(end(RosGoalStatus::Aborted, json!({}), true).contains("another program's goal"));
        assert!(end(RosGoalStatus::Canceled, json!({}), false).contains("cancelled"));
    }

    #[test]
    fn a_charge_is_a_share_or_percent_and_an_unknown_one_is_none() {
        for (percentage, charge) in [
            (json!(0.5), Some(0.5)),
            (json!(73.0), Some(0.73)),
            (json!("nan"), None),
            (json!(-1.0), None),
            (json!(250.0), Some(1.0)),
        ] {
            assert_eq!(charge_of(&json!({ "percentage": percentage })), charge, "{percentage}");
        }
    }

    #[test]
    fn an_uncertain_pose_is_none() {
        let message = |variance: f64| {
            let mut covariance = [0.0; 36];
            covariance[7] = variance;
            let pose = MapPose { x: 1.0, y: 2.0, yaw: 0.0 }.to_message();
            json!({ "pose": { "pose": pose, "covariance": covariance.to_vec() } })
        };
        assert!(localized(&message(0.1)).is_some());
        assert_eq!(localized(&message(3.0)), None);
        assert_eq!(localized(&json!({})), None);
    }
}
