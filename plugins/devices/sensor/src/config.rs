//! The `config` of a sensor's entry: the keys of all sensors, and the keys for the hardware of each
//! driver.

use std::path::PathBuf;

use actuator::{PlaceName, unit_conversion};
use agent::{Blueprint, BuildError};
use gpio_lines::{Bias, LineName};
use serde::Deserialize;

use crate::quantity::SensorQuantity;
use crate::text::TextFormat;
use crate::{COMMAND, GPIO, LINUX, MQTT, PHIDGET};

/// The `config` of a sensor's entry in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// Room of the sensor.
    pub(crate) location: PlaceName,
    /// Name of the quantity that a `sensor` measures, such as `"co2"`.
    pub(crate) quantity: Option<String>,
    /// Whether a `temperature-sensor` also measures the humidity.
    pub(crate) humidity: Option<bool>,
    /// Time for which a measurement counts as known, such as `"10min"`. Without this key, the time is
    /// not limited.
    pub(crate) valid_for: Option<String>,
    /// Driver `linux`: name of the device in the list of `althing sensors`.
    device: Option<String>,
    /// Driver `linux`: channel of the device, if several channels measure the same quantity.
    channel: Option<String>,
    /// Driver `linux`: folder with the kernel's devices; default is `/sys`.
    sysfs: Option<PathBuf>,
    /// Driver `command`: the program that measures, and its arguments.
    command: Option<Vec<String>>,
    /// Drivers `command` and `mqtt`: JSON pointer to the value in a JSON text, such as
    /// `"/main/temp"`.
    json: Option<String>,
    /// Drivers `command` and `phidget`: factor that converts the number to the quantity's unit.
    /// With the driver `phidget`, only a sensor without a unit may have a factor.
    factor: Option<f64>,
    /// Drivers `command` and `mqtt`: unit of numbers without a unit in their text, such as `"°F"`.
    unit: Option<String>,
    /// Driver `command`: pause between two runs for a quantity that is announced when it changes,
    /// such as `"5s"`.
    every: Option<String>,
    /// Driver `phidget`: path of `libphidget22`; default is the system's folders of libraries.
    library: Option<PathBuf>,
    /// Driver `phidget`: serial number that is printed on the interface kit, the hub or the
    /// Phidget.
    serial: Option<u32>,
    /// Driver `phidget`: port of a VINT hub that the sensor is connected to.
    hub_port: Option<u8>,
    /// Driver `phidget`: input port of an interface kit that the sensor is connected to.
    port: Option<u8>,
    /// Driver `phidget`: port of the humidity cable, for a sensor with two cables.
    humidity_port: Option<u8>,
    /// Driver `phidget`: part number of the sensor on the port, such as `"1111"`.
    sensor: Option<String>,
    /// Driver `mqtt`: address of the broker, as `HOST:PORT` or `mqtts://HOST:PORT`.
    broker: Option<String>,
    /// Driver `mqtt`: user name at the broker.
    user: Option<String>,
    /// Driver `mqtt`: path of the file with the user's password.
    password_file: Option<PathBuf>,
    /// Driver `mqtt`: path of the file with the trusted certificate authorities, for a broker
    /// `mqtts://…`.
    ca: Option<PathBuf>,
    /// Driver `mqtt`: topic of the device's values.
    topic: Option<String>,
    /// Driver `mqtt`: topic that reports whether the device is online.
    availability: Option<String>,
    /// Driver `gpio`: name of the line, such as `"gpiochip0/17"` or `"GPIO17"`.
    line: Option<LineName>,
    /// Driver `gpio`: whether a low level of the line means yes.
    active_low: Option<bool>,
    /// Driver `gpio`: bias of the line, such as `"pull-up"`. Without this key, the present bias is
    /// kept.
    bias: Option<Bias>,
    /// Driver `gpio`: time for which a level must be stable before it counts, such as `"10ms"`.
    debounce: Option<String>,
    /// Driver `gpio`: folder of the GPIO chips' device files; default is `/dev`.
    chips: Option<PathBuf>,
}

/// The keys of a sensor's config that are for its driver.
#[derive(Debug, Default)]
pub(crate) struct HardwareConfig {
    pub(crate) device: Option<String>,
    pub(crate) channel: Option<String>,
    pub(crate) sysfs: Option<PathBuf>,
    pub(crate) command: Option<Vec<String>>,
    pub(crate) json: Option<String>,
    pub(crate) factor: Option<f64>,
    pub(crate) unit: Option<String>,
    pub(crate) every: Option<String>,
    pub(crate) wiring: PhidgetWiring,
    pub(crate) broker: Option<String>,
    pub(crate) user: Option<String>,
    pub(crate) password_file: Option<PathBuf>,
    pub(crate) ca: Option<PathBuf>,
    pub(crate) topic: Option<String>,
    pub(crate) availability: Option<String>,
    pub(crate) line: Option<LineName>,
    pub(crate) active_low: Option<bool>,
    pub(crate) bias: Option<Bias>,
    pub(crate) debounce: Option<String>,
    pub(crate) chips: Option<PathBuf>,
}

