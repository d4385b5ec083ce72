//! A robot with Nav2 that drives in the simulated building. Its clients reach it over Zenoh as they
//! reach real robots, through a bridge or with `rmw_zenoh`. Its real place is that of the building.
//!
//! - Nav2 rejects goals while it is not active ([`SimulatedNav2::set_active`]). A new goal takes
//!   the place of the running one. A cancelled goal ends as such. Where no way leads, Nav2 tries
//!   for a while, and gives up with a code and a text.
//! - The localization follows the robot, also if it is carried away in the building.
//!   [`SimulatedNav2::set_localized`] makes it uncertain.
//! - While the robot drives, it tells poses between its start and its goal. A goal in the place
//!   where it stands moves it within the place; with the brush on, it sweeps the place on the way.
//! - The battery is that of the building; docking charges it. The display is the screen that is
//!   mounted on the robot in the building.
//! - [`RobotNode`] and [`ActionServer`] serve any topic, service and action, for tests of other
//!   robots.

mod action_server;
mod wire;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use building::BuildingHandle;
use ros_messages::Interfaces;
use serde_json::{Value, json};
use tokio::sync::{mpsc, watch};
use tokio_util::task::AbortOnDropHandle;
use zenoh::Wait as _;

pub use action_server::{AcceptsGoals, ActionServer, Feedback, RunGoal};
pub use wire::{RobotNode, RobotWire, Service};

/// Interval of the localization, the battery and the dock status. Real robots publish the first
/// after each movement, the others once or more per second.
const TELEMETRY_INTERVAL: Duration = Duration::from_millis(100);

/// Interval of the feedback of a goal. The behaviour trees of a real Nav2 publish it every 10 ms.
const FEEDBACK_INTERVAL: Duration = Duration::from_millis(20);

/// Time for which Nav2 tries to find another way before it gives up. The recoveries of a real Nav2
/// take half a minute.
const RECOVERY_TIME: Duration = Duration::from_millis(100);

/// Maximum distance of a goal from a place of the building, in meters: half a room. A goal that is
/// farther from all places is outside the map.
const NEAR: f64 = 2.5;

/// Error code of Nav2 for a goal that cannot be reached.
const NO_WAY: u16 = 9_000;

/// Number of texts for the display that wait.
const TEXTS_MAX: usize = 16;

const POSE: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";
const VELOCITY: &str = "geometry_msgs/msg/Twist";
const TEXT: &str = "std_msgs/msg/String";

/// The robot of the building that drives with Nav2, and the position of each place on the robot's
/// map.
#[derive(Clone, Debug)]
pub struct Nav2Settings {
    /// Name of the robot in the building.
    pub robot: String,
    /// The way in which ROS names become keys of Zenoh.
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
    _topics: Vec<zenoh::pubsub::Subscriber<()>>,
}

impl Drop for SimulatedNav2 {
    /// Closes the session before its topics are undeclared, one by one, under the traffic of its
    /// clients: Zenoh 1.10.2 then panics now and then, in `remote_subscribers_of`.
    fn drop(&mut self) {
        // An error means that the session is closed already.
        drop(self.state.node.session.close().wait());
    }
}

struct DrivingRobot {
    node: Arc<RobotNode>,
    building: BuildingHandle,
    settings: Nav2Settings,
    is_active: AtomicBool,
    is_localized: AtomicBool,
    is_docked: AtomicBool,
    /// Whether action servers answer requests for results.
    answers_results: Arc<AtomicBool>,
    /// Number of goals that Nav2 has accepted or rejected.
    goals: watch::Sender<u64>,
    initial_poses: AtomicU64,
    /// Number of messages that set the velocity to zero.
    zero_velocities: AtomicU64,
    /// Position that the robot tells, with the place to which it belongs.
    position: Mutex<Option<(String, MapPosition)>>,
    /// Whether the brush is on, and whether it was on when the robot drove within its place.
    brush: Mutex<Brush>,
}

