//! The driver of robots with ROS 2 and Nav2, over a Zenoh session to each robot.
//!
//! - `config.ros2` has the address of the robot, and the pose of each place on the robot's map. The
//!   robot stands at the nearest place, if that is near enough.
//! - The session is opened in the background when the agent starts. If the robot has not reported
//!   its pose some seconds later, the driver sets the pose to that of `start`.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use actuator::BoxFuture;
use agent::{Blueprint, config_tables};
use pddl::InitElement;
use ros2_link::{
    LinkReach, LinkWatch, MapPose, Nav2Names, Nav2Robot, RosAddress, RosDialect, RosError, RosLink,
    VelocityMessage,
};
use serde::Deserialize;
use tokio::sync::watch;
use tokio_util::task::AbortOnDropHandle;

use crate::{BaseDriver, BasePlace, BaseReading, DriveFailure};

/// How long a robot may take to report its pose before the driver sets the pose to that of `start`.
/// A robot with a known pose reports it at once.
const POSE_AWAITED: Duration = Duration::from_secs(3);

/// How long the localization may take to report that the robot stands where it has arrived. AMCL
/// publishes within half a second after a movement.
const SETTLES_WITHIN: Duration = Duration::from_secs(3);

/// How long a reading of the robot is awaited: long enough for a robot with a link that is being
/// opened.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// Change of the charge that counts as news, as a share of the range. Robots report far smaller
/// changes every second.
const CHARGE_STEP: f64 = 0.01;

/// How long `althing robot` waits for the pose of a robot. AMCL sends the last pose at once.
const POSE_TOLD_WITHIN: Duration = Duration::from_secs(5);

/// Pause before the robot is asked again after an error.
const ASK_AGAIN: Duration = Duration::from_secs(1);

/// The table `config.ros2` of a robot's entry.
#[derive(Clone, Debug, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Ros2Config {
    /// Zenoh endpoint of the robot's bridge or router, such as `tcp/192.168.1.20:7447`.
    endpoint: String,
    /// How the robot's messages reach Zenoh: `ros2dds` (through zenoh-bridge-ros2dds) or
    /// `rmw-zenoh`.
    #[serde(default)]
    dialect: RosDialect,
    /// ROS namespace of the robot's names; may be empty.
    #[serde(default)]
    namespace: String,
    /// ROS domain of the robot; used with `rmw-zenoh` only.
    #[serde(default)]
    domain_id: u32,
    /// Pose of each place on the robot's map, by the name of the place.
    places: BTreeMap<String, MapPose>,
    /// Distance from the pose of a place, in meters, within which the robot stands at that place.
    #[serde(default = "default_tolerance")]
    tolerance: f64,
    /// Type of the messages that set the robot's velocity: `twist` or `twist-stamped`.
    #[serde(default)]
    velocity: VelocityMessage,
    /// Whether the driver sets the robot's pose to that of `start`, if the robot reports none.
    #[serde(default = "default_initial_pose")]
    initial_pose: bool,
}

config_tables!(Ros2Config);

fn default_tolerance() -> f64 {
    1.0
}

fn default_initial_pose() -> bool {
    true
}

impl Ros2Config {
    /// Returns the address of the robot, after checking it.
    fn address(&self) -> Result<RosAddress, String> {
        let Ros2Config { endpoint, dialect, namespace, domain_id, .. } = self;
        let (endpoint, namespace) = (endpoint.clone(), namespace.clone());
        let (dialect, domain_id) = (*dialect, *domain_id);
        let address = RosAddress { endpoint, dialect, namespace, domain_id };
        address.check().map_err(|problem| format!("config.ros2: {problem}"))?;
        Ok(address)
    }
}

/// A robot with Nav2 as a mobile base.
#[derive(Clone)]
pub(crate) struct Ros2Base {
    settings: Arc<Ros2Settings>,
    attended: Arc<OnceLock<AttendedRobot>>,
    /// Number of methods that move the robot at present.
    moving: Arc<watch::Sender<usize>>,
}

/// A method that moves the robot. The places that the robot tells meanwhile are no news.
struct MovingRobot(Arc<watch::Sender<usize>>);

impl Drop for MovingRobot {
    fn drop(&mut self) {
        self.0.send_modify(|number| *number -= 1);
    }
}

struct Ros2Settings {
    agent: String,
    address: RosAddress,
    places: BTreeMap<String, MapPose>,
    tolerance: f64,
    /// Pose that the driver sets if the robot reports none; `None` if the driver sets no pose.
    initial_pose: Option<MapPose>,
    /// Range of a full battery in meters; `None` if the base has no battery.
    range: Option<f64>,
    velocity: VelocityMessage,
}

