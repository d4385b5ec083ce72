//! Thermometers on a 1-wire bus (`Documentation/w1/slaves/w1_therm` of the kernel).

use std::path::Path;

use crate::channel::{SensorChannel, ValueFiles};
use crate::hwmon::NO_DEGREES;
use crate::identity::DeviceIdentity;
use crate::quantity::SysfsQuantity;
use crate::{Sysfs, file_name};

/// Names of the families of 1-wire thermometers, by the number of the family, which begins the
/// serial number.
const FAMILIES: &[(&str, &str)] =
    &[("10", "ds18s20"), ("22", "ds1822"), ("28", "ds18b20"), ("3b", "ds1825"), ("42", "ds28ea00")];

/// Factor from the number in a file to degrees Celsius; the kernel reports thousandths of degrees.
const FACTOR: f64 = 1e-3;

/// Number in the file of a thermometer after power-up, before the first measurement.
const AT_POWER_UP: f64 = 85_000.0;

/// Returns the sensor channels on 1-wire buses.
pub(crate) fn channels(sysfs: &Sysfs) -> Vec<SensorChannel> {
    let devices = sysfs.list("bus/w1/devices");
    devices.iter().filter_map(|folder| channel(folder)).collect()
}

fn channel(folder: &Path) -> Option<SensorChannel> {
    let (family, serial) = file_name(folder)?.split_once('-')?;
    let (_, called) = FAMILIES.iter().find(|(number, _)| *number == family)?;
    let file = folder.join("temperature");
    if !file.exists() {
        return None;
    }
    // The serial number identifies the device in any place.
    let device = DeviceIdentity { name: (*called).to_owned(), place: format!("{family}-{serial}") };
    let reading = ValueFiles {
        file,
        offset: None,
        scale: None,
        fault: None,
        no_values: NO_DEGREES,
        at_power_up: Some(AT_POWER_UP),
        factor: FACTOR,
    };
    let (name, quantity) = ("temperature".to_owned(), SysfsQuantity::Temperature);
    Some(SensorChannel { device, name, quantity, is_ambient: true, reading })
}
