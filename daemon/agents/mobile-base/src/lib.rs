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

mod ros2;
mod simulated;

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::future::pending;
use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::{Achieve, Keep, Method, Methods, Reason, Refusal};
use actuator::{
    BoxFuture, Initiative, MethodCall, MethodFailure, MethodResult, PlaceName, facts_of,
};
use agent::{Blueprint, BuildError};
use serde::Deserialize;
use tokio::sync::watch;

use crate::ros2::Ros2Config;

pub use crate::ros2::recorded_pose;

/// Share of the full range at or below which the battery counts as empty. With less charge the
/// cells are damaged, and the next place is too far anyway.
const EMPTY: f64 = 0.01;

/// Share of the full range at or below which the base requests a charge. The rest is enough for the
/// way to the dock in most buildings.
const LOW: f64 = 0.25;

/// Priority of charging, above people's goals: a robot that is stranded in a doorway is of no use.
const CHARGING_PRIORITY: i32 = 10;

/// Time that the action of charging may take for docking, in addition to the charging itself.
const DOCKING: Duration = Duration::from_secs(60);

/// How long the driver may take after a start to report the robot's place. A localization that is
/// already running needs less, and the robot's absence during this time has no effect.
const LOOKED_WITHIN: Duration = Duration::from_secs(1);

/// Cost of charging in a plan, in meters of driving, so that a plan charges the battery only if it
/// must.
const RECHARGE_COST: u32 = 10;

/// Names of the drivers of a base; the first is the default.
pub const DRIVERS: &[&str] = &["simulated", ROS2];

const ROS2: &str = "ros2";

/// Cost of driving to the place beside which a base stands, in meters of driving.
const REJOIN_COST: u32 = 2;

/// Interface to the hardware of a mobile base.
pub trait BaseDriver: Send + Sync + 'static {
    /// Drives the base to a neighboring place. The text of an error completes “failed to …”.
    /// Dropping the future stops the base.
    fn navigate_to(&self, place: &str) -> BoxFuture<Result<(), String>>;

    /// Charges the battery of the base, which must be at the dock.
    fn recharge(&self) -> BoxFuture<Result<(), String>>;

    /// Returns where the base really stands, and how far it can still drive.
    fn read(&self) -> BoxFuture<Result<BaseReading, String>>;

    /// Waits until the base reads otherwise than `known`, for a base that may be moved by others.
    /// By default this never happens.
    fn until_differs(&self, _known: BaseReading) -> BoxFuture<()> {
        Box::pin(pending())
    }
}

/// What a driver reads from a base.
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
    /// At no place; this one is the nearest.
    Near(String),
    /// The base does not know where it is.
    Unknown,
    /// The driver does not reach the base, so that nothing can be done with it.
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

/// Part of a robot's `config` in the ecosystem file that describes its mobile base.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct BaseConfig {
    /// Place where the base stands at the start.
    start: PlaceName,
    /// Speed of the base, in meters per second.
    #[serde(default = "default_speed")]
    speed: f64,
    /// Time limit of one move of the base, in seconds: enough for a corridor of 30 meters at 0.3
    /// m/s, with a person in the way.
    #[serde(default = "default_move_timeout")]
    move_timeout: f64,
    /// The battery of the base; `None` if its range is unlimited.
    #[serde(default)]
    battery: Option<BatteryConfig>,
    /// Place where the battery is charged; `None` if the base has no battery.
    #[serde(default)]
    dock: Option<PlaceName>,
    /// Poses, which are spots beside the places of the map, by name.
    #[serde(default)]
    poses: BTreeMap<String, PoseConfig>,
    /// The robot behind the driver `ros2`; `None` for other drivers.
    #[serde(default)]
    ros2: Option<Ros2Config>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct BatteryConfig {
    /// Range of a full battery, in meters.
    range: f64,
    /// Range that is left in the battery at the start, in meters; a full range if the key is
    /// missing.
    #[serde(default)]
    charge: Option<f64>,
    /// Time to charge an empty battery, in seconds.
    #[serde(default = "default_recharge_time")]
    recharge_time: f64,
}

/// A pose, which is a spot beside a place of the map. The config gives the place alone, or the
/// place and its distance from the pose in meters.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum PoseConfig {
    Near(PlaceName),
    Away { near: PlaceName, meters: f64 },
}

fn default_speed() -> f64 {
    0.3
}

fn default_move_timeout() -> f64 {
    120.0
}

