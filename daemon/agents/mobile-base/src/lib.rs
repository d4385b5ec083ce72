//! The mobile base of every robot: it moves between the places of the map and its own poses, and
//! tracks the range left in its battery, if it has one.
//!
//! - [`BaseDriver`] is the interface to the hardware. Its implementations are shared by all robots:
//!   `simulated` moves a robot in the simulated building, `ros2` a real one with Nav2.
//! - After each move, even a failed one, the base reads its real place and the range left from its
//!   driver. A real robot may also be carried away: it then stands at another place, beside one
//!   (`stray-near`), or does not know where it is.
//! - The base adapts its offer (the paper: “re-evaluates what it can do”): with an empty battery it
//!   offers no `move`. Long before the battery is empty, the base requests a charge by itself.
//!
//! A robot's plugin takes the base's part of the model, the facts and the methods from this module,
//! and adds those of the robot.

mod config;
mod description;
mod learned_ways;
mod ros2;
mod ros_part;
mod simulated;
mod ways;

use std::fmt;
use std::future::pending;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Achieve, Keep, Reason, Refusal};
use actuator::{
    BoxFuture, Initiative, MethodCall, MethodFailure, MethodResult, PlaceName, facts_of,
};
use agent::{Blueprint, BuildError};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::config::{BatteryConfig, positive};
use crate::learned_ways::LearnedWays;

pub use crate::config::{BaseConfig, check_ros_name, ros_address};
pub use crate::ros_part::RosPart;
pub use crate::ros2::recorded_pose;
pub use ros2_link::{MapPose, RosAddress, RosDialect};

/// Share of the full range at or below which the battery counts as empty. A lower charge damages
/// the cells, and the next place is too far anyway.
const EMPTY: f64 = 0.01;

/// Share of the full range at or below which the base requests a charge. The rest is enough for the
/// way to the dock in most buildings.
const LOW: f64 = 0.25;

/// Priority of charging, above people's goals: a robot that is stranded in a doorway is of no use.
const CHARGING_PRIORITY: i32 = 10;

/// How long the driver may take after a start to report the robot's place. A localization that is
/// already running answers sooner.
const LOOKED_WITHIN: Duration = Duration::from_secs(1);

/// Names of the drivers of a base; the first is the default.
pub const DRIVERS: &[&str] = &["simulated", ROS2];

const ROS2: &str = "ros2";

/// Interface to the hardware of a mobile base.
pub trait BaseDriver: Send + Sync + 'static {
    /// Drives the base to a neighboring place. Dropping the future stops the base.
    fn navigate_to(&self, place: &str) -> BoxFuture<Result<(), DriveFailure>>;

    /// Charges the battery of the base, which must be at the dock.
    fn recharge(&self) -> BoxFuture<Result<(), String>>;

    /// Returns where the base really stands, and how far it can still drive.
    fn read(&self) -> BoxFuture<Result<BaseReading, String>>;

    /// Brings the base to a standstill, and waits until it confirms this. By default dropping the
    /// future of a method is enough.
    fn stand_still(&self) -> Option<BoxFuture<Result<(), String>>> {
        None
    }

    /// Waits until the reading of the base differs from `known`, for a base that others may move.
    /// By default the wait never ends.
    fn until_differs(&self, _known: BaseReading) -> BoxFuture<()> {
        Box::pin(pending())
    }
}

/// Reason why a base did not arrive. The text completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DriveFailure {
    /// The base is able to drive, and did not get through on this way.
    #[error("{0}")]
    NoWay(String),
    /// Any other reason.
    #[error("{0}")]
    Other(String),
}

/// The place and the charge of a base, as its driver reads them.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseReading {
    /// Where the base stands.
    pub place: BasePlace,
    /// How far the base can still drive, in meters; `None` if its range is unlimited or not known.
    pub charge: Option<f64>,
}

/// Where a base stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BasePlace {
    /// At this place of the map, or in this pose.
    At(String),
    /// At no place of the map; this place is the nearest.
    Near(String),
    /// The base does not know where it is.
    Unknown,
    /// The driver does not reach the base, so that the base offers no actions.
    Unreachable,
}

impl fmt::Display for BasePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            BasePlace::At(place) => write!(f, "at `{place}`"),
            BasePlace::Near(place) => write!(f, "at no place; the nearest is `{place}`"),
            BasePlace::Unknown => write!(f, "where it does not know"),
            BasePlace::Unreachable => write!(f, "out of reach"),
        }
    }
}

