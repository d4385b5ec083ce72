//! A channel: one quantity that one device measures, and how it is read.

use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::identity::DeviceIdentity;
use crate::quantity::SysfsQuantity;

/// One quantity that a device measures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorChannel {
    /// The device.
    pub device: DeviceIdentity,
    /// Name of the channel as in the kernel: `temp`, `temp_object`, `humidityrelative`.
    #[serde(rename = "channel")]
    pub name: String,
    /// Quantity that it measures.
    pub quantity: SysfsQuantity,
    /// Whether it measures the room, judged by the device's name. A processor's thermometer does not.
    pub is_ambient: bool,
    #[serde(skip)]
    pub(crate) reading: ValueFiles,
}

/// Files of a value, and its conversion to the quantity's unit: `(FILE + offset) * scale * factor`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ValueFiles {
    pub(crate) file: PathBuf,
    pub(crate) offset: Option<PathBuf>,
    pub(crate) scale: Option<PathBuf>,
    /// File with a number other than 0 if the value is invalid: the sensor is missing or its wire is
    /// broken.
    pub(crate) fault: Option<PathBuf>,
    /// Ranges of values in the file that mean “no value”, both ends included.
    pub(crate) no_values: &'static [(f64, f64)],
    /// Value in the file after power-up, before the first measurement.
    pub(crate) at_power_up: Option<f64>,
    pub(crate) factor: f64,
}

/// Reason why a channel was not read. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file could not be read: the device is gone, or its bus failed this time.
    #[error("read `{}`: {source}", .file.display())]
    File {
        /// Path of the file.
        file: PathBuf,
        /// The error.
        source: io::Error,
    },
    /// The file does not contain a number.
    #[error("read `{}`: `{text}` is no number", .file.display())]
    NoNumber {
        /// Path of the file.
        file: PathBuf,
        /// Its text, or the beginning of it.
        text: String,
    },
    /// The device reports that its value is invalid.
    #[error("read `{device}`: it reports a fault of its sensor")]
    Fault {
        /// The device.
        device: DeviceIdentity,
    },
    /// The device reports a number that means “no value”, or that is impossible.
    #[error("use {value}, the value of `{device}`: no sensor measures that")]
    Impossible {
        /// The device.
        device: DeviceIdentity,
        /// The value, in the quantity's unit.
        value: f64,
    },
    /// The device was powered up, and has not measured yet.
    #[error("use the value of `{device}`: it has just been powered up")]
    PoweredUp {
        /// The device.
        device: DeviceIdentity,
    },
}

/// Characters of a text without a number that an error shows.
const QUOTED_CHARS: usize = 20;

impl SensorChannel {
    /// Returns the current value, in the quantity's unit. Waits for the device: on some buses nearly a
    /// second.
    ///
    /// # Errors
    ///
    /// Returns an error if the device is gone or did not answer (some fail one time in five), or if it
    /// reports an invalid or impossible value.
    pub fn read(&self) -> Result<f64, ReadError> {
        let ValueFiles { file, offset, scale, fault, no_values, at_power_up, factor } =
            &self.reading;
        let value = number(file)?;
        // Checked after the value, so that a fault that occurs meanwhile is noticed.
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

    /// Whether its file exists, which it does as long as the device is present.
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
