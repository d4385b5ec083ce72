//! Hardware monitoring, the kernel's subsystem for chips that measure temperature and humidity
//! (`Documentation/hwmon/sysfs-interface` of the kernel). Most of the chips monitor the machine
//! itself.

use std::path::Path;

use crate::channel::{SensorChannel, ValueFiles};
use crate::identity::DeviceIdentity;
use crate::quantity::SysfsQuantity;
use crate::{Sysfs, file_name, line, list};

/// Factor from the number in a file to the unit of the quantity: both quantities are reported in
/// thousandths.
const FACTOR: f64 = 1e-3;

/// Ranges of numbers that temperature chips report for a sensor that does not answer. In such a
/// number, either all bits are ones, or only the first bit is.
pub(crate) const NO_DEGREES: &[(f64, f64)] = &[(-1e9, -127_000.0), (127_000.0, 128_000.0)];

/// Prefixes of the names of chips that measure rooms. All other chips measure processors, disks and
/// boards.
const AMBIENT: &[&str] = &[
    "adt7410", "adt7420", "adt75", "ds1621", "ds1775", "ds620", "hih6130", "hs3001", "lm75",
    "lm92", "mcp980", "pct2075", "sht15", "sht21", "sht3", "sht4", "shtc", "shtw", "stds75",
    "sts3", "tc74", "tmp1", "tmp4", "tmp75",
];

/// Returns the sensor channels of the subsystem for hardware monitoring.
pub(crate) fn channels(sysfs: &Sysfs) -> Vec<SensorChannel> {
    let mut channels = Vec::new();
    for folder in sysfs.list("class/hwmon") {
        let name = line(&folder.join("name"));
        // This chip is a 1-wire thermometer, which `one_wire` reports.
        if name.as_deref() == Some("w1_slave_temp") {
            continue;
        }
        // A chip without a device belongs to the machine itself.
        let there = folder.join("device");
        let place = if there.exists() { &there } else { &folder };
        if let Some(device) = DeviceIdentity::of(sysfs, place, name) {
            let files = list(&folder);
            channels.extend(files.iter().filter_map(|file| channel(&device, file)));
        }
    }
    channels
}

fn channel(device: &DeviceIdentity, file: &Path) -> Option<SensorChannel> {
    let name = file_name(file)?.strip_suffix("_input")?;
    let is_of = |kind| {
        let number = name.strip_prefix(kind)?;
        number.parse::<u32>().ok()
    };
    let quantity = match (is_of("temp"), is_of("humidity")) {
        (Some(_), _) => SysfsQuantity::Temperature,
        (_, Some(_)) => SysfsQuantity::Humidity,
        _ => return None,
    };
    let is_ambient = AMBIENT.iter().any(|chip| device.name.starts_with(chip));
    let no_values = match quantity {
        SysfsQuantity::Temperature => NO_DEGREES,
        _ => &[],
    };
    let reading = ValueFiles {
        file: file.to_owned(),
        offset: None,
        scale: None,
        fault: Some(file.with_file_name(format!("{name}_fault"))),
        no_values,
        at_power_up: None,
        factor: FACTOR,
    };
    let (device, name) = (device.clone(), name.to_owned());
    Some(SensorChannel { device, name, quantity, is_ambient, reading })
}
