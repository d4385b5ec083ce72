//! All sensors that this machine's kernel knows, as agents that come and go by themselves: what is
//! plugged into a board measures the room that the board stands in.
//!
//! Each is a sensor with the driver `linux`, as a file would name it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use acl::content::Discovered;
use actuator::Actuator;
use agent::{
    Admission, Admissions, Admit, Agent, Blueprint, Brought, BuildError, Callbacks, Context,
    Launch, PluginEntry, Work,
};
use linux_sensors::{Bundle, Sysfs};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::quantity::Quantity;
use crate::{LINUX, Sensor, sensor, temperature_sensor};

/// The line in the daemon's table of plugins.
pub const BOARD: PluginEntry = PluginEntry {
    name: "board",
    about: "all sensors that a machine's kernel knows, as agents that appear by themselves",
    drivers: &[],
    stands_by: false,
    build,
};

/// Pause between two looks at what is plugged in: a person has just let go of it.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// How long one that could not come rests before it is tried again.
const REST: Duration = Duration::from_secs(10);

/// So much of a device's name is in an agent's, which may have 64 letters.
const NAME_MAX: usize = 56;

/// Agents that one board brings.
const AGENTS_MAX: usize = 256;

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// The room that the board stands in.
    location: Option<String>,
    /// Where single devices stand, by their names such as `"bme280@i2c-1/1-0076"`.
    #[serde(default)]
    rooms: BTreeMap<String, String>,
    /// Devices that take part where others are only listed.
    #[serde(default)]
    devices: Vec<String>,
    /// Devices that are not wanted, or that the file names itself.
    #[serde(default)]
    ignore: Vec<String>,
    /// How long a measurement counts as known.
    valid_for: Option<String>,
    /// Where the kernel shows its devices, if not at `/sys`.
    sysfs: Option<PathBuf>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let config: Config = blueprint.config_as()?;
    let rooms: Vec<_> =
        blueprint.host.map.objects.iter().map(|declared| declared.object.name.as_str()).collect();
    for room in config.location.iter().chain(config.rooms.values()) {
        if !rooms.contains(&room.as_str()) {
            let near = pddl::nearest(room, rooms.iter().copied());
            let hint = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
            return Err(blueprint.problem(format!("there is no `{room}` on the map{hint}")));
        }
    }
    let valid_for = config.valid_for.as_deref().map(humantime::parse_duration).transpose();
    valid_for.map_err(|error| blueprint.problem(format!("valid-for: {error}")))?;
    let admissions = blueprint.host.resources.get::<Admissions>();
    let admissions = admissions.unwrap_or_else(|| Arc::new(Admissions::new(Admit::default())));
    let sysfs = config.sysfs.clone().map_or_else(Sysfs::default, Sysfs::new);
    let (here, problems) = (BTreeMap::new(), BTreeMap::new());
    Ok(Box::new(Board { blueprint, config, sysfs, admissions, here, problems, looking: None }))
}

struct Board {
    blueprint: Blueprint,
    config: Config,
    sysfs: Sysfs,
    admissions: Arc<Admissions>,
    /// The agents it has brought, and with which configs.
    here: BTreeMap<AgentId, (Value, Brought)>,
    /// Why some could not come.
    problems: BTreeMap<AgentId, String>,
    looking: Option<Work>,
}

impl Agent for Board {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.look(ctx);
    }
}

impl Board {
    fn look(&mut self, ctx: &mut Context<Self>) {
        let sysfs = self.sysfs.clone();
        let looking = tokio::task::spawn_blocking(move || Bundle::all(&sysfs.channels()));
        let work = ctx.run(looking, |board: &mut Self, found, ctx| {
            if let Ok(bundles) = found {
                board.settle(&bundles, ctx);
            }
            ctx.after(LOOK_AGAIN, |board: &mut Self, ctx| board.look(ctx));
        });
        self.looking = Some(work);
    }

    /// Lets come who is plugged in, and go who is not.
    fn settle(&mut self, bundles: &[Bundle], ctx: &mut Context<Self>) {
        let (mut wanted, mut discovered) = (BTreeMap::new(), Vec::new());
        let mut applicants = BTreeMap::new();
        let by = self.blueprint.id.clone();
        for bundle in bundles.iter().filter(|bundle| !self.is_in(&self.config.ignore, bundle)) {
            let Ok(agent) = AgentId::new(&name_of(bundle)) else { continue };
            if Quantity::named(bundle.quantity.name()).is_err() || wanted.len() >= AGENTS_MAX {
                continue;
            }
            let room = self.room(bundle);
            let admission = match self.is_in(&self.config.devices, bundle) {
                true => Admission::Granted,
                false => self.admissions.of(by.as_str(), agent.as_str()),
            };
            let nowhere = room.is_none().then(|| "nobody says in which room it stands".to_owned());
            let failed = self.problems.get(&agent).cloned();
            let problem = nowhere.or_else(|| admission.reason()).or(failed);
            let joined = problem.is_none() && admission == Admission::Granted;
            let (toml, agent_id) = (self.lines(bundle), agent.clone());
            discovered.push(Discovered {
                agent: agent_id,
                by: by.to_string(),
                joined,
                problem,
                toml,
            });
            let Some(room) = room else { continue };
            match admission {
                Admission::Granted => drop(wanted.insert(agent, self.config_of(bundle, room))),
                Admission::Asked => {
                    drop(applicants.insert(agent.to_string(), format!("{by}, {room}")))
                }
                Admission::Listed | Admission::Denied => (),
            }
        }
        self.here.retain(|agent, (config, _)| wanted.get(agent) == Some(config));
        for (agent, config) in wanted {
            if !self.here.contains_key(&agent) && !self.problems.contains_key(&agent) {
                self.bring(agent, config, ctx);
            }
        }
        self.admissions.present(by.as_str(), applicants);
        ctx.switchboard().discovered(by.as_str(), discovered);
    }