/// The link to a robot, with the task that follows the robot's messages.
struct AttendedRobot {
    robot: Nav2Robot,
    /// The last reading; an error until there is one.
    readings: watch::Receiver<Result<BaseReading, String>>,
    _watch: LinkWatch,
    _attending: AbortOnDropHandle<()>,
}

/// Returns the driver of a robot with ROS 2.
///
/// # Errors
///
/// Returns a text for a person if the config has a mistake, or if a place has no pose.
pub(crate) fn base(
    blueprint: &Blueprint,
    config: Ros2Config,
    start: &str,
    own_poses: &[&str],
    range: Option<f64>,
) -> Result<Ros2Base, String> {
    let address = config.address()?;
    let Ros2Config { places, tolerance, initial_pose, velocity, .. } = config;
    if !(tolerance.is_finite() && tolerance > 0.0) {
        return Err(format!("config.ros2.tolerance = {tolerance} must be above zero"));
    }
    check_places(blueprint, &places, start, own_poses)?;
    let places: BTreeMap<String, MapPose> =
        places.into_iter().map(|(name, at)| (name.to_lowercase(), at)).collect();
    let initial_pose = initial_pose.then(|| places.get(start).copied()).flatten();
    let agent = blueprint.id.to_string();
    let settings =
        Ros2Settings { agent, address, places, tolerance, initial_pose, range, velocity };
    Ok(Ros2Base { settings: Arc::new(settings), attended: Arc::default(), moving: Arc::default() })
}

/// Returns the pose of a robot as a value of the table `config.ros2.places`. `config` is the
/// `config` of the robot's entry; its places may be missing.
///
/// # Errors
///
/// Returns a text for a person if the config has no usable `ros2` table, or if the robot is not
/// reached or does not know where it is. The text completes “failed to …”.
pub async fn recorded_pose(config: &serde_json::Value) -> Result<String, String> {
    let mut table = config["ros2"].clone();
    let Some(entries) = table.as_object_mut() else {
        return Err("read its `config.ros2`: there is none".to_owned());
    };
    entries.entry("places").or_insert_with(|| serde_json::json!({}));
    let config: Ros2Config = serde_json::from_value(table)
        .map_err(|error| format!("read its `config.ros2`: {error}"))?;
    let address = config.address()?;
    let link = RosLink::open(address, Arc::new(ros2_link::standard_interfaces()));
    let link = link.map_err(|error| error.to_string())?;
    let robot = Nav2Robot::new(link, Nav2Names::default());
    let told = tokio::time::timeout(POSE_TOLD_WITHIN, robot.first_pose()).await;
    let told = told.map_err(|_| {
        "read its pose: it tells none (`amcl_pose`); is it localized, and has it moved?".to_owned()
    })?;
    told.map_err(|error| error.to_string())?;
    match robot.pose().await.map_err(|error| error.to_string())? {
        Some(MapPose { x, y, yaw }) => Ok(format!("{{ x = {x:.3}, y = {y:.3}, yaw = {yaw:.3} }}")),
        None => Err("read its pose: it does not know where it is".to_owned()),
    }
}

/// Checks that each place to which the robot can drive has a pose, and that each pose is finite and
/// belongs to a place.
fn check_places(
    blueprint: &Blueprint,
    places: &BTreeMap<String, MapPose>,
    start: &str,
    own_poses: &[&str],
) -> Result<(), String> {
    for (name, pose) in places {
        pose.check().map_err(|problem| format!("config.ros2.places.{name}: {problem}"))?;
        if !own_poses.contains(&name.as_str()) {
            let known = blueprint.host.has_place(name);
            known.map_err(|problem| format!("config.ros2.places: {problem}"))?;
        }
    }
    let mut needed = reachable(blueprint, start);
    needed.extend(own_poses.iter().map(|pose| (*pose).to_owned()));
    let missing: Vec<String> = { needed.iter() }
        .filter(|place| !places.keys().any(|name| name.eq_ignore_ascii_case(place)))
        .map(|place| format!("`{place}`"))
        .collect();
    match missing.as_slice() {
        [] => Ok(()),
        [first, ..] => Err(format!(
            "config.ros2.places lacks the pose of {}, to which the robot can drive; drive it \
             there, and `althing robot {} {}` prints the line to write",
            missing.join(", "),
            blueprint.id,
            first.trim_matches('`'),
        )),
    }
}

