//! A sensor channel: one quantity that one device measures, and the files with its value.

use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::identity::DeviceIdentity;
use crate::quantity::SysfsQuantity;

/// One quantity that a device measures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorChannel {
    /// Device that the channel belongs to.
    pub device: DeviceIdentity,
    /// Name of the channel in the kernel, such as `temp`, `temp_object` or `humidityrelative`.
    #[serde(rename = "channel")]
    pub name: String,
    /// Quantity that the channel measures.
    pub quantity: SysfsQuantity,
    /// Whether the channel measures the room around the device, according to the device's name. The
    /// thermometer of a processor, for example, does not.
    pub is_ambient: bool,
    #[serde(skip)]
    pub(crate) reading: ValueFiles,
}

/// Files with a channel's value. The number in `file` is converted to the unit of the quantity by
/// `(FILE + offset) * scale * factor`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ValueFiles {
    pub(crate) file: PathBuf,
    pub(crate) offset: Option<PathBuf>,
    pub(crate) scale: Option<PathBuf>,
    /// File with a number other than 0 if the value is invalid, because the sensor is missing or
    /// its wire is broken; `None` if the device has no such file.
    pub(crate) fault: Option<PathBuf>,
    /// Ranges of numbers in the value's file that mean “no value”; both ends are included.
    pub(crate) no_values: &'static [(f64, f64)],
    /// Number in the value's file after power-up, before the first measurement; `None` if the
    /// device has no such special number.
    pub(crate) at_power_up: Option<f64>,
    pub(crate) factor: f64,
}

/// Reason why a channel could not be read. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file with the value could not be read: the device is gone, or its bus failed
    /// temporarily.
    #[error("read `{}`: {source}", .file.display())]
    File {
        /// Path of the file with the value.
        file: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// The file with the value does not contain a number.
    #[error("read `{}`: `{text}` is no number", .file.display())]
    NoNumber {
        /// Path of the file with the value.
        file: PathBuf,
        /// Text in the file, or the beginning of the text.
        text: String,
    },
    /// The device reports that its current value is invalid.
    #[error("read `{device}`: it reports a fault of its sensor")]
    Fault {
        /// Device that reports the invalid value.
        device: DeviceIdentity,
    },
    /// The device reports a number that means “no value”, or that is physically impossible.
    #[error("use {value}, the value of `{device}`: no sensor measures that")]
    Impossible {
        /// Device that reports the number.
        device: DeviceIdentity,
        /// Number that was reported, in the quantity's unit.
        value: f64,
    },
    /// The device was just powered up and has not measured yet.
    #[error("use the value of `{device}`: it has just been powered up")]
    PoweredUp {
        /// Device that has not measured yet.
        device: DeviceIdentity,
    },
}

/// Maximum number of characters of an invalid text that an error quotes.
const QUOTED_CHARS: usize = 20;

impl SensorChannel {
    /// Returns the current value of the channel, in the quantity's unit. The call blocks until the
    /// device answers, which takes nearly a second on some buses.
    ///
    /// # Errors
    ///
    /// Returns an error if the device is gone or did not answer (some devices fail one time in
    /// five), or if the device reports an invalid or impossible value.
    pub fn read(&self) -> Result<f64, ReadError> {
        let ValueFiles { file, offset, scale, fault, no_values, at_power_up, factor } =
            &self.reading;
        let value = number(file)?;
        // The fault is read after the value, so that a fault that occurs meanwhile is detected.
        if let Some(fault) = fault.as_deref().filter(|fault| fault.exists())
            && number(fault)? != 0.0
        {
            return Err(ReadError::Fault { device: self.device.clone() });
        }
        if at_power_up.is_some_and(|marker| marker == value) {
            return Err(ReadError::PoweredUp { device: self.device.clone() });
        }
        let is_none = no_values.iter().any(|(from, to)| (*from..=*to).contains(&value));
        let offset = offset.as_deref().map_or(Ok(0.0), number)?;
        let scale = scale.as_deref().map_or(Ok(1.0), number)?;
        let value = (value + offset) * scale * factor;
        if is_none || !self.quantity.can_be(value) {
            return Err(ReadError::Impossible { device: self.device.clone(), value });
        }
        Ok(value)
    }

    /// Whether the file with the channel's value exists, which means that the device is present.
    pub fn is_present(&self) -> bool {
        self.reading.file.exists()
    }

    pub(crate) fn place(&self) -> (&DeviceIdentity, &str) {
        (&self.device, &self.name)
    }
}

fn number(file: &Path) -> Result<f64, ReadError> {
    let text = std::fs::read_to_string(file)
        .map_err(|source| ReadError::File { file: file.to_owned(), source })?;
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| {
        let text = text.trim().chars().take(QUOTED_CHARS).collect();
        ReadError::NoNumber { file: file.to_owned(), text }
    })
}
