//! A robot with Nav2 that drives in the simulated building. It is reached over Zenoh as real
//! robots are, through a bridge or with `rmw_zenoh`, and its truth is that of the building.
//!
//! - Nav2 rejects goals while it is not active ([`SimulatedNav2::set_active`]). A new goal takes
//!   the place of the running one. A cancelled goal ends as such. Where no way leads, Nav2 tries
//!   for a while, and gives up with a code and a text.
//! - The localization follows the robot, also if it is carried away in the building.
//!   [`SimulatedNav2::set_localized`] makes it uncertain.
//! - The battery is that of the building; docking charges it.

mod action_server;
mod wire;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use building::BuildingHandle;
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio_util::task::AbortOnDropHandle;

use crate::action_server::{AcceptsGoals, ActionServer, Feedback, RunGoal};
use crate::wire::RobotNode;

pub use wire::RobotWire;

/// Interval of the localization, the battery and the dock status. Real robots publish the first
/// after each movement, the others once or more per second.
const TELEMETRY_INTERVAL: Duration = Duration::from_millis(100);

/// Interval of the feedback of a goal; that of Nav2's behaviour trees is 10 ms.
const FEEDBACK_INTERVAL: Duration = Duration::from_millis(20);

/// Time for which Nav2 tries to find another way before it gives up: that of its recoveries, which
/// take half a minute in reality.
const RECOVERY_TIME: Duration = Duration::from_millis(100);

/// Farthest distance of a goal from a place of the building, in meters.
const NEAR: f64 = 0.5;

/// Error code of Nav2 for a goal that cannot be reached.
const NO_WAY: u16 = 9_000;

const POSE: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";

/// A robot of the simulated building, and where its places are on the robot's map.
#[derive(Clone, Debug)]
pub struct Nav2Settings {
    /// Name of the robot in the building.
    pub robot: String,
    /// How the names of ROS are put on Zenoh.
    pub wire: RobotWire,
    /// Endpoint at which the robot listens; `None` for a port of loopback that the kernel chooses.
    pub listen: Option<String>,
    /// Namespace of the robot; may be empty.
    pub namespace: String,
    /// Position of each place on the robot's map, in meters.
    pub places: BTreeMap<String, (f64, f64)>,
    /// Range of a full battery in meters; `None` without a battery.
    pub battery_range: Option<f64>,
}

/// A running simulated robot. Dropping it ends its session, as if the robot was switched off.
pub struct SimulatedNav2 {
    endpoint: String,
    state: Arc<DrivingRobot>,
    _tasks: Vec<AbortOnDropHandle<()>>,
    _initial_pose: zenoh::pubsub::Subscriber<()>,
}

struct DrivingRobot {
    node: Arc<RobotNode>,
    building: BuildingHandle,
    settings: Nav2Settings,
    is_active: AtomicBool,
    is_localized: AtomicBool,
    is_docked: AtomicBool,
    /// Whether action servers answer questions for results.
    answers_results: Arc<AtomicBool>,
    /// Number of goals that Nav2 has accepted or rejected.
    goals: watch::Sender<u64>,
    initial_poses: AtomicU64,
}

impl SimulatedNav2 {
    /// Starts the robot.
    ///
    /// # Errors
    ///
    /// Returns an error if Zenoh cannot open the router.
    pub async fn start(
        building: BuildingHandle,
        settings: Nav2Settings,
    ) -> zenoh::Result<SimulatedNav2> {
        let (node, endpoint) = RobotNode::open(&settings).await?;
        let node = Arc::new(node);
        let state = Arc::new(DrivingRobot {
            node: Arc::clone(&node),
            building,
            settings,
            is_active: AtomicBool::new(true),
            is_localized: AtomicBool::new(true),
            is_docked: AtomicBool::new(false),
            answers_results: Arc::new(AtomicBool::new(true)),
            goals: watch::Sender::new(0),
            initial_poses: AtomicU64::new(0),
        });
        let told = Arc::clone(&state);
        let initial_pose = node.subscribe("initialpose", POSE, move |_| {
            told.initial_poses.fetch_add(1, Ordering::Relaxed);
            told.is_localized.store(true, Ordering::Relaxed);
        });
        let initial_pose = initial_pose.await?;
        let mut tasks = serve_actions(&node, &state).await?;
        tasks.push(serve_lifecycle(&node, &state).await?);
        tasks.push(AbortOnDropHandle::new(tokio::spawn(Arc::clone(&state).tell())));
        Ok(SimulatedNav2 { endpoint, state, _tasks: tasks, _initial_pose: initial_pose })
    }

