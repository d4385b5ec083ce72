//! Table of the sensors that this crate can read, and of the quantities that they measure.
//!
//! Types of analog sensors are numbers of the library (`SENSOR_TYPE_…` of `phidget22.h`). The
//! library contains the formula of each type; the table has the conversion from the library's value
//! to a canonical unit.

use std::fmt;

use crate::ffi::ChannelClass;

/// Quantity that a part measures, with one unit for all parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PhidgetQuantity {
    /// Temperature, in degrees Celsius.
    Temperature,
    /// Relative humidity, in per cent.
    Humidity,
    /// Illuminance, in lux.
    Light,
    /// Distance to the nearest object, in meters.
    Distance,
    /// Motion: 1 if there is motion, 0 if there is none.
    Motion,
    /// Reflection: 1 if a nearby object reflects, 0 if none does.
    Reflection,
}

impl PhidgetQuantity {
    /// All quantities that the parts of the table measure.
    pub const ALL: [PhidgetQuantity; 6] = [
        PhidgetQuantity::Temperature,
        PhidgetQuantity::Humidity,
        PhidgetQuantity::Light,
        PhidgetQuantity::Distance,
        PhidgetQuantity::Motion,
        PhidgetQuantity::Reflection,
    ];

    /// Returns the name of the quantity in ecosystem files.
    pub fn name(self) -> &'static str {
        match self {
            PhidgetQuantity::Temperature => "temperature",
            PhidgetQuantity::Humidity => "humidity",
            PhidgetQuantity::Light => "light",
            PhidgetQuantity::Distance => "distance",
            PhidgetQuantity::Motion => "motion",
            PhidgetQuantity::Reflection => "reflection",
        }
    }

    /// Returns the quantity with this name; `None` if there is none.
    pub fn named(name: &str) -> Option<PhidgetQuantity> {
        PhidgetQuantity::ALL.into_iter().find(|quantity| quantity.name() == name)
    }
}

impl fmt::Display for PhidgetQuantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// One quantity that a product of Phidgets Inc. measures.
#[derive(Debug)]
pub struct PhidgetPart {
    /// Number printed on the product; `None` for a Phidget that measures without an input.
    name: Option<&'static str>,
    quantity: PhidgetQuantity,
    pub(crate) class: ChannelClass,
    /// Number of the sensor's type in the library; [`PLAIN`] if the product is not an analog
    /// sensor.
    pub(crate) sensor_type: i32,
    value: ValueConversion,
}

/// Conversion of the library's value to the unit of the quantity.
#[derive(Clone, Copy, Debug)]
enum ValueConversion {
    Same,
    /// The library's value is a length in centimeters.
    Centimeters,
    /// The library's value is between 0 and 1, and has no known unit.
    Unscaled,
    /// The library's value is around 0 at rest, and swings to both sides during motion. An absolute
    /// value of at least this threshold means motion.
    Swing(f64),
    /// The library's value is small while an object is near. A value up to this threshold means
    /// that an object is near; a greater value means that there is none.
    Near(f64),
}

/// Threshold for the motion sensor 1111. Its value swings up to −1 and 1 during motion, and by a
/// few hundredths at rest. 0.16 corresponds to the 0.4 V that the library uses as medium
/// sensitivity for the successor, the MOT2002.
const MOTION: f64 = 0.16;

/// Value of the reflection sensor 1146, as a share of its supply voltage, for an object at 4 mm.
/// This is the greatest distance at which the sensor detects an object. Greater values mean a
/// greater distance.
const FOUR_MILLIMETERS: f64 = 0.536;

/// Value of `sensor_type` for a part without a sensor type. The value of such a part is the share
/// of the supply voltage at the analog input.
const PLAIN: i32 = 0;

const DIGITAL: &str = "digital";

use PhidgetQuantity::{Distance, Humidity, Light, Motion, Reflection, Temperature};

/// Table of all parts, one entry for each part and quantity.
const PARTS: &[PhidgetPart] = &[
    itself(Temperature, ChannelClass::Temperature),
    itself(Humidity, ChannelClass::Humidity),
    itself(Light, ChannelClass::Light),
    analog("1125", Temperature, ChannelClass::Ratio, 11252, ValueConversion::Same),
    analog("1125", Humidity, ChannelClass::Ratio, 11251, ValueConversion::Same),
    analog("1124", Temperature, ChannelClass::Ratio, 11240, ValueConversion::Same),
    analog("1107", Humidity, ChannelClass::Ratio, 11070, ValueConversion::Same),
    // The ranges of Sharp's sensors are 4 to 30 cm, 10 to 80 cm, and 20 to 150 cm.
    analog("1101-2D120X", Distance, ChannelClass::Ratio, 11011, ValueConversion::Centimeters),
    analog("1101-2Y0A21", Distance, ChannelClass::Ratio, 11012, ValueConversion::Centimeters),
    analog("1101-2Y0A02", Distance, ChannelClass::Ratio, 11013, ValueConversion::Centimeters),
    analog("1102", Reflection, ChannelClass::Ratio, 11020, ValueConversion::Same),
    analog("1103", Reflection, ChannelClass::Ratio, 11030, ValueConversion::Same),
    // The library converts the value to millimeters, and has no value beyond 4 mm. Here “no object
    // near” must be a value as well, so the plain value is read.
    analog("1146", Reflection, ChannelClass::Ratio, PLAIN, ValueConversion::Near(FOUR_MILLIMETERS)),
    analog("1111", Motion, ChannelClass::Ratio, 11110, ValueConversion::Swing(MOTION)),
    analog("1127", Light, ChannelClass::Voltage, 11270, ValueConversion::Same),
    analog("1142", Light, ChannelClass::Voltage, 11420, ValueConversion::Same),
    analog("1143", Light, ChannelClass::Voltage, 11430, ValueConversion::Same),
    analog("1105", Light, ChannelClass::Ratio, 11050, ValueConversion::Unscaled),
    analog(DIGITAL, Motion, ChannelClass::Digital, PLAIN, ValueConversion::Same),
    analog(DIGITAL, Reflection, ChannelClass::Digital, PLAIN, ValueConversion::Same),
];

