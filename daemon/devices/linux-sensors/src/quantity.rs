//! Quantities that sensors measure, and their units.

use std::fmt;

use serde::Serialize;

/// Quantity that a sensor measures, with one unit for all subsystems of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SysfsQuantity {
    /// Temperature, in degrees Celsius.
    Temperature,
    /// Relative humidity, in per cent.
    Humidity,
    /// Carbon dioxide, in parts per million.
    Co2,
    /// Illuminance, in lux.
    Light,
    /// Distance to the nearest object, in meters.
    Distance,
}

impl SysfsQuantity {
    /// All quantities that sensors can measure.
    pub const ALL: [SysfsQuantity; 5] = [
        SysfsQuantity::Temperature,
        SysfsQuantity::Humidity,
        SysfsQuantity::Co2,
        SysfsQuantity::Light,
        SysfsQuantity::Distance,
    ];

    /// Returns the name of the quantity in ecosystem files.
    pub fn name(self) -> &'static str {
        match self {
            SysfsQuantity::Temperature => "temperature",
            SysfsQuantity::Humidity => "humidity",
            SysfsQuantity::Co2 => "co2",
            SysfsQuantity::Light => "light",
            SysfsQuantity::Distance => "distance",
        }
    }

    /// Returns the quantity with this name; `None` if there is none.
    pub fn named(name: &str) -> Option<SysfsQuantity> {
        SysfsQuantity::ALL.into_iter().find(|quantity| quantity.name() == name)
    }

    /// Whether `value`, in the unit of this quantity, is physically possible.
    pub(crate) fn can_be(self, value: f64) -> bool {
        match self {
            SysfsQuantity::Temperature => value >= -273.15,
            // Some chips report a little more than 100.
            SysfsQuantity::Humidity => (-1.0..=110.0).contains(&value),
            SysfsQuantity::Co2 | SysfsQuantity::Light | SysfsQuantity::Distance => value >= 0.0,
        }
    }

    /// Returns the symbol of the quantity's unit, from SenML (RFC 8428 and RFC 8798, and IANA's
    /// registry of units for SenML).
    pub fn unit(self) -> &'static str {
        match self {
            SysfsQuantity::Temperature => "Cel",
            SysfsQuantity::Humidity => "%RH",
            SysfsQuantity::Co2 => "ppm",
            SysfsQuantity::Light => "lx",
            SysfsQuantity::Distance => "m",
        }
    }
}

impl fmt::Display for SysfsQuantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
