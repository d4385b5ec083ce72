//! Quantities and their units.

use std::fmt;

use serde::Serialize;

/// Quantity that is measured, with one unit for all sources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Quantity {
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

impl Quantity {
    /// All quantities.
    pub const ALL: [Quantity; 5] = [
        Quantity::Temperature,
        Quantity::Humidity,
        Quantity::Co2,
        Quantity::Light,
        Quantity::Distance,
    ];

    /// Returns the name as in ecosystem files.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Temperature => "temperature",
            Quantity::Humidity => "humidity",
            Quantity::Co2 => "co2",
            Quantity::Light => "light",
            Quantity::Distance => "distance",
        }
    }

    /// Returns the quantity of this name, or `None` if there is none.
    pub fn named(name: &str) -> Option<Quantity> {
        Quantity::ALL.into_iter().find(|quantity| quantity.name() == name)
    }

    /// Whether the value is physically possible, in its unit.
    pub(crate) fn can_be(self, value: f64) -> bool {
        match self {
            Quantity::Temperature => value >= -273.15,
            // Some chips report a little more than 100.
            Quantity::Humidity => (-1.0..=110.0).contains(&value),
            Quantity::Co2 | Quantity::Light | Quantity::Distance => value >= 0.0,
        }
    }

    /// Returns the symbol of its unit, from SenML (RFC 8428 and RFC 8798, and IANA's registry of them).
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::Temperature => "Cel",
            Quantity::Humidity => "%RH",
            Quantity::Co2 => "ppm",
            Quantity::Light => "lx",
            Quantity::Distance => "m",
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
