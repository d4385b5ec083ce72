//! A robot arm: it takes parcels from its shelves, and loads them on robots that stand still before
//! it.
//!
//! Its shelves and what it has gripped are `:private`: with `privacy = "agents"` other agents learn
//! where the arm stands, which parcels it has, and that it can load them.
//!
//! The arm has one driver, `simulated`. A real one is an agent of the plugin `ros2` or `command` with
//! the same actions.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use building::{BuildingHandle, DeviceError, ParcelPlace};
use serde::Deserialize;
use tokio::sync::watch;

/// The entry of the arm in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "arm",
    about: "a robot arm that loads parcels from its shelves on robots",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

const GRIP: &str = "grip";
const PUT_BACK: &str = "put_back";
const LOAD: &str = "load";

/// Time limit of one movement of the arm.
const MOVEMENT_MAX: Duration = Duration::from_secs(60);

/// Interval at which the arm looks whether its parcels are where it believes: a person may take one,
/// or a method may have been cancelled at the last moment.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// The actions of the arm, as PDDL.
const ACTIONS: &str = "(:action grip
        :agent ?a - arm
        :parameters (?p - parcel ?s - shelf)
        :precondition (and (stored ?p ?a) (on-shelf ?p ?s) (gripper-free ?a))
        :effect (and (gripped ?a ?p) (not (on-shelf ?p ?s)) (not (gripper-free ?a))
            (increase (total-cost) 1)))
    (:action put-back
        :agent ?a - arm
        :parameters (?p - parcel ?s - shelf)
        :precondition (and (gripped ?a ?p) (reaches ?a ?s))
        :effect (and (on-shelf ?p ?s) (gripper-free ?a) (not (gripped ?a ?p))
            (increase (total-cost) 1)))
    (:action load
        :agent ?a - arm
        :parameters (?p - parcel ?b - mobile-base ?l - location)
        :precondition (and (stored ?p ?a) (gripped ?a ?p) (stands-at ?a ?l) (at ?b ?l)
            (holding-still ?b ?l))
        :effect (and (carrying ?b ?p) (not (holding-still ?b ?l)) (not (stored ?p ?a))
            (gripper-free ?a) (not (gripped ?a ?p)) (increase (total-cost) 1)))";

/// The `config` of an arm's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// The place where the arm stands.
    location: PlaceName,
    /// The shelves within its reach.
    shelves: Vec<PlaceName>,
    /// The parcels of the arm, by their names, each with its shelf at the start.
    #[serde(default)]
    stored: BTreeMap<String, PlaceName>,
}

/// Where the parcels of the arm are, by their names.
type ParcelPlaces = BTreeMap<String, ParcelPlace>;

struct Arm {
    id: String,
    ontology: String,
    location: PlaceName,
    shelves: Vec<PlaceName>,
    /// Names of the parcels that the arm has at the start.
    parcels: Vec<PlaceName>,
    building: Arc<BuildingHandle>,
    /// Where the parcels were at the last look; `None` if the driver cannot tell.
    places: Arc<watch::Sender<Option<ParcelPlaces>>>,
}

/// A movement of the arm, as a call of a method requests it.
struct ArmMovement {
    /// Name of the parcel.
    parcel: String,
    kind: MovementKind,
}

enum MovementKind {
    Grip,
    PutBack { shelf: String },
    Load { robot: String },
}

impl ArmMovement {
    fn of(call: &MethodCall) -> Result<ArmMovement, MethodFailure> {
        let argument = |name| call.argument(name).map(str::to_owned);
        let kind = match call.method.as_str() {
            GRIP => MovementKind::Grip,
            PUT_BACK => MovementKind::PutBack { shelf: argument("shelf")? },
            LOAD => MovementKind::Load { robot: argument("robot")? },
            unknown => return Err(MethodFailure::UnknownMethod(unknown.to_owned())),
        };
        Ok(ArmMovement { parcel: argument("parcel")?, kind })
    }
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { location, shelves, stored } = blueprint.config_as()?;
    if shelves.is_empty() {
        return Err(blueprint.problem("`shelves` names no shelf"));
    }
    if let Some((parcel, shelf)) = stored.iter().find(|(_, shelf)| !shelves.contains(shelf)) {
        let problem = format!("`{parcel}` is stored on `{shelf}`, which `shelves` does not name");
        return Err(blueprint.problem(problem));
    }
    for (position, shelf) in shelves.iter().enumerate() {
        let name = shelf.as_str();
        let taken = if blueprint.host.map.objects.iter().any(|it| it.object.name == *name) {
            "a thing on the map"
        } else if name == blueprint.id.as_str() {
            "the arm"
        } else if stored.contains_key(name) {
            "a parcel"
        } else if shelves[..position].contains(shelf) {
            "named before"
        } else {
            continue;
        };
        let problem = format!("`shelves` names `{name}`, which is {taken}; choose another name");
        return Err(blueprint.problem(problem));
    }
    let parcels = stored.into_keys().map(PlaceName::try_from).collect::<Result<_, _>>();
    let parcels = parcels.map_err(|error| blueprint.problem(format!("stored: {error}")))?;
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let arm = Arm {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        location,
        shelves,
        parcels,
        building,
        places: Arc::new(watch::Sender::new(None)),
    };
    Actuator::build(&blueprint, arm)
}

fn driver_failure(error: DeviceError) -> MethodFailure {
    MethodFailure::Driver(error.to_string())
}

