//! What of a machine's channels makes one sensor.

use std::collections::BTreeMap;

use crate::{Channel, Identity, Quantity};

/// What one sensor measures with: a channel of a device, and with a thermometer's the humidity on the
/// same board.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Bundle {
    /// The device.
    pub device: Identity,
    /// What it measures before all.
    pub quantity: Quantity,
    /// Its channel, where the device measures that in several places.
    pub channel: Option<String>,
    /// Whether a thermometer measures the humidity too.
    pub has_humidity: bool,
}

impl Bundle {
    /// The sensors of a machine; those that measure the machine itself are left out.
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
    // A thermometer that measures the humidity too is one sensor.
    let is_own = |channel: &&&Channel| !(has_both && channel.quantity == Quantity::Humidity);
    let bundle = |channel: &&Channel| Bundle {
        device: channel.device.clone(),
        quantity: channel.quantity,
        channel: (count(channel.quantity) > 1).then(|| channel.name.clone()),
        has_humidity: has_both && channel.quantity == Quantity::Temperature,
    };
    channels.iter().filter(is_own).map(bundle).collect()
}