/// The mobile base of one robot.
pub struct MobileBase {
    id: String,
    kind: &'static str,
    /// Place where the base stands at the start, according to the config.
    start: String,
    speed: f64,
    move_timeout: Duration,
    power: Option<PowerSupply>,
    /// Each pose, the place of the map beside it, and the distance between them in meters.
    poses: Vec<(PlaceName, PlaceName, f64)>,
    /// The last reading. The base shares it with the future that moves the base, because that
    /// future may be dropped at any time.
    state: Arc<watch::Sender<BaseReading>>,
    driver: Arc<dyn BaseDriver>,
    /// The ways as a real base knows them; `None` if the base is simulated. A real base can stand
    /// beside a place, and so offers to drive there.
    ways: Option<Arc<LearnedWays>>,
    /// Access to a robot with ROS 2; `None` with another driver.
    ros: Option<RosPart>,
    /// Whether the base has requested a charge.
    wants_charge: bool,
}

struct PowerSupply {
    range: f64,
    recharge_time: Duration,
    dock: PlaceName,
}

fn is_low(reading: &BaseReading, range: f64) -> bool {
    reading.charge.is_some_and(|charge| charge <= range * LOW)
}

/// Outcome of a method of the base that has succeeded.
#[derive(Clone, Debug, PartialEq)]
pub enum BaseOutcome {
    /// The base stands at this place now.
    Arrived(String),
    /// The battery of the base is full.
    Recharged,
}

impl MobileBase {
    /// Creates the base of a robot of the PDDL type `kind`, with the driver that the blueprint
    /// names.
    ///
    /// # Errors
    ///
    /// Returns an error if values of the config are out of range or contradict each other, or if
    /// the driver cannot be made.
    pub fn new(
        blueprint: &Blueprint,
        kind: &'static str,
        config: BaseConfig,
    ) -> Result<MobileBase, BuildError> {
        let BaseConfig { start, speed, move_timeout, battery, dock, poses, blocked_for, ros2 } =
            config;
        let problem = |text: String| blueprint.problem(text);
        let range = battery.as_ref().map(|battery| battery.range);
        let own_poses: Vec<&str> = poses.keys().map(String::as_str).collect();
        let (driver, ros): (Arc<dyn BaseDriver>, _) = match (blueprint.driver.as_str(), ros2) {
            (ROS2, Some(ros2)) => {
                let base = ros2::base(blueprint, ros2, start.as_str(), &own_poses, range);
                let base = base.map_err(problem)?;
                (Arc::new(base.clone()), Some(RosPart::of(base)))
            }
            (ROS2, None) => {
                let missing = "the driver `ros2` needs a table `config.ros2`, with the `endpoint` \
                    of the robot and the poses of its `places`";
                return Err(blueprint.problem(missing));
            }
            (other, Some(_)) => {
                let surplus = format!("`config.ros2` is for the driver `ros2`, not `{other}`");
                return Err(blueprint.problem(surplus));
            }
            (_, None) => (simulated::base(blueprint)?, None),
        };
        let speed = positive("speed", speed).map_err(problem)?;
        let move_timeout = positive("move-timeout", move_timeout).map_err(problem)?;
        let charge = battery.as_ref().map(|battery| battery.charge.unwrap_or(battery.range));
        let power = PowerSupply::of(battery, dock).map_err(problem)?;
        let poses = poses.into_iter().map(|(name, pose)| pose.of(name, blueprint));
        let poses: Vec<_> = poses.collect::<Result<_, _>>().map_err(problem)?;
        let blocked_for = positive("blocked-for", blocked_for).map_err(problem)?;
        let own_ways = poses.iter().map(|(pose, near, meters)| {
            (pose.to_string().to_lowercase(), near.to_string().to_lowercase(), *meters)
        });
        let ways = ros.as_ref().map(|_| {
            let blocked_for = Duration::from_secs_f64(blocked_for);
            Arc::new(LearnedWays::of(blueprint, own_ways, speed, blocked_for))
        });
        Ok(MobileBase {
            id: blueprint.id.to_string(),
            kind,
            start: start.to_string(),
            speed,
            move_timeout: Duration::from_secs_f64(move_timeout),
            power,
            poses,
            state: Arc::new(watch::Sender::new(BaseReading {
                place: BasePlace::At(start.to_string()),
                charge,
            })),
            driver,
            ways,
            ros,
            wants_charge: false,
        })
    }

    /// Returns the place where the base stands at the start, according to the config.
    pub fn start(&self) -> &str {
        &self.start
    }

    /// Returns where the base stands, as its driver last reported it, in words for a person.
    pub fn whereabouts(&self) -> String {
        self.current_state().place.to_string()
    }

