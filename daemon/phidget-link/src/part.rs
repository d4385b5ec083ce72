//! What can be plugged in, and what it measures: one table.
//!
//! The numbers of analog sensors are the library's (`SENSOR_TYPE_…` of `phidget22.h`); the library
//! knows each one's formula, and the table what is left to do to be in a canonical unit.

use std::fmt;

use crate::ffi::Class;

/// A kind of quantity, in one unit whatever the library says it in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Quantity {
    /// In degrees Celsius.
    Temperature,
    /// Relative, in per cent.
    Humidity,
    /// Illuminance, in lux.
    Light,
    /// To what is nearest, in meters.
    Distance,
    /// Yes or no.
    Motion,
    /// Whether something close by reflects: yes or no.
    Reflection,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Quantity; 6] = [
        Quantity::Temperature,
        Quantity::Humidity,
        Quantity::Light,
        Quantity::Distance,
        Quantity::Motion,
        Quantity::Reflection,
    ];

    /// Its name, as in ecosystem files.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Temperature => "temperature",
            Quantity::Humidity => "humidity",
            Quantity::Light => "light",
            Quantity::Distance => "distance",
            Quantity::Motion => "motion",
            Quantity::Reflection => "reflection",
        }
    }

    /// The quantity of this name.
    pub fn named(name: &str) -> Option<Quantity> {
        Quantity::ALL.into_iter().find(|quantity| quantity.name() == name)
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Something that Phidgets makes, and one quantity that it measures.
#[derive(Debug)]
pub struct Part {
    /// What is printed on it; what measures by itself has none.
    name: Option<&'static str>,
    quantity: Quantity,
    pub(crate) class: Class,
    /// The library's number of it, if it is analog.
    pub(crate) sensor_type: i32,
    value: Value,
}

/// What the library's value is, beside the quantity's unit.
#[derive(Clone, Copy, Debug)]
enum Value {
    Same,
    /// In centimeters, of a length.
    Centimeters,
    /// Between 0 and 1, and nobody but its owner knows of what.
    Unscaled,
    /// Rests at 0 and swings to both sides; so far it does without being a yes.
    Swing(f64),
    /// More than this is a no.
    Near(f64),
}

/// A 1111 swings as far as −1 and 1 while somebody moves, and by a few hundredths at rest. 0.16 is
/// the 0.4 V that the library takes as medium sensitivity for its successor, the MOT2002.
const MOTION: f64 = 0.16;

/// A 1146 says 4 mm, the farthest it sees, by this share of its supply; more is farther.
const FOUR_MILLIMETERS: f64 = 0.536;

/// No type of sensor: the share of its supply that an analog input has.
const PLAIN: i32 = 0;

const DIGITAL: &str = "digital";

use Quantity::{Distance, Humidity, Light, Motion, Reflection, Temperature};

/// All of them.
const PARTS: &[Part] = &[
    itself(Temperature, Class::Temperature),
    itself(Humidity, Class::Humidity),
    itself(Light, Class::Light),
    analog("1125", Temperature, Class::Ratio, 11252, Value::Same),
    analog("1125", Humidity, Class::Ratio, 11251, Value::Same),
    analog("1124", Temperature, Class::Ratio, 11240, Value::Same),
    analog("1107", Humidity, Class::Ratio, 11070, Value::Same),
    // Each of Sharp's sensors has a range of its own: 4 to 30 cm, 10 to 80 cm, 20 to 150 cm.
    analog("1101-2D120X", Distance, Class::Ratio, 11011, Value::Centimeters),
    analog("1101-2Y0A21", Distance, Class::Ratio, 11012, Value::Centimeters),
    analog("1101-2Y0A02", Distance, Class::Ratio, 11013, Value::Centimeters),
    analog("1102", Reflection, Class::Ratio, 11020, Value::Same),
    analog("1103", Reflection, Class::Ratio, 11030, Value::Same),
    // The library has millimeters of it, and no value beyond 4: that nothing is there is a value too.
    analog("1146", Reflection, Class::Ratio, PLAIN, Value::Near(FOUR_MILLIMETERS)),
    analog("1111", Motion, Class::Ratio, 11110, Value::Swing(MOTION)),
    analog("1127", Light, Class::Voltage, 11270, Value::Same),
    analog("1142", Light, Class::Voltage, 11420, Value::Same),
    analog("1143", Light, Class::Voltage, 11430, Value::Same),
    analog("1105", Light, Class::Ratio, 11050, Value::Unscaled),
    analog(DIGITAL, Motion, Class::Digital, PLAIN, Value::Same),
    analog(DIGITAL, Reflection, Class::Digital, PLAIN, Value::Same),
];

const fn itself(quantity: Quantity, class: Class) -> Part {
    Part { name: None, quantity, class, sensor_type: PLAIN, value: Value::Same }
}

const fn analog(
    name: &'static str,
    quantity: Quantity,
    class: Class,
    sensor_type: i32,
    value: Value,
) -> Part {
    Part { name: Some(name), quantity, class, sensor_type, value }
}

impl Part {
    /// What measures this: the part of this name, or without one a Phidget that does so by itself.
    ///
    /// # Errors
    ///
    /// If there is none, with what would be right.
    pub fn find(name: Option<&str>, quantity: Quantity) -> Result<&'static Part, String> {
        let is_it = |part: &&Part| match (part.name, name) {
            (Some(part), Some(name)) => part.eq_ignore_ascii_case(name),
            (part, name) => part.is_none() && name.is_none(),
        };
        let found = PARTS.iter().find(|part| part.quantity == quantity && is_it(part));
        found.ok_or_else(|| {
            let right = fitting(|part| part.quantity == quantity);
            let Some(name) = name else {
                return format!("no Phidget measures the {quantity} by itself: write {right}");
            };
            let measured: Vec<_> =
                { PARTS.iter().filter(is_it) }.map(|part| part.quantity.name()).collect();
            let is_kin = |part: &Part| part.is_kind_of(name) && part.quantity == quantity;
            if !measured.is_empty() {
                let measured = measured.join(" and ");
                return format!("a `{name}` measures {measured}, and no {quantity}: write {right}");
            }
            match fitting(is_kin).as_str() {
                "" => format!("there is no sensor `{name}` for {quantity}: write {right}"),
                kin => format!("there are several `{name}`: write {kin}"),
            }
        })
    }

    /// Whether its number is `number`, whatever hangs on it.
    fn is_kind_of(&self, number: &str) -> bool {
        let rest = self.name.and_then(|name| name.strip_prefix(number));
        rest.is_some_and(|rest| rest.starts_with('-'))
    }

    /// Whether it is read by an input of an interface kit or a hub, and is no Phidget itself.
    pub fn needs_input(&self) -> bool {
        self.name.is_some()
    }

    /// Whether a cable carries only one of the quantities that it measures.
    pub fn has_cables(&self) -> bool {
        let same = |part: &&Part| part.name == self.name && part.class == Class::Ratio;
        PARTS.iter().filter(same).count() > 1
    }

    /// Whether only its owner knows how much its 1 is.
    pub fn is_unscaled(&self) -> bool {
        matches!(self.value, Value::Unscaled)
    }

    /// Whether it swings: between two yes there are no.
    pub fn swings(&self) -> bool {
        matches!(self.value, Value::Swing(_))
    }

    /// The library's value in the quantity's unit.
    pub(crate) fn canonical(&self, value: f64) -> f64 {
        match self.value {
            Value::Same | Value::Unscaled => value,
            Value::Centimeters => value / 100.0,
            Value::Swing(yes) => f64::from(value.abs() >= yes),
            Value::Near(no) => f64::from(value <= no),
        }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name {
            None => write!(f, "a Phidget that measures the {}", self.quantity),
            Some(DIGITAL) => write!(f, "a digital input"),
            Some(name) => write!(f, "a {name}"),
        }
    }
}

