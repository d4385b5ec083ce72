//! A gateway to an MQTT broker: devices of the broker automatically appear as agents, with action
//! models that follow from the devices' own descriptions.
//!
//! - `zigbee2mqtt`, `home_assistant` (ESPHome and many others), `tasmota` and `shelly` read the
//!   descriptions of devices; `description` is their common form.
//! - `setting` describes what can be set, triggered or pressed; `level` and `option` make the objects
//!   of the planning problem of it.
//! - `device_class` is the table from device classes to PDDL names (`classes.toml`). `part` divides
//!   a device into agents; `part_model` builds their action models.
//! - `device_agents` lists the agents of all devices, with their rooms; `agent::discovery` starts
//!   and stops them.
//! - `device` is the agent of one part of a device. It announces values as facts, offers actions
//!   only while the device is online, and carries out commands (`command`). A command is done only
//!   when the device reports it. `feature_reading` reads values and writes them as facts.
//! - `feature_tracker` keeps the last values of a device: a feature is known, unknown, or
//!   unavailable.
//! - `text_reading` extracts values from JSON and through templates; `template` renders the
//!   templates of Home Assistant.
//! - `color` has the colors that goals can name.
//! - `room_air` decides whether a value is about the air of a room.
//! - `naming` builds names of agents and compares names of rooms.
//!
//! The gateway itself has no facts and offers no actions. When the gateway stops, the agents of its
//! devices stop as well.

mod color;
mod command;
#[cfg(test)]
mod corpus;
mod description;
mod device;
mod device_agents;
mod device_class;
mod feature_reading;
mod feature_tracker;
mod home_assistant;
mod level;
mod message;
mod naming;
mod option;
mod part;
mod part_model;
mod room_air;
mod setting;
mod shelly;
mod shelly_calls;
mod tasmota;
mod tasmota_things;
mod template;
mod text_reading;
mod zigbee2mqtt;
mod zigbee_exposes;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use acl::AgentId;
use actuator::Actuator;
use agent::discovery::FoundDevice;
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, DiscoveredAgents, DiscoversAgents,
    LaunchableAgent, PluginEntry, WorkHandle, config_validity, discovery,
};
use mqtt_link::{Broker, BrokerConnection, Inbox};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::watch;

use device::MqttDevice;
use device_class::DeviceClasses;
use naming::core;
use part::DevicePart;

/// The entry of the MQTT gateway in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "mqtt",
    about: "a gateway to an MQTT broker: its devices appear as agents by themselves",
    drivers: &[],
    has_replicas: false,
    build,
};

/// Maximum number of messages of the broker that are handled at one time; further ones wait.
const MESSAGES_MAX: usize = 1_024;

/// Maximum number of agents of one gateway; further devices get no agent.
const AGENTS_MAX: usize = 2_048;

/// Range of the delay between a connect and the request for descriptions, in milliseconds. The
/// delay is random, so that the gateways of several daemons do not send at the same time.
const BIRTH_MS: std::ops::Range<u64> = 200..2_000;

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// Address of the broker, as `HOST:PORT` or `mqtts://HOST:PORT`.
    broker: Option<String>,
    /// User name at the broker, and the path of the file with the password.
    user: Option<String>,
    password_file: Option<PathBuf>,
    /// Path of the file with the trusted certificate authorities, for a broker `mqtts://…`.
    ca: Option<PathBuf>,
    /// Room of each device, by the device's name or identifier; a `*` at the end of the name
    /// matches any ending.
    #[serde(default)]
    rooms: BTreeMap<String, String>,
    /// Names or identifiers of the devices that take part without an admission. Any other device
    /// needs an admission, and is only listed until then.
    #[serde(default)]
    devices: Vec<String>,
    /// Names or identifiers of the devices that are ignored.
    #[serde(default)]
    ignore: Vec<String>,
    /// Time for which a measurement counts as known, such as `"10min"`. Without this key, the time is
    /// not limited.
    valid_for: Option<String>,
    /// Base topics of the descriptions by Zigbee2MQTT, Home Assistant and Tasmota.
    #[serde(default = "zigbee2mqtt")]
    zigbee2mqtt: String,
    #[serde(default = "home_assistant")]
    home_assistant: String,
    #[serde(default = "tasmota")]
    tasmota: String,
    /// Whether the gateway requests descriptions from devices after each connect to the broker.
    #[serde(default = "yes")]
    birth: bool,
    /// Additional device classes, and changes of built-in classes.
    #[serde(default)]
    classes: Value,
}

