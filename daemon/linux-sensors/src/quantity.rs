//! What is measured, and in what: one table.

use std::fmt;

use serde::Serialize;

/// A kind of quantity, in one unit whatever the kernel says it in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Quantity {
    /// In degrees Celsius.
    Temperature,
    /// Relative, in per cent.
    Humidity,
    /// Carbon dioxide, in parts per million.
    Co2,
    /// Illuminance, in lux.
    Light,
    /// To what is nearest, in meters.
    Distance,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Quantity; 5] = [
        Quantity::Temperature,
        Quantity::Humidity,
        Quantity::Co2,
        Quantity::Light,
        Quantity::Distance,
    ];

    /// Its name, as in ecosystem files.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Temperature => "temperature",
            Quantity::Humidity => "humidity",
            Quantity::Co2 => "co2",
            Quantity::Light => "light",
            Quantity::Distance => "distance",
        }
    }

    /// The quantity of this name.
    pub fn named(name: &str) -> Option<Quantity> {
        Quantity::ALL.into_iter().find(|quantity| quantity.name() == name)
    }

    /// Whether there can be such a value, in its unit.
    pub(crate) fn can_be(self, value: f64) -> bool {
        match self {
            Quantity::Temperature => value >= -273.15,
            // Chips measure a little above a hundred.
            Quantity::Humidity => (-1.0..=110.0).contains(&value),
            Quantity::Co2 | Quantity::Light | Quantity::Distance => value >= 0.0,
        }
    }

    /// The symbol of its unit: SenML's (RFC 8428 and RFC 8798, and IANA's registry of them).
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
