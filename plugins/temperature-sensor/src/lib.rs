//! The stationary temperature sensor (the paper, “Temperature / Humidity Sensor”): reports the
//! temperature at its location.
//!
//! - [`Thermometer`] is what a driver does; `simulated` measures in the simulated building.
//! - After a failed measurement it offers nothing for a while: “re-evaluate and update
//!   self-capabilities” (the paper, “Semantic Plug & Play”).

mod simulated;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::Deadline;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Call, Description, Device, Failure, OwnFact, Performed, Place, facts_of,
    model_of,
};
use agent::{Blueprint, BuildError, Launch, PluginEntry};
use serde::Deserialize;
use tokio::time::Instant;

/// How long a thermometer that failed offers nothing. A loose wire comes back within seconds.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// The longest a measurement may take: slow bus sensors need below a second.
const MEASURING: Duration = Duration::from_secs(2);

/// The line in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "temperature-sensor",
    about: "reports the temperature of the room it stands in",
    drivers: &["simulated"],
    build,
};

/// The entry's `config`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// The room it stands in.
    location: Place,
    /// How long a measurement counts as known, such as `"10m"`; without it, until it dies.
    #[serde(default)]
    valid_for: Option<String>,
}

/// What a thermometer's driver does.
pub trait Thermometer: Send + Sync + 'static {
    /// Measures, in °C. The error completes “failed to …”.
    fn measure(&self) -> BoxFuture<Result<Measurement, String>>;
}

/// A measured temperature.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// The temperature.
    pub celsius: f64,
    /// When it was measured.
    pub at: Instant,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let Config { location, valid_for } = blueprint.config_as()?;
    let valid_for = valid_for
        .map(|text| {
            humantime::parse_duration(&text)
                .map_err(|error| blueprint.problem(format!("valid-for `{text}`: {error}")))
        })
        .transpose()?;
    let thermometer = simulated::thermometer(&blueprint)?;
    let sensor = TemperatureSensor {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        location,
        valid_for,
        thermometer,
        last: None,
        rests_until: None,
    };
    Ok(Box::new(Actuator::new(&blueprint, sensor)?))
}

struct TemperatureSensor {
    id: String,
    ontology: String,
    location: Place,
    valid_for: Option<Duration>,
    thermometer: Arc<dyn Thermometer>,
    last: Option<Measurement>,
    rests_until: Option<Instant>,
}

impl TemperatureSensor {
    fn works(&self) -> bool {
        self.rests_until.is_none_or(|until| until <= Instant::now())
    }

    /// The measurement as facts, as long as it counts as known.
    fn known(&self) -> Vec<OwnFact> {
        let Some(Measurement { celsius, at }) = &self.last else { return Vec::new() };
        let known_for = self.valid_for.map(|valid_for| valid_for.saturating_sub(at.elapsed()));
        if known_for.is_some_and(|left| left.is_zero()) {
            return Vec::new();
        }
        let location = &self.location;
        let text = format!("(known-temperature {location}) (= (temperature {location}) {celsius})");
        facts_of(&text).into_iter().map(|fact| OwnFact { known_for, ..fact }).collect()
    }
}

impl Device for TemperatureSensor {
    type Yield = Measurement;

    fn describe(&self) -> Description {
        let TemperatureSensor { id, ontology, location, .. } = self;
        let action = "(:action report-temperature
            :agent ?s - temperature-sensor
            :parameters (?r - room)
            :precondition (located ?s ?r)
            :effect (and (known-temperature ?r) (increase (total-cost) 1)))";
        let offered = if self.works() { action } else { "" };
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:objects {id} - temperature-sensor)
                (:init (located {id} {location}))
                {offered})"
        );
        let method = Method {
            method: "read_temperature".to_owned(),
            arguments: BTreeMap::new(),
            timeout: Deadline(MEASURING),
        };
        let methods = [("report-temperature".to_owned(), method)].into();
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let located = format!("(located {} {})", self.id, self.location);
        facts_of(&located).into_iter().chain(self.known()).collect()
    }

    fn perform(&mut self, call: &Call) -> BoxFuture<Result<Measurement, Failure>> {
        if call.method != "read_temperature" {
            let unknown = Failure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        }
        let measured = self.thermometer.measure();
        Box::pin(async move { measured.await.map_err(Failure::Driver) })
    }

    fn performed(&mut self, _call: &Call, measured: Measurement) -> Performed {
        let detail = format!("{:.1} °C at {}", measured.celsius, self.location);
        self.last = Some(measured);
        let observations = self.known().into_iter().map(|fact| fact.fact).collect();
        Performed { detail, observations }
    }

    fn failed(&mut self, _call: &Call, failure: &Failure) {
        if *failure != Failure::GivenUp {
            self.rests_until = Some(Instant::now() + REST_AFTER_FAILURE);
        }
    }
}