impl HardwareConfig {
    /// Removes the keys for the format of values in texts from the config, and returns them.
    ///
    /// # Errors
    ///
    /// Returns an error if the factor is 0 or not finite, or if the unit cannot be converted to
    /// that of a quantity of the sensor.
    pub(crate) fn text_format(
        &mut self,
        blueprint: &Blueprint,
        quantities: &[&SensorQuantity],
    ) -> Result<TextFormat, BuildError> {
        let format = TextFormat {
            pointer: self.json.take(),
            unit: self.unit.take(),
            factor: self.factor.take(),
        };
        if let Some(factor) = format.factor.filter(|factor| !factor.is_finite() || *factor == 0.0) {
            let problem = format!("factor = {factor}: write a finite number other than 0");
            return Err(blueprint.problem(problem));
        }
        if let Some(unit) = &format.unit {
            let fits = |quantity: &&&SensorQuantity| {
                !quantity.is_noticed() && unit_conversion(unit, quantity.unit()).is_some()
            };
            if quantities.iter().find(fits).is_none() {
                let own = quantities.first().map_or("", |quantity| quantity.unit());
                let problem = match own {
                    "" => format!("unit = \"{unit}\": a yes or no has no unit"),
                    own => format!("unit = \"{unit}\": it cannot be converted to {own}"),
                };
                return Err(blueprint.problem(problem));
            }
            if format.factor.is_some() {
                let problem = "`factor` converts the number already: write `factor` or `unit`";
                return Err(blueprint.problem(problem));
            }
        }
        Ok(format)
    }
}

/// Whether a device is named by its name and its place. The numbers of the kernel change.
fn names_place(device: &str) -> bool {
    device.split_once('@').is_some_and(|(name, place)| !name.is_empty() && !place.is_empty())
}

/// The connection of a Phidget to its interface kit or hub, and the Phidget's part number.
#[derive(Debug, Default)]
pub(crate) struct PhidgetWiring {
    pub(crate) library: Option<PathBuf>,
    pub(crate) serial: Option<u32>,
    pub(crate) hub_port: Option<u8>,
    pub(crate) port: Option<u8>,
    pub(crate) humidity_port: Option<u8>,
    pub(crate) sensor: Option<String>,
}

impl Config {
    /// Removes the keys for the driver from the config, and returns them.
    ///
    /// # Errors
    ///
    /// Returns an error if a key belongs to another driver than that of the entry, or `json` is not
    /// a JSON pointer.
    pub(crate) fn hardware(&mut self, blueprint: &Blueprint) -> Result<HardwareConfig, BuildError> {
        let said = self.driver_keys();
        let this = blueprint.driver.as_str();
        let is_of_another =
            |(_, drivers, is_said): &&(_, &[&str], bool)| *is_said && !drivers.contains(&this);
        if let Some((key, drivers, _)) = said.iter().find(is_of_another) {
            let driver = drivers.first().copied().unwrap_or_default();
            let problem =
                format!("`{key}` is for `driver = \"{driver}\"`, and this driver is `{this}`");
            return Err(blueprint.problem(problem));
        }
        if let Some(device) = self.device.as_deref().filter(|device| !names_place(device)) {
            let problem = format!(
                "device = \"{device}\": write NAME@PLACE, as `althing sensors` lists the devices of \
                 this machine"
            );
            return Err(blueprint.problem(problem));
        }
        if let Some(pointer) = self.json.as_deref().filter(|pointer| !pointer.starts_with('/')) {
            let problem =
                format!("json = \"{pointer}\": write a JSON pointer, such as \"/main/temp\"");
            return Err(blueprint.problem(problem));
        }
        Ok(HardwareConfig {
            device: self.device.take(),
            channel: self.channel.take(),
            sysfs: self.sysfs.take(),
            command: self.command.take(),
            json: self.json.take(),
            factor: self.factor.take(),
            unit: self.unit.take(),
            every: self.every.take(),
            wiring: self.wiring(),
            broker: self.broker.take(),
            user: self.user.take(),
            password_file: self.password_file.take(),
            ca: self.ca.take(),
            topic: self.topic.take(),
            availability: self.availability.take(),
            line: self.line.take(),
            active_low: self.active_low.take(),
            bias: self.bias.take(),
            debounce: self.debounce.take(),
            chips: self.chips.take(),
        })
    }

    /// Returns the keys for drivers; each with its drivers, and `true` if the config has the key.
    fn driver_keys(&self) -> Vec<(&'static str, &'static [&'static str], bool)> {
        vec![
            ("device", &[LINUX], self.device.is_some()),
            ("channel", &[LINUX], self.channel.is_some()),
            ("sysfs", &[LINUX], self.sysfs.is_some()),
            ("command", &[COMMAND], self.command.is_some()),
            ("json", &[COMMAND, MQTT], self.json.is_some()),
            ("factor", &[COMMAND, PHIDGET], self.factor.is_some()),
            ("unit", &[COMMAND, MQTT], self.unit.is_some()),
            ("every", &[COMMAND], self.every.is_some()),
            ("library", &[PHIDGET], self.library.is_some()),
            ("serial", &[PHIDGET], self.serial.is_some()),
            ("hub-port", &[PHIDGET], self.hub_port.is_some()),
            ("port", &[PHIDGET], self.port.is_some()),
            ("humidity-port", &[PHIDGET], self.humidity_port.is_some()),
            ("sensor", &[PHIDGET], self.sensor.is_some()),
            ("broker", &[MQTT], self.broker.is_some()),
            ("user", &[MQTT], self.user.is_some()),
            ("password-file", &[MQTT], self.password_file.is_some()),
            ("ca", &[MQTT], self.ca.is_some()),
            ("topic", &[MQTT], self.topic.is_some()),
            ("availability", &[MQTT], self.availability.is_some()),
            ("line", &[GPIO], self.line.is_some()),
            ("active-low", &[GPIO], self.active_low.is_some()),
            ("bias", &[GPIO], self.bias.is_some()),
            ("debounce", &[GPIO], self.debounce.is_some()),
            ("chips", &[GPIO], self.chips.is_some()),
        ]
    }

    fn wiring(&mut self) -> PhidgetWiring {
        PhidgetWiring {
            library: self.library.take(),
            serial: self.serial.take(),
            hub_port: self.hub_port.take(),
            port: self.port.take(),
            humidity_port: self.humidity_port.take(),
            sensor: self.sensor.take(),
        }
    }
}
