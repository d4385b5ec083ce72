//! What a Linux kernel says of the sensors of its machine, in canonical units.
//!
//! - Reads files below [`Sysfs`] and nothing else: no C library, no special rights, no clock.
//! - A device is known by its name and where it hangs ([`Identity`]), never by the number that the
//!   kernel gave it: that changes with the order in which drivers came.
//! - A channel that is found may be gone when it is read. Whoever reads tries again.
//!
//! - [`Bundle`] is what of a machine's channels makes one sensor.
//!
//! `iio`, `hwmon` and `one_wire` know where each subsystem keeps what, and in which unit;
//! [`Quantity`] is what all of it is measured in.

mod bundle;
mod channel;
mod hwmon;
mod identity;
mod iio;
mod one_wire;
mod quantity;

use std::path::{Path, PathBuf};

pub use bundle::Bundle;
pub use channel::{Channel, ReadError};
pub use identity::Identity;
pub use quantity::Quantity;

/// Where a kernel shows its devices: `/sys`, or a copy of it.
#[derive(Clone, Debug)]
pub struct Sysfs {
    root: PathBuf,
}

/// Why there is no such channel. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// No device has this identity, or none that measures this.
    #[error("find `{wanted}`, which measures the {quantity}; {}", there_is(known))]
    Unknown {
        /// The device that was asked for.
        wanted: String,
        /// What it should measure.
        quantity: Quantity,
        /// The devices that measure it.
        known: Vec<String>,
    },
    /// The device measures it in several places.
    #[error("choose a `channel` of `{device}`: it has {}", channels.join(", "))]
    Ambiguous {
        /// The device.
        device: String,
        /// Its channels.
        channels: Vec<String>,
    },
}

fn there_is(known: &[String]) -> String {
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
    /// The devices below this folder.
    pub fn new(root: impl Into<PathBuf>) -> Sysfs {
        Sysfs { root: root.into() }
    }

    /// All that can be measured here now, by device. What cannot be read is not there.
    pub fn channels(&self) -> Vec<Channel> {
        let mut channels = iio::channels(self);
        channels.extend(one_wire::channels(self));
        channels.extend(hwmon::channels(self));
        channels.sort_by(|one, other| one.place().cmp(&other.place()));
        channels
    }

    /// The channel of a device that measures `quantity`: the one of this name, or the only one.
    ///
    /// # Errors
    ///
    /// If it is not there (now), or several are and none was named.
    pub fn find(
        &self,
        device: &str,
        quantity: Quantity,
        channel: Option<&str>,
    ) -> Result<Channel, FindError> {
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

    /// What is in a folder below the root, as whole paths in the order of their names.
    fn list(&self, folder: &str) -> Vec<PathBuf> {
        list(&self.root.join(folder))
    }
}

/// What is in a folder, in the order of names; nothing, if it cannot be read.
fn list(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths
}

/// The name of a file, if it can be read as text.
fn file_name(path: &Path) -> Option<&str> {
    path.file_name()?.to_str()
}

/// A line of text, without what surrounds it.
fn line(path: &Path) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
