//! A gateway to an MQTT broker: its devices appear as agents by themselves, with an action model made
//! from what they say of themselves.
//!
//! - `zigbee2mqtt`, `home_assistant` (ESPHome and many others) and `tasmota` read what devices say of
//!   themselves, `described` is that in one form.
//! - `class` is the table from device classes to words (`classes.toml`); `part` makes of a device the
//!   agents it is, and their action models.
//! - `census` says what agents all of them are, and in which rooms; `agent::bringing` lets them come.
//! - `device` is such an agent: what the device says is known at once, its availability is its presence,
//!   a lamp, a relay or a lock is switched, and only what the device then says is believed.
//! - `reading` finds values in JSON and through Jinja templates.
//!
//! The gateway itself says nothing and offers nothing; with it, its devices leave.

mod census;
mod class;
mod described;
mod device;
mod home_assistant;
mod part;
mod reading;
mod tasmota;
mod zigbee2mqtt;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use actuator::Actuator;
use agent::bringing::Finding;
use agent::{
    Agent, Blueprint, Bringing, Brings, BuildError, Callbacks, Context, Launch, PluginEntry, Work,
    bringing,
};
use mqtt_link::{Broker, Connection, Told};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::mpsc;

use class::Classes;
use described::{Described, core};
use device::MqttDevice;
use part::Part;

/// A gateway to an MQTT broker.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "mqtt",
    about: "a gateway to an MQTT broker, whose devices appear as agents by themselves",
    drivers: &[],
    stands_by: false,
    build,
};

/// Words that are taken in at one time.
const WORDS_MAX: usize = 1_024;

/// Agents that one gateway brings.
const AGENTS_MAX: usize = 2_048;

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// Whom it speaks to, as `HOST:PORT` or `mqtts://HOST:PORT`.
    broker: Option<String>,
    /// Who logs in there, and where the password stands.
    user: Option<String>,
    password_file: Option<PathBuf>,
    /// The authorities that are trusted, where the broker is `mqtts://…`.
    ca: Option<PathBuf>,
    /// In which room a device stands, by its name or its identifier; a `*` at the end is any ending.
    #[serde(default)]
    rooms: BTreeMap<String, String>,
    /// Devices that take part where others are only listed.
    #[serde(default)]
    devices: Vec<String>,
    /// Devices that are not wanted.
    #[serde(default)]
    ignore: Vec<String>,
    /// How long a measurement counts as known, such as `"10m"`; without it, until the device is away.
    valid_for: Option<String>,
    /// Under which topics they are.
    #[serde(default = "zigbee2mqtt")]
    zigbee2mqtt: String,
    #[serde(default = "home_assistant")]
    home_assistant: String,
    #[serde(default = "tasmota")]
    tasmota: String,
    /// What else device classes mean.
    #[serde(default)]
    classes: Value,
}

fn zigbee2mqtt() -> String {
    "zigbee2mqtt".to_owned()
}

fn home_assistant() -> String {
    "homeassistant".to_owned()
}

fn tasmota() -> String {
    "tasmota/discovery".to_owned()
}

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let mut config: Config = blueprint.config_as()?;
    let (user, password_file) = (config.user.take(), config.password_file.take());
    let broker = Broker::new(config.broker.as_deref(), user, password_file, config.ca.take());
    let broker = broker.map_err(|problem| blueprint.problem(problem))?;
    let classes = Classes::with(&config.classes).map_err(|problem| blueprint.problem(problem))?;
    let valid_for = config.valid_for.as_deref().map(humantime::parse_duration).transpose();
    let valid_for = valid_for.map_err(|error| blueprint.problem(format!("valid-for: {error}")))?;
    for (device, room) in &config.rooms {
        let is_there = blueprint.host.has_place(room);
        is_there.map_err(|problem| blueprint.problem(format!("rooms.{device}: {problem}")))?;
    }
    let rooms = blueprint.host.places().map(|name| (core(name), name.to_owned())).collect();
    Ok(Box::new(Gateway {
        bringing: Bringing::new(&blueprint.host, AGENTS_MAX),
        blueprint,
        config,
        broker,
        classes,
        rooms,
        valid_for,
        connection: None,
        zigbee: Vec::new(),
        home_assistant: home_assistant::Discovery::default(),
        tasmota: tasmota::Discovery::default(),
        hearing: BTreeMap::new(),
    }))
}