    /// Returns the place at which the base stands, as its driver last reported it; `None` if it
    /// stands at no place.
    pub fn place(&self) -> Option<String> {
        match self.current_state().place {
            BasePlace::At(place) => Some(place),
            BasePlace::Near(_) | BasePlace::Unknown | BasePlace::Unreachable => None,
        }
    }

    /// Returns the access to a robot with ROS 2; `None` with another driver.
    pub fn ros(&self) -> Option<&RosPart> {
        self.ros.as_ref()
    }

    /// Brings the base to a standstill: see [`BaseDriver::stand_still`].
    pub fn stand_still(&self) -> Option<BoxFuture<Result<(), String>>> {
        self.driver.stand_still()
    }

    fn current_state(&self) -> BaseReading {
        self.state.borrow().clone()
    }

    /// Reads the real place and the range left from the driver after a start. If the driver fails
    /// or does not answer in time, the base keeps the values of the config.
    pub fn locate(&self) -> BoxFuture<()> {
        let (body, id) = (self.handle(), self.id.clone());
        Box::pin(async move {
            let problem = match tokio::time::timeout(LOOKED_WITHIN, body.refresh()).await {
                Ok(Ok(_)) => return,
                Ok(Err(failure)) => failure.to_string(),
                Err(_) => "the driver does not answer in time".to_owned(),
            };
            tracing::warn!(%id, problem, "failed to read its place; its config is used");
        })
    }

    fn handle(&self) -> BaseHandle {
        BaseHandle {
            driver: Arc::clone(&self.driver),
            state: Arc::clone(&self.state),
            ways: self.ways.clone(),
        }
    }

    fn is_empty(&self) -> bool {
        let Some(power) = &self.power else { return false };
        self.current_state().charge.is_some_and(|charge| charge <= power.range * EMPTY)
    }

    /// Waits until others have moved the base, until a blocked way is to be tried again, or until
    /// the charge of the battery becomes low, or ceases to be low. If it is low,
    /// [`MobileBase::take_initiatives`] then returns the request to charge it.
    pub fn next_initiative(&self) -> BoxFuture<()> {
        let (mut changes, wants_charge) = (self.state.subscribe(), self.wants_charge);
        let range = self.power.as_ref().map(|power| power.range);
        let (body, known) = (self.handle(), self.current_state());
        Box::pin(async move {
            let unblocked = async {
                match &body.ways {
                    Some(ways) => ways.next_unblocked().await,
                    None => pending().await,
                }
            };
            let has_charge_news = async {
                let is_news = |state: &BaseReading| {
                    range.is_some_and(|range| is_low(state, range) != wants_charge)
                };
                let is_gone = changes.wait_for(is_news).await.is_err();
                // The robot is gone, and this future will be dropped too.
                if is_gone {
                    pending().await
                }
            };
            tokio::select! {
                () = has_charge_news => (),
                () = unblocked => (),
                () = body.driver.until_differs(known) => drop(body.refresh().await),
            }
        })
    }

    /// Returns the initiatives that the base has at present: the request to charge its battery,
    /// once each time that the charge becomes low.
    pub fn take_initiatives(&mut self) -> Vec<Initiative> {
        let Some(PowerSupply { range, .. }) = self.power else { return Vec::new() };
        let is_low = is_low(&self.current_state(), range);
        if !is_low || std::mem::replace(&mut self.wants_charge, is_low) {
            self.wants_charge = is_low;
            return Vec::new();
        }
        let goal = format!("(charged {})", self.id);
        let goal = Achieve::new(goal, Keep::Achieve, CHARGING_PRIORITY);
        vec![Initiative::RequestGoal { name: "charge".to_owned(), goal, insists: true }]
    }
}

impl PowerSupply {
    fn of(
        battery: Option<BatteryConfig>,
        dock: Option<PlaceName>,
    ) -> Result<Option<PowerSupply>, String> {
        let (BatteryConfig { range, charge, recharge_time }, dock) = match (battery, dock) {
            (None, None) => return Ok(None),
            (Some(battery), Some(dock)) => (battery, dock),
            (Some(_), None) => return Err("a battery needs a `dock`, to be filled there".into()),
            (None, Some(_)) => return Err("a dock needs a `battery` that is filled there".into()),
        };
        let range = positive("battery.range", range)?;
        let recharge_time = positive("battery.recharge-time", recharge_time)?;
        if charge.is_some_and(|charge| !(0.0..=range).contains(&charge)) {
            return Err(format!("battery.charge must be between 0 and the range, {range}"));
        }
        Ok(Some(PowerSupply { range, recharge_time: Duration::from_secs_f64(recharge_time), dock }))
    }
}

// === impl MobileBase: acting ===

