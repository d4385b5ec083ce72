//! The colors of lamps that goals can name. A lamp is set to a color by its numbers, and the numbers
//! that it reports are the named color with the nearest hue.

use serde_json::{Value, json};

/// A color with a name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NamedColor {
    pub(crate) name: &'static str,
    /// Hue, in degrees. The saturation of a named color is full.
    pub(crate) hue: f64,
}

/// The colors with names. White is a color temperature, and no color.
pub(crate) const COLORS: [NamedColor; 8] = [
    NamedColor { name: "red", hue: 0.0 },
    NamedColor { name: "orange", hue: 30.0 },
    NamedColor { name: "yellow", hue: 60.0 },
    NamedColor { name: "green", hue: 120.0 },
    NamedColor { name: "cyan", hue: 180.0 },
    NamedColor { name: "blue", hue: 240.0 },
    NamedColor { name: "purple", hue: 280.0 },
    NamedColor { name: "pink", hue: 330.0 },
];

/// Name of all other colors, which is no option.
pub(crate) const OTHER: &str = "another color";

/// Distance of the hue of a lamp from that of a named color, in degrees, up to which the lamp has
/// this color: less than half of the distance between two colors.
const HUE_TOLERANCE: f64 = 14.0;

/// Least saturation of a color, in percent; a light with less is white.
const SATURATION_MIN: f64 = 50.0;

impl NamedColor {
    /// Returns the amounts of red, green and blue, from 0 to 255.
    pub(crate) fn rgb(self) -> [u8; 3] {
        let part = |offset: f64| {
            let k = (offset + self.hue / 60.0) % 6.0;
            let share = 1.0 - k.min(4.0 - k).clamp(0.0, 1.0);
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "the share is between 0 and 1"
            )]
            let amount = (share * 255.0).round() as u8;
            amount
        };
        [part(5.0), part(3.0), part(1.0)]
    }

    /// Returns the chromaticity, as the two coordinates of CIE 1931.
    pub(crate) fn xy(self) -> (f64, f64) {
        let [red, green, blue] = self.rgb().map(|part| linear(f64::from(part) / 255.0));
        let x = 0.4124 * red + 0.3576 * green + 0.1805 * blue;
        let y = 0.2126 * red + 0.7152 * green + 0.0722 * blue;
        let z = 0.0193 * red + 0.1192 * green + 0.9505 * blue;
        let rounded = |part: f64| (part / (x + y + z) * 1e4).round() / 1e4;
        (rounded(x), rounded(y))
    }

    /// Returns the color as hexadecimal digits: `#FF0000`.
    pub(crate) fn hex(self) -> String {
        let [red, green, blue] = self.rgb();
        format!("#{red:02X}{green:02X}{blue:02X}")
    }

    /// Returns the color as a JSON object of the given kind: `rgb`, `hs` or `xy`.
    pub(crate) fn json(self, kind: &str) -> Value {
        let [red, green, blue] = self.rgb();
        let (x, y) = self.xy();
        match kind {
            "hs" => json!({ "h": self.hue, "s": 100.0 }),
            "xy" => json!({ "x": x, "y": y }),
            _ => json!({ "r": red, "g": green, "b": blue }),
        }
    }
}