fn yes() -> bool {
    true
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

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let mut config: Config = blueprint.config_as()?;
    let (user, password_file) = (config.user.take(), config.password_file.take());
    let broker = Broker::new(config.broker.as_deref(), user, password_file, config.ca.take());
    let broker = broker.map_err(|problem| blueprint.problem(problem))?;
    let classes =
        DeviceClasses::with(&config.classes).map_err(|problem| blueprint.problem(problem))?;
    let validity = |text| config_validity("valid-for", text);
    let valid_for = config.valid_for.as_deref().map(validity).transpose();
    let valid_for = valid_for.map_err(|problem| blueprint.problem(problem))?;
    for (device, room) in &config.rooms {
        let is_there = blueprint.host.has_place(room);
        is_there.map_err(|problem| blueprint.problem(format!("rooms.{device}: {problem}")))?;
    }
    let rooms = blueprint.host.places().map(|name| (core(name), name.to_owned())).collect();
    Ok(Box::new(Gateway {
        bringing: DiscoveredAgents::new(&blueprint.host, AGENTS_MAX),
        blueprint,
        config,
        broker,
        classes,
        rooms,
        valid_for,
        connection: None,
        zigbee: zigbee2mqtt::ZigbeeDiscovery::default(),
        home_assistant: home_assistant::HomeAssistantDiscovery::default(),
        tasmota: tasmota::TasmotaDiscovery::default(),
        shelly: shelly::ShellyDiscovery::default(),
        given: Mutex::default(),
        subscriptions: BTreeMap::new(),
        birth: None,
        following: None,
    }))
}

struct Gateway {
    blueprint: Blueprint,
    config: Config,
    broker: Broker,
    classes: DeviceClasses,
    /// Rooms of the map, by their normalised names; see `naming::core`.
    rooms: BTreeMap<String, String>,
    valid_for: Option<Duration>,
    connection: Option<Arc<BrokerConnection>>,
    zigbee: zigbee2mqtt::ZigbeeDiscovery,
    home_assistant: home_assistant::HomeAssistantDiscovery,
    tasmota: tasmota::TasmotaDiscovery,
    shelly: shelly::ShellyDiscovery,
    bringing: DiscoveredAgents<DevicePart>,
    /// Names that were assigned to the devices.
    given: Mutex<device_agents::AssignedNames>,
    /// Task of each subscription, by the number of the subscription.
    subscriptions: BTreeMap<usize, WorkHandle>,
    /// Task that requests descriptions from devices after each connect.
    birth: Option<WorkHandle>,
    /// Task that watches the connection to the broker.
    following: Option<WorkHandle>,
}

impl Agent for Gateway {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let connection = BrokerConnection::shared(&self.broker, self.blueprint.id.as_str());
        let Config { zigbee2mqtt, home_assistant, tasmota, .. } = &self.config;
        let mut filters = vec![
            format!("{zigbee2mqtt}/bridge/devices"),
            format!("{home_assistant}/+/+/config"),
            format!("{home_assistant}/+/+/+/config"),
            format!("{tasmota}/+/+"),
        ];
        filters.extend(shelly::filters());
        if self.config.birth {
            let birth = request_descriptions(Arc::clone(&connection), home_assistant.clone());
            self.birth = Some(ctx.run(birth, |_: &mut Self, (), _| ()));
        }
        for (number, filter) in filters.iter().enumerate() {
            let inbox = match filter.ends_with(shelly::EVENTS) {
                true => connection.listen_to_events(filter),
                false => connection.listen_to_all(filter),
            };
            self.subscribe(number, inbox, ctx);
        }
        self.follow(connection.problem(), ctx);
        self.connection = Some(connection);
        discovery::follow_admissions(self, ctx);
    }
}