    /// Switches the robot off, and waits until its endpoint is free.
    pub async fn close(self) {
        let node = Arc::clone(&self.state.node);
        drop(self);
        // An error means that the session is closed already.
        drop(node.session.close().await);
    }

    /// Returns the Zenoh endpoint at which the robot is reached.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }

    /// Makes Nav2 active or inactive. An inactive Nav2 rejects goals.
    pub fn set_active(&self, is_active: bool) {
        self.state.is_active.store(is_active, Ordering::Relaxed);
    }

    /// Makes the localization certain or uncertain.
    pub fn set_localized(&self, is_localized: bool) {
        self.state.is_localized.store(is_localized, Ordering::Relaxed);
    }

    /// Makes the action servers drop questions for results, or answer them. The topics of the actions
    /// go on.
    pub fn set_answers_results(&self, answers: bool) {
        self.state.answers_results.store(answers, Ordering::Relaxed);
    }

    /// Whether the robot stands in its dock.
    pub fn is_docked(&self) -> bool {
        self.state.is_docked.load(Ordering::Relaxed)
    }

    /// Returns the number of goals that were sent to Nav2.
    pub fn goals(&self) -> u64 {
        *self.state.goals.borrow()
    }

    /// Waits until Nav2 has been sent this number of goals.
    pub async fn until_goals(&self, number: u64) {
        // The sender lives as long as the robot.
        drop(self.state.goals.subscribe().wait_for(|goals| *goals >= number).await);
    }

    /// Returns how often the robot was told where it stands.
    pub fn initial_poses(&self) -> u64 {
        self.state.initial_poses.load(Ordering::Relaxed)
    }
}

async fn serve_actions(
    node: &Arc<RobotNode>,
    state: &Arc<DrivingRobot>,
) -> zenoh::Result<Vec<AbortOnDropHandle<()>>> {
    let robot = Arc::clone(state);
    let accepts: AcceptsGoals = Arc::new(move || {
        robot.goals.send_modify(|goals| *goals += 1);
        robot.is_active.load(Ordering::Relaxed)
    });
    let robot = Arc::clone(state);
    let navigate: RunGoal =
        Arc::new(move |goal, feedback| Box::pin(Arc::clone(&robot).navigate(goal, feedback)));
    let robot = Arc::clone(state);
    let dock: RunGoal = Arc::new(move |_, _| Box::pin(Arc::clone(&robot).dock()));
    let robot = Arc::clone(state);
    let undock: RunGoal = Arc::new(move |_, _| {
        robot.is_docked.store(false, Ordering::Relaxed);
        Box::pin(std::future::ready(Ok(json!({ "is_docked": false }))))
    });
    let always: AcceptsGoals = Arc::new(|| true);
    let results = &state.answers_results;
    let navigate_type = "nav2_msgs/action/NavigateToPose";
    let dock_type = "irobot_create_msgs/action/Dock";
    let undock_type = "irobot_create_msgs/action/Undock";
    Ok(vec![
        ActionServer::serve(node, "navigate_to_pose", navigate_type, accepts, navigate, results)
            .await?,
        ActionServer::serve(node, "dock", dock_type, Arc::clone(&always), dock, results).await?,
        ActionServer::serve(node, "undock", undock_type, always, undock, results).await?,
    ])
}