/// Returns the name of the color that a lamp reports: as an object with `x` and `y`, `r`, `g` and
/// `b`, or a hue and a saturation, or as a text with a hue, a saturation and perhaps a brightness.
/// Returns `None` if the value is no color.
pub(crate) fn name_of_color(value: &Value) -> Option<&'static str> {
    let number = |keys: &[&str]| keys.iter().find_map(|key| value.get(*key)?.as_f64());
    let (hue, saturation) = match value {
        Value::String(text) => {
            let mut parts = text.split(',').map(|part| part.trim().parse::<f64>().ok());
            (parts.next()??, parts.next()??)
        }
        Value::Object(_) => match (number(&["hue", "h"]), number(&["saturation", "s"])) {
            (Some(hue), Some(saturation)) => (hue, saturation),
            _ => {
                let parts = [number(&["r"]), number(&["g"]), number(&["b"])];
                let parts = match parts {
                    [Some(red), Some(green), Some(blue)] => [red, green, blue],
                    _ => rgb_of_xy(number(&["x"])?, number(&["y"])?),
                };
                hue_and_saturation(parts)
            }
        },
        _ => return None,
    };
    if !hue.is_finite() || !saturation.is_finite() {
        return None;
    }
    let distance = |color: &NamedColor| {
        let apart = (color.hue - hue).rem_euclid(360.0);
        apart.min(360.0 - apart)
    };
    let near = COLORS.iter().find(|color| distance(color) <= HUE_TOLERANCE);
    let near = near.filter(|_| saturation >= SATURATION_MIN);
    Some(near.map_or(OTHER, |color| color.name))
}

/// Returns the linear amount for one part of an sRGB color.
fn linear(part: f64) -> f64 {
    if part <= 0.04045 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
}

/// Returns the amounts of red, green and blue for a chromaticity, the greatest of which is 1.
fn rgb_of_xy(x: f64, y: f64) -> [f64; 3] {
    let (big_x, big_z) = (x / y, (1.0 - x - y) / y);
    let linear = [
        3.2406 * big_x - 1.5372 - 0.4986 * big_z,
        -0.9689 * big_x + 1.8758 + 0.0415 * big_z,
        0.0557 * big_x - 0.2040 + 1.0570 * big_z,
    ];
    let most = linear.into_iter().fold(0.0, f64::max);
    linear.map(|part| {
        let part = (part / most).max(0.0);
        if part <= 0.003_130_8 { part * 12.92 } else { 1.055 * part.powf(1.0 / 2.4) - 0.055 }
    })
}

fn hue_and_saturation([red, green, blue]: [f64; 3]) -> (f64, f64) {
    let most = red.max(green).max(blue);
    let range = most - red.min(green).min(blue);
    let sector = match most {
        _ if range == 0.0 => 0.0,
        most if most == red => (green - blue) / range,
        most if most == green => 2.0 + (blue - red) / range,
        _ => 4.0 + (red - green) / range,
    };
    (sector * 60.0, range / most * 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_color_is_recognised_in_every_form() {
        for color in COLORS {
            let [red, green, blue] = color.rgb();
            let (x, y) = color.xy();
            for value in [
                json!({ "x": x, "y": y }),
                json!({ "r": red, "g": green, "b": blue }),
                json!({ "hue": color.hue, "saturation": 100 }),
                json!({ "h": color.hue - 5.0, "s": 90 }),
                json!(format!("{},100,40", color.hue)),
            ] {
                assert_eq!(name_of_color(&value), Some(color.name), "{value}");
            }
        }
        assert_eq!(COLORS.map(NamedColor::hex)[..3], ["#FF0000", "#FF8000", "#FFFF00"]);
        // The red of a Hue lamp, which cannot show that of sRGB.
        assert_eq!(name_of_color(&json!({ "x": 0.6942, "y": 0.2963 })), Some("red"));
    }

    #[test]
    fn white_and_garbage_are_no_named_colors() {
        for white in [json!({ "x": 0.3227, "y": 0.329 }), json!({ "h": 30, "s": 20 })] {
            assert_eq!(name_of_color(&white), Some(OTHER), "{white}");
        }
        for garbage in [
            json!({ "x": 0.3, "y": 0 }),
            json!({ "x": 1e308, "y": 1e-308 }),
            json!({ "r": 0, "g": 0, "b": 0 }),
            json!({ "h": "red" }),
            json!("NaN,NaN"),
            json!([1, 2]),
            json!(7),
        ] {
            let named = name_of_color(&garbage);
            assert!(named.is_none() || named == Some(OTHER), "{garbage}: {named:?}");
        }
    }
}