    fn is_in(&self, list: &[String], bundle: &Bundle) -> bool {
        let device = bundle.device.to_string();
        list.iter().any(|named| *named == device || *named == name_of(bundle))
    }

    fn room<'b>(&'b self, bundle: &Bundle) -> Option<&'b str> {
        let own = self.config.rooms.get(&bundle.device.to_string());
        own.or(self.config.location.as_ref()).map(String::as_str)
    }

    /// What a file would say of it.
    fn config_of(&self, bundle: &Bundle, room: &str) -> Value {
        let mut config = json!({ "location": room, "device": bundle.device.to_string() });
        let says = [
            ("channel", bundle.channel.as_ref().map(|channel| json!(channel))),
            ("humidity", bundle.has_humidity.then_some(Value::Bool(true))),
            ("valid-for", self.config.valid_for.as_ref().map(|valid_for| json!(valid_for))),
            ("sysfs", self.config.sysfs.as_ref().map(|sysfs| json!(sysfs))),
            ("quantity", (!is_thermometer(bundle)).then(|| json!(bundle.quantity.name()))),
        ];
        for (key, value) in says.into_iter().filter_map(|(key, value)| Some((key, value?))) {
            config[key] = value;
        }
        config
    }

    /// The lines that would let it take part.
    fn lines(&self, bundle: &Bundle) -> String {
        let (board, device) = (&self.blueprint.id, &bundle.device);
        let room = self.room(bundle).unwrap_or_default();
        format!(
            "# in the config of `{board}`\ndevices = [\"{device}\"]\n\
             rooms = {{ \"{device}\" = \"{room}\" }}\n"
        )
    }

    fn bring(&mut self, agent: AgentId, config: Value, ctx: &mut Context<Self>) {
        let blueprint = Blueprint {
            id: agent.clone(),
            driver: LINUX.to_owned(),
            config: Arc::new(config.clone()),
            host: Arc::clone(&self.blueprint.host),
        };
        let built = built(&blueprint).and_then(|sensor| Actuator::new(&blueprint, sensor));
        let actuator = match built {
            Ok(actuator) => Box::new(actuator),
            Err(error) => return self.failed(agent, format!("failed to {error}"), ctx),
        };
        let name = agent.clone();
        let brought = ctx.bring(agent.clone(), actuator, move |board: &mut Self, error, ctx| {
            let Some(error) = error else { return };
            board.here.remove(&name);
            board.failed(name.clone(), format!("failed to {error}"), ctx);
        });
        tracing::info!(%agent, "is plugged in");
        self.here.insert(agent, (config, brought));
    }

    fn failed(&mut self, agent: AgentId, problem: String, ctx: &mut Context<Self>) {
        tracing::warn!(%agent, "{problem}");
        self.problems.insert(agent.clone(), problem);
        ctx.after(REST, move |board: &mut Self, _| drop(board.problems.remove(&agent)));
    }
}

fn built(blueprint: &Blueprint) -> Result<Sensor, BuildError> {
    match blueprint.config.get("quantity") {
        Some(_) => sensor(blueprint),
        None => temperature_sensor(blueprint),
    }
}

fn is_thermometer(bundle: &Bundle) -> bool {
    bundle.quantity == linux_sensors::Quantity::Temperature
}

/// The name of its agent: its device's, and what tells it from the device's others.
fn name_of(bundle: &Bundle) -> String {
    let mut name = bundle.device.to_string();
    if !is_thermometer(bundle) {
        name += &format!("-{}", bundle.quantity);
    }
    if let Some(channel) = &bundle.channel {
        name += &format!("-{channel}");
    }
    let plain = |symbol: char| if symbol.is_ascii_alphanumeric() { symbol } else { '-' };
    let name: String = name.to_ascii_lowercase().chars().map(plain).collect();
    // Of a long place the end tells it from others.
    let end = name.len().saturating_sub(NAME_MAX);
    let name = &name[end..];
    match name.starts_with(|symbol: char| symbol.is_ascii_lowercase()) {
        true => name.to_owned(),
        false => format!("sensor-{name}"),
    }
}

#[cfg(test)]
mod tests {
    use linux_sensors::{Identity, Quantity};

    use super::*;

    #[test]
    fn every_device_has_a_name_that_an_agent_may_have() {
        let long = "platform/soc/".repeat(9);
        let long = long.as_str();
        for (device, quantity, channel, expected) in [
            (("tmp117", "i2c-1/1-0048"), Quantity::Temperature, None, "tmp117-i2c-1-1-0048"),
            (("BME280", "i2c-1/1-0076"), Quantity::Humidity, None, "bme280-i2c-1-1-0076-humidity"),
            (("28-0316", "w1"), Quantity::Temperature, Some("temp"), "sensor-28-0316-w1-temp"),
            (("x", long), Quantity::Temperature, None, "-soc-platform-soc-"),
        ] {
            let device = Identity { name: device.0.to_owned(), place: device.1.to_owned() };
            let channel = channel.map(str::to_owned);
            let name = name_of(&Bundle { device, quantity, channel, has_humidity: false });
            assert!(AgentId::new(&name).is_ok(), "{name}");
            assert!(name.ends_with(expected) || name == expected, "{name}");
        }
    }
}
