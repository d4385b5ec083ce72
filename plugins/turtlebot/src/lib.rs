//! The TurtleBot (the paper, “TurtleBot”): a mobile base that moves between the places of the map
//! and carries sensors.
//!
//! - [`MobileBase`] is what a driver does; `simulated` moves in the simulated building.
//! - It carries the agents that say they are `mounted-on` it, and so plans with their actions.
//! - After a move that failed or was given up it asks its driver where it truly stands.

mod simulated;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::Deadline;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Call, Description, Device, Failure, OwnFact, Performed, Place, facts_of,
    model_of,
};
use agent::{Blueprint, BuildError, Launch, PluginEntry};
use pddl::{ActionModel, InitElement, Term};
use serde::Deserialize;

/// The line in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "turtlebot",
    about: "a mobile base: moves between the places of the map, carries sensors",
    drivers: &["simulated"],
    build,
};

/// The entry's `config`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// Where it stands at first.
    start: Place,
    /// How fast it moves, in meters per second.
    #[serde(default = "default_speed")]
    speed: f64,
    /// The longest one move may take, in seconds: a corridor of 30 meters at 0.3 m/s, with a
    /// person in the way.
    #[serde(default = "default_move_timeout")]
    move_timeout: f64,
}

fn default_speed() -> f64 {
    0.3
}

fn default_move_timeout() -> f64 {
    120.0
}

/// What a mobile base's driver does.
pub trait MobileBase: Send + Sync + 'static {
    /// Drives to a neighboring place. The error completes “failed to …”. Dropping the future
    /// stops the base.
    fn navigate_to(&self, place: &str) -> BoxFuture<Result<(), String>>;

    /// Where it stands.
    fn place(&self) -> BoxFuture<Result<String, String>>;
}

/// The place where the base stands as far as it knows: shared with the future that moves it,
/// which may be dropped at any time.
type Stands = Arc<Mutex<String>>;

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let Config { start, speed, move_timeout } = blueprint.config_as()?;
    let positive = |name: &str, number: f64| {
        let is_fine = number.is_finite() && number > 0.0 && number < 1e6;
        is_fine
            .then_some(number)
            .ok_or_else(|| blueprint.problem(format!("{name} = {number} must be above zero")))
    };
    let base = simulated::base(&blueprint)?;
    let turtlebot = TurtleBot {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        speed: positive("speed", speed)?,
        move_timeout: Duration::from_secs_f64(positive("move-timeout", move_timeout)?),
        place: Arc::new(Mutex::new(start.to_string())),
        base,
    };
    Ok(Box::new(Actuator::new(&blueprint, turtlebot)?))
}

struct TurtleBot {
    id: String,
    ontology: String,
    speed: f64,
    move_timeout: Duration,
    place: Stands,
    base: Arc<dyn MobileBase>,
}

impl TurtleBot {
    fn at(&self) -> String {
        self.place.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Device for TurtleBot {
    type Yield = String;

    fn describe(&self) -> Description {
        let TurtleBot { id, ontology, speed, .. } = self;
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types turtlebot - mobile-base)
                (:objects {id} - turtlebot)
                (:init (= (speed {id}) {speed}))
                (:action move
                    :agent ?b - turtlebot
                    :parameters (?from ?to - location)
                    :precondition (and (at ?b ?from) (connected ?from ?to))
                    :effect (and (not (at ?b ?from)) (at ?b ?to)
                        (increase (total-cost) (distance ?from ?to)))))"
        );
        let method = Method {
            method: "navigate_to".to_owned(),
            arguments: [("place".to_owned(), "?to".to_owned())].into(),
            timeout: Deadline(self.move_timeout),
        };
        let methods = [("move".to_owned(), method)].into();
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let TurtleBot { id, speed, .. } = self;
        let text = format!("(at {id} {}) (= (speed {id}) {speed})", self.at());
        facts_of(&text)
    }

    fn perform(&mut self, call: &Call) -> BoxFuture<Result<String, Failure>> {
        let place = match call.argument("place") {
            Ok(place) if call.method == "navigate_to" => place.to_owned(),
            Ok(_) => return fails(Failure::UnknownMethod(call.method.clone())),
            Err(failure) => return fails(failure),
        };
        let (base, stands) = (Arc::clone(&self.base), Arc::clone(&self.place));
        Box::pin(async move {
            let moved = base.navigate_to(&place).await;
            // Where it truly is, however the move ended.
            let truth = base.place().await.map_err(Failure::Driver)?;
            *stands.lock().unwrap_or_else(PoisonError::into_inner) = truth.clone();
            moved.map_err(Failure::Driver)?;
            if truth == place {
                return Ok(truth);
            }
            Err(Failure::Driver(format!("arrive at `{place}`: the base stands at `{truth}`")))
        })
    }

    fn performed(&mut self, _call: &Call, place: String) -> Performed {
        let at = format!("(at {} {place})", self.id);
        let observations = facts_of(&at).into_iter().map(|fact| fact.fact).collect();
        Performed { detail: format!("arrived at {place}"), observations }
    }

    fn carries(&self, model: &ActionModel) -> bool {
        let is_self = |term: &Term| matches!(term, Term::Object(name) if *name == self.id.as_str());
        model.init.iter().any(|element| match element {
            InitElement::Atom(atom) => {
                atom.predicate == "mounted-on" && atom.arguments.get(1).is_some_and(is_self)
            }
            _ => false,
        })
    }
}

fn fails(failure: Failure) -> BoxFuture<Result<String, Failure>> {
    Box::pin(std::future::ready(Err(failure)))
}
