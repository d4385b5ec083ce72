//! The sensors that are fixed in a room (the paper, “Temperature / Humidity Sensor” and the
//! sensors for CO2, motion, IR distance, light and IR reflection): each reports what it measures
//! there.
//!
//! - `quantity` is the table of what can be measured; everything else is the same for all.
//! - [`Probe`] is what a driver does: `simulated` measures in the simulated building, `linux` with
//!   what this machine's kernel knows, `command` by running a program, `mqtt` hears it of a broker,
//!   `phidget` measures with what hangs on Phidgets' interface kits, `gpio` watches a line of a board.
//! - `board` brings all that this machine's kernel knows, by itself.
//! - What is yes or no (motion, a door's contact) is noticed: announced at once, without being asked.
//! - After a failed measurement a sensor offers nothing for a while: “re-evaluate and update
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
#[path = "../../../tests/support/broker.rs"]
#[allow(dead_code, reason = "what other tests need of a broker besides")]
mod broker;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::Deadline;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Call, Description, Device, Failure, OwnFact, Performed, Place, Stir,
    facts_of, model_of,
};
use agent::{Blueprint, BuildError, Launch, PluginEntry};
use pddl::Domain;
use tokio::time::Instant;

use crate::config::Config;
use crate::quantity::{QUANTITIES, Quantity};

/// How long a sensor that failed offers nothing. A loose wire comes back within seconds.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// The longest a measurement may take: slow bus sensors need below a second.
const MEASURING: Duration = Duration::from_secs(2);

const SIMULATED: &str = "simulated";
const LINUX: &str = "linux";
const COMMAND: &str = "command";
const MQTT: &str = "mqtt";
const PHIDGET: &str = "phidget";
const GPIO: &str = "gpio";
const DRIVERS: &[&str] = &[SIMULATED, LINUX, COMMAND, MQTT, PHIDGET, GPIO];

pub use board::BOARD;

/// The line in the daemon's table of plugins: a sensor of any quantity.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "sensor",
    about: "reports the CO2, humidity, light, motion … of the room it stands in",
    drivers: DRIVERS,
    stands_by: false,
    build,
};

/// The line of the sensor that every building has: temperature, and humidity on the same board.
pub const TEMPERATURE_SENSOR: PluginEntry = PluginEntry {
    name: "temperature-sensor",
    about: "reports the temperature, and if asked to the humidity, of the room it stands in",
    drivers: DRIVERS,
    stands_by: false,
    build: build_temperature_sensor,
};

