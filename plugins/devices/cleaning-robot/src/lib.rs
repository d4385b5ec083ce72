//! The cleaning robot: a mobile base that drives to rooms and sweeps them.
//!
//! - `mobile_base::MobileBase` implements moving, the battery and the dock, as for every robot.
//! - The broom has a driver of its own: `simulated`, or with ROS 2 the lanes of each room.
//! - The bin of the robot has space for a few rooms, and is emptied at the robot's home. The fill
//!   level of the bin is private, so that other ecosystems cannot see how much was cleaned.

mod lanes;
mod simulated;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Method, Refusal};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use mobile_base::{BaseConfig, BaseOutcome, MapPose, MobileBase, check_ros_name};
use pddl::InitElement;
use serde::Deserialize;

use crate::lanes::LaneBroom;

/// The entry of the cleaning robot in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "cleaning-robot",
    about: "a mobile base that sweeps rooms, and empties its bin at home",
    drivers: mobile_base::DRIVERS,
    has_replicas: false,
    build,
};

const SWEEP: &str = "sweep";
const EMPTY_BIN: &str = "empty_bin";

/// Time limit for sweeping one room, including waits for people in the way.
const SWEEPING_MAX: Duration = Duration::from_secs(600);

/// Time limit for emptying the bin.
const EMPTYING_MAX: Duration = Duration::from_secs(60);

/// The driver of the broom.
trait Broom: Send + Sync + 'static {
    /// Returns the places that can be swept; `None` if all can.
    fn places(&self) -> Option<Vec<String>>;

    /// Sweeps `place`, at which the robot stands, and returns the name of the swept place. Error
    /// texts complete “failed to …”.
    fn sweep(&self, place: &str) -> BoxFuture<Result<String, String>>;
}

/// The `config` of a cleaning robot's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Config {
    #[serde(flatten)]
    base: BaseConfig,
    /// Number of swept rooms with which the bin is full.
    #[serde(default = "default_bin")]
    bin: u32,
    /// Poses through which a robot with ROS 2 drives to sweep a place, by the name of the place.
    #[serde(default)]
    lanes: BTreeMap<String, Vec<MapPose>>,
    /// Name of the service that switches the brush of a robot with ROS 2; `None` if it has none.
    #[serde(default)]
    brush: Option<String>,
    /// All other keys of the entry's `config`. Any such key is an error.
    #[serde(flatten)]
    unknown: serde_json::Map<String, serde_json::Value>,
}

fn default_bin() -> u32 {
    10
}

struct CleaningRobot {
    id: String,
    ontology: String,
    base: MobileBase,
    broom: Arc<dyn Broom>,
    /// Place where the bin is emptied, which is the robot's place at the start.
    home: String,
    /// Number of rooms that fit into the bin, and number of rooms swept since the bin was last
    /// emptied.
    bin: u32,
    rooms_in_bin: u32,
    /// Places that the robot has swept.
    swept: Vec<String>,
}

/// The result of a method of the cleaning robot.
enum CleaningResult {
    Moved(BaseOutcome),
    Swept(String),
    Emptied,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { base, bin, lanes, brush, unknown } = blueprint.config_as()?;
    if let Some(key) = unknown.keys().next() {
        return Err(blueprint.problem(format!("a cleaning robot's config has no key `{key}`")));
    }
    if bin == 0 {
        return Err(blueprint.problem("bin = 0: a bin takes at least one room"));
    }
    if let Some(brush) = &brush {
        check_ros_name("brush", brush).map_err(|problem| blueprint.problem(problem))?;
    }
    let base = MobileBase::new(&blueprint, "cleaning-robot", base)?;
    let broom: Arc<dyn Broom> = match base.ros() {
        Some(robot) => Arc::new(LaneBroom::new(&blueprint, robot, lanes, brush)?),
        None if lanes.is_empty() && brush.is_none() => simulated::broom(&blueprint)?,
        None => {
            let surplus = "`lanes` and `brush` are for the driver `ros2`";
            return Err(blueprint.problem(surplus));
        }
    };
    let robot = CleaningRobot {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        home: base.start().to_owned(),
        base,
        broom,
        bin,
        rooms_in_bin: 0,
        swept: Vec::new(),
    };
    Actuator::build(&blueprint, robot)
}

impl Device for CleaningRobot {
    type Yield = CleaningResult;

