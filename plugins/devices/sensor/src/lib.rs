//! Sensors that are fixed in a room (the paper, “Temperature / Humidity Sensor” and the sensors for
//! CO2, motion, IR distance, light and IR reflection). Each sensor reports the measurements in its
//! room.
//!
//! - `quantity` is the table of quantities; all other code is independent of the quantity.
//! - [`Probe`] is the trait of drivers. `simulated` measures in the simulated building, `linux`
//!   with devices of this machine's kernel, and `command` by running a program. `mqtt` receives
//!   values from a broker, `phidget` measures with sensors on interface kits of Phidgets, and
//!   `gpio` watches a line of a board.
//! - `board` automatically creates agents for all sensors of this machine's kernel.
//! - Changes of yes-or-no quantities (motion, a door's contact) are announced at once, without a
//!   request.
//! - After a failed measurement a sensor offers no actions for a while: “re-evaluate and update
//!   self-capabilities” (the paper, “Semantic Plug & Play”).

mod board;
mod command;
mod config;
mod gpio;
mod linux;
mod mqtt;
mod phidget;
mod quantity;
mod simulated;
mod text;

#[cfg(test)]
#[path = "../../../../tests/support/broker.rs"]
#[allow(dead_code, reason = "what other tests need of a broker besides")]
mod broker;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry, StopButtons, config_validity};
use pddl::Domain;
use tokio::time::Instant;

use crate::config::Config;
use crate::quantity::{QUANTITIES, SensorQuantity};

/// Pause after a failure, during which a sensor offers no actions. For example, a loose wire has
/// contact again within seconds.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// Time limit of a measurement. Sensors on a slow bus need less than a second.
const MEASURING: Duration = Duration::from_secs(2);

const SIMULATED: &str = "simulated";
const LINUX: &str = "linux";
const COMMAND: &str = "command";
const MQTT: &str = "mqtt";
const PHIDGET: &str = "phidget";
const GPIO: &str = "gpio";
const DRIVERS: &[&str] = &[SIMULATED, LINUX, COMMAND, MQTT, PHIDGET, GPIO];

pub use board::BOARD;

/// The entry of sensors of any quantity in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "sensor",
    about: "reports the CO2, humidity, light, motion … of the room it stands in",
    drivers: DRIVERS,
    has_replicas: false,
    build,
};

/// The entry of the sensor that every building has, in the daemon's table of plugins. The sensor
/// measures temperature, and humidity on the same board.
pub const TEMPERATURE_SENSOR: PluginEntry = PluginEntry {
    name: "temperature-sensor",
    about: "reports the temperature, and if asked to the humidity, of the room it stands in",
    drivers: DRIVERS,
    has_replicas: false,
    build: build_temperature_sensor,
};

