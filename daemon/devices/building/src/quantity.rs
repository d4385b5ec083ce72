//! The quantities other than temperature that sensors measure. To add a quantity, add a variant to
//! [`Quantity`] and a line to the table `QUANTITIES`.
//!
//! Yes-or-no quantities are numbers as well: 1 is yes, 0 is no.

use serde::{Deserialize, Serialize};

/// A quantity other than temperature, with a value in each location; sensors measure it.
#[derive(Clone, Copy, Debug, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Quantity {
    /// Relative humidity, in %.
    Humidity,
    /// Carbon dioxide, in ppm.
    Co2,
    /// Illuminance, in lx.
    Light,
    /// Whether a person or another warm body moves near the sensor: 1 or 0.
    Motion,
    /// Free distance in front of an IR distance sensor, in m.
    Distance,
    /// Whether an object is directly in front of an IR reflective sensor: 1 or 0.
    Reflection,
    /// Whether the contact of a door or a window is closed: 1 or 0.
    Contact,
}

struct QuantityRow {
    quantity: Quantity,
    name: &'static str,
    /// Value in each location for which no value was set: the value of an empty office by day.
    usual: f64,
    min: f64,
    max: f64,
}

/// Name, usual value and bounds of all quantities. The bounds are the extremes that exist, rounded
/// up: for example, those of sunlight or of a storeroom with dry ice.
const QUANTITIES: &[QuantityRow] = &[
    line(Quantity::Humidity, "humidity", 45.0, 0.0, 100.0),
    line(Quantity::Co2, "co2", 420.0, 0.0, 1_000_000.0),
    line(Quantity::Light, "light", 300.0, 0.0, 200_000.0),
    line(Quantity::Motion, "motion", 0.0, 0.0, 1.0),
    line(Quantity::Distance, "distance", 3.0, 0.0, 1_000.0),
    line(Quantity::Reflection, "reflection", 0.0, 0.0, 1.0),
    line(Quantity::Contact, "contact", 0.0, 0.0, 1.0),
];

const fn line(
    quantity: Quantity,
    name: &'static str,
    usual: f64,
    min: f64,
    max: f64,
) -> QuantityRow {
    QuantityRow { quantity, name, usual, min, max }
}

impl Quantity {
    /// Returns all quantities, in the order of the table.
    pub fn all() -> impl Iterator<Item = Quantity> {
        QUANTITIES.iter().map(|line| line.quantity)
    }

    /// Returns the quantity of this name; `None` if there is none.
    pub fn named(name: &str) -> Option<Quantity> {
        QUANTITIES.iter().find(|line| line.name == name).map(|line| line.quantity)
    }

    /// Returns the name of the quantity, as in files and on the socket.
    pub fn name(self) -> &'static str {
        self.line().name
    }

    /// Returns the value of the quantity in a location for which no value was set.
    pub(crate) fn usual(self) -> f64 {
        self.line().usual
    }

    /// Returns the smallest and the largest possible value of the quantity.
    pub(crate) fn bounds(self) -> (f64, f64) {
        (self.line().min, self.line().max)
    }

    fn line(self) -> &'static QuantityRow {
        let line = QUANTITIES.iter().find(|line| line.quantity == self);
        line.expect("invariant: each quantity has its line; a test counts them")
    }
}

#[cfg(test)]
mod tests {
    use super::Quantity;

    #[test]
    fn each_quantity_has_one_line_and_one_spelling() {
        // The match is exhaustive, so that a new variant does not compile until it is added here.
        let count = |quantity| match quantity {
            Quantity::Humidity
            | Quantity::Co2
            | Quantity::Light
            | Quantity::Motion
            | Quantity::Distance
            | Quantity::Reflection
            | Quantity::Contact => 7,
        };
        assert!(Quantity::all().all(|quantity| count(quantity) == Quantity::all().count()));
        for quantity in Quantity::all() {
            let json = serde_json::to_string(&quantity).unwrap();
            assert_eq!(json, format!("\"{}\"", quantity.name()));
            assert_eq!(Quantity::named(quantity.name()), Some(quantity));
            let (min, max) = quantity.bounds();
            assert!((min..=max).contains(&quantity.usual()), "{json}");
        }
    }
}