impl DiscoversAgents for Gateway {
    type Part = DevicePart;

    fn discovered_agents(&mut self) -> &mut DiscoveredAgents<DevicePart> {
        &mut self.bringing
    }

    fn found_devices(&self) -> Vec<FoundDevice<DevicePart>> {
        self.census()
    }

    fn discovery_problem(&self) -> Option<String> {
        let problem = self.connection.as_ref()?.problem().borrow().clone()?;
        Some(format!("the broker {} is not reached: {problem}", self.broker))
    }

    fn build(
        &self,
        agent: &AgentId,
        part: &DevicePart,
    ) -> Result<Box<dyn LaunchableAgent>, BuildError> {
        let (id, host) = (agent.clone(), Arc::clone(&self.blueprint.host));
        let connection = self.connection.as_ref().expect("there is one since it was activated");
        let device = MqttDevice::new(part.clone(), Arc::clone(&host.ontology), connection);
        let (driver, config) = (String::new(), Arc::new(Value::Null));
        let blueprint = Blueprint { id, driver, config, host };
        Actuator::build(&blueprint, device)
    }
}

impl Gateway {
    /// Reports to users when the connection to the broker is lost, and when it is back.
    fn follow(&mut self, mut trouble: watch::Receiver<Option<String>>, ctx: &mut Context<Self>) {
        let next = async move { trouble.changed().await.is_ok().then_some(trouble) };
        let work = ctx.run(next, |gateway: &mut Self, trouble, ctx| {
            let Some(trouble) = trouble else { return };
            discovery::schedule_reconcile(gateway, ctx);
            gateway.follow(trouble, ctx);
        });
        self.following = Some(work);
    }

    fn subscribe(&mut self, number: usize, inbox: Inbox, ctx: &mut Context<Self>) {
        let next = async move { (inbox.take(MESSAGES_MAX).await, inbox) };
        let work = ctx.run(next, move |gateway: &mut Self, (heard, inbox), ctx| {
            let mut is_news = false;
            for (topic, text) in heard {
                is_news |= gateway.handle_message(&topic, &text);
            }
            if is_news {
                discovery::schedule_reconcile(gateway, ctx);
            }
            gateway.subscribe(number, inbox, ctx);
        });
        self.subscriptions.insert(number, work);
    }

    /// Handles a message of a device. Returns `true` if the message may change the set of agents.
    fn handle_message(&mut self, topic: &str, text: &str) -> bool {
        let Config { zigbee2mqtt, home_assistant, tasmota, .. } = &self.config;
        let understood = if topic.starts_with(&format!("{zigbee2mqtt}/")) {
            self.zigbee.receive_devices(zigbee2mqtt, text)
        } else if topic.starts_with(&format!("{home_assistant}/")) {
            self.home_assistant.receive_description(home_assistant, topic, text)
        } else if topic.starts_with(&format!("{tasmota}/")) {
            self.tasmota.receive_discovery(topic, text)
        } else if shelly::is_own(topic) {
            return self.shelly.receive_report(topic, text);
        } else {
            return false;
        };
        if let Err(problem) = understood {
            tracing::warn!(topic, "ignored a message that is not understood: {problem}");
        }
        true
    }
}

/// Requests from devices, after each connect, to describe themselves and report their state. There
/// are two requests: the message that Home Assistant sends when it starts, and the command for
/// Shelly's first generation.
async fn request_descriptions(connection: Arc<BrokerConnection>, home_assistant: String) {
    let mut trouble = connection.problem();
    while trouble.wait_for(Option::is_none).await.is_ok() {
        tokio::time::sleep(Duration::from_millis(fastrand::u64(BIRTH_MS))).await;
        // If the connection is lost meanwhile, the requests are repeated after the next connect.
        let birth = format!("{home_assistant}/status");
        for (topic, text) in [(birth.as_str(), "online"), ("shellies/command", "announce")] {
            if let Err(problem) = connection.publish_text(topic, text) {
                tracing::debug!(topic, "failed to announce: {problem}");
            }
        }
        if trouble.wait_for(Option::is_some).await.is_err() {
            return;
        }
    }
}