/// Returns the failure of loading a robot. If the robot is not there, does not stand still or carries
/// something, or if another parcel is gripped, the arm is able: the next plan begins with what is so.
fn loading_failure(error: DeviceError) -> MethodFailure {
    match error {
        DeviceError::Impossible { .. } => MethodFailure::Hindered(error.to_string()),
        error => driver_failure(error),
    }
}

/// Returns names as the declaration of objects of a type; empty if there are none.
fn declared<'n>(names: impl IntoIterator<Item = &'n str>, ty: &str) -> String {
    let names: Vec<_> = names.into_iter().collect();
    match names.as_slice() {
        [] => String::new(),
        names => format!("{} - {ty}", names.join(" ")),
    }
}

impl Arm {
    /// Returns the facts about the shelves of the arm.
    fn reached(&self) -> String {
        let reached = self.shelves.iter().map(|shelf| format!(" (reaches {} {shelf})", self.id));
        reached.collect()
    }
}

impl Device for Arm {
    type Yield = ();

    fn describe(&self) -> Description {
        let Arm { id, ontology, location, .. } = self;
        let mut parcels: BTreeSet<&str> = self.parcels.iter().map(PlaceName::as_str).collect();
        let places = self.places.borrow();
        // The file may have been read again without a parcel that the arm still has.
        parcels.extend(places.iter().flat_map(BTreeMap::keys).map(String::as_str));
        let parcels = declared(parcels, "parcel");
        let shelves = declared(self.shelves.iter().map(PlaceName::as_str), "shelf");
        let (location, reached) = (location.as_str(), self.reached());
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types arm mobile-base - agent item - object parcel - item shelf - object)
                (:predicates
                    (at ?b - mobile-base ?l - location)
                    (stands-at ?a - arm ?l - location)
                    (stored ?p - parcel ?a - arm)
                    (holding-still ?b - mobile-base ?l - location)
                    (carrying ?b - mobile-base ?i - item)
                    (:private
                        (reaches ?a - arm ?s - shelf)
                        (on-shelf ?p - parcel ?s - shelf)
                        (gripped ?a - arm ?p - parcel)
                        (gripper-free ?a - arm)))
                (:objects {id} - arm {parcels} (:private {shelves}))
                (:init (stands-at {id} {location}) {reached})
                {ACTIONS})"
        );
        let method = |name: &str, arguments: &[_]| Method::new(name, arguments, MOVEMENT_MAX);
        let methods = [
            ("grip".to_owned(), method(GRIP, &[("parcel", "?p")])),
            ("put-back".to_owned(), method(PUT_BACK, &[("parcel", "?p"), ("shelf", "?s")])),
            ("load".to_owned(), method(LOAD, &[("parcel", "?p"), ("robot", "?b")])),
        ];
        Description { model: model_of(&text), methods: methods.into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let Arm { id, location, .. } = self;
        let mut text = format!("(stands-at {id} {}){}", location.as_str(), self.reached());
        if let Some(places) = &*self.places.borrow() {
            let mut is_free = true;
            for (parcel, place) in places {
                text += &format!(" (stored {parcel} {id})");
                match place {
                    ParcelPlace::Stored { shelf, .. } => {
                        text += &format!(" (on-shelf {parcel} {shelf})");
                    }
                    _ => {
                        is_free = false;
                        text += &format!(" (gripped {id} {parcel})");
                    }
                }
            }
            if is_free {
                text += &format!(" (gripper-free {id})");
            }
        }
        facts_of(&text)
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let places = Arc::clone(&self.places);
        Some(Box::pin(async move {
            let read = building.parcels_of(&id).await.ok();
            places.send_replace(read);
        }))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        let movement = ArmMovement::of(call);
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let places = Arc::clone(&self.places);
        Box::pin(async move {
            let ArmMovement { parcel, kind } = movement?;
            let place = match kind {
                MovementKind::Grip => {
                    building.grip(&id, &parcel).await.map_err(driver_failure)?;
                    Some(ParcelPlace::On(id))
                }
                MovementKind::PutBack { shelf } => {
                    building.put_back(&id, &parcel, &shelf).await.map_err(driver_failure)?;
                    Some(ParcelPlace::Stored { arm: id, shelf })
                }
                MovementKind::Load { robot } => {
                    building.load(&id, &parcel, &robot).await.map_err(loading_failure)?;
                    None
                }
            };
            // Even if the method is given up now, the arm knows what it has done.
            places.send_modify(|places| {
                // If the last look failed, the arm does not know where its other parcels are.
                let Some(places) = places else { return };
                match place {
                    Some(place) => places.insert(parcel, place),
                    None => places.remove(&parcel),
                };
            });
            Ok(())
        })
    }

    fn on_success(&mut self, call: &MethodCall, (): ()) -> MethodResult {
        let detail = match (call.method.as_str(), call.argument("robot")) {
            (LOAD, Ok(robot)) => format!("has loaded {robot}"),
            _ => "has moved a parcel".to_owned(),
        };
        MethodResult { detail, observations: Vec::new() }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Arm>>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let places = Arc::clone(&self.places);
        Some(Box::pin(async move {
            loop {
                tokio::time::sleep(LOOK_INTERVAL).await;
                let known = places.borrow().clone();
                let read = building.parcels_of(&id).await.ok();
                if read != known {
                    let news: DeviceEvent<Arm> = Box::new(move |arm| {
                        // What a method has changed meanwhile is known already.
                        arm.places.send_if_modified(|places| {
                            let is_new = *places == known;
                            if is_new {
                                *places = read;
                            }
                            is_new
                        });
                        Vec::new()
                    });
                    return news;
                }
            }
        }))
    }
}