async fn serve_lifecycle(
    node: &Arc<RobotNode>,
    state: &Arc<DrivingRobot>,
) -> zenoh::Result<AbortOnDropHandle<()>> {
    let (name, type_name) = ("bt_navigator/get_state", "lifecycle_msgs/srv/GetState");
    let mut service = node.service(name, type_name).await?;
    let (node, state) = (Arc::clone(node), Arc::clone(state));
    Ok(AbortOnDropHandle::new(tokio::spawn(async move {
        while let Some(query) = service.next().await {
            let is_active = state.is_active.load(Ordering::Relaxed);
            let (id, label) = if is_active { (3, "active") } else { (2, "inactive") };
            let response = json!({ "current_state": { "id": id, "label": label } });
            node.reply(&query, name, type_name, &response).await;
        }
    })))
}

impl DrivingRobot {
    /// Drives to the place at the pose of the goal.
    async fn navigate(self: Arc<Self>, goal: Value, feedback: Feedback) -> Result<Value, Value> {
        let aborted = |text: &str| json!({ "error_code": NO_WAY, "error_msg": text });
        if self.is_docked.load(Ordering::Relaxed) {
            return Err(aborted("the robot is docked"));
        }
        let position = &goal["pose"]["pose"]["position"];
        let (x, y) = (position["x"].as_f64(), position["y"].as_f64());
        let (Some(x), Some(y)) = (x, y) else { return Err(aborted("the pose has no position")) };
        let distance = |(px, py): (f64, f64)| (px - x).hypot(py - y);
        let near = self.settings.places.iter().find(|(_, at)| distance(**at) <= NEAR);
        let Some((place, _)) = near else { return Err(aborted("the pose is outside the map")) };
        let start = self.place().await.and_then(|place| self.settings.places.get(&place).copied());
        let meters = start.map_or(0.0, distance);
        let driven = self.building.navigate(&self.settings.robot, place);
        let mut driven = std::pin::pin!(driven);
        let mut pace = tokio::time::interval(FEEDBACK_INTERVAL);
        let mut told = 0_u32;
        let end = loop {
            tokio::select! {
                end = &mut driven => break end,
                _ = pace.tick() => {
                    told += 1;
                    let left = meters / f64::from(told);
                    feedback(json!({ "distance_remaining": left }));
                }
            }
        };
        match end {
            Ok(()) => Ok(json!({})),
            Err(error) => {
                tokio::time::sleep(RECOVERY_TIME).await;
                Err(aborted(&error.to_string()))
            }
        }
    }

    async fn dock(self: Arc<Self>) -> Result<Value, Value> {
        match self.building.recharge(&self.settings.robot).await {
            Ok(()) => {
                self.is_docked.store(true, Ordering::Relaxed);
                Ok(json!({ "is_docked": true }))
            }
            Err(_) => Err(json!({ "is_docked": false })),
        }
    }

    async fn place(&self) -> Option<String> {
        self.building.place_of(&self.settings.robot).await.ok()
    }

    /// Publishes the localization, the battery and the dock status again and again.
    async fn tell(self: Arc<Self>) {
        let mut pace = tokio::time::interval(TELEMETRY_INTERVAL);
        loop {
            pace.tick().await;
            if let Some((x, y)) =
                self.place().await.and_then(|place| self.settings.places.get(&place).copied())
            {
                let is_localized = self.is_localized.load(Ordering::Relaxed);
                let mut covariance = [0.0; 36];
                covariance[0] = if is_localized { 0.05 } else { 25.0 };
                let pose = json!({ "position": { "x": x, "y": y } });
                let message = json!({
                    "header": { "frame_id": "map" },
                    "pose": { "pose": pose, "covariance": covariance.to_vec() },
                });
                self.node.publish("amcl_pose", POSE, &message).await;
            }
            let docked = json!({ "is_docked": self.is_docked.load(Ordering::Relaxed) });
            let dock_type = "irobot_create_msgs/msg/DockStatus";
            self.node.publish("dock_status", dock_type, &docked).await;
            if let Some(range) = self.settings.battery_range
                && let Ok(Some(meters)) = self.building.charge_of(&self.settings.robot).await
            {
                let battery = json!({ "percentage": meters / range });
                self.node.publish("battery_state", "sensor_msgs/msg/BatteryState", &battery).await;
            }
        }
    }
}
