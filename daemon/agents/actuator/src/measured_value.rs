//! Units of measured values, and the bounds within which a value is possible in its unit. All
//! drivers and gateways use these bounds.

/// Largest absolute value that a measurement may have; a larger one is rejected. Larger numbers
/// have no exact thousandths any more, and no quantity of a room is as large.
const LARGEST: f64 = 1e12;

/// Returns the factor and the offset that convert a value from one unit to another; `None` if the
/// units measure different things.
pub fn unit_conversion(from: &str, to: &str) -> Option<(f64, f64)> {
    match (canonical_unit(from).as_str(), canonical_unit(to).as_str()) {
        (one, other) if one == other => Some((1.0, 0.0)),
        // A missing unit means the usual one.
        ("", _) => Some((1.0, 0.0)),
        ("f", "c") => Some((5.0 / 9.0, -160.0 / 9.0)),
        ("k", "c") => Some((1.0, -273.15)),
        ("c", "f") => Some((1.8, 32.0)),
        ("klx", "lx") => Some((1_000.0, 0.0)),
        ("ppb", "ppm") => Some((0.001, 0.0)),
        ("cm", "m") => Some((0.01, 0.0)),
        ("mm", "m") => Some((0.001, 0.0)),
        ("kw", "w") | ("mwh", "kwh") => Some((1_000.0, 0.0)),
        ("wh", "kwh") => Some((0.001, 0.0)),
        _ => None,
    }
}

/// Returns a value in another unit, rounded so that 68 °F are exactly 20 °C; `None` if the units
/// measure different things.
pub fn converted_value(value: f64, from: &str, to: &str) -> Option<f64> {
    let (factor, offset) = unit_conversion(from, to)?;
    let converted = value * factor + offset;
    let is_same = factor == 1.0 && offset == 0.0;
    Some(if is_same { value } else { (converted * 1e6).round() / 1e6 })
}

/// Returns the canonical spelling of a unit.
fn canonical_unit(unit: &str) -> String {
    let unit = unit.trim().trim_start_matches(['°', 'º']).trim().to_lowercase();
    match unit.as_str() {
        "℃" | "degc" | "cel" | "celsius" => "c",
        "℉" | "degf" | "fahrenheit" => "f",
        "kelvin" => "k",
        "lux" => "lx",
        "%rh" | "% rh" | "rh%" => "%",
        other => other,
    }
    .to_owned()
}

/// Whether a value is possible in its unit. Impossible values occur because chips report special
/// numbers for “no value”.
pub fn is_possible_value(value: f64, unit: &str) -> bool {
    if !value.is_finite() || value.abs() > LARGEST {
        return false;
    }
    match canonical_unit(unit).as_str() {
        // Thermometers that cannot be reached report -127 or -128, those without a probe 999 or
        // 327.67; no room is as hot as 200 °C.
        "c" => value > -127.0 && value <= 200.0,
        "f" => value > -196.0 && value <= 392.0,
        "k" => (0.0..=474.0).contains(&value),
        // A million ppm is the whole.
        "ppm" => (0.0..=1e6).contains(&value),
        "ppb" => (0.0..=1e9).contains(&value),
        // Direct sunlight has a little more than 100,000 lx.
        "lx" => (0.0..=1e6).contains(&value),
        // A luminous flux and a distance are never negative.
        "lm" | "m" => value >= 0.0,
        // Chips may measure a little above 100 %; 255 and 655.35 mean “no value”.
        "%" => (0.0..=110.0).contains(&value),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_values_are_recognised() {
        for (value, unit, expected) in [
            (21.5, "°C", true),
            (-40.0, "°C", true),
            (-127.0, "°C", false),
            (-327.68, "°C", false),
            (f64::NAN, "°C", false),
            (1e305, "°C", false),
            (f64::INFINITY, "hPa", false),
            (-1e305, "hPa", false),
            (1e13, "W", false),
            (1e9, "lx", false),
            (120_000.0, "lx", true),
            (2e6, "ppm", false),
            (999.0, "°C", false),
            (327.67, "°C", false),
            (95.0, "°C", true),
            (700.0, "°F", false),
            (100.4, "%", true),
            (655.35, "%", false),
            (-1.0, "ppm", false),
            (-1.0, "hPa", true),
            (0.26, "m", true),
            (-0.26, "m", false),
        ] {
            assert_eq!(is_possible_value(value, unit), expected, "{value} {unit}");
        }
    }

    #[test]
    fn units_are_converted() {
        for (from, to, value, expected) in [
            ("°F", "°C", 68.0, Some(20.0)),
            ("K", "°C", 293.15, Some(20.0)),
            ("lux", "lx", 12.0, Some(12.0)),
            ("", "ppm", 400.0, Some(400.0)),
            ("hPa", "°C", 1.0, None),
            ("℃", "°C", 20.0, Some(20.0)),
            ("klx", "lx", 1.5, Some(1500.0)),
            ("% RH", "%", 40.0, Some(40.0)),
            ("cm", "m", 26.0, Some(0.26)),
            ("lx", "ppm", 26.0, None),
            ("kW", "W", 1.5, Some(1500.0)),
            ("Wh", "kWh", 1500.0, Some(1.5)),
            ("MWh", "kWh", 1.5, Some(1500.0)),
            ("W", "kWh", 1.0, None),
        ] {
            let converted = converted_value(value, from, to);
            let is_it = match (converted, expected) {
                (Some(one), Some(other)) => f64::abs(one - other) < 1e-9,
                (one, other) => one.is_none() && other.is_none(),
            };
            assert!(is_it, "{from} {to}: {converted:?}");
        }
    }
}
