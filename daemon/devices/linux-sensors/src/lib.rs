//! Sensors of a machine, as reported by its Linux kernel, in canonical units.
//!
//! - The crate reads files below [`Sysfs`], and needs no C library, no special rights and no clock.
//! - A device is identified by its name and its place ([`DeviceIdentity`]), never by its number in
//!   the kernel, because the number depends on the order in which drivers were loaded.
//! - A channel may be gone when it is read. The caller should try again.
//! - [`SensorBundle`] groups the channels of a machine into sensors.
//!
//! `iio`, `hwmon` and `one_wire` contain the files and units of each subsystem of the kernel.
//! [`SysfsQuantity`] defines the units to which all values are converted.

mod bundle;
mod channel;
mod hwmon;
mod identity;
mod iio;
mod one_wire;
mod quantity;

use std::path::{Path, PathBuf};

pub use bundle::SensorBundle;
pub use channel::{ReadError, SensorChannel};
pub use identity::DeviceIdentity;
pub use quantity::SysfsQuantity;

/// Folder with the devices of a kernel: `/sys`, or a copy of `/sys`.
#[derive(Clone, Debug)]
pub struct Sysfs {
    root: PathBuf,
}

/// Reason why a channel was not found. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// No device has the requested identity, or the device does not measure the quantity.
    #[error("find `{wanted}`, which measures the {quantity}; {}", known_devices_text(known))]
    Unknown {
        /// Requested identity of the device.
        wanted: String,
        /// Requested quantity.
        quantity: SysfsQuantity,
        /// Identities of the devices that measure the quantity.
        known: Vec<String>,
    },
    /// The device has several channels for the requested quantity.
    #[error("choose a `channel` of `{device}`: it has {}", channels.join(", "))]
    Ambiguous {
        /// Requested identity of the device.
        device: String,
        /// Names of the device's channels for the quantity.
        channels: Vec<String>,
    },
}

fn known_devices_text(known: &[String]) -> String {
    match known {
        [] => "nothing that measures it is plugged in".to_owned(),
        known => format!("there is {}", known.join(", ")),
    }
}

impl Default for Sysfs {
    fn default() -> Sysfs {
        Sysfs::new("/sys")
    }
}

impl Sysfs {
    /// Returns the devices of a kernel below the folder `root`.
    pub fn new(root: impl Into<PathBuf>) -> Sysfs {
        Sysfs { root: root.into() }
    }

    /// Returns all present channels, sorted by device. Devices that cannot be read are left out.
    pub fn channels(&self) -> Vec<SensorChannel> {
        let mut channels = iio::channels(self);
        channels.extend(one_wire::channels(self));
        channels.extend(hwmon::channels(self));
        channels.sort_by(|one, other| one.place().cmp(&other.place()));
        channels
    }

    /// Returns the channel by which a device measures `quantity`: the channel with the name
    /// `channel`, or the only channel if `channel` is `None`.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such channel at present, or if there are several and
    /// `channel` is `None`.
    pub fn find(
        &self,
        device: &str,
        quantity: SysfsQuantity,
        channel: Option<&str>,
    ) -> Result<SensorChannel, FindError> {
        let measuring: Vec<_> =
            self.channels().into_iter().filter(|each| each.quantity == quantity).collect();
        let known: Vec<_> = measuring.iter().map(|each| format!("`{}`", each.device)).collect();
        let mut fitting = { measuring.into_iter() }
            .filter(|each| each.device.to_string() == device)
            .filter(|each| channel.is_none_or(|name| each.name == name));
        let unknown = || FindError::Unknown { wanted: device.to_owned(), quantity, known };
        let first = fitting.next().ok_or_else(unknown)?;
        let others: Vec<_> = fitting.map(|each| each.name).collect();
        if others.is_empty() {
            return Ok(first);
        }
        let channels = std::iter::once(first.name).chain(others);
        let channels = channels.map(|name| format!("`{name}`")).collect();
        Err(FindError::Ambiguous { device: device.to_owned(), channels })
    }

    /// Returns the entries of a folder below the root of the kernel's devices, as full paths sorted
    /// by name.
    fn list(&self, folder: &str) -> Vec<PathBuf> {
        list(&self.root.join(folder))
    }
}

/// Returns the entries of a folder, sorted by name; empty if the folder cannot be read.
fn list(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths
}

/// Returns the name of a file; `None` if the name is not UTF-8.
fn file_name(path: &Path) -> Option<&str> {
    path.file_name()?.to_str()
}

/// Returns the text of a file without blanks at both ends; `None` if the text is empty or cannot be
/// read.
fn line(path: &Path) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