/// Returns the places of the map that are reachable from `start` by `connected` facts.
fn reachable(blueprint: &Blueprint, start: &str) -> BTreeSet<String> {
    let ways: Vec<(String, String)> = { blueprint.host.map.init.iter() }
        .filter_map(|element| match element {
            InitElement::Atom(atom) if atom.predicate == "connected" => {
                let [from, to] = atom.arguments.as_slice() else { return None };
                Some((from.to_string().to_lowercase(), to.to_string().to_lowercase()))
            }
            _ => None,
        })
        .collect();
    let mut found: BTreeSet<String> = [start.to_lowercase()].into();
    let mut queue = vec![start.to_lowercase()];
    while let Some(place) = queue.pop() {
        for (from, to) in &ways {
            if *from == place && found.insert(to.clone()) {
                queue.push(to.clone());
            }
        }
    }
    found
}

// === impl Ros2Settings ===

impl Ros2Settings {
    fn place_at(&self, pose: &MapPose) -> BasePlace {
        let distance = |(_, at): &(&String, &MapPose)| at.distance(pose);
        let nearest = self.places.iter().min_by(|one, two| distance(one).total_cmp(&distance(two)));
        match nearest {
            Some((place, at)) if at.distance(pose) <= self.tolerance => {
                BasePlace::At(place.clone())
            }
            Some((place, _)) => BasePlace::Near(place.clone()),
            None => BasePlace::Unknown,
        }
    }

    async fn read(&self, robot: &Nav2Robot) -> Result<BaseReading, RosError> {
        let pose = robot.pose().await?;
        let place = pose.map_or(BasePlace::Unknown, |pose| self.place_at(&pose));
        let charge = match self.range {
            Some(range) => robot.charge().await?.map(|share| share * range),
            None => None,
        };
        Ok(BaseReading { place, charge })
    }

    /// Follows the robot's messages until it is dropped, and sends each new reading to `readings`.
    async fn attend(
        self: Arc<Self>,
        robot: Nav2Robot,
        link: watch::Receiver<LinkReach>,
        readings: watch::Sender<Result<BaseReading, String>>,
    ) {
        tokio::join!(self.establish_pose(&robot), self.follow_messages(&robot, link, &readings));
    }

    /// Reads the robot after each of its messages, and when the state of the link changes. Ends when
    /// the watch over the link ends.
    async fn follow_messages(
        &self,
        robot: &Nav2Robot,
        mut link: watch::Receiver<LinkReach>,
        readings: &watch::Sender<Result<BaseReading, String>>,
    ) {
        let step = self.range.unwrap_or_default() * CHARGE_STEP;
        loop {
            let is_lost = *link.borrow_and_update() == LinkReach::Lost;
            let news = match is_lost {
                true => Ok(BaseReading { place: BasePlace::Unreachable, charge: None }),
                false => tokio::select! {
                    message = robot.next_message() => match message {
                        Ok(()) => self.read(robot).await,
                        Err(error) => Err(error),
                    },
                    changed = link.changed() => match changed {
                        Ok(()) => continue,
                        Err(_) => return,
                    },
                },
            };
            let is_error = news.is_err();
            let news = news.map_err(|error| error.to_string());
            readings.send_if_modified(|known| {
                let is_new = is_news(known, &news, step);
                if is_new {
                    *known = news;
                }
                is_new
            });
            if is_error {
                tokio::time::sleep(ASK_AGAIN).await;
            }
            if is_lost && link.changed().await.is_err() {
                return;
            }
        }
    }

    /// Sets the robot's pose to that of `start`, if the robot does not report its pose.
    async fn establish_pose(&self, robot: &Nav2Robot) {
        let Some(start) = self.initial_pose else { return };
        while let Err(error) = robot.pose().await {
            tracing::debug!(agent = self.agent, %error, "the robot is not reached yet");
            tokio::time::sleep(ASK_AGAIN).await;
        }
        if tokio::time::timeout(POSE_AWAITED, robot.first_pose()).await.is_err() {
            match robot.set_pose(start).await {
                Ok(()) => tracing::info!(agent = self.agent, "told where it stands, its `start`"),
                Err(error) => tracing::warn!(agent = self.agent, %error, "its pose is not set"),
            }
        }
    }
}

/// Whether the reading `news` differs from the reading `known`. A charge that differs by less than
/// `step` does not count.
fn is_news(
    known: &Result<BaseReading, String>,
    news: &Result<BaseReading, String>,
    step: f64,
) -> bool {
    match (known, news) {
        (Ok(known), Ok(news)) => known.place != news.place || has_other_charge(known, news, step),
        (known, news) => known != news,
    }
}

fn has_other_charge(one: &BaseReading, two: &BaseReading, step: f64) -> bool {
    match (one.charge, two.charge) {
        (Some(one), Some(two)) => (one - two).abs() >= step.max(f64::EPSILON),
        (one, two) => one.is_some() != two.is_some(),
    }
}

// === impl Ros2Base ===

