//! The courier: a mobile base that carries one parcel at a time, to another place or into the cabin
//! of a lift.
//!
//! - `mobile_base::MobileBase` implements moving, the battery and the dock, as for every robot.
//! - Where parcels lie is told by a tag reader, and where the cabin of a lift is by the lift.

use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::{Method, Refusal};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use building::BuildingHandle;
use mobile_base::{BaseConfig, BaseOutcome, MobileBase};
use serde::Deserialize;
use tokio::sync::watch;

/// The entry of the courier in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "courier",
    about: "a mobile base that carries parcels, also into and out of lifts",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

const TAKE_UP: &str = "take_up";
const SET_DOWN: &str = "set_down";
const PUT_IN: &str = "put_in";

/// Time limit of taking up or setting down a parcel.
const HANDLING_MAX: Duration = Duration::from_secs(60);

/// Interval at which the courier looks whether it still carries what it believes: a person may take
/// the parcel, or a method may have been cancelled at the last moment.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// The `config` of a courier's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Config {
    #[serde(flatten)]
    base: BaseConfig,
    /// All other keys of the entry's `config`. Any such key is an error.
    #[serde(flatten)]
    unknown: serde_json::Map<String, serde_json::Value>,
}

struct Courier {
    id: String,
    ontology: String,
    base: MobileBase,
    building: Arc<BuildingHandle>,
    /// Name of the carried parcel; `None` if the hands are free.
    carried: Arc<watch::Sender<Option<String>>>,
}

/// The result of a method of the courier.
enum CourierResult {
    Moved(BaseOutcome),
    Carries(Option<String>),
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { base, unknown } = blueprint.config_as()?;
    if let Some(key) = unknown.keys().next() {
        return Err(blueprint.problem(format!("a courier's config has no key `{key}`")));
    }
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let courier = Courier {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        base: MobileBase::new(&blueprint, "courier", base)?,
        building,
        carried: Arc::new(watch::Sender::new(None)),
    };
    Actuator::build(&blueprint, courier)
}

/// Returns the PDDL of the actions with parcels.
fn actions() -> &'static str {
    "(:action take-up
        :agent ?b - courier
        :parameters (?p - parcel ?l - location)
        :precondition (and (at ?b ?l) (parcel-at ?p ?l) (hands-free ?b))
        :effect (and (carrying ?b ?p) (not (hands-free ?b)) (not (parcel-at ?p ?l))
            (increase (total-cost) 1)))
    (:action set-down
        :agent ?b - courier
        :parameters (?p - parcel ?l - location)
        :precondition (and (at ?b ?l) (carrying ?b ?p))
        :effect (and (parcel-at ?p ?l) (hands-free ?b) (not (carrying ?b ?p))
            (increase (total-cost) 1)))
    (:action take-out
        :agent ?b - courier
        :parameters (?p - parcel ?c - lift-cabin ?l - location)
        :precondition (and (at ?b ?l) (cabin-at ?c ?l) (in-cabin ?p ?c) (hands-free ?b))
        :effect (and (carrying ?b ?p) (not (hands-free ?b)) (not (in-cabin ?p ?c))
            (increase (total-cost) 1)))
    (:action put-in
        :agent ?b - courier
        :parameters (?p - parcel ?c - lift-cabin ?l - location)
        :precondition (and (at ?b ?l) (cabin-at ?c ?l) (carrying ?b ?p))
        :effect (and (in-cabin ?p ?c) (hands-free ?b) (not (carrying ?b ?p))
            (increase (total-cost) 1)))"
}

impl Device for Courier {
    type Yield = CourierResult;

    fn describe(&self) -> Description {
        let Courier { id, ontology, base, .. } = self;
        let method = |name: &str, arguments: &[(&str, &str)]| {
            let argument = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
            Method {
                method: name.to_owned(),
                arguments: arguments.iter().map(argument).collect(),
                timeout: Millis(HANDLING_MAX),
            }
        };
        let mut methods = base.methods();
        for action in ["take-up", "take-out"] {
            methods.insert(action.to_owned(), method(TAKE_UP, &[("parcel", "?p")]));
        }
        methods.insert("set-down".to_owned(), method(SET_DOWN, &[]));
        methods.insert("put-in".to_owned(), method(PUT_IN, &[("lift", "?c")]));
        let (objects, lasting, moving) = (base.objects(), base.model_facts(), base.actions(""));
        let (predicates, functions) = (base.predicates(), base.functions());
        let handling = actions();
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types courier - mobile-base lift-cabin - agent item - object parcel - item)
                (:functions {functions})
                (:predicates {predicates}
                    (parcel-at ?p - parcel ?l - location)
                    (in-cabin ?p - parcel ?c - lift-cabin)
                    (cabin-at ?c - lift-cabin ?l - location)
                    (carrying ?b - mobile-base ?i - item)
                    (:private (hands-free ?b - courier)))
                (:objects {objects})
                (:init {lasting})
                {moving}
                {handling})"
        );
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let Courier { id, base, .. } = self;
        let hands = match &*self.carried.borrow() {
            Some(parcel) => format!("(carrying {id} {parcel})"),
            None => format!("(hands-free {id})"),
        };
        facts_of(&format!("{} {hands}", base.facts()))
    }

    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal> {
        self.base.check_call(call)
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<CourierResult, MethodFailure>> {
        let argument = |name| call.argument(name).map(str::to_owned);
        let (take, lift) = match call.method.as_str() {
            TAKE_UP => (argument("parcel").map(Some), None),
            SET_DOWN => (Ok(None), None),
            PUT_IN => (Ok(None), Some(argument("lift"))),
            _ => {
                let moved = self.base.perform(call);
                return Box::pin(async move { moved.await.map(CourierResult::Moved) });
            }
        };
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let carried = Arc::clone(&self.carried);
        Box::pin(async move {
            let (take, lift) = (take?, lift.transpose()?);
            let done = match &take {
                Some(parcel) => building.take_up(&id, parcel).await,
                None => building.set_down(&id, lift.as_deref()).await,
            };
            done.map_err(|error| MethodFailure::Driver(error.to_string()))?;
            carried.send_replace(take.clone());
            Ok(CourierResult::Carries(take))
        })
    }

    fn on_success(&mut self, _call: &MethodCall, done: CourierResult) -> MethodResult {
        let carried = match done {
            CourierResult::Moved(moved) => return self.base.performed(&moved),
            CourierResult::Carries(carried) => carried,
        };
        let detail = match &carried {
            Some(parcel) => format!("carries {parcel}"),
            None => "has set the parcel down".to_owned(),
        };
        MethodResult { detail, observations: Vec::new() }
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let (carried, located) = (Arc::clone(&self.carried), self.base.locate());
        Some(Box::pin(async move {
            located.await;
            if let Ok(parcel) = building.carried_by(&id).await {
                carried.send_replace(parcel);
            }
        }))
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        self.base.stand_still()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Courier>>> {
        let wish = self.base.next_initiative();
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let carried = Arc::clone(&self.carried);
        let differs = async move {
            loop {
                tokio::time::sleep(LOOK_INTERVAL).await;
                let known = carried.borrow().clone();
                match building.carried_by(&id).await {
                    // What a method has changed meanwhile is known already.
                    Ok(now) if now != known && *carried.borrow() == known => return now,
                    _ => (),
                }
            }
        };
        Some(Box::pin(async move {
            let news: DeviceEvent<Courier> = tokio::select! {
                () = wish => Box::new(|robot| robot.base.take_initiatives()),
                now = differs => Box::new(move |robot| {
                    robot.carried.send_replace(now);
                    Vec::new()
                }),
            };
            news
        }))
    }
}
