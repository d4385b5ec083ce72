//! One thing that one device measures, and how to read it.

use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::identity::Identity;
use crate::quantity::Quantity;

/// One thing that a device measures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Channel {
    /// Which device.
    pub device: Identity,
    /// Which of its channels, as the kernel calls it: `temp`, `temp_object`, `humidityrelative`.
    #[serde(rename = "channel")]
    pub name: String,
    /// What it measures.
    pub quantity: Quantity,
    /// Whether it measures the room it is in, as far as the device's name tells. A processor's
    /// thermometer does not.
    pub is_ambient: bool,
    #[serde(skip)]
    pub(crate) reading: Reading,
}

/// From which files a value comes, and what makes it a value in its quantity's unit:
/// `(FILE + offset) * scale * factor`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Reading {
    pub(crate) file: PathBuf,
    pub(crate) offset: Option<PathBuf>,
    pub(crate) scale: Option<PathBuf>,
    /// Says 1 where the value is none: its sensor is not there, or its wire is broken.
    pub(crate) fault: Option<PathBuf>,
    /// Values in the file that a chip says for “no value”, from the first to the second.
    pub(crate) no_values: &'static [(f64, f64)],
    /// What is said by who has just been powered up, and has measured nothing yet.
    pub(crate) at_power_up: Option<f64>,
    pub(crate) factor: f64,
}

/// Why a channel was not read. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file was not read: the device is gone, or its bus failed this time.
    #[error("read `{}`: {source}", .file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file has no number in it.
    #[error("read `{}`: `{text}` is no number", .file.display())]
    NoNumber {
        /// The file.
        file: PathBuf,
        /// Its text, or how it begins.
        text: String,
    },
    /// The device says that its value is none.
    #[error("read `{device}`: it reports a fault of its sensor")]
    Fault {
        /// The device.
        device: Identity,
    },
    /// The device says a number that stands for “no value”, or that cannot be.
    #[error("believe `{device}`, which says {value}: no sensor measures that")]
    Impossible {
        /// The device.
        device: Identity,
        /// What it says, in its quantity's unit.
        value: f64,
    },
    /// The device has been powered up a moment ago.
    #[error("believe `{device}`, which has just been powered up")]
    PoweredUp {
        /// The device.
        device: Identity,
    },
}

/// So much of a text that is no number is told.
const TOLD_CHARS: usize = 20;

impl Channel {
    /// What it measures now, in its quantity's unit. Waits for the device: on some buses nearly a
    /// second.
    ///
    /// # Errors
    ///
    /// If the device is gone or did not answer, which some do not one time in five.
    pub fn read(&self) -> Result<f64, ReadError> {
        let Reading { file, offset, scale, fault, no_values, at_power_up, factor } = &self.reading;
        let value = number(file)?;
        // Looked at after the value: what broke meanwhile is broken.
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

    /// Whether its file is there, which it is as long as the device is.
    pub fn is_there(&self) -> bool {
        self.reading.file.exists()
    }

    pub(crate) fn place(&self) -> (&Identity, &str) {
        (&self.device, &self.name)
    }
}

fn number(file: &Path) -> Result<f64, ReadError> {
    let text = std::fs::read_to_string(file)
        .map_err(|source| ReadError::File { file: file.to_owned(), source })?;
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| {
        let text = text.trim().chars().take(TOLD_CHARS).collect();
        ReadError::NoNumber { file: file.to_owned(), text }
    })
}
