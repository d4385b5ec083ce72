//! A gateway to an MQTT broker: its devices appear as agents by themselves, with an action model made
//! from what they say of themselves.
//!
//! - `zigbee2mqtt`, `home_assistant` (ESPHome and many others) and `tasmota` read what devices say of
//!   themselves, `described` is that in one form.
//! - `class` is the table from device classes to words (`classes.toml`); `part` makes of a device the
//!   agents it is, and their action models.
//! - `census` says which of them are to be here, and why not of the others.
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

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use actuator::Actuator;
use agent::{
    Admissions, Admit, Agent, Blueprint, Brought, BuildError, Callbacks, Context, Launch,
    PluginEntry, Work,
};
use mqtt_link::{Broker, Connection, Told};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::{mpsc, watch};

use census::Census;
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

/// Words that are taken in at one time, and how long is waited for more before agents come and go: a
/// broker tells of hundreds of devices at once.
const WORDS_MAX: usize = 1_024;
const MORE: Duration = Duration::from_millis(50);

/// The number beyond those of topics under which is listened to who is let in.
const ADMISSIONS: usize = usize::MAX;

/// How long one that could not come rests before it is tried again.
const REST: Duration = Duration::from_secs(10);

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
    let map = &blueprint.host.map;
    let rooms: BTreeMap<String, String> = map
        .objects
        .iter()
        .map(|declared| declared.object.name.as_str().to_owned())
        .map(|name| (core(&name), name))
        .collect();
    // On the machine itself only: elsewhere the map is the same, and is held against it too.
    for (device, room) in &config.rooms {
        if !rooms.values().any(|known| known == room) {
            let near = pddl::nearest(room, rooms.values().map(String::as_str));
            let hint = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
            let problem = format!("rooms.{device}: there is no `{room}` on the map{hint}");
            return Err(blueprint.problem(problem));
        }
    }
    let admissions = blueprint.host.resources.get::<Admissions>();
    let admissions = admissions.unwrap_or_else(|| Arc::new(Admissions::new(Admit::default())));

    Ok(Box::new(Gateway {
        blueprint,
        config,
        broker,
        classes,
        rooms,
        valid_for,
        admissions,
        connection: None,
        zigbee: Vec::new(),
        home_assistant: home_assistant::Discovery::default(),
        tasmota: tasmota::Discovery::default(),
        here: BTreeMap::new(),
        problems: BTreeMap::new(),
        is_due: false,
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
    /// Whether a device that nobody names takes part.
    admissions: Arc<Admissions>,
    connection: Option<Arc<Connection>>,
    zigbee: Vec<Described>,
    home_assistant: home_assistant::Discovery,
    tasmota: tasmota::Discovery,
    /// The agents it has brought.
    here: BTreeMap<AgentId, (Part, Brought)>,
    /// Why some could not come.
    problems: BTreeMap<AgentId, String>,
    /// Whether it is going to see who comes and goes.
    is_due: bool,
    /// What is listened to: each filter of topics, by its number, and `ADMISSIONS`.
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
        self.hear_of_admissions(self.admissions.changes(), ctx);
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
            gateway.settle_soon(MORE, ctx);
            gateway.hear(number, words, ctx);
        });
        self.hearing.insert(number, work);
    }

    fn hear_of_admissions(&mut self, mut changes: watch::Receiver<()>, ctx: &mut Context<Self>) {
        let next = async move { changes.changed().await.is_ok().then_some(changes) };
        let work = ctx.run(next, |gateway: &mut Self, changes, ctx| {
            let Some(changes) = changes else { return };
            gateway.settle_soon(MORE, ctx);
            gateway.hear_of_admissions(changes, ctx);
        });
        self.hearing.insert(ADMISSIONS, work);
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

    fn settle_soon(&mut self, wait: Duration, ctx: &mut Context<Self>) {
        if self.is_due {
            return;
        }
        self.is_due = true;
        ctx.after(wait, |gateway: &mut Self, ctx| {
            gateway.is_due = false;
            gateway.settle(ctx);
        });
    }

    /// Lets come who is to be here, and go who is not.
    fn settle(&mut self, ctx: &mut Context<Self>) {
        let Census { wanted, discovered, applicants, .. } = self.census();
        self.here.retain(|agent, (part, _)| wanted.get(agent) == Some(part));
        let here: BTreeSet<_> = self.here.keys().cloned().collect();
        for (_, part) in wanted.into_iter().filter(|(agent, _)| !here.contains(agent)) {
            self.bring(part, ctx);
        }
        let by = ctx.id().to_string();
        self.admissions.present(&by, applicants);
        ctx.switchboard().discovered(&by, discovered);
    }

    fn bring(&mut self, part: Part, ctx: &mut Context<Self>) {
        let Some(connection) = &self.connection else { return };
        let (agent, host) = (part.agent.clone(), Arc::clone(&self.blueprint.host));
        let device = MqttDevice::new(part.clone(), Arc::clone(&host.ontology), connection);
        let (driver, config) = (String::new(), Arc::new(Value::Null));
        let blueprint = Blueprint { id: agent.clone(), driver, config, host };
        let actuator = match Actuator::new(&blueprint, device) {
            Ok(actuator) => Box::new(actuator),
            Err(error) => {
                tracing::warn!(%agent, "failed to {error}");
                self.problems.insert(agent, format!("failed to {error}"));
                return;
            }
        };
        let name = agent.clone();
        let brought = ctx.bring(agent.clone(), actuator, move |gateway: &mut Self, error, ctx| {
            let Some(error) = error else { return };
            tracing::warn!(agent = %name, "failed to {error}");
            gateway.here.remove(&name);
            gateway.problems.insert(name.clone(), format!("failed to {error}"));
            let rested = name.clone();
            ctx.after(REST, move |gateway: &mut Self, ctx| {
                gateway.problems.remove(&rested);
                gateway.settle_soon(MORE, ctx);
            });
        });
        tracing::info!(%agent, room = part.room, "appears");
        self.here.insert(agent, (part, brought));
    }
}