#[derive(Default)]
struct Brush {
    is_on: bool,
    has_swept: bool,
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
        let Nav2Settings { wire, listen, namespace, .. } = &settings;
        let interfaces = Interfaces::standard();
        let (node, endpoint) =
            RobotNode::open(*wire, listen.as_deref(), namespace, interfaces).await?;
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
            zero_velocities: AtomicU64::new(0),
            position: Mutex::default(),
            brush: Mutex::default(),
        });
        let topics = subscribe(&node, &state).await?;
        let mut tasks = serve_actions(&node, &state).await?;
        tasks.push(serve_lifecycle(&node, &state).await?);
        tasks.push(serve_brush(&node, &state).await?);
        tasks.push(AbortOnDropHandle::new(tokio::spawn(Arc::clone(&state).tell())));
        Ok(SimulatedNav2 { endpoint, state, _tasks: tasks, _topics: topics })
    }

    /// Switches the robot off, and waits until its endpoint is free.
    pub async fn close(self) {
        let node = Arc::clone(&self.state.node);
        drop(self);
        node.close().await;
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

    /// Makes the action servers ignore requests for results, or answer them. The topics of the
    /// actions go on.
    pub fn set_answers_results(&self, answers: bool) {
        self.state.answers_results.store(answers, Ordering::Relaxed);
    }

    /// Publishes any bytes on a topic of the robot, as a faulty node does.
    pub async fn publish_bytes(&self, topic: &str, type_name: &str, payload: Vec<u8>) {
        self.state.node.publish_bytes(topic, type_name, payload).await;
    }

    /// Whether the robot stands in its dock.
    pub fn is_docked(&self) -> bool {
        self.state.is_docked.load(Ordering::Relaxed)
    }

    /// Returns the number of goals that were sent to Nav2.
    pub fn goals(&self) -> u64 {
        *self.state.goals.borrow()
    }

    /// Waits until this number of goals has been sent to Nav2.
    pub async fn until_goals(&self, number: u64) {
        // The sender lives as long as the robot.
        drop(self.state.goals.subscribe().wait_for(|goals| *goals >= number).await);
    }

    /// Returns how often the velocity of the robot was set to zero.
    pub fn zero_velocities(&self) -> u64 {
        self.state.zero_velocities.load(Ordering::Relaxed)
    }

    /// Whether the brush of the robot is on.
    pub fn is_brush_on(&self) -> bool {
        locked(&self.state.brush).is_on
    }

    /// Returns how often the robot was told where it stands.
    pub fn initial_poses(&self) -> u64 {
        self.state.initial_poses.load(Ordering::Relaxed)
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

async fn subscribe(
    node: &RobotNode,
    state: &Arc<DrivingRobot>,
) -> zenoh::Result<Vec<zenoh::pubsub::Subscriber<()>>> {
    let told = Arc::clone(state);
    let initial_pose = node.subscribe("initialpose", POSE, move |_| {
        told.initial_poses.fetch_add(1, Ordering::Relaxed);
        told.is_localized.store(true, Ordering::Relaxed);
    });
    let robot = Arc::clone(state);
    let velocity = node.subscribe("cmd_vel", VELOCITY, move |velocity| {
        let is_zero = |part: &str| {
            ["x", "y", "z"].iter().all(|axis| velocity[part][axis].as_f64() == Some(0.0))
        };
        if is_zero("linear") && is_zero("angular") {
            robot.zero_velocities.fetch_add(1, Ordering::Relaxed);
        }
    });
    let (shown, mut texts) = mpsc::channel::<Value>(TEXTS_MAX);
    let display = node.subscribe("hmi/display/message", TEXT, move |text| {
        // A text that does not fit into the queue is not shown.
        drop(shown.try_send(text));
    });
    let (building, screen) = (state.building.clone(), format!("{}-screen", state.settings.robot));
    tokio::spawn(async move {
        while let Some(text) = texts.recv().await {
            let text = text["data"].as_str().filter(|text| !text.is_empty());
            // A robot without a screen shows nothing.
            drop(building.show(&screen, text).await);
        }
    });
    Ok(vec![initial_pose.await?, velocity.await?, display.await?])
}

async fn serve_brush(
    node: &Arc<RobotNode>,
    state: &Arc<DrivingRobot>,
) -> zenoh::Result<AbortOnDropHandle<()>> {
    let (name, type_name) = ("brush", "std_srvs/srv/SetBool");
    let mut service = node.service(name, type_name).await?;
    let (node, state) = (Arc::clone(node), Arc::clone(state));
    Ok(AbortOnDropHandle::new(tokio::spawn(async move {
        while let Some(query) = service.next().await {
            let Some(request) = node.request(&query, type_name) else { continue };
            let is_on = request["data"].as_bool() == Some(true);
            *locked(&state.brush) = Brush { is_on, has_swept: false };
            node.reply(&query, name, type_name, &json!({ "success": true })).await;
        }
    })))
}

async fn serve_actions(
    node: &Arc<RobotNode>,
    state: &Arc<DrivingRobot>,
) -> zenoh::Result<Vec<AbortOnDropHandle<()>>> {
    let robot = Arc::clone(state);
    let accepts: AcceptsGoals = Arc::new(move || {
        // Decided before a test that awaits the goal may make Nav2 active.
        let is_accepted = robot.is_active.load(Ordering::Relaxed);
        robot.goals.send_modify(|goals| *goals += 1);
        is_accepted
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

/// A position on the robot's map, in meters.
#[derive(Clone, Copy)]
struct MapPosition {
    x: f64,
    y: f64,
}

impl MapPosition {
    fn distance(self, other: MapPosition) -> f64 {
        (self.x - other.x).hypot(self.y - other.y)
    }

    /// Returns the position at this share of the way to another one.
    fn towards(self, other: MapPosition, share: f64) -> MapPosition {
        let between = |from: f64, to: f64| from + (to - from) * share;
        MapPosition { x: between(self.x, other.x), y: between(self.y, other.y) }
    }
}

/// A robot that drives. The building knows no positions between places: when the drive ends without
/// arrival, the robot is back where it began.
struct OnTheWay<'a> {
    robot: &'a DrivingRobot,
    rests_at: Option<(String, MapPosition)>,
}

impl OnTheWay<'_> {
    fn arrive(mut self, place: String, position: MapPosition) {
        self.rests_at = Some((place, position));
    }
}

impl Drop for OnTheWay<'_> {
    fn drop(&mut self) {
        *locked(&self.robot.position) = self.rests_at.take();
    }
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
        let to = MapPosition { x, y };
        let Some(place) = self.place_near(to) else {
            return Err(aborted("the pose is outside the map"));
        };
        let (Some(here), Some(from)) = (self.place().await, self.position().await) else {
            return Err(aborted("the robot is nowhere"));
        };
        let driven = async {
            if here == place {
                return self.drive_within_place().await;
            }
            let driven = self.building.navigate(&self.settings.robot, &place).await;
            driven.map_err(|error| error.to_string())
        };
        let mut driven = std::pin::pin!(driven);
        let mut pace = tokio::time::interval(FEEDBACK_INTERVAL);
        let on_the_way = OnTheWay { robot: &self, rests_at: Some((here.clone(), from)) };
        let mut told = 0_u32;
        let end = loop {
            tokio::select! {
                end = &mut driven => break end,
                _ = pace.tick() => {
                    told += 1;
                    let left = 1.0 / f64::from(told);
                    *locked(&self.position) = Some((here.clone(), from.towards(to, 1.0 - left)));
                    feedback(json!({ "distance_remaining": from.distance(to) * left }));
                }
            }
        };
        match end {
            Ok(()) => {
                on_the_way.arrive(place.clone(), to);
                Ok(json!({}))
            }
            Err(error) => {
                tokio::time::sleep(RECOVERY_TIME).await;
                Err(aborted(&error))
            }
        }
    }

    /// Drives within the place at which the robot stands, and sweeps it if the brush is on.
    async fn drive_within_place(&self) -> Result<(), String> {
        let sweeps = {
            let brush = locked(&self.brush);
            brush.is_on && !brush.has_swept
        };
        if sweeps {
            let swept = self.building.sweep(&self.settings.robot).await;
            swept.map_err(|error| error.to_string())?;
            locked(&self.brush).has_swept = true;
        }
        Ok(())
    }

    /// Returns the place nearest to the position; `None` if all places are too far away.
    fn place_near(&self, position: MapPosition) -> Option<String> {
        let distance =
            |(_, (x, y)): &(&String, &(f64, f64))| position.distance(MapPosition { x: *x, y: *y });
        let places = self.settings.places.iter();
        let nearest = places.min_by(|one, two| distance(one).total_cmp(&distance(two)))?;
        (distance(&nearest) <= NEAR).then(|| nearest.0.clone())
    }

    /// Returns the position of the robot on its map; `None` if its place has none.
    async fn position(&self) -> Option<MapPosition> {
        let here = self.place().await?;
        if let Some((place, position)) = &*locked(&self.position)
            && *place == here
        {
            return Some(*position);
        }
        self.settings.places.get(&here).map(|(x, y)| MapPosition { x: *x, y: *y })
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

    /// Publishes the localization, the battery and the dock status every [`TELEMETRY_INTERVAL`].
    async fn tell(self: Arc<Self>) {
        let mut pace = tokio::time::interval(TELEMETRY_INTERVAL);
        loop {
            pace.tick().await;
            if let Some(MapPosition { x, y }) = self.position().await {
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
