//! Identity of a device, independent of the number that the kernel assigns to the device.

use std::fmt;
use std::path::{Component, Path};

use serde::{Serialize, Serializer};

use crate::{Sysfs, line};

/// Prefixes of the names of buses. The place of a device begins at its bus; the devices above the
/// bus are not part of the place, because they differ between kernels.
const BUSES: [&str; 2] = ["i2c-", "spi"];

/// Identity of a device: its name and its place. Its text form is `NAME@PLACE`, such as
/// `bme280@i2c-1/1-0076`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DeviceIdentity {
    /// Name of the device according to its driver.
    pub name: String,
    /// Place where the device is attached: its folder among the kernel's devices, from the bus on.
    pub place: String,
}

impl DeviceIdentity {
    /// Returns the identity of the device in `folder`, which may be a link. `called` is the name of
    /// the device if the folder has none. Returns `None` if the device has no name or is not below
    /// the devices of `sysfs`.
    pub(crate) fn of(
        sysfs: &Sysfs,
        folder: &Path,
        called: Option<String>,
    ) -> Option<DeviceIdentity> {
        let folder = folder.canonicalize().ok()?;
        let devices = sysfs.root.canonicalize().ok()?.join("devices");
        let place = place(folder.strip_prefix(devices).ok()?);
        let name = line(&folder.join("name")).or(called)?;
        Some(DeviceIdentity { name, place })
    }
}

/// Returns the part of a device's path that states where the device is attached.
fn place(path: &Path) -> String {
    let normal = path.components().filter_map(|part| match part {
        Component::Normal(part) => part.to_str(),
        _ => None,
    });
    let parts: Vec<_> = normal.collect();
    let is_bus = |part: &&str| {
        BUSES
            .iter()
            .any(|bus| part.strip_prefix(bus).is_some_and(|number| number.parse::<u32>().is_ok()))
    };
    let from = parts.iter().position(is_bus).unwrap_or(0);
    parts[from..].join("/")
}

impl fmt::Display for DeviceIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format!("{}@{}", self.name, self.place))
    }
}

impl Serialize for DeviceIdentity {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_begins_with_its_bus() {
        for (path, expected) in [
            ("i2c-0/0-0040", "i2c-0/0-0040"),
            ("platform/soc/fe804000.i2c/i2c-1/1-0076", "i2c-1/1-0076"),
            ("platform/soc/fe204000.spi/spi_master/spi0/spi0.0", "spi0/spi0.0"),
            ("platform/dht11@4", "platform/dht11@4"),
            ("w1_bus_master1/28-0316a2791234", "w1_bus_master1/28-0316a2791234"),
        ] {
            assert_eq!(place(Path::new(path)), expected);
        }
    }
}
