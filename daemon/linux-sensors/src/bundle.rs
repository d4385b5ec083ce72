//! Groups the channels of a machine into sensors.

use std::collections::BTreeMap;

use crate::{Channel, Identity, Quantity};

/// Channels that make up one sensor: one channel of a device; for a thermometer also the humidity channel
/// of the same device.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Bundle {
    /// The device.
    pub device: Identity,
    /// Main quantity that the sensor measures.
    pub quantity: Quantity,
    /// Name of the channel, if the device has several for that quantity.
    pub channel: Option<String>,
    /// Whether the thermometer also measures the humidity.
    pub has_humidity: bool,
}

impl Bundle {
    /// Returns the sensors of a machine. Sensors that measure the machine itself are left out.
    pub fn all(channels: &[Channel]) -> Vec<Bundle> {
        let mut devices: BTreeMap<&Identity, Vec<&Channel>> = BTreeMap::new();
        for channel in channels.iter().filter(|channel| channel.is_ambient) {
            devices.entry(&channel.device).or_default().push(channel);
        }
        devices.into_values().flat_map(|of_device| of(&of_device)).collect()
    }
}

fn of(channels: &[&Channel]) -> Vec<Bundle> {
    let count = |wanted| channels.iter().filter(|channel| channel.quantity == wanted).count();
    let has_both = count(Quantity::Temperature) > 0 && count(Quantity::Humidity) > 0;
    // A thermometer that also measures the humidity is one sensor.
    let is_own = |channel: &&&Channel| !(has_both && channel.quantity == Quantity::Humidity);
    let bundle = |channel: &&Channel| Bundle {
        device: channel.device.clone(),
        quantity: channel.quantity,
        channel: (count(channel.quantity) > 1).then(|| channel.name.clone()),
        has_humidity: has_both && channel.quantity == Quantity::Temperature,
    };
    channels.iter().filter(is_own).map(bundle).collect()
}