    fn describe(&self) -> Description {
        let CleaningRobot { id, ontology, base, home, .. } = self;
        let mut methods = base.methods();
        methods.insert("sweep".to_owned(), Method::new(SWEEP, &[], SWEEPING_MAX));
        methods.insert("empty-bin".to_owned(), Method::new(EMPTY_BIN, &[], EMPTYING_MAX));
        let (objects, lasting, moving) = (base.objects(), base.model_facts(), base.actions(""));
        let (predicates, functions) = (base.predicates(), base.functions());
        // A place without lanes cannot be swept.
        let can_sweep = if self.broom.places().is_some() { "(has-lanes ?b ?l)" } else { "" };
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types cleaning-robot - mobile-base)
                (:functions {functions})
                (:predicates {predicates} (:private
                    (bin-free ?b - cleaning-robot)
                    (has-lanes ?b - cleaning-robot ?l - location)
                    (bin-emptied-at ?b - cleaning-robot ?l - location)))
                (:objects {objects})
                (:init {lasting} (bin-emptied-at {id} {home}))
                {moving}
                (:action sweep
                    :agent ?b - cleaning-robot
                    :parameters (?l - location)
                    :precondition (and (at ?b ?l) (bin-free ?b) {can_sweep})
                    :effect (and (swept ?l) (increase (total-cost) 5)))
                (:action empty-bin
                    :agent ?b - cleaning-robot
                    :parameters (?l - location)
                    :precondition (and (at ?b ?l) (bin-emptied-at ?b ?l))
                    :effect (and (bin-free ?b) (increase (total-cost) 2))))"
        );
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let CleaningRobot { id, base, home, bin, rooms_in_bin, swept, .. } = self;
        let mut text = format!("{} (bin-emptied-at {id} {home})", base.facts());
        if rooms_in_bin < bin {
            text += &format!(" (bin-free {id})");
        }
        for place in self.broom.places().unwrap_or_default() {
            text += &format!(" (has-lanes {id} {place})");
        }
        for place in swept {
            text += &format!(" (swept {place})");
        }
        facts_of(&text)
    }

    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal> {
        self.base.check_call(call)
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<CleaningResult, MethodFailure>> {
        match call.method.as_str() {
            SWEEP => {
                let Some(place) = self.base.place() else {
                    let stands = self.base.whereabouts();
                    let failure = MethodFailure::Driver(format!("sweep: it stands {stands}"));
                    return Box::pin(std::future::ready(Err(failure)));
                };
                let swept = self.broom.sweep(&place);
                Box::pin(async move {
                    swept.await.map(CleaningResult::Swept).map_err(MethodFailure::Driver)
                })
            }
            EMPTY_BIN if self.base.place().as_ref() == Some(&self.home) => {
                Box::pin(std::future::ready(Ok(CleaningResult::Emptied)))
            }
            EMPTY_BIN => {
                let failure = format!("empty the bin: the robot is not at `{}`", self.home);
                Box::pin(std::future::ready(Err(MethodFailure::Driver(failure))))
            }
            _ => {
                let moved = self.base.perform(call);
                Box::pin(async move { moved.await.map(CleaningResult::Moved) })
            }
        }
    }

    fn on_success(&mut self, _call: &MethodCall, done: CleaningResult) -> MethodResult {
        let place = match done {
            CleaningResult::Moved(moved) => return self.base.performed(&moved),
            CleaningResult::Emptied => {
                self.rooms_in_bin = 0;
                return MethodResult {
                    detail: "the bin is empty".into(),
                    observations: Vec::new(),
                };
            }
            CleaningResult::Swept(place) => place,
        };
        self.rooms_in_bin += 1;
        let observations: Vec<InitElement> =
            facts_of(&format!("(swept {place})")).into_iter().map(|own| own.fact).collect();
        let detail = format!("swept {place}");
        if !self.swept.contains(&place) {
            self.swept.push(place);
        }
        MethodResult { detail, observations }
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        Some(self.base.locate())
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        self.base.stand_still()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<CleaningRobot>>> {
        let wish = self.base.next_initiative();
        Some(Box::pin(async move {
            wish.await;
            let stir: DeviceEvent<CleaningRobot> = Box::new(|robot| robot.base.take_initiatives());
            stir
        }))
    }
}
