//! The IR temperature sensor (the paper, “Temperature IR Sensor”), which is mounted on a mobile
//! base and reports the temperature at the location of the base.
//!
//! - [`InfraredThermometer`] is the trait of drivers; `simulated` measures in the simulated
//!   building.
//! - The sensor keeps the last measurement of each room in which it has measured.
//! - A measurement in a room other than the requested one is a failure, because the plan assumes
//!   the base to be in the requested room.

mod simulated;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::content::Method;
use acl::{AgentId, Millis};
use actuator::{
    Actuator, BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact,
    facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry, config_validity};
use serde::Deserialize;
use tokio::time::Instant;

/// Pause after a failure, during which a sensor offers no actions.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// Time limit of a measurement.
const MEASURING: Duration = Duration::from_secs(2);

/// The entry of the IR temperature sensor in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "ir-temperature-sensor",
    about: "reports the temperature wherever its mobile base stands",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

/// The `config` of an IR temperature sensor's entry.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// Name of the mobile base that carries the sensor.
    mounted_on: AgentId,
    /// Time for which a measurement counts as known, such as `"10min"`. Without this key, the time is
    /// not limited.
    #[serde(default)]
    valid_for: Option<String>,
}

/// The driver of an infrared thermometer.
pub trait InfraredThermometer: Send + Sync + 'static {
    /// Measures the temperature at the location of the sensor. Error texts complete “failed to …”.
    fn measure(&self) -> BoxFuture<Result<IrMeasurement, String>>;
}

/// A temperature that an IR temperature sensor has measured.
#[derive(Clone, Debug, PartialEq)]
pub struct IrMeasurement {
    /// Name of the location of the measurement.
    pub location: String,
    /// Measured temperature, in °C.
    pub celsius: f64,
    /// Time of the measurement.
    pub at: Instant,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { mounted_on, valid_for } = blueprint.config_as()?;
    let valid_for = valid_for
        .map(|text| config_validity("valid-for", &text))
        .transpose()
        .map_err(|problem| blueprint.problem(problem))?;
    let thermometer = simulated::thermometer(&blueprint)?;
    let sensor = IrTemperatureSensor {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        mounted_on,
        valid_for,
        thermometer,
        measured: BTreeMap::new(),
        paused_until: None,
    };
    Actuator::build(&blueprint, sensor)
}

struct IrTemperatureSensor {
    id: String,
    ontology: String,
    mounted_on: AgentId,
    valid_for: Option<Duration>,
    thermometer: Arc<dyn InfraredThermometer>,
    /// Last measurement of each room, by the room's name.
    measured: BTreeMap<String, IrMeasurement>,
    paused_until: Option<Instant>,
}

impl IrTemperatureSensor {
    fn is_available(&self) -> bool {
        self.paused_until.is_none_or(|until| until <= Instant::now())
    }

    /// Returns the facts of a measurement; an empty list if the measurement no longer counts as
    /// known.
    fn known(&self, measurement: &IrMeasurement) -> Vec<OwnFact> {
        let IrMeasurement { location, celsius, at } = measurement;
        let known_for = self.valid_for.map(|valid_for| valid_for.saturating_sub(at.elapsed()));
        if known_for.is_some_and(|left| left.is_zero()) {
            return Vec::new();
        }
        let text = format!("(known-temperature {location}) (= (temperature {location}) {celsius})");
        facts_of(&text).into_iter().map(|fact| OwnFact { known_for, ..fact }).collect()
    }
}

impl Device for IrTemperatureSensor {
    type Yield = IrMeasurement;

    fn describe(&self) -> Description {
        let IrTemperatureSensor { id, ontology, mounted_on, .. } = self;
        // The cost is higher than that of a sensor that is fixed in the room, so that the base
        // stays free for tasks of its own.
        let action = "(:action report-temperature
            :agent ?s - ir-temperature-sensor
            :parameters (?b - mobile-base ?r - room)
            :precondition (and (mounted-on ?s ?b) (at ?b ?r))
            :effect (and (known-temperature ?r) (increase (total-cost) 2))
            :observe (temperature ?r))";
        let offered = if self.is_available() { action } else { "" };
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:objects {id} - ir-temperature-sensor)
                (:init (mounted-on {id} {mounted_on}))
                {offered})"
        );
        let method = Method {
            method: "read_temperature".to_owned(),
            arguments: [("room".to_owned(), "?r".to_owned())].into(),
            timeout: Millis(MEASURING),
        };
        let methods = [("report-temperature".to_owned(), method)].into();
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let mounted = format!("(mounted-on {} {})", self.id, self.mounted_on);
        let known = self.measured.values().flat_map(|measurement| self.known(measurement));
        facts_of(&mounted).into_iter().chain(known).collect()
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<IrMeasurement, MethodFailure>> {
        let room = match call.argument("room") {
            Ok(room) if call.method == "read_temperature" => room.to_owned(),
            Ok(_) => return failed_method(MethodFailure::UnknownMethod(call.method.clone())),
            Err(failure) => return failed_method(failure),
        };
        let measured = self.thermometer.measure();
        Box::pin(async move {
            let measurement = measured.await.map_err(MethodFailure::Driver)?;
            if measurement.location != room {
                let IrMeasurement { location, .. } = measurement;
                let problem = format!("measure in `{room}`: the sensor is in `{location}`");
                return Err(MethodFailure::Driver(problem));
            }
            Ok(measurement)
        })
    }

    fn on_success(&mut self, _call: &MethodCall, measured: IrMeasurement) -> MethodResult {
        let detail = format!("{:.1} °C at {}", measured.celsius, measured.location);
        let observations = self.known(&measured).into_iter().map(|fact| fact.fact).collect();
        self.measured.insert(measured.location.clone(), measured);
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, _call: &MethodCall, failure: &MethodFailure) {
        if *failure != MethodFailure::GivenUp {
            self.paused_until = Some(Instant::now() + REST_AFTER_FAILURE);
        }
    }
}

fn failed_method(failure: MethodFailure) -> BoxFuture<Result<IrMeasurement, MethodFailure>> {
    Box::pin(std::future::ready(Err(failure)))
}
