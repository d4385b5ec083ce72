//! The part of a robot's `config` that describes its mobile base.

use std::collections::BTreeMap;

use actuator::PlaceName;
use agent::{Blueprint, config_tables};
use ros2_link::{RosAddress, is_ros_name};
use serde::Deserialize;
use serde_json::{Map, Value};

use crate::ros2::Ros2Config;

/// Part of a robot's `config` in the ecosystem file that describes its mobile base.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct BaseConfig {
    /// Place where the base stands at the start.
    pub(crate) start: PlaceName,
    /// Speed of the base, in meters per second.
    #[serde(default = "default_speed")]
    pub(crate) speed: f64,
    /// Time limit of one move of the base, in seconds: enough for a corridor of 30 meters at 0.3
    /// m/s, with a person in the way.
    #[serde(default = "default_move_timeout")]
    pub(crate) move_timeout: f64,
    /// The battery of the base; `None` if its range is unlimited.
    #[serde(default)]
    pub(crate) battery: Option<BatteryConfig>,
    /// Place where the battery is charged; `None` if the base has no battery.
    #[serde(default)]
    pub(crate) dock: Option<PlaceName>,
    /// Poses, which are spots beside the places of the map, by name.
    #[serde(default)]
    pub(crate) poses: BTreeMap<String, PoseConfig>,
    /// How long a way is avoided on which the base failed, in seconds. A real base only.
    #[serde(default = "default_blocked_for")]
    pub(crate) blocked_for: f64,
    /// Settings of the driver `ros2`; `None` for other drivers.
    #[serde(default)]
    pub(crate) ros2: Option<Ros2Config>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct BatteryConfig {
    /// Range of a full battery, in meters.
    pub(crate) range: f64,
    /// Range that is left in the battery at the start, in meters; a full range if the key is
    /// missing.
    #[serde(default)]
    pub(crate) charge: Option<f64>,
    /// Time to charge an empty battery, in seconds.
    #[serde(default = "default_recharge_time")]
    pub(crate) recharge_time: f64,
}

config_tables!(BatteryConfig);

/// A pose, which is a spot beside a place of the map. The config gives that place alone, or that
/// place and the distance between the two, in meters.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum PoseConfig {
    Near(PlaceName),
    Away { near: PlaceName, meters: f64 },
}

fn default_speed() -> f64 {
    0.3
}

fn default_move_timeout() -> f64 {
    120.0
}

fn default_blocked_for() -> f64 {
    60.0
}

fn default_recharge_time() -> f64 {
    600.0
}

/// Keys of the table `ros2` that are the address of a robot.
const ADDRESS: [&str; 4] = ["endpoint", "dialect", "namespace", "domain-id"];

/// Returns the address in the table `ros2` of a `config`, in the form in which two addresses of one robot
/// are equal; `None` if there is none, or if it has a mistake. The config is that of a robot, of its
/// watchdog, or of other nodes.
pub fn ros_address(config: &Value) -> Option<RosAddress> {
    let table = config.get("ros2")?.as_object()?;
    let of_address = |(key, _): &(&String, &Value)| ADDRESS.contains(&key.as_str());
    let own = table.iter().filter(of_address).map(|(key, value)| (key.clone(), value.clone()));
    let address: RosAddress =
        serde_json::from_value(Value::Object(own.collect::<Map<_, _>>())).ok()?;
    address.check().is_ok().then(|| address.canonical())
}

/// Checks the name of a topic or a service of ROS, which stands at `key` in a `config`.
///
/// # Errors
///
/// Returns what a name must be, as text for a person.
pub fn check_ros_name(key: &str, name: &str) -> Result<(), String> {
    is_ros_name(name).then_some(()).ok_or_else(|| {
        format!(
            "{key} = \"{name}\" is no name of ROS: letters, digits, `_` and `/`, and no digit at the \
             beginning or behind a slash"
        )
    })
}

/// Returns `number` if it is above zero and not absurdly large.
pub(crate) fn positive(name: &str, number: f64) -> Result<f64, String> {
    let is_fine = number.is_finite() && number > 0.0 && number < 1e6;
    is_fine.then_some(number).ok_or_else(|| format!("{name} = {number} must be above zero"))
}

impl PoseConfig {
    /// Distance between a pose and its place in meters, if the config gives none: one step into a
    /// room.
    const METERS: f64 = 1.0;

    /// Returns the name of the pose, the place beside it, and their distance in meters.
    pub(crate) fn of(
        self,
        name: String,
        blueprint: &Blueprint,
    ) -> Result<(PlaceName, PlaceName, f64), String> {
        let is_on_map = |name: &PlaceName| {
            let mut objects = blueprint.host.map.objects.iter();
            objects.any(|declaration| declaration.object.name == name.as_str())
        };
        let name = PlaceName::try_from(name).map_err(|error| error.to_string())?;
        let (near, meters) = match self {
            PoseConfig::Near(near) => (near, Self::METERS),
            PoseConfig::Away { near, meters } => (near, positive("poses.meters", meters)?),
        };
        if is_on_map(&name) {
            return Err(format!("the pose `{name}` is a place on the map: it needs no pose"));
        }
        if !is_on_map(&near) {
            return Err(format!("the pose `{name}` is near `{near}`, which is not on the map"));
        }
        Ok((name, near, meters))
    }
}