const fn itself(quantity: PhidgetQuantity, class: ChannelClass) -> PhidgetPart {
    PhidgetPart { name: None, quantity, class, sensor_type: PLAIN, value: ValueConversion::Same }
}

const fn analog(
    name: &'static str,
    quantity: PhidgetQuantity,
    class: ChannelClass,
    sensor_type: i32,
    value: ValueConversion,
) -> PhidgetPart {
    PhidgetPart { name: Some(name), quantity, class, sensor_type, value }
}

impl PhidgetPart {
    /// Returns the part with this name that measures the quantity. Without a name, returns the
    /// Phidget that measures the quantity without an input.
    ///
    /// # Errors
    ///
    /// Returns an error with the possible names if there is no such part.
    pub fn find(
        name: Option<&str>,
        quantity: PhidgetQuantity,
    ) -> Result<&'static PhidgetPart, String> {
        let is_it = |part: &&PhidgetPart| match (part.name, name) {
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
            let is_kin = |part: &PhidgetPart| part.is_kind_of(name) && part.quantity == quantity;
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

    /// Whether the part's name is `number` followed by `-` and a suffix. The suffix names the
    /// sensor on the part.
    fn is_kind_of(&self, number: &str) -> bool {
        let rest = self.name.and_then(|name| name.strip_prefix(number));
        rest.is_some_and(|rest| rest.starts_with('-'))
    }

    /// Whether the part is read through an input of an interface kit or a hub, because it is not a
    /// Phidget itself.
    pub fn needs_input(&self) -> bool {
        self.name.is_some()
    }

    /// Whether the part measures several quantities, with a separate cable for each.
    pub fn has_cables(&self) -> bool {
        let same =
            |part: &&PhidgetPart| part.name == self.name && part.class == ChannelClass::Ratio;
        PARTS.iter().filter(same).count() > 1
    }

    /// Whether the unit of the part's value is unknown. Then the user has to state the meaning of
    /// the value 1.
    pub fn is_unscaled(&self) -> bool {
        matches!(self.value, ValueConversion::Unscaled)
    }

    /// Whether the part's value swings during motion, so that single readings may be below the
    /// threshold.
    pub fn swings(&self) -> bool {
        matches!(self.value, ValueConversion::Swing(_))
    }

    /// Converts the library's value for the part to the unit of the quantity.
    pub(crate) fn canonical(&self, value: f64) -> f64 {
        match self.value {
            ValueConversion::Same | ValueConversion::Unscaled => value,
            ValueConversion::Centimeters => value / 100.0,
            ValueConversion::Swing(yes) => f64::from(value.abs() >= yes),
            ValueConversion::Near(no) => f64::from(value <= no),
        }
    }
}

impl fmt::Display for PhidgetPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name {
            None => write!(f, "a Phidget that measures the {}", self.quantity),
            Some(DIGITAL) => write!(f, "a digital input"),
            Some(name) => write!(f, "a {name}"),
        }
    }
}

/// Returns the possible settings `sensor` of an entry in an ecosystem file, for the parts that
/// `fits` accepts.
fn fitting(fits: impl Fn(&PhidgetPart) -> bool) -> String {
    let parts: Vec<_> = PARTS
        .iter()
        .filter(|part| fits(part))
        .map(|part| match part.name {
            Some(name) => format!("`sensor = \"{name}\"`"),
            None => "no `sensor` (a Phidget that measures by itself)".to_owned(),
        })
        .collect();
    parts.join(" or ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_converted_to_canonical_units() {
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
            let part = PhidgetPart::find(name, quantity).expect("a part");
            assert!((part.canonical(value) - expected).abs() < 1e-9, "{part} {value}");
        }
    }

    #[test]
    fn a_wrong_pair_of_part_and_quantity_is_refused_with_a_correction() {
        for (name, quantity, expected) in [
            (
                Some("1111"),
                Temperature,
                "a `1111` measures motion, and no temperature: write no `sensor` (a Phidget \
                 that measures by itself) or `sensor = \"1125\"` or `sensor = \"1124\"`",
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
            assert_eq!(PhidgetPart::find(name, quantity).err().as_deref(), Some(expected));
        }
    }

    #[test]
    fn every_quantity_has_parts() {
        for quantity in PhidgetQuantity::ALL {
            assert!(PARTS.iter().any(|part| part.quantity == quantity), "{quantity}");
            assert_eq!(PhidgetQuantity::named(quantity.name()), Some(quantity));
        }
    }
}
