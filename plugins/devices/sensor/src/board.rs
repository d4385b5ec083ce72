//! The board: creates an agent for each sensor that this machine's kernel lists. The agents appear
//! and disappear automatically. A sensor that is plugged into a board measures the room of the
//! board.
//!
//! Each of the agents is a sensor with the driver `linux`, as if it had an entry in the ecosystem
//! file.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use actuator::Actuator;
use agent::discovery::{FoundDevice, ROOM_UNKNOWN};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, DiscoveredAgents, DiscoversAgents,
    LaunchableAgent, PluginEntry, WorkHandle, config_validity, discovery,
};
use linux_sensors::{SensorBundle, Sysfs};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::quantity::SensorQuantity;
use crate::{LINUX, sensor, temperature_sensor};

/// The entry of the board in the daemon's table of plugins.
pub const BOARD: PluginEntry = PluginEntry {
    name: "board",
    about: "all sensors that a machine's kernel knows, as agents that appear by themselves",
    drivers: &[],
    has_replicas: false,
    build,
};

/// Pause between two searches for plugged-in devices: about the time that a person needs to plug in
/// a device.
const SCAN_INTERVAL: Duration = Duration::from_secs(1);

/// Maximum length of the part of a device's name that is used in the name of its agent; the
/// beginning of a longer name is cut off. The name of an agent may have 64 characters.
const NAME_MAX: usize = 56;

/// Maximum number of agents of one board; further sensors get no agent.
const AGENTS_MAX: usize = 256;

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct BoardConfig {
    /// Room of the board.
    location: Option<String>,
    /// Rooms of single devices, by the device's name, such as `"bme280@i2c-1/1-0076"`.
    #[serde(default)]
    rooms: BTreeMap<String, String>,
    /// Devices that take part without an admission, by the name of the device or of its agent. Any
    /// other device needs an admission, and is only listed until then.
    #[serde(default)]
    devices: Vec<String>,
    /// Devices that are ignored, for example because they have an entry of their own, by the name
    /// of the device or of its agent.
    #[serde(default)]
    ignore: Vec<String>,
    /// Time for which a measurement counts as known, such as `"10min"`.
    valid_for: Option<String>,
    /// Folder with the kernel's devices; default is `/sys`.
    sysfs: Option<PathBuf>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let config: BoardConfig = blueprint.config_as()?;
    for room in config.location.iter().chain(config.rooms.values()) {
        blueprint.host.has_place(room).map_err(|problem| blueprint.problem(problem))?;
    }
    let valid_for = config.valid_for.as_deref().map(|text| config_validity("valid-for", text));
    valid_for.transpose().map_err(|problem| blueprint.problem(problem))?;
    let sysfs = config.sysfs.clone().map_or_else(Sysfs::default, Sysfs::new);
    let bringing = DiscoveredAgents::new(&blueprint.host, AGENTS_MAX);
    let (bundles, looking) = (Vec::new(), None);
    Ok(Box::new(SensorBoard { blueprint, config, sysfs, bringing, bundles, scan_task: looking }))
}

struct SensorBoard {
    blueprint: Blueprint,
    config: BoardConfig,
    sysfs: Sysfs,
    /// Agents of the board's sensors, with their configs.
    bringing: DiscoveredAgents<Value>,
    /// Sensors that the last search of the board found.
    bundles: Vec<SensorBundle>,
    scan_task: Option<WorkHandle>,
}

impl Agent for SensorBoard {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        discovery::follow_admissions(self, ctx);
        self.start_scanning(ctx);
    }
}

impl DiscoversAgents for SensorBoard {
    type Part = Value;

    fn discovered_agents(&mut self) -> &mut DiscoveredAgents<Value> {
        &mut self.bringing
    }

    fn found_devices(&self) -> Vec<FoundDevice<Value>> {
        self.bundles.iter().filter_map(|bundle| self.finding(bundle)).collect()
    }

    fn build(
        &self,
        agent: &AgentId,
        config: &Value,
    ) -> Result<Box<dyn LaunchableAgent>, BuildError> {
        let blueprint = Blueprint {
            id: agent.clone(),
            driver: LINUX.to_owned(),
            config: Arc::new(config.clone()),
            host: Arc::clone(&self.blueprint.host),
        };
        let sensor = match config.get("quantity") {
            Some(_) => sensor(&blueprint),
            None => temperature_sensor(&blueprint),
        }?;
        Actuator::build(&blueprint, sensor)
    }
}