/// The driver of a sensor. Error texts complete “failed to …”.
pub trait Probe: Send + Sync + 'static {
    /// Measures the quantity with the name `quantity` in the table `QUANTITIES`.
    fn measure(&self, quantity: &'static str) -> BoxFuture<Result<Measurement, String>>;

    /// Waits until a yes-or-no quantity differs from `known`, and measures it. The wait lasts as
    /// long as the quantity does not change.
    fn notice(&self, quantity: &'static str, known: f64) -> BoxFuture<Result<Measurement, String>>;

    /// Returns `true` if the sensor was plugged in at the last check.
    fn is_present(&self) -> bool {
        true
    }

    /// Returns a future that checks whether the sensor is plugged in; `None` if a sensor of this
    /// driver cannot be unplugged.
    fn check_presence(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// Returns a future that ends when the sensor is unplugged, is plugged in, or reports a value
    /// by itself; `None` if none of these events can happen.
    fn wait_for_news(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// Returns the last value of a quantity that the sensor has reported by itself, or the reason
    /// why that report has no value. Returns `None` if there is no report.
    fn last_report(&self, _quantity: &'static str) -> Option<Result<Measurement, String>> {
        None
    }
}

/// Result of one measurement of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Measured value in the quantity's unit; for a yes-or-no quantity, 1 is yes and 0 is no.
    pub value: f64,
    /// Time of the measurement.
    pub at: Instant,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Actuator::build(&blueprint, sensor(&blueprint)?)
}

fn build_temperature_sensor(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Actuator::build(&blueprint, temperature_sensor(&blueprint)?)
}

fn sensor(blueprint: &Blueprint) -> Result<Sensor, BuildError> {
    let config: Config = blueprint.config_as()?;
    if config.humidity.is_some() {
        let problem = "`humidity` is for `plugin = \"temperature-sensor\"`; write `quantity`";
        return Err(blueprint.problem(problem));
    }
    let quantity = config.quantity.clone().ok_or_else(|| {
        let known: Vec<_> = QUANTITIES.iter().map(|quantity| quantity.name).collect();
        blueprint.problem(format!("it needs a `quantity`: {}", known.join(", ")))
    })?;
    Sensor::new(blueprint, &[&quantity], config)
}

fn temperature_sensor(blueprint: &Blueprint) -> Result<Sensor, BuildError> {
    let config: Config = blueprint.config_as()?;
    if config.quantity.is_some() {
        let problem = "`quantity` is for `plugin = \"sensor\"`; this one measures the temperature";
        return Err(blueprint.problem(problem));
    }
    let humidity = config.humidity.unwrap_or(false);
    let quantities: &[_] = if humidity { &["temperature", "humidity"] } else { &["temperature"] };
    Sensor::new(blueprint, quantities, config)
}

struct Sensor {
    id: String,
    ontology: Arc<Domain>,
    location: PlaceName,
    /// Whether the sensor is a hardware stop, and so no door or window of its room.
    is_stop_button: bool,
    /// Quantities that the sensor measures. The first one determines the PDDL type of the sensor.
    quantities: Vec<&'static SensorQuantity>,
    valid_for: Option<Duration>,
    probe: Arc<dyn Probe>,
    /// Last measurement of each quantity, by the quantity's name.
    measured: BTreeMap<&'static str, Measurement>,
    paused_until: Option<Instant>,
}

impl Sensor {
    fn new(
        blueprint: &Blueprint,
        quantities: &[&str],
        mut config: Config,
    ) -> Result<Sensor, BuildError> {
        let named =
            |name: &&str| SensorQuantity::named(name).map_err(|problem| blueprint.problem(problem));
        let validity =
            |text| config_validity("valid-for", text).map_err(|problem| blueprint.problem(problem));
        let quantities = quantities.iter().map(named).collect::<Result<Vec<_>, _>>()?;
        let hardware = config.hardware(blueprint)?;
        let probe = match blueprint.driver.as_str() {
            LINUX => linux::probe(blueprint, hardware, &quantities)?,
            COMMAND => command::probe(blueprint, hardware, &quantities)?,
            MQTT => mqtt::probe(blueprint, hardware, &quantities)?,
            PHIDGET => phidget::probe(blueprint, hardware, &quantities)?,
            GPIO => gpio::probe(blueprint, hardware, &quantities)?,
            _ => simulated::probe(blueprint)?,
        };
        let Config { location, valid_for, .. } = config;
        let buttons = blueprint.host.resources.get::<StopButtons>();
        let is_stop_button =
            buttons.is_some_and(|buttons| buttons.names().any(|name| *name == blueprint.id));
        Ok(Sensor {
            id: blueprint.id.to_string(),
            ontology: Arc::clone(&blueprint.host.ontology),
            location,
            is_stop_button,
            quantities,
            valid_for: valid_for.as_deref().map(validity).transpose()?,
            probe,
            measured: BTreeMap::new(),
            paused_until: None,
        })
    }

    fn is_available(&self) -> bool {
        self.probe.is_present() && self.paused_until.is_none_or(|until| until <= Instant::now())
    }

    /// Returns the quantity that a method measures; `None` if there is none.
    fn read_by(&self, method: &str) -> Option<&'static SensorQuantity> {
        self.quantities.iter().copied().find(|quantity| quantity.method() == method)
    }

    /// Returns the facts of the last measurement of a quantity while the measurement counts as
    /// known; otherwise, the facts for an unknown value.
    fn known(&self, quantity: &SensorQuantity) -> Vec<OwnFact> {
        let room = self.location.as_str();
        let term = quantity.term(&self.id, room, &self.ontology);
        let measured = self.measured.get(quantity.name).filter(|_| self.probe.is_present());
        let known = measured.and_then(|Measurement { value, at }| {
            let left = self.valid_for.map(|valid_for| valid_for.saturating_sub(at.elapsed()));
            left.is_none_or(|left| !left.is_zero()).then_some((*value, left))
        });
        let Some((value, known_for)) = known else {
            return facts_of(&quantity.unknown(&term, room));
        };
        let text = quantity.facts(&term, room, value);
        facts_of(&text).into_iter().map(|fact| OwnFact { known_for, ..fact }).collect()
    }

    /// Starts the pause after a failure, during which no actions are offered. Quantities that are
    /// announced when they change become unknown, because a change may have been missed. An
    /// unplugged sensor gets no pause, because it can be used as soon as it is back.
    fn pause_actions(&mut self) {
        self.paused_until = self.probe.is_present().then(|| Instant::now() + REST_AFTER_FAILURE);
        for quantity in self.quantities.iter().filter(|quantity| quantity.is_noticed()) {
            self.measured.remove(quantity.name);
        }
    }

    fn action(&self, quantity: &SensorQuantity) -> String {
        format!(
            "(:action {}
                :agent ?s - {}
                :parameters (?r - room)
                :precondition (located ?s ?r)
                :effect (and ({} ?r) (increase (total-cost) 1))
                :observe {})",
            quantity.action(),
            self.sensor_type(),
            quantity.known(),
            quantity.term("?s", "?r", &self.ontology)
        )
    }

    /// Returns the location of the sensor, as PDDL facts.
    fn place(&self) -> String {
        let (id, room) = (self.id.as_str(), self.location.as_str());
        let placed = self.quantities.iter().filter(|_| !self.is_stop_button);
        let places = placed.map(|quantity| quantity.place(id, room, &self.ontology));
        format!("(located {id} {room}) {}", places.collect::<String>())
    }

    fn sensor_type(&self) -> String {
        let first = self.quantities.first();
        first.map_or_else(|| "sensor".to_owned(), |quantity| quantity.sensor_type())
    }
}

