//! A sensor, written from scratch: its action model, its facts, its method.
//!
//! `cargo run -p actuator --example sensor`
//!
//! The sensor implements [`Device`]. [`Actuator`] adds the heartbeats, the bids with a planner of
//! the device's own, and the ledger of commands. The example runs the sensor on an in-memory
//! network (`office`). In a real ecosystem, the constant `PLUGIN` is given to
//! `plugin_process::run`, which makes it the program of a package (docs/plugins.md), or the
//! constant is listed in daemon/command-line/althing/src/plugins.rs.

mod office;

use std::collections::BTreeMap;
use std::error::Error;
use std::time::{Duration, Instant};

use acl::Millis;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact,
    PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use serde::Deserialize;
use serde_json::json;

use office::{Wish, play};

/// The entry of this plugin in a daemon's table of plugins.
const PLUGIN: PluginEntry = PluginEntry {
    name: "example-thermometer",
    about: "reports the temperature of the room it stands in",
    drivers: &[],
    has_replicas: false,
    build,
};

/// How long a measured temperature counts as known.
const VALID_FOR: Duration = Duration::from_secs(600);

/// The `config` of a sensor in the ecosystem file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    location: PlaceName,
}

struct Thermometer {
    id: String,
    room: PlaceName,
    /// The last measured temperature in °C, and the time of the measurement.
    measured: Option<(f64, Instant)>,
}

/// Reads the config of the sensor and checks it. Opens no hardware, because `althing check` also
/// builds agents.
fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { location } = blueprint.config_as()?;
    let checked = blueprint.host.has_place(location.as_str());
    checked.map_err(|problem| blueprint.problem(problem))?;
    let device = Thermometer { id: blueprint.id.to_string(), room: location, measured: None };
    Actuator::build(&blueprint, device)
}

impl Device for Thermometer {
    /// The result of the method `measure`: a temperature in °C.
    type Yield = f64;

    fn describe(&self) -> Description {
        let Thermometer { id, room, .. } = self;
        // The effect states which fact is known after the action; `:observe` names the value that
        // is measured.
        let model = model_of(&format!(
            "(define (agent {id}) (:domain smart-office)
               (:objects {id} - temperature-sensor)
               (:init (located {id} {room}))
               (:action report-temperature
                 :agent ?s - temperature-sensor
                 :parameters (?r - room)
                 :precondition (located ?s ?r)
                 :effect (and (known-temperature ?r) (increase (total-cost) 1))
                 :observe (temperature ?r)))"
        ));
        let method = Method {
            method: "measure".to_owned(),
            arguments: BTreeMap::new(),
            timeout: Millis(Duration::from_secs(2)),
        };
        Description { model, methods: [("report-temperature".to_owned(), method)].into() }
    }

    /// Returns all facts that the sensor answers for. A fact that is missing from the list is
    /// false, and a number that is missing has no value.
    fn facts(&self) -> Vec<OwnFact> {
        let Thermometer { id, room, measured } = self;
        let mut facts = facts_of(&format!("(located {id} {room})"));
        if let Some((celsius, at)) = measured {
            let left = VALID_FOR.saturating_sub(at.elapsed());
            let known = format!("(known-temperature {room}) (= (temperature {room}) {celsius})");
            let known = facts_of(&known).into_iter();
            facts.extend(known.map(|fact| OwnFact { known_for: Some(left), ..fact }));
        }
        facts
    }

    /// Runs the method that a request names. The agent's task must not block, so the work is done
    /// in the returned future.
    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<f64, MethodFailure>> {
        if call.method != "measure" {
            let unknown = MethodFailure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        }
        Box::pin(async { measure().await.map_err(MethodFailure::Driver) })
    }

    /// Stores the measurement that a method has returned. [`Device::facts`] is called next, before
    /// the action is confirmed.
    fn on_success(&mut self, _call: &MethodCall, celsius: f64) -> MethodResult {
        self.measured = Some((celsius, Instant::now()));
        let observations = self.facts().into_iter().map(|fact| fact.fact).collect();
        MethodResult { detail: format!("{celsius} °C at {}", self.room), observations }
    }
}

/// Reads the hardware; in this example it returns a fixed number after a moment. The text of an
/// error completes “failed to …”.
async fn measure() -> Result<f64, String> {
    tokio::time::sleep(Duration::from_millis(20)).await;
    Ok(21.5)
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let wish =
        Wish { goal: "(known-temperature office1)", method: "measure", arguments: BTreeMap::new() };
    play(PLUGIN, "thermometer-1", json!({ "location": "office1" }), wish).await
}