/// What an entry may write, of those that fit.
fn fitting(fits: impl Fn(&Part) -> bool) -> String {
    let parts: Vec<_> = PARTS
        .iter()
        .filter(|part| fits(part))
        .map(|part| match part.name {
            Some(name) => format!("`sensor = \"{name}\"`"),
            None => "no `sensor`, for a Phidget of its own".to_owned(),
        })
        .collect();
    parts.join(" or ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_become_canonical() {
        for (name, quantity, value, expected) in [
            (None, Temperature, 21.5, 21.5),
            (Some("1125"), Humidity, 40.0, 40.0),
            (Some("1101-2y0a21"), Distance, 25.5, 0.255),
            (Some("1111"), Motion, 0.02, 0.0),
            (Some("1111"), Motion, -0.5, 1.0),
            (Some("1111"), Motion, 0.5, 1.0),
            (Some("1146"), Reflection, 0.2, 1.0),
            (Some("1146"), Reflection, 0.9, 0.0),
            (Some("1102"), Reflection, 1.0, 1.0),
        ] {
            let part = Part::find(name, quantity).expect("a part");
            assert!((part.canonical(value) - expected).abs() < 1e-9, "{part} {value}");
        }
    }

    #[test]
    fn a_wrong_pair_is_told_with_what_would_be_right() {
        for (name, quantity, expected) in [
            (
                Some("1111"),
                Temperature,
                "a `1111` measures motion, and no temperature: write no `sensor`, for a Phidget of \
                 its own or `sensor = \"1125\"` or `sensor = \"1124\"`",
            ),
            (
                Some("1125"),
                Motion,
                "a `1125` measures temperature and humidity, and no motion: write \
                 `sensor = \"1111\"` or `sensor = \"digital\"`",
            ),
            (
                Some("1101"),
                Distance,
                "there are several `1101`: write `sensor = \"1101-2D120X\"` or \
                 `sensor = \"1101-2Y0A21\"` or `sensor = \"1101-2Y0A02\"`",
            ),
            (
                Some("9999"),
                Motion,
                "there is no sensor `9999` for motion: write `sensor = \"1111\"` or \
                 `sensor = \"digital\"`",
            ),
            (
                None,
                Motion,
                "no Phidget measures the motion by itself: write `sensor = \"1111\"` or \
                 `sensor = \"digital\"`",
            ),
        ] {
            assert_eq!(Part::find(name, quantity).err().as_deref(), Some(expected));
        }
    }

    #[test]
    fn every_quantity_has_parts() {
        for quantity in Quantity::ALL {
            assert!(PARTS.iter().any(|part| part.quantity == quantity), "{quantity}");
            assert_eq!(Quantity::named(quantity.name()), Some(quantity));
        }
    }
}