impl Ros2Base {
    /// Returns the link to the robot, and begins to open it at the first call.
    fn attended(&self) -> &AttendedRobot {
        self.attended.get_or_init(|| {
            let address = self.settings.address.clone();
            let interfaces = Arc::new(ros2_link::standard_interfaces());
            let link = RosLink::open(address, interfaces);
            let link = link.expect("invariant: the address was checked when the base was built");
            let watch = LinkWatch::start(link.clone(), &self.settings.agent);
            let robot = Nav2Robot::new(link, Nav2Names::default());
            let (sender, readings) = watch::channel(Err(
                "read where the robot stands: it has not reported it yet".to_owned(),
            ));
            let attending = Arc::clone(&self.settings).attend(robot.clone(), watch.state(), sender);
            let _attending = AbortOnDropHandle::new(tokio::spawn(attending));
            AttendedRobot { robot, readings, _watch: watch, _attending }
        })
    }

    pub(crate) fn robot(&self) -> &Nav2Robot {
        &self.attended().robot
    }

    fn begin_moving(&self) -> MovingRobot {
        self.moving.send_modify(|number| *number += 1);
        MovingRobot(Arc::clone(&self.moving))
    }

    /// Drives through `poses`, one after the other, and back to `place`.
    pub(crate) async fn drive_through(
        &self,
        poses: &[MapPose],
        place: &str,
    ) -> Result<(), DriveFailure> {
        let _moving = self.begin_moving();
        for pose in poses {
            let driven = self.drive_to_pose(*pose).await;
            driven.map_err(|error| DriveFailure::Other(error.to_string()))?;
        }
        self.drive(place).await
    }

    async fn drive_to_pose(&self, pose: MapPose) -> Result<(), RosError> {
        let agent = &self.settings.agent;
        let MapPose { x, y, .. } = pose;
        let driven = self.robot().drive(pose, |meters| {
            tracing::debug!(agent, x, y, meters, "drives");
        });
        driven.await
    }

    async fn drive(&self, place: &str) -> Result<(), DriveFailure> {
        let _moving = self.begin_moving();
        let pose = self.settings.places.get(&place.to_lowercase()).copied();
        let pose =
            pose.ok_or_else(|| DriveFailure::Other(format!("drive to `{place}`: it has no pose")))?;
        self.drive_to_pose(pose).await.map_err(|error| match error {
            RosError::NoWay { .. } => DriveFailure::NoWay(error.to_string()),
            _ => DriveFailure::Other(error.to_string()),
        })?;
        // The message of the localization about the arrival may come after the end of the goal.
        let is_there = |reading: &Result<BaseReading, String>| matches!(reading, Ok(BaseReading { place: BasePlace::At(at), .. }) if at == place);
        let mut readings = self.attended().readings.clone();
        drop(tokio::time::timeout(SETTLES_WITHIN, readings.wait_for(is_there)).await);
        Ok(())
    }
}

impl BaseDriver for Ros2Base {
    fn navigate_to(&self, place: &str) -> BoxFuture<Result<(), DriveFailure>> {
        let (base, place) = (self.clone(), place.to_owned());
        Box::pin(async move { base.drive(&place).await })
    }

    fn stand_still(&self) -> Option<BoxFuture<Result<(), String>>> {
        let base = self.clone();
        Some(Box::pin(async move {
            let still = base.robot().stand_still(base.settings.velocity).await;
            still.map_err(|error| error.to_string())
        }))
    }

    fn recharge(&self) -> BoxFuture<Result<(), String>> {
        let base = self.clone();
        Box::pin(async move {
            let _moving = base.begin_moving();
            base.attended().robot.recharge().await.map_err(|error| error.to_string())
        })
    }

    fn read(&self) -> BoxFuture<Result<BaseReading, String>> {
        let base = self.clone();
        Box::pin(async move {
            let mut readings = base.attended().readings.clone();
            // Without a reading in time, the error that stands for it is returned.
            drop(tokio::time::timeout(READ_WITHIN, readings.wait_for(Result::is_ok)).await);
            readings.borrow().clone()
        })
    }

    fn until_differs(&self, known: BaseReading) -> BoxFuture<()> {
        let base = self.clone();
        Box::pin(async move {
            let step = base.settings.range.unwrap_or_default() * CHARGE_STEP;
            let (mut readings, mut moving) =
                (base.attended().readings.clone(), base.moving.subscribe());
            let differs = |reading: &Result<BaseReading, String>| {
                reading.as_ref().is_ok_and(|reading| {
                    reading.place != known.place || has_other_charge(&known, reading, step)
                })
            };
            loop {
                // The senders live as long as the base.
                drop(moving.wait_for(|moving| *moving == 0).await);
                if readings.wait_for(differs).await.is_err() {
                    std::future::pending().await
                }
                if *moving.borrow_and_update() == 0 {
                    return;
                }
            }
        })
    }
}
