//! The entry's `config`: of all sensors, and of each driver's hardware.

use std::path::PathBuf;

use actuator::Place;
use agent::{Blueprint, BuildError};
use gpio_lines::{Bias, LineName};
use serde::Deserialize;

use crate::{COMMAND, GPIO, LINUX, MQTT, PHIDGET};

/// What an entry says.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// The room it stands in.
    pub(crate) location: Place,
    /// What a `sensor` measures, such as `"co2"`.
    pub(crate) quantity: Option<String>,
    /// Whether a `temperature-sensor` measures the humidity too.
    pub(crate) humidity: Option<bool>,
    /// How long a measurement counts as known, such as `"10m"`; without it, until it dies.
    pub(crate) valid_for: Option<String>,
    /// Driver `linux`: which device, as `althing sensors` lists it.
    device: Option<String>,
    /// Driver `linux`: which of its channels, where several measure the same.
    channel: Option<String>,
    /// Driver `linux`: where the kernel shows its devices, if not at `/sys`.
    sysfs: Option<PathBuf>,
    /// Driver `command`: a program and its arguments.
    command: Option<Vec<String>>,
    /// Drivers `command` and `mqtt`: where in a JSON text the value is, such as `"/main/temp"`.
    json: Option<String>,
    /// Driver `command`: what makes the number one in the quantity's unit. Driver `phidget`: the
    /// same, for a sensor that has no unit.
    factor: Option<f64>,
    /// Driver `command`: how often a sensor that notices by itself looks, such as `"5s"`.
    every: Option<String>,
    /// Driver `phidget`: where `libphidget22` lies, if not where the system has libraries.
    library: Option<PathBuf>,
    /// Driver `phidget`: the number that is printed on the interface kit, the hub or the Phidget.
    serial: Option<u32>,
    /// Driver `phidget`: the port of a VINT hub.
    hub_port: Option<u8>,
    /// Driver `phidget`: the input of an interface kit.
    port: Option<u8>,
    /// Driver `phidget`: where the humidity of a sensor with two cables is.
    humidity_port: Option<u8>,
    /// Driver `phidget`: what hangs there, such as `"1111"`.
    sensor: Option<String>,
    /// Driver `mqtt`: whom it speaks to, as `HOST:PORT`.
    broker: Option<String>,
    /// Driver `mqtt`: who logs in there.
    user: Option<String>,
    /// Driver `mqtt`: where the user's password stands.
    password_file: Option<PathBuf>,
    /// Driver `mqtt`: the authorities that are trusted, where the broker is `mqtts://…`.
    ca: Option<PathBuf>,
    /// Driver `mqtt`: under which topic the device speaks.
    topic: Option<String>,
    /// Driver `mqtt`: under which topic it is said whether the device is online.
    availability: Option<String>,
    /// Driver `gpio`: which line, such as `"gpiochip0/17"` or `"GPIO17"`.
    line: Option<LineName>,
    /// Driver `gpio`: whether the line is yes when it is low.
    active_low: Option<bool>,
    /// Driver `gpio`: what pulls the line, such as `"pull-up"`; as it is, if nobody says.
    bias: Option<Bias>,
    /// Driver `gpio`: how long the line must be still before it counts, such as `"10ms"`.
    debounce: Option<String>,
    /// Driver `gpio`: where the chips are, if not in `/dev`.
    chips: Option<PathBuf>,
}

/// What it says of the hardware.
#[derive(Debug, Default)]
pub(crate) struct Hardware {
    pub(crate) device: Option<String>,
    pub(crate) channel: Option<String>,
    pub(crate) sysfs: Option<PathBuf>,
    pub(crate) command: Option<Vec<String>>,
    pub(crate) json: Option<String>,
    pub(crate) factor: Option<f64>,
    pub(crate) every: Option<String>,
    pub(crate) wiring: Wiring,
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

/// Where a Phidget hangs, and what it is.
#[derive(Debug, Default)]
pub(crate) struct Wiring {
    pub(crate) library: Option<PathBuf>,
    pub(crate) serial: Option<u32>,
    pub(crate) hub_port: Option<u8>,
    pub(crate) port: Option<u8>,
    pub(crate) humidity_port: Option<u8>,
    pub(crate) sensor: Option<String>,
}

impl Config {
    /// Takes what is said of the hardware.
    ///
    /// # Errors
    ///
    /// If that is for another driver than this entry's.
    pub(crate) fn hardware(&mut self, blueprint: &Blueprint) -> Result<Hardware, BuildError> {
        let said = [
            ("device", &[LINUX][..], self.device.is_some()),
            ("channel", &[LINUX], self.channel.is_some()),
            ("sysfs", &[LINUX], self.sysfs.is_some()),
            ("command", &[COMMAND], self.command.is_some()),
            ("json", &[COMMAND, MQTT], self.json.is_some()),
            ("factor", &[COMMAND, PHIDGET], self.factor.is_some()),
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
        ];
        let this = blueprint.driver.as_str();
        let is_of_another =
            |(_, drivers, is_said): &&(&str, &[&str], bool)| *is_said && !drivers.contains(&this);
        if let Some((key, drivers, _)) = said.iter().find(is_of_another) {
            let driver = drivers.first().copied().unwrap_or_default();
            let problem =
                format!("`{key}` is for `driver = \"{driver}\"`, and this driver is `{this}`");
            return Err(blueprint.problem(problem));
        }
        if let Some(pointer) = self.json.as_deref().filter(|pointer| !pointer.starts_with('/')) {
            let problem =
                format!("json = \"{pointer}\": write where in the text, such as \"/main/temp\"");
            return Err(blueprint.problem(problem));
        }
        Ok(Hardware {
            device: self.device.take(),
            channel: self.channel.take(),
            sysfs: self.sysfs.take(),
            command: self.command.take(),
            json: self.json.take(),
            factor: self.factor.take(),
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
    fn wiring(&mut self) -> Wiring {
        Wiring {
            library: self.library.take(),
            serial: self.serial.take(),
            hub_port: self.hub_port.take(),
            port: self.port.take(),
            humidity_port: self.humidity_port.take(),
            sensor: self.sensor.take(),
        }
    }
}