fn default_recharge_time() -> f64 {
    600.0
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
    /// Each pose with the place beside it and the distance between them in meters.
    poses: Vec<(PlaceName, PlaceName, f64)>,
    /// The last reading. The base shares it with the future that moves the base, because that
    /// future may be dropped at any time.
    state: Arc<watch::Sender<BaseReading>>,
    driver: Arc<dyn BaseDriver>,
    /// Whether the base can stand beside a place, and so offers to drive there.
    can_stray: bool,
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
        let BaseConfig { start, speed, move_timeout, battery, dock, poses, ros2 } = config;
        let problem = |text: String| blueprint.problem(text);
        let range = battery.as_ref().map(|battery| battery.range);
        let own_poses: Vec<&str> = poses.keys().map(String::as_str).collect();
        let driver: Arc<dyn BaseDriver> = match (blueprint.driver.as_str(), ros2) {
            (ROS2, Some(ros2)) => {
                ros2::base(blueprint, ros2, start.as_str(), &own_poses, range).map_err(problem)?
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
            (_, None) => simulated::base(blueprint)?,
        };
        let speed = positive("speed", speed).map_err(problem)?;
        let move_timeout = positive("move-timeout", move_timeout).map_err(problem)?;
        let charge = battery.as_ref().map(|battery| battery.charge.unwrap_or(battery.range));
        let power = PowerSupply::of(battery, dock).map_err(problem)?;
        let poses = poses.into_iter().map(|(name, pose)| pose.of(name, blueprint));
        Ok(MobileBase {
            id: blueprint.id.to_string(),
            kind,
            start: start.to_string(),
            speed,
            move_timeout: Duration::from_secs_f64(move_timeout),
            power,
            poses: poses.collect::<Result<_, _>>().map_err(problem)?,
            state: Arc::new(watch::Sender::new(BaseReading {
                place: BasePlace::At(start.to_string()),
                charge,
            })),
            driver,
            can_stray: blueprint.driver == ROS2,
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

    fn current_state(&self) -> BaseReading {
        self.state.borrow().clone()
    }

    /// Reads the real place and the range left from the driver after a start. If the driver does
    /// not answer in time, the base keeps the values of the config.
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
        BaseHandle { driver: Arc::clone(&self.driver), state: Arc::clone(&self.state) }
    }

    fn is_empty(&self) -> bool {
        let Some(power) = &self.power else { return false };
        self.current_state().charge.is_some_and(|charge| charge <= power.range * EMPTY)
    }

    /// Waits until the base was moved by others, or until the charge of the battery becomes low, or
    /// ceases to be low. If it is low, [`MobileBase::take_initiatives`] then returns the request to
    /// charge it.
    pub fn next_initiative(&self) -> BoxFuture<()> {
        let (mut changes, wants_charge) = (self.state.subscribe(), self.wants_charge);
        let range = self.power.as_ref().map(|power| power.range);
        let (body, known) = (self.handle(), self.current_state());
        Box::pin(async move {
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

fn positive(name: &str, number: f64) -> Result<f64, String> {
    let is_fine = number.is_finite() && number > 0.0 && number < 1e6;
    is_fine.then_some(number).ok_or_else(|| format!("{name} = {number} must be above zero"))
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

impl PoseConfig {
    /// Distance between a pose and its place in meters, if the config gives none: one step into a
    /// room.
    const METERS: f64 = 1.0;

    fn of(
        self,
        name: String,
        blueprint: &Blueprint,
    ) -> Result<(PlaceName, PlaceName, f64), String> {
        let is_on_map = |name: &PlaceName| {
            let mut objects = blueprint.host.map.objects.iter();
            objects.any(|declaration| declaration.object.name == name.as_str())
        };
        let name = PlaceName::try_from(name).map_err(|error| error.to_string())?;
        let (near, meters) = match self {
            PoseConfig::Near(near) => (near, Self::METERS),
            PoseConfig::Away { near, meters } => (near, positive("poses.meters", meters)?),
        };
        if is_on_map(&name) {
            return Err(format!("the pose `{name}` is a place on the map: it needs no pose"));
        }
        if !is_on_map(&near) {
            return Err(format!("the pose `{name}` is near `{near}`, which is not on the map"));
        }
        Ok((name, near, meters))
    }
}

// === impl MobileBase: its part of a robot's self-description ===

impl MobileBase {
    /// Returns the PDDL objects of the base: the robot itself and its poses.
    pub fn objects(&self) -> String {
        let mut text = format!("{} - {}", self.id, self.kind);
        for (pose, ..) in &self.poses {
            push(&mut text, format_args!(" {pose} - pose"));
        }
        text
    }

    /// Returns the declarations of the predicates of the base that the ontology need not have, as
    /// PDDL.
    pub fn predicates(&self) -> &'static str {
        if self.can_stray {
            "(stray-near ?b - mobile-base ?l - location) (lost ?b - mobile-base)"
        } else {
            ""
        }
    }

    /// Returns the facts of the base that never change, as PDDL.
    pub fn constant_facts(&self) -> String {
        let mut text = format!("(= (speed {}) {})", self.id, self.speed);
        for (pose, near, meters) in &self.poses {
            for (from, to) in [(pose, near), (near, pose)] {
                let way =
                    format_args!(" (connected {from} {to}) (= (distance {from} {to}) {meters})");
                push(&mut text, way);
            }
        }
        if let Some(PowerSupply { range, dock, .. }) = &self.power {
            let id = &self.id;
            push(&mut text, format_args!(" (dock-of {id} {dock}) (= (range {id}) {range})"));
        }
        text
    }

    /// Returns all facts of the base that are known at present, as PDDL.
    pub fn facts(&self) -> String {
        let BaseReading { place, charge } = self.current_state();
        let mut text = match place {
            BasePlace::At(place) => format!("(at {} {place}) ", self.id),
            BasePlace::Near(place) => format!("(stray-near {} {place}) ", self.id),
            BasePlace::Unknown | BasePlace::Unreachable => format!("(lost {}) ", self.id),
        };
        text += &self.constant_facts();
        if let (Some(PowerSupply { range, .. }), Some(charge)) = (&self.power, charge) {
            push(&mut text, format_args!(" (= (charge {}) {charge})", self.id));
            if charge >= *range {
                push(&mut text, format_args!(" (charged {})", self.id));
            }
        }
        text
    }

    /// Returns the PDDL of the actions that the base offers at present. `guard` is one more
    /// condition in the precondition of `move`, such as `(not (presenting ?b))`; `?b` is the robot.
    /// An empty text adds no condition.
    pub fn actions(&self, guard: &str) -> String {
        let kind = self.kind;
        if self.current_state().place == BasePlace::Unreachable {
            return String::new();
        }
        let rejoin = if self.can_stray { rejoin(kind) } else { String::new() };
        if self.power.is_none() {
            return format!(
                "{rejoin}(:action move
                    :agent ?b - {kind}
                    :parameters (?from ?to - location)
                    :precondition (and (at ?b ?from) (connected ?from ?to) {guard})
                    :effect (and (not (at ?b ?from)) (at ?b ?to)
                        (increase (total-cost) (distance ?from ?to))))"
            );
        }
        let recharge = format!(
            "{rejoin}(:action recharge
                :agent ?b - {kind}
                :parameters (?l - location)
                :precondition (and (at ?b ?l) (dock-of ?b ?l))
                :effect (and (charged ?b) (assign (charge ?b) (range ?b))
                    (increase (total-cost) {RECHARGE_COST})))"
        );
        if self.is_empty() {
            return recharge;
        }
        format!(
            "(:action move
                :agent ?b - {kind}
                :parameters (?from ?to - location)
                :precondition (and (at ?b ?from) (connected ?from ?to)
                    (>= (charge ?b) (distance ?from ?to)) {guard})
                :effect (and (not (at ?b ?from)) (at ?b ?to) (not (charged ?b))
                    (decrease (charge ?b) (distance ?from ?to))
                    (increase (total-cost) (distance ?from ?to))))
            {recharge}"
        )
    }

    /// Returns the methods that carry out the actions of the base.
    pub fn methods(&self) -> Methods {
        let navigate = Method {
            method: "navigate_to".to_owned(),
            arguments: [("place".to_owned(), "?to".to_owned())].into(),
            timeout: Millis(self.move_timeout),
        };
        let mut methods: Methods = [("move".to_owned(), navigate.clone())].into();
        if self.can_stray {
            methods.insert("rejoin".to_owned(), navigate);
        }
        if let Some(PowerSupply { recharge_time, .. }) = &self.power {
            let recharge = Method {
                method: "recharge".to_owned(),
                arguments: BTreeMap::new(),
                timeout: Millis(*recharge_time * 2 + DOCKING),
            };
            methods.insert("recharge".to_owned(), recharge);
        }
        methods
    }
}

/// Returns the action that drives a base from beside a place to the place.
fn rejoin(kind: &str) -> String {
    format!(
        "(:action rejoin
            :agent ?b - {kind}
            :parameters (?to - location)
            :precondition (stray-near ?b ?to)
            :effect (and (at ?b ?to) (not (stray-near ?b ?to))
                (increase (total-cost) {REJOIN_COST})))
        "
    )
}

fn push(text: &mut String, piece: std::fmt::Arguments<'_>) {
    text.write_fmt(piece).expect("invariant: writing to a String cannot fail");
}

// === impl MobileBase: acting ===

impl MobileBase {
    /// Returns a refusal if a `move` is to begin at another place than the base stands at: its plan
    /// was made with older knowledge. Other calls are not refused.
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

/// Driver and state of a mobile base, as a running method uses them.
struct BaseHandle {
    driver: Arc<dyn BaseDriver>,
    state: Arc<watch::Sender<BaseReading>>,
}

impl BaseHandle {
    async fn navigate_to(&self, place: String) -> Result<BaseOutcome, MethodFailure> {
        let moved = self.driver.navigate_to(&place).await;
        let truth = self.refresh().await?;
        moved.map_err(MethodFailure::Driver)?;
        match truth {
            BasePlace::At(truth) if truth == place => Ok(BaseOutcome::Arrived(truth)),
            other => {
                Err(MethodFailure::Driver(format!("arrive at `{place}`: the base stands {other}")))
            }
        }
    }

    async fn recharge(&self) -> Result<BaseOutcome, MethodFailure> {
        let charged = self.driver.recharge().await;
        self.refresh().await?;
        charged.map(|()| BaseOutcome::Recharged).map_err(MethodFailure::Driver)
    }

    /// Reads the real place and the range left from the driver, and stores both. Called after each
    /// method, even a failed one. Returns the place.
    async fn refresh(&self) -> Result<BasePlace, MethodFailure> {
        let reading = self.driver.read().await.map_err(MethodFailure::Driver)?;
        let place = reading.place.clone();
        self.state.send_replace(reading);
        Ok(place)
    }
}