impl SensorBoard {
    fn start_scanning(&mut self, ctx: &mut Context<Self>) {
        let sysfs = self.sysfs.clone();
        let looking = tokio::task::spawn_blocking(move || SensorBundle::all(&sysfs.channels()));
        let work = ctx.run(looking, |board: &mut Self, found, ctx| {
            if let Ok(bundles) = found {
                board.bundles = bundles;
                discovery::schedule_reconcile(board, ctx);
            }
            ctx.after(SCAN_INTERVAL, |board: &mut Self, ctx| board.start_scanning(ctx));
        });
        self.scan_task = Some(work);
    }

    /// Returns the agent of a sensor. Returns `None` if the sensor's quantity is not in the table
    /// of `quantity`, or the config ignores the device.
    fn finding(&self, bundle: &SensorBundle) -> Option<FoundDevice<Value>> {
        SensorQuantity::named(bundle.quantity.name()).ok()?;
        if self.is_in(&self.config.ignore, bundle) {
            return None;
        }
        let room = self.room(bundle);
        Some(FoundDevice {
            agent: AgentId::new(&name_of(bundle)).ok()?,
            is_named: self.is_in(&self.config.devices, bundle),
            room: room.map(str::to_owned),
            part: room
                .map(|room| self.config_of(bundle, room))
                .ok_or_else(|| ROOM_UNKNOWN.to_owned()),
            problem: None,
            toml: self.lines(bundle),
        })
    }

    fn is_in(&self, list: &[String], bundle: &SensorBundle) -> bool {
        let device = bundle.device.to_string();
        list.iter().any(|named| *named == device || *named == name_of(bundle))
    }

    fn room<'b>(&'b self, bundle: &SensorBundle) -> Option<&'b str> {
        let own = self.config.rooms.get(&bundle.device.to_string());
        own.or(self.config.location.as_ref()).map(String::as_str)
    }

    /// Returns the config of a sensor's agent, in the form of an entry in the ecosystem file.
    fn config_of(&self, bundle: &SensorBundle, room: &str) -> Value {
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

    /// Returns the lines of configuration with which the sensor would take part in the ecosystem.
    fn lines(&self, bundle: &SensorBundle) -> String {
        let (board, device) = (&self.blueprint.id, &bundle.device);
        let room = self.room(bundle).unwrap_or_default();
        format!(
            "# in the config of `{board}`\ndevices = [\"{device}\"]\n\
             rooms = {{ \"{device}\" = \"{room}\" }}\n"
        )
    }
}

fn is_thermometer(bundle: &SensorBundle) -> bool {
    bundle.quantity == linux_sensors::SysfsQuantity::Temperature
}

/// Returns the name of a sensor's agent: the name of the device, followed by the parts that
/// distinguish the sensor from the device's other sensors.
fn name_of(bundle: &SensorBundle) -> String {
    let mut name = bundle.device.to_string();
    if !is_thermometer(bundle) {
        name += &format!("-{}", bundle.quantity);
    }
    if let Some(channel) = &bundle.channel {
        name += &format!("-{channel}");
    }
    let plain = |symbol: char| if symbol.is_ascii_alphanumeric() { symbol } else { '-' };
    let name: String = name.to_ascii_lowercase().chars().map(plain).collect();
    // A long name is cut at its beginning, because its end distinguishes the sensor.
    let end = name.len().saturating_sub(NAME_MAX);
    let name = &name[end..];
    match name.starts_with(|symbol: char| symbol.is_ascii_lowercase()) {
        true => name.to_owned(),
        false => format!("sensor-{name}"),
    }
}

#[cfg(test)]
mod tests {
    use linux_sensors::{DeviceIdentity, SysfsQuantity};

    use super::*;

    #[test]
    fn the_name_of_every_device_is_a_valid_agent_name() {
        let long = "platform/soc/".repeat(9);
        let long = long.as_str();
        for (device, quantity, channel, expected) in [
            (("tmp117", "i2c-1/1-0048"), SysfsQuantity::Temperature, None, "tmp117-i2c-1-1-0048"),
            (
                ("BME280", "i2c-1/1-0076"),
                SysfsQuantity::Humidity,
                None,
                "bme280-i2c-1-1-0076-humidity",
            ),
            (("28-0316", "w1"), SysfsQuantity::Temperature, Some("temp"), "sensor-28-0316-w1-temp"),
            (("x", long), SysfsQuantity::Temperature, None, "-soc-platform-soc-"),
        ] {
            let device = DeviceIdentity { name: device.0.to_owned(), place: device.1.to_owned() };
            let channel = channel.map(str::to_owned);
            let name = name_of(&SensorBundle { device, quantity, channel, has_humidity: false });
            assert!(AgentId::new(&name).is_ok(), "{name}");
            assert!(name.ends_with(expected) || name == expected, "{name}");
        }
    }
}