impl MobileBase {
    /// Returns a refusal if the call is a `move` from another place than the base stands at: its
    /// plan was made with older knowledge. Other calls are not refused.
    pub fn check_call(&self, call: &MethodCall) -> Option<Refusal> {
        let step = pddl::parse_step(&call.action).into_result().ok()?;
        let from = step.arguments.get(1).filter(|_| step.action == "move")?;
        if self.place().is_some_and(|place| place.eq_ignore_ascii_case(from.as_str())) {
            return None;
        }
        let detail =
            format!("{} begins at `{from}`: the base stands {}", call.action, self.whereabouts());
        Some(Refusal::new(Reason::Conflict, detail))
    }

    /// Runs a method of the base; fails with [`MethodFailure::UnknownMethod`] if the base has no
    /// such method.
    pub fn perform(&self, call: &MethodCall) -> BoxFuture<Result<BaseOutcome, MethodFailure>> {
        let body = self.handle();
        match (call.method.as_str(), call.argument("place")) {
            ("navigate_to", Ok(place)) => {
                let place = place.to_owned();
                Box::pin(async move { body.navigate_to(place).await })
            }
            ("navigate_to", Err(failure)) => Box::pin(std::future::ready(Err(failure))),
            ("recharge", _) => Box::pin(async move { body.recharge().await }),
            _ => {
                let unknown = MethodFailure::UnknownMethod(call.method.clone());
                Box::pin(std::future::ready(Err(unknown)))
            }
        }
    }

    /// Returns the result that the base reports for a method that has succeeded.
    pub fn performed(&self, moved: &BaseOutcome) -> MethodResult {
        let (detail, observed) = match moved {
            BaseOutcome::Arrived(place) => {
                (format!("arrived at {place}"), format!("(at {} {place})", self.id))
            }
            BaseOutcome::Recharged => {
                ("the battery is full".to_owned(), format!("(charged {})", self.id))
            }
        };
        let observations = facts_of(&observed).into_iter().map(|fact| fact.fact).collect();
        MethodResult { detail, observations }
    }
}

/// The driver and the state of a mobile base, for a method that runs.
struct BaseHandle {
    driver: Arc<dyn BaseDriver>,
    state: Arc<watch::Sender<BaseReading>>,
    ways: Option<Arc<LearnedWays>>,
}

impl BaseHandle {
    async fn navigate_to(&self, place: String) -> Result<BaseOutcome, MethodFailure> {
        let (from, began) = (self.state.borrow().place.clone(), Instant::now());
        let moved = self.driver.navigate_to(&place).await;
        let elapsed = began.elapsed();
        let truth = self.refresh().await?;
        self.learn((&from, &place), &truth, &moved, elapsed).await;
        moved.map_err(|failure| match failure {
            DriveFailure::NoWay(why) if self.ways.is_some() => MethodFailure::Hindered(why),
            DriveFailure::NoWay(why) | DriveFailure::Other(why) => MethodFailure::Driver(why),
        })?;
        match truth {
            BasePlace::At(truth) if truth == place => Ok(BaseOutcome::Arrived(truth)),
            other => {
                Err(MethodFailure::Driver(format!("arrive at `{place}`: the base stands {other}")))
            }
        }
    }

    /// Remembers how the base fared on the way from one place to another. `truth` is where it stands
    /// now: a base that stands at a third place was not on this way at all.
    async fn learn(
        &self,
        (from, to): (&BasePlace, &str),
        truth: &BasePlace,
        moved: &Result<(), DriveFailure>,
        elapsed: Duration,
    ) {
        let (Some(ways), BasePlace::At(from)) = (&self.ways, from) else { return };
        let was_elsewhere = matches!(truth, BasePlace::At(at) if at != from && at != to);
        match moved {
            _ if was_elsewhere => (),
            Ok(()) => ways.passed(from, to, elapsed).await,
            Err(DriveFailure::NoWay(_)) => ways.failed(from, to),
            Err(DriveFailure::Other(_)) => (),
        }
    }

    async fn recharge(&self) -> Result<BaseOutcome, MethodFailure> {
        let charged = self.driver.recharge().await;
        self.refresh().await?;
        charged.map(|()| BaseOutcome::Recharged).map_err(MethodFailure::Driver)
    }

    /// Reads the real place and the range left from the driver, stores both, and returns the place.
    /// Called after each method, even a failed one.
    async fn refresh(&self) -> Result<BasePlace, MethodFailure> {
        let reading = self.driver.read().await.map_err(MethodFailure::Driver)?;
        let place = reading.place.clone();
        self.state.send_replace(reading);
        Ok(place)
    }
}