/// What a sensor's driver does. Errors complete “failed to …”.
pub trait Probe: Send + Sync + 'static {
    /// Measures a quantity of the table, by its name.
    fn measure(&self, quantity: &'static str) -> BoxFuture<Result<Measurement, String>>;

    /// Waits until a quantity that is yes or no is not `known` any more, and measures it. May wait
    /// for as long as nothing changes.
    fn notice(&self, quantity: &'static str, known: f64) -> BoxFuture<Result<Measurement, String>>;

    /// Whether it is plugged in, as far as was looked.
    fn is_here(&self) -> bool {
        true
    }

    /// Looks whether it is plugged in; `None` if it cannot be unplugged.
    fn look(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// Waits until it is unplugged, plugged in, or says something by itself; `None` if it never
    /// is and never does.
    fn until_news(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// What it said last of a quantity by itself.
    fn last_word(&self, _quantity: &'static str) -> Option<Result<Measurement, String>> {
        None
    }
}

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// In the quantity's unit; of what is yes or no, 1 is yes and 0 is no.
    pub value: f64,
    /// When it was measured.
    pub at: Instant,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    Ok(Box::new(Actuator::new(&blueprint, sensor(&blueprint)?)?))
}

fn build_temperature_sensor(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    Ok(Box::new(Actuator::new(&blueprint, temperature_sensor(&blueprint)?)?))
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
    location: Place,
    /// What it measures. The first says what kind of sensor it is.
    quantities: Vec<&'static Quantity>,
    valid_for: Option<Duration>,
    probe: Arc<dyn Probe>,
    /// The last measurement of each quantity, by its name.
    measured: BTreeMap<&'static str, Measurement>,
    rests_until: Option<Instant>,
}

impl Sensor {
    fn new(
        blueprint: &Blueprint,
        quantities: &[&str],
        mut config: Config,
    ) -> Result<Sensor, BuildError> {
        let named =
            |name: &&str| Quantity::named(name).map_err(|problem| blueprint.problem(problem));
        let duration = |text| {
            humantime::parse_duration(text)
                .map_err(|error| blueprint.problem(format!("valid-for `{text}`: {error}")))
        };
        let quantities = quantities.iter().map(named).collect::<Result<Vec<_>, _>>()?;
        let hardware = config.hardware(blueprint)?;
        let probe = match blueprint.driver.as_str() {
            LINUX => linux::probe(blueprint, hardware, &quantities)?,
            COMMAND => command::probe(blueprint, hardware)?,
            MQTT => mqtt::probe(blueprint, hardware)?,
            PHIDGET => phidget::probe(blueprint, hardware, &quantities)?,
            GPIO => gpio::probe(blueprint, hardware, &quantities)?,
            _ => simulated::probe(blueprint)?,
        };
        let Config { location, valid_for, .. } = config;
        Ok(Sensor {
            id: blueprint.id.to_string(),
            ontology: Arc::clone(&blueprint.host.ontology),
            location,
            quantities,
            valid_for: valid_for.as_deref().map(duration).transpose()?,
            probe,
            measured: BTreeMap::new(),
            rests_until: None,
        })
    }

    fn works(&self) -> bool {
        self.probe.is_here() && self.rests_until.is_none_or(|until| until <= Instant::now())
    }

    /// The quantity that a method reads.
    fn read_by(&self, method: &str) -> Option<&'static Quantity> {
        self.quantities.iter().copied().find(|quantity| quantity.method() == method)
    }

    /// What was measured of a quantity, as facts, as long as it counts as known; and else that it does
    /// not.
    fn known(&self, quantity: &Quantity) -> Vec<OwnFact> {
        let room = self.location.as_str();
        let term = quantity.term(&self.id, room, &self.ontology);
        let measured = self.measured.get(quantity.name).filter(|_| self.probe.is_here());
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

    /// It failed: it offers nothing for a while, and what it should notice it may have missed. What
    /// is unplugged has not failed, and is as good as new when it is back.
    fn rest(&mut self) {
        self.rests_until = self.probe.is_here().then(|| Instant::now() + REST_AFTER_FAILURE);
        for quantity in self.quantities.iter().filter(|quantity| quantity.is_noticed()) {
            self.measured.remove(quantity.name);
        }
    }

    fn action(&self, quantity: &Quantity) -> String {
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

    /// Where it is, as PDDL facts.
    fn place(&self) -> String {
        let (id, room) = (self.id.as_str(), self.location.as_str());
        let places =
            self.quantities.iter().map(|quantity| quantity.place(id, room, &self.ontology));
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
        let offered = self.quantities.iter().filter(|_| self.works());
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
        let method = |quantity: &&Quantity| {
            let method = Method {
                method: quantity.method(),
                arguments: BTreeMap::new(),
                timeout: Deadline(MEASURING),
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

    fn look(&self) -> Option<BoxFuture<()>> {
        self.probe.look()
    }

    fn perform(&mut self, call: &Call) -> BoxFuture<Result<Measurement, Failure>> {
        let Some(quantity) = self.read_by(&call.method) else {
            let unknown = Failure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        };
        let measured = self.probe.measure(quantity.name);
        Box::pin(async move { believable(measured.await).map_err(Failure::Driver) })
    }

    fn performed(&mut self, call: &Call, measured: Measurement) -> Performed {
        let Some(quantity) = self.read_by(&call.method) else { return Performed::default() };
        self.measured.insert(quantity.name, measured);
        let detail = format!("{} at {}", quantity.words(measured.value), self.location);
        let observations = self.known(quantity).into_iter().map(|fact| fact.fact).collect();
        Performed { detail, observations }
    }

    fn failed(&mut self, _call: &Call, failure: &Failure) {
        if *failure != Failure::GivenUp {
            self.rest();
        }
    }

    fn watch(&mut self) -> Option<BoxFuture<Stir<Sensor>>> {
        let noticed = self.quantities.iter().copied().find(|quantity| quantity.is_noticed());
        let Some(quantity) = noticed else { return self.watch_for_news() };
        // What was never measured is not known; but nothing to speak of happens until it is yes.
        let known = self.measured.get(quantity.name).map_or(0.0, |measured| measured.value);
        let (probe, rests_until) = (Arc::clone(&self.probe), self.rests_until);
        let news = self.watch_for_news();
        Some(Box::pin(async move {
            let noticing = async {
                if let Some(until) = rests_until {
                    tokio::time::sleep_until(until).await;
                }
                believable(probe.notice(quantity.name, known).await)
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
                    let stir: Stir<Sensor> = Box::new(move |sensor| {
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
    /// What is unplugged offers nothing; what is plugged in again, or speaks, has not failed.
    fn watch_for_news(&self) -> Option<BoxFuture<Stir<Sensor>>> {
        let until_news = self.probe.until_news()?;
        Some(Box::pin(async move {
            until_news.await;
            let stir: Stir<Sensor> = Box::new(|sensor| {
                sensor.rests_until = None;
                sensor.take_news();
                if !sensor.probe.is_here() {
                    // As of who dies: nobody stands for it any more.
                    sensor.measured.clear();
                }
                Vec::new()
            });
            stir
        }))
    }

    fn take_news(&mut self) {
        for quantity in &self.quantities {
            let said = self.probe.last_word(quantity.name);
            match said.map(believable) {
                Some(Ok(measured)) => drop(self.measured.insert(quantity.name, measured)),
                // What it says now is no value, so that what it said before is none either.
                Some(Err(problem)) => {
                    self.measured.remove(quantity.name);
                    tracing::info!("failed to {problem}");
                }
                None => (),
            }
        }
    }

    fn noticed(&mut self, quantity: &'static Quantity, noticed: Result<Measurement, String>) {
        match noticed {
            Ok(measured) => {
                tracing::info!(at = %self.location, "{}", quantity.words(measured.value));
                self.measured.insert(quantity.name, measured);
            }
            Err(problem) => {
                tracing::warn!("failed to {problem}");
                self.rest();
            }
        }
    }
}

/// Numbers that PDDL cannot say are a driver's failure, and not its measurement.
fn believable(measured: Result<Measurement, String>) -> Result<Measurement, String> {
    match measured {
        Ok(Measurement { value, .. }) if !value.is_finite() => {
            Err(format!("believe what was measured: {value}"))
        }
        other => other,
    }
}
