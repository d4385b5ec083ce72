//! The courier: a mobile base that carries one parcel at a time, to another place or into the cabin
//! of a lift. With a tray, an arm can load it while it stands still.
//!
//! - `mobile_base::MobileBase` implements moving, the battery and the dock, as for every robot.
//! - Where parcels lie is told by a tag reader, and where the cabin of a lift is by the lift.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

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
const HOLD_STILL: &str = "hold_still";
const MOVE_ON: &str = "move_on";

/// Time limit of taking up or setting down a parcel.
const HANDLING_MAX: Duration = Duration::from_secs(60);

/// Interval at which the courier looks whether it still carries what it believes: a person may take
/// the parcel, or a method may have been cancelled at the last moment.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// Interval at which a courier that waits to be loaded looks whether it is loaded, and how often it
/// looks at this interval: for ten seconds.
const LOADING_INTERVAL: Duration = Duration::from_millis(50);
const LOADING_LOOKS: u32 = 200;

/// Maximum number of parcels that a courier declares as objects; of more, those that it has carried
/// first are not declared any more.
const DECLARED_MAX: usize = 32;

/// The `config` of a courier's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Config {
    #[serde(flatten)]
    base: BaseConfig,
    /// Whether it has a tray on which an arm can load a parcel.
    #[serde(default)]
    tray: bool,
    /// All other keys of the entry's `config`. Any such key is an error.
    #[serde(flatten)]
    unknown: serde_json::Map<String, serde_json::Value>,
}

struct Courier {
    id: String,
    ontology: String,
    base: MobileBase,
    building: Arc<BuildingHandle>,
    has_tray: bool,
    load: Arc<watch::Sender<CourierLoad>>,
}

/// What a courier carries, or waits for.
#[derive(Default)]
struct CourierLoad {
    /// Name of the carried parcel; `None` if it carries none.
    carried: Option<String>,
    /// The place where it stands still to be loaded; `None` if it does not wait for that.
    holding_still_at: Option<String>,
    /// Names of the parcels that it has carried since its start, the newest last.
    carried_before: VecDeque<String>,
}

/// The result of a method of the courier.
enum CourierResult {
    Moved(BaseOutcome),
    Carries(Option<String>),
    /// Stands still in this place to be loaded, or no longer.
    HoldsStill(Option<String>),
}

// === impl CourierLoad ===

impl CourierLoad {
    /// Sets the carried parcel, and where the courier stands still to be loaded.
    fn set(&mut self, carried: Option<String>, holding_still_at: Option<String>) {
        (self.carried, self.holding_still_at) = (carried, holding_still_at);
        if let Some(parcel) = &self.carried
            && !self.carried_before.contains(parcel)
        {
            self.carried_before.push_back(parcel.clone());
            if self.carried_before.len() > DECLARED_MAX {
                self.carried_before.pop_front();
            }
        }
    }

    /// Sets the carried parcel as a look has found it. A courier that is loaded does not wait for it.
    fn look(&mut self, carried: Option<String>) {
        let holding_still_at = self.holding_still_at.take().filter(|_| carried.is_none());
        self.set(carried, holding_still_at);
    }
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { base, tray, unknown } = blueprint.config_as()?;
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
        has_tray: tray,
        load: Arc::default(),
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

/// The PDDL of the actions with a tray.
const TRAY_ACTIONS: &str = "(:action hold-still
        :agent ?b - courier
        :parameters (?l - location)
        :precondition (and (at ?b ?l) (hands-free ?b))
        :effect (and (holding-still ?b ?l) (not (hands-free ?b)) (increase (total-cost) 1)))
    (:action move-on
        :agent ?b - courier
        :parameters (?l - location)
        :precondition (holding-still ?b ?l)
        :effect (and (hands-free ?b) (not (holding-still ?b ?l)) (increase (total-cost) 1)))";

impl Courier {
    /// Carries out a method with which the courier begins to stand still, or ceases to.
    fn hold_still(&self, call: &MethodCall) -> BoxFuture<Result<CourierResult, MethodFailure>> {
        let place = call.argument("place").map(str::to_owned);
        let (is_begun, here) = (call.method == HOLD_STILL, self.base.place());
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let load = Arc::clone(&self.load);
        Box::pin(async move {
            let place = place?;
            let parcel = building.carried_by(&id).await;
            let parcel = parcel.map_err(|error| MethodFailure::Driver(error.to_string()))?;
            let problem = match &parcel {
                Some(parcel) => Some(format!("carry nothing: it carries `{parcel}`")),
                None if is_begun && here.as_ref() != Some(&place) => {
                    let here = here.as_deref().unwrap_or("a place that it does not know");
                    Some(format!("stand still at `{place}`: it is at `{here}`"))
                }
                None => None,
            };
            let holding_still_at = Some(place).filter(|_| is_begun && problem.is_none());
            load.send_modify(|load| load.set(parcel, holding_still_at.clone()));
            match problem {
                Some(problem) => Err(MethodFailure::Hindered(problem)),
                None => Ok(CourierResult::HoldsStill(holding_still_at)),
            }
        })
    }

