//! Groups the channels of a machine into sensors.

use std::collections::BTreeMap;

use crate::{DeviceIdentity, SensorChannel, SysfsQuantity};

/// Channels that make up one sensor. A sensor is one channel of a device; the sensor of a
/// thermometer also includes the humidity channel of the same device.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SensorBundle {
    /// Device that the channels belong to.
    pub device: DeviceIdentity,
    /// Main quantity that the sensor measures.
    pub quantity: SysfsQuantity,
    /// Name of the channel for the main quantity; `None` if the device has only one channel for
    /// that quantity.
    pub channel: Option<String>,
    /// Whether the sensor is a thermometer that also measures the humidity.
    pub has_humidity: bool,
}

impl SensorBundle {
    /// Returns the sensors of a machine, without those that measure the machine itself.
    pub fn all(channels: &[SensorChannel]) -> Vec<SensorBundle> {
        let mut devices: BTreeMap<&DeviceIdentity, Vec<&SensorChannel>> = BTreeMap::new();
        for channel in channels.iter().filter(|channel| channel.is_ambient) {
            devices.entry(&channel.device).or_default().push(channel);
        }
        devices.into_values().flat_map(|of_device| of(&of_device)).collect()
    }
}

fn of(channels: &[&SensorChannel]) -> Vec<SensorBundle> {
    let count = |wanted| channels.iter().filter(|channel| channel.quantity == wanted).count();
    let has_both = count(SysfsQuantity::Temperature) > 0 && count(SysfsQuantity::Humidity) > 0;
    // A thermometer that also measures the humidity is one sensor.
    let is_own =
        |channel: &&&SensorChannel| !(has_both && channel.quantity == SysfsQuantity::Humidity);
    let bundle = |channel: &&SensorChannel| SensorBundle {
        device: channel.device.clone(),
        quantity: channel.quantity,
        channel: (count(channel.quantity) > 1).then(|| channel.name.clone()),
        has_humidity: has_both && channel.quantity == SysfsQuantity::Temperature,
    };
    channels.iter().filter(is_own).map(bundle).collect()
}
