//! A door that a motor opens and closes, for others that have to pass: robots pass it only while
//! it is open, so its two sides are `connected` only then.
//!
//! The door has one driver, `simulated`. A real one is an agent of the plugin `command` or `ros2`
//! with the same actions.

use std::sync::Arc;
use std::time::Duration;

use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact,
    PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use building::BuildingHandle;
use serde::Deserialize;
use tokio::sync::watch;

/// The entry of the door in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "door",
    about: "a door that a motor opens and closes for those that have to pass",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

const OPEN: &str = "open";
const CLOSE: &str = "close";

/// Time limit of opening or closing. A sliding door takes some seconds.
const MOVING_MAX: Duration = Duration::from_secs(30);

/// The `config` of a door's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// The places on the two sides of the door.
    between: Vec<PlaceName>,
    /// Length of the way through the door in meters, if the map does not have it.
    #[serde(default)]
    length: Option<f64>,
}

struct Door {
    id: String,
    ontology: String,
    sides: [PlaceName; 2],
    length: Option<f64>,
    building: Arc<BuildingHandle>,
    /// Whether the door is open, as it was last read or moved.
    is_open: Arc<watch::Sender<bool>>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { between, length } = blueprint.config_as()?;
    let Ok(sides) = <[PlaceName; 2]>::try_from(between) else {
        let problem = "`between` names the two places of the door, such as [\"hall\", \"lab\"]";
        return Err(blueprint.problem(problem));
    };
    if length.is_some_and(|length| !length.is_finite() || length <= 0.0) {
        return Err(blueprint.problem("`length` is more than 0, in meters"));
    }
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let door = Door {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        sides,
        length,
        building,
        is_open: Arc::new(watch::Sender::new(false)),
    };
    Actuator::build(&blueprint, door)
}

impl Door {
    /// Returns the facts about the door that never change, as PDDL.
    fn lasting(&self) -> String {
        let Door { id, sides: [a, b], .. } = self;
        let length = self.length.map(|length| {
            format!(" (= (distance {a} {b}) {length}) (= (distance {b} {a}) {length})")
        });
        format!("(door-between {id} {a} {b}){}", length.unwrap_or_default())
    }
}

impl Device for Door {
    type Yield = bool;

    fn describe(&self) -> Description {
        let Door { id, ontology, .. } = self;
        let lasting = self.lasting();
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types door - agent)
                (:predicates (door-between ?d - door ?a ?b - location) (opened ?d - door))
                (:objects {id} - door)
                (:init {lasting})
                (:action open-door
                    :agent ?d - door
                    :parameters (?a ?b - location)
                    :precondition (door-between ?d ?a ?b)
                    :effect (and (opened ?d) (connected ?a ?b) (connected ?b ?a)
                        (increase (total-cost) 1)))
                (:action close-door
                    :agent ?d - door
                    :parameters (?a ?b - location)
                    :precondition (and (door-between ?d ?a ?b) (opened ?d))
                    :effect (and (not (opened ?d)) (not (connected ?a ?b))
                        (not (connected ?b ?a)) (increase (total-cost) 1))))"
        );
        let methods = [("open-door", OPEN), ("close-door", CLOSE)];
        let methods =
            methods.map(|(action, name)| (action.to_owned(), Method::new(name, &[], MOVING_MAX)));
        Description { model: model_of(&text), methods: methods.into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let Door { id, sides: [a, b], .. } = self;
        let open = format!("(opened {id}) (connected {a} {b}) (connected {b} {a})");
        let open = if *self.is_open.borrow() { open } else { String::new() };
        facts_of(&format!("{} {open}", self.lasting()))
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let is_open = Arc::clone(&self.is_open);
        Some(Box::pin(async move {
            // A door that cannot be read counts as closed, so that no plan leads through it.
            let read = building.is_open(&id).await.unwrap_or(false);
            is_open.send_replace(read);
        }))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<bool, MethodFailure>> {
        let open = match call.method.as_str() {
            OPEN => true,
            CLOSE => false,
            other => {
                let unknown = MethodFailure::UnknownMethod(other.to_owned());
                return Box::pin(std::future::ready(Err(unknown)));
            }
        };
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        Box::pin(async move {
            let moved = building.set_door(&id, open).await;
            moved.map(|()| open).map_err(|error| MethodFailure::Driver(error.to_string()))
        })
    }

    fn on_success(&mut self, _call: &MethodCall, open: bool) -> MethodResult {
        self.is_open.send_replace(open);
        let detail = if open { "the door is open" } else { "the door is closed" };
        MethodResult { detail: detail.to_owned(), observations: Vec::new() }
    }
}