struct Gateway {
    blueprint: Blueprint,
    config: Config,
    broker: Broker,
    classes: Classes,
    /// The places of the map, by what is left of their names.
    rooms: BTreeMap<String, String>,
    valid_for: Option<Duration>,
    connection: Option<Arc<Connection>>,
    zigbee: Vec<Described>,
    home_assistant: home_assistant::Discovery,
    tasmota: tasmota::Discovery,
    bringing: Bringing<Part>,
    /// What is listened to: each filter of topics, by its number.
    hearing: BTreeMap<usize, Work>,
}

impl Agent for Gateway {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let connection = Connection::to(&self.broker);
        let Config { zigbee2mqtt, home_assistant, tasmota, .. } = &self.config;
        let filters = [
            format!("{zigbee2mqtt}/bridge/devices"),
            format!("{home_assistant}/+/+/config"),
            format!("{home_assistant}/+/+/+/config"),
            format!("{tasmota}/+/+"),
        ];
        for (number, filter) in filters.iter().enumerate() {
            self.hear(number, connection.listen_to_all(filter), ctx);
        }
        self.connection = Some(connection);
        bringing::begin(self, ctx);
    }
}

impl Brings for Gateway {
    type Part = Part;

    fn bringing(&mut self) -> &mut Bringing<Part> {
        &mut self.bringing
    }

    fn found(&self) -> Vec<Finding<Part>> {
        self.census()
    }

    fn build(&self, agent: &AgentId, part: &Part) -> Result<Box<dyn Launch>, BuildError> {
        let (id, host) = (agent.clone(), Arc::clone(&self.blueprint.host));
        let connection = self.connection.as_ref().expect("there is one since it was activated");
        let device = MqttDevice::new(part.clone(), Arc::clone(&host.ontology), connection);
        let (driver, config) = (String::new(), Arc::new(Value::Null));
        let blueprint = Blueprint { id, driver, config, host };
        Ok(Box::new(Actuator::new(&blueprint, device)?))
    }
}

impl Gateway {
    fn hear(&mut self, number: usize, mut words: mpsc::Receiver<Told>, ctx: &mut Context<Self>) {
        let next = async move {
            let mut heard = Vec::new();
            words.recv_many(&mut heard, WORDS_MAX).await;
            (heard, words)
        };
        let work = ctx.run(next, move |gateway: &mut Self, (heard, words), ctx| {
            if heard.is_empty() {
                return;
            }
            for (topic, text) in heard {
                gateway.heard(&topic, &text);
            }
            bringing::settle_soon(gateway, ctx);
            gateway.hear(number, words, ctx);
        });
        self.hearing.insert(number, work);
    }

    fn heard(&mut self, topic: &str, text: &str) {
        let Config { zigbee2mqtt, home_assistant, tasmota, .. } = &self.config;
        let understood = if topic.starts_with(&format!("{zigbee2mqtt}/")) {
            zigbee2mqtt::devices(zigbee2mqtt, text).map(|devices| self.zigbee = devices)
        } else if topic.starts_with(&format!("{home_assistant}/")) {
            self.home_assistant.hear(home_assistant, topic, text)
        } else if topic.starts_with(&format!("{tasmota}/")) {
            self.tasmota.hear(topic, text)
        } else {
            Ok(())
        };
        if let Err(problem) = understood {
            tracing::warn!(topic, "ignored what nobody understands: {problem}");
        }
    }
}