    /// Carries out a method of the base. A courier that drives away does not wait to be loaded any
    /// more; whether it was loaded is looked up before and after.
    fn drive(&mut self, call: &MethodCall) -> BoxFuture<Result<CourierResult, MethodFailure>> {
        let moved = self.base.perform(call);
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let load = Arc::clone(&self.load);
        Box::pin(async move {
            if load.borrow().holding_still_at.is_none() {
                return moved.await.map(CourierResult::Moved);
            }
            let look = async || {
                if let Ok(parcel) = building.carried_by(&id).await {
                    load.send_modify(|load| load.look(parcel));
                }
            };
            look().await;
            load.send_modify(|load| load.holding_still_at = None);
            let moved = moved.await;
            // The arm may have ended loading at the last moment before the departure.
            look().await;
            moved.map(CourierResult::Moved)
        })
    }
}

impl Device for Courier {
    type Yield = CourierResult;

    fn describe(&self) -> Description {
        let Courier { id, ontology, base, .. } = self;
        let method = |name: &str, arguments: &[_]| Method::new(name, arguments, HANDLING_MAX);
        let mut methods = base.methods();
        for action in ["take-up", "take-out"] {
            methods.insert(action.to_owned(), method(TAKE_UP, &[("parcel", "?p")]));
        }
        methods.insert("set-down".to_owned(), method(SET_DOWN, &[]));
        methods.insert("put-in".to_owned(), method(PUT_IN, &[("lift", "?c")]));
        let (mut waiting, mut tray) = ("", "");
        if self.has_tray {
            methods.insert("hold-still".to_owned(), method(HOLD_STILL, &[("place", "?l")]));
            methods.insert("move-on".to_owned(), method(MOVE_ON, &[("place", "?l")]));
            (waiting, tray) = ("(holding-still ?b - mobile-base ?l - location)", TRAY_ACTIONS);
        }
        let (mut objects, lasting, moving) = (base.objects(), base.model_facts(), base.actions(""));
        // The arm that has loaded a parcel may leave. What the courier has told of the parcel counts
        // only as long as some agent declares it.
        if self.has_tray {
            for parcel in &self.load.borrow().carried_before {
                objects += &format!(" {parcel} - parcel");
            }
        }
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
                    {waiting}
                    (:private (hands-free ?b - courier)))
                (:objects {objects})
                (:init {lasting})
                {moving}
                {handling}
                {tray})"
        );
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let Courier { id, base, .. } = self;
        let load = self.load.borrow();
        let hands = match (&load.carried, &load.holding_still_at) {
            (Some(parcel), _) => format!("(carrying {id} {parcel})"),
            (None, Some(place)) if base.place().as_ref() == Some(place) => {
                format!("(holding-still {id} {place})")
            }
            (None, _) => format!("(hands-free {id})"),
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
            HOLD_STILL | MOVE_ON => return self.hold_still(call),
            _ => return self.drive(call),
        };
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let load = Arc::clone(&self.load);
        Box::pin(async move {
            let (take, lift) = (take?, lift.transpose()?);
            let done = match &take {
                Some(parcel) => building.take_up(&id, parcel).await,
                None => building.set_down(&id, lift.as_deref()).await,
            };
            done.map_err(|error| MethodFailure::Driver(error.to_string()))?;
            load.send_modify(|load| load.set(take.clone(), None));
            Ok(CourierResult::Carries(take))
        })
    }

    fn on_success(&mut self, _call: &MethodCall, done: CourierResult) -> MethodResult {
        let carried = match done {
            CourierResult::Moved(moved) => return self.base.performed(&moved),
            CourierResult::Carries(carried) => carried,
            CourierResult::HoldsStill(place) => {
                let detail = match place {
                    Some(place) => format!("stands still at {place}"),
                    None => "no longer waits to be loaded".to_owned(),
                };
                return MethodResult { detail, observations: Vec::new() };
            }
        };
        let detail = match &carried {
            Some(parcel) => format!("carries {parcel}"),
            None => "has set the parcel down".to_owned(),
        };
        MethodResult { detail, observations: Vec::new() }
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let (load, located) = (Arc::clone(&self.load), self.base.locate());
        Some(Box::pin(async move {
            located.await;
            if let Ok(parcel) = building.carried_by(&id).await {
                load.send_modify(|load| load.look(parcel));
            }
        }))
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        self.base.stand_still()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Courier>>> {
        let wish = self.base.next_initiative();
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let load = Arc::clone(&self.load);
        let differs = async move {
            let mut changes = load.subscribe();
            let mut quick_looks = LOADING_LOOKS;
            loop {
                let known = changes.borrow_and_update().carried.clone();
                let is_waiting = changes.borrow().holding_still_at.is_some() && quick_looks > 0;
                quick_looks = quick_looks.saturating_sub(u32::from(is_waiting));
                let interval = if is_waiting { LOADING_INTERVAL } else { LOOK_INTERVAL };
                tokio::select! {
                    () = tokio::time::sleep(interval) => (),
                    // The sender is held above, so there is no error.
                    _ = changes.changed() => {
                        quick_looks = LOADING_LOOKS;
                        continue;
                    }
                }
                match building.carried_by(&id).await {
                    Ok(now) if now != known => return (known, now),
                    _ => (),
                }
            }
        };
        Some(Box::pin(async move {
            let news: DeviceEvent<Courier> = tokio::select! {
                () = wish => Box::new(|robot| robot.base.take_initiatives()),
                (known, now) = differs => Box::new(move |robot| {
                    // What a method has changed meanwhile is known already.
                    if robot.load.borrow().carried == known {
                        robot.load.send_modify(|load| load.look(now));
                    }
                    Vec::new()
                }),
            };
            news
        }))
    }
}
