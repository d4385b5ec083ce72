//! Industrial I/O, the kernel's subsystem for most sensors on boards
//! (`Documentation/ABI/testing/sysfs-bus-iio` of the kernel).

use std::path::Path;

use crate::channel::{SensorChannel, ValueFiles};
use crate::identity::DeviceIdentity;
use crate::quantity::SysfsQuantity;
use crate::{Sysfs, file_name, line, list};

/// Name of each quantity in the kernel, and the factor from the kernel's unit to the unit of
/// [`SysfsQuantity`].
const KINDS: &[(&str, SysfsQuantity, f64)] = &[
    // The kernel's units with a factor: milli-degrees, thousandths of per cent, per cent.
    ("temp", SysfsQuantity::Temperature, 1e-3),
    ("humidityrelative", SysfsQuantity::Humidity, 1e-3),
    ("concentration_co2", SysfsQuantity::Co2, 1e4),
    ("illuminance", SysfsQuantity::Light, 1.0),
    ("distance", SysfsQuantity::Distance, 1.0),
];

/// Beginnings of the names of quantities that only sensors of the air measure.
const AIR: &[&str] = &["humidityrelative", "pressure", "concentration"];

/// Beginnings of the names of chips that measure the temperature around them or at a probe.
const THERMOMETERS: &[&str] = &[
    "ad741", "ltc2983", "max3185", "max3186", "mcp9600", "mcp9601", "mcp98", "mlx90614",
    "mlx90632", "tmp006", "tmp007", "tmp11", "tsic", "tsys",
];

/// Suffixes of channels without current measurements: maximum and minimum since the start, and
/// averages.
const DERIVED: &[&str] = &["_peak", "_trough", "_mean"];

/// Returns the sensor channels of the subsystem Industrial I/O.
pub(crate) fn channels(sysfs: &Sysfs) -> Vec<SensorChannel> {
    let mut channels = Vec::new();
    for folder in sysfs.list("bus/iio/devices") {
        if let Some(device) = device(sysfs, &folder) {
            let files = list(&folder);
            channels.extend(files.iter().filter_map(|file| channel(&device, file)));
        }
    }
    channels
}

/// Returns the device of a folder `iio:deviceN`, which is the device with the parent folder.
fn device(sysfs: &Sysfs, folder: &Path) -> Option<DeviceIdentity> {
    file_name(folder).filter(|name| name.starts_with("iio:device"))?;
    let own = folder.canonicalize().ok()?;
    DeviceIdentity::of(sysfs, own.parent()?, line(&folder.join("name")))
}

/// Returns the channel with its value in this file. Returns `None` if the file's name has neither
/// of the forms `in_KIND[N][_MODIFIER]_raw` and `in_KIND[N][_MODIFIER]_input`, or if the channel is
/// left out.
fn channel(device: &DeviceIdentity, file: &Path) -> Option<SensorChannel> {
    let name = file_name(file)?.strip_prefix("in_")?;
    let (name, is_raw) = match name.strip_suffix("_input") {
        Some(name) => (name, false),
        None => (name.strip_suffix("_raw")?, true),
    };
    if DERIVED.iter().any(|derived| name.ends_with(derived)) {
        return None;
    }
    let is_of = |kind: &str| {
        let rest =
            name.strip_prefix(kind)?.trim_start_matches(|digit: char| digit.is_ascii_digit());
        (rest.is_empty() || rest.starts_with('_')).then_some(())
    };
    let (kind, quantity, factor) = KINDS.iter().find(|(kind, ..)| is_of(kind).is_some())?;
    // If the value exists both raw and processed, only the processed one is used.
    if is_raw && file.with_file_name(format!("in_{name}_input")).exists() {
        return None;
    }
    let beside = |what: &str| {
        let of = |whose: &str| file.with_file_name(format!("in_{whose}_{what}"));
        [of(name), of(kind)].into_iter().find(|path| is_raw && path.exists())
    };
    let (offset, scale) = (beside("offset"), beside("scale"));
    let file = file.to_owned();
    let (fault, no_values, at_power_up, factor) = (None, &[][..], None, *factor);
    let reading = ValueFiles { file, offset, scale, fault, no_values, at_power_up, factor };
    let (device, name) = (device.clone(), name.to_owned());
    let is_ambient = *quantity != SysfsQuantity::Temperature || is_of_room(&device, &reading.file);
    Some(SensorChannel { device, name, quantity: *quantity, is_ambient, reading })
}

/// Whether a temperature is that of the room: power chips, converters and inertial sensors report
/// their own, and infrared thermometers that of an object.
fn is_of_room(device: &DeviceIdentity, file: &Path) -> bool {
    let measures_air = || {
        let siblings = file.parent().map(list).unwrap_or_default();
        siblings.iter().filter_map(|file| file_name(file)).any(|name| {
            let kind = name.strip_prefix("in_").unwrap_or_default();
            AIR.iter().any(|air| kind.starts_with(air))
        })
    };
    let is_of_object = file_name(file).is_some_and(|name| name.contains("_object"));
    let is_thermometer = THERMOMETERS.iter().any(|chip| device.name.starts_with(chip));
    !is_of_object && (is_thermometer || measures_air())
}
