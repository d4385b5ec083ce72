//! A lift: its cabin is at one of its landings, and is sent to another one for others that have
//! something to go there. Parcels ride in it; robots do not.
//!
//! The lift has one driver, `simulated`. A real one is an agent of the plugin `command` or `ros2`
//! with the same action.

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

/// The entry of the lift in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "lift",
    about: "a lift that takes parcels from landing to landing",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

const SEND: &str = "send_cabin";

/// Time limit of a trip of the cabin.
const TRIP_MAX: Duration = Duration::from_secs(120);

/// The `config` of a lift's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// The places where the cabin stops; it is at the first one until its driver has told.
    landings: Vec<PlaceName>,
}

struct Lift {
    id: String,
    ontology: String,
    landings: Vec<PlaceName>,
    building: Arc<BuildingHandle>,
    /// Name of the landing where the cabin is, as it was last read or sent there; `None` if its
    /// driver cannot tell.
    cabin: Arc<watch::Sender<Option<String>>>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { landings } = blueprint.config_as()?;
    if landings.len() < 2 {
        return Err(blueprint.problem("`landings` names fewer than two places"));
    }
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let lift = Lift {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        landings,
        building,
        cabin: Arc::new(watch::Sender::new(None)),
    };
    Actuator::build(&blueprint, lift)
}

impl Lift {
    fn served(&self) -> String {
        let served = self.landings.iter().map(|landing| format!(" (serves {} {landing})", self.id));
        served.collect()
    }
}

impl Device for Lift {
    type Yield = String;

    fn describe(&self) -> Description {
        let Lift { id, ontology, .. } = self;
        let served = self.served();
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types lift-cabin - agent)
                (:predicates
                    (serves ?c - lift-cabin ?l - location)
                    (cabin-at ?c - lift-cabin ?l - location))
                (:objects {id} - lift-cabin)
                (:init {served})
                (:action send-cabin
                    :agent ?c - lift-cabin
                    :parameters (?from ?to - location)
                    :precondition (and (cabin-at ?c ?from) (serves ?c ?to))
                    :effect (and (not (cabin-at ?c ?from)) (cabin-at ?c ?to)
                        (increase (total-cost) 2))))"
        );
        let method = Method::new(SEND, &[("to", "?to")], TRIP_MAX);
        Description { model: model_of(&text), methods: [("send-cabin".to_owned(), method)].into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let cabin = self.cabin.borrow().clone();
        let cabin = cabin.map(|landing| format!(" (cabin-at {} {landing})", self.id));
        facts_of(&(self.served() + &cabin.unwrap_or_default()))
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let cabin = Arc::clone(&self.cabin);
        Some(Box::pin(async move {
            let read = building.place_of(&id).await.ok();
            cabin.send_replace(read);
        }))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<String, MethodFailure>> {
        let to = match (call.method.as_str(), call.argument("to")) {
            (SEND, Ok(to)) => to.to_owned(),
            (SEND, Err(missing)) => return Box::pin(std::future::ready(Err(missing))),
            (other, _) => {
                let unknown = MethodFailure::UnknownMethod(other.to_owned());
                return Box::pin(std::future::ready(Err(unknown)));
            }
        };
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        Box::pin(async move {
            let sent = building.send_cabin(&id, &to).await;
            sent.map(|()| to).map_err(|error| MethodFailure::Driver(error.to_string()))
        })
    }

    fn on_success(&mut self, _call: &MethodCall, landing: String) -> MethodResult {
        let detail = format!("the cabin is at {landing}");
        self.cabin.send_replace(Some(landing));
        MethodResult { detail, observations: Vec::new() }
    }
}