impl Device for Sensor {
    type Yield = Measurement;

    fn describe(&self) -> Description {
        let Sensor { id, ontology, .. } = self;
        let offered = self.quantities.iter().filter(|_| self.is_available());
        let actions: String = offered.map(|quantity| self.action(quantity)).collect();
        let text = format!(
            "(define (agent {id}) (:domain {})
                (:objects {id} - {})
                (:init {})
                {actions})",
            ontology.name,
            self.sensor_type(),
            self.place()
        );
        let method = |quantity: &&SensorQuantity| {
            let method = Method {
                method: quantity.method(),
                arguments: BTreeMap::new(),
                timeout: Millis(MEASURING),
            };
            (quantity.action(), method)
        };
        let methods = self.quantities.iter().map(method).collect();
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let located = self.place();
        let known = self.quantities.iter().flat_map(|quantity| self.known(quantity));
        facts_of(&located).into_iter().chain(known).collect()
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        self.probe.check_presence()
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<Measurement, MethodFailure>> {
        let Some(quantity) = self.read_by(&call.method) else {
            let unknown = MethodFailure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        };
        let measured = self.probe.measure(quantity.name);
        Box::pin(async move { believable(quantity, measured.await).map_err(MethodFailure::Driver) })
    }

    fn on_success(&mut self, call: &MethodCall, measured: Measurement) -> MethodResult {
        let Some(quantity) = self.read_by(&call.method) else { return MethodResult::default() };
        self.measured.insert(quantity.name, measured);
        let detail = format!("{} at {}", quantity.words(measured.value), self.location);
        let observations = self.known(quantity).into_iter().map(|fact| fact.fact).collect();
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, _call: &MethodCall, failure: &MethodFailure) {
        if *failure != MethodFailure::GivenUp {
            self.pause_actions();
        }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Sensor>>> {
        let noticed = self.quantities.iter().copied().find(|quantity| quantity.is_noticed());
        let Some(quantity) = noticed else { return self.watch_for_news() };
        // A quantity that was never measured is watched as if it were “no”, so that only a “yes” is
        // reported. Of a hardware stop, both must be known from the start.
        let measured = self.measured.get(quantity.name);
        let is_asked = self.is_stop_button && measured.is_none();
        let known = measured.map_or(0.0, |measured| measured.value);
        let (probe, rests_until) = (Arc::clone(&self.probe), self.paused_until);
        let news = self.watch_for_news();
        Some(Box::pin(async move {
            let noticing = async {
                if let Some(until) = rests_until {
                    tokio::time::sleep_until(until).await;
                }
                let noticed = match is_asked {
                    true => probe.measure(quantity.name),
                    false => probe.notice(quantity.name, known),
                };
                believable(quantity, noticed.await)
            };
            let news = async {
                match news {
                    Some(news) => news.await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                biased;
                noticed = noticing => {
                    let stir: DeviceEvent<Sensor> = Box::new(move |sensor| {
                        sensor.noticed(quantity, noticed);
                        Vec::new()
                    });
                    stir
                }
                stir = news => stir,
            }
        }))
    }
}

impl Sensor {
    /// Returns an event that occurs when the sensor is plugged in or unplugged, or reports a value.
    /// The event ends the pause after a failure. If the sensor is unplugged, the event removes its
    /// measurements.
    fn watch_for_news(&self) -> Option<BoxFuture<DeviceEvent<Sensor>>> {
        let until_news = self.probe.wait_for_news()?;
        Some(Box::pin(async move {
            until_news.await;
            let stir: DeviceEvent<Sensor> = Box::new(|sensor| {
                sensor.paused_until = None;
                sensor.take_news();
                if !sensor.probe.is_present() {
                    // The values of an unplugged sensor are unknown, as those of an absent agent
                    // are.
                    sensor.measured.clear();
                }
                Vec::new()
            });
            stir
        }))
    }

    fn take_news(&mut self) {
        for quantity in &self.quantities {
            let said = self.probe.last_report(quantity.name);
            match said.map(|said| believable(quantity, said)) {
                Some(Ok(measured)) => drop(self.measured.insert(quantity.name, measured)),
                // The latest report has no value, so that the earlier value is no longer valid.
                Some(Err(problem)) => {
                    self.measured.remove(quantity.name);
                    tracing::info!("failed to {problem}");
                }
                None => (),
            }
        }
    }

    fn noticed(&mut self, quantity: &'static SensorQuantity, noticed: Result<Measurement, String>) {
        match noticed {
            Ok(measured) => {
                tracing::info!(at = %self.location, "{}", quantity.words(measured.value));
                self.measured.insert(quantity.name, measured);
            }
            Err(problem) => {
                tracing::warn!("failed to {problem}");
                self.pause_actions();
            }
        }
    }
}

/// Returns an error instead of a value that is impossible for a quantity.
fn believable(
    quantity: &SensorQuantity,
    measured: Result<Measurement, String>,
) -> Result<Measurement, String> {
    let measured = measured?;
    let possible = quantity.possible(measured.value);
    possible.map_err(|problem| format!("use the measured value {problem}"))?;
    Ok(measured)
}
