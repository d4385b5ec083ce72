//! Extracts values from the texts of programs and devices.

use actuator::converted_value;
use serde_json::Value;

use crate::quantity::SensorQuantity;

type JsonObject = serde_json::Map<String, Value>;

/// Maximum number of characters that are quoted of a text without a valid value.
const QUOTED_CHARS: usize = 60;

/// Texts that mean yes, and texts that mean no.
const YES: [&str; 5] = ["true", "yes", "on", "open", "detected"];
const NO: [&str; 5] = ["false", "no", "off", "closed", "clear"];

/// Further names of each quantity in the messages of devices (Zigbee2MQTT, Tasmota and others).
const ALIASES: &[(&str, &[&str])] = &[
    // If both are present, `illuminance` is a raw value (Zigbee2MQTT 1.x).
    ("light", &["illuminance_lux", "illuminance"]),
    ("motion", &["occupancy", "presence"]),
    ("humidity", &["relative_humidity"]),
    ("co2", &["carbon_dioxide"]),
];

/// Prefixes of the names of chips in a Tasmota device that measure the device itself instead of the
/// room.
const CHIPS: &[&str] = &["ESP32", "ENERGY", "AXP", "MPU", "BL09", "Shelly"];

/// Format of the values of a sensor in texts.
#[derive(Clone, Debug, Default)]
pub(crate) struct TextFormat {
    /// JSON pointer (RFC 6901) to the value in a JSON text; `None` to search for the value by its
    /// name.
    pub(crate) pointer: Option<String>,
    /// Unit of numbers without a unit in their text; `None` for the unit of the quantity.
    pub(crate) unit: Option<String>,
    /// Factor that converts numbers to the unit of the quantity, regardless of the unit in their
    /// text.
    pub(crate) factor: Option<f64>,
}

/// A value in a text, before its interpretation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FoundValue {
    /// The value as it is written in the text.
    pub(crate) word: String,
    /// Unit beside the value in the text; `None` if there is none.
    pub(crate) unit: Option<String>,
}

impl TextFormat {
    /// Returns the value of a quantity in a text, or the reason why the quantity has no value.
    /// Returns `None` if the text does not mention the quantity, such as a text about a battery.
    pub(crate) fn extract(
        &self,
        text: &str,
        quantity: &SensorQuantity,
    ) -> Option<Result<f64, String>> {
        let is_json = serde_json::from_str::<Value>(text).is_ok_and(|json| json.is_object());
        let found = match &self.pointer {
            Some(pointer) => at(text, pointer, quantity.name)?,
            None if is_json => named(text, quantity.name)?,
            None => FoundValue { word: text.to_owned(), unit: None },
        };
        Some(self.value(&found, quantity))
    }

    /// Returns a value of a quantity, in the quantity's unit.
    ///
    /// # Errors
    ///
    /// Returns the beginning of the text if it is not a number or, for a yes-or-no quantity, not a
    /// word for yes or no. Returns the reason if the unit cannot be converted, or the number is
    /// impossible.
    pub(crate) fn value(
        &self,
        found: &FoundValue,
        quantity: &SensorQuantity,
    ) -> Result<f64, String> {
        let unread = || excerpt(&found.word);
        if quantity.is_noticed() {
            let value = yes_or_no(&found.word, quantity.name).ok_or_else(unread)?;
            return quantity.possible(value * self.factor.unwrap_or(1.0));
        }
        let (number, own) = number_with_unit(&found.word).ok_or_else(|| no_number(&found.word))?;
        let value = match self.factor {
            Some(factor) => number * factor,
            None => {
                let own = Some(own).filter(|unit| !unit.is_empty());
                let unit = own.or(found.unit.as_deref()).or(self.unit.as_deref());
                let (unit, wanted) = (unit.unwrap_or_default(), quantity.unit());
                let other = || format!("{}, which is in `{unit}` and not in {wanted}", unread());
                converted_value(number, unit, wanted).ok_or_else(other)?
            }
        };
        quantity.possible(value)
    }
}

/// Returns the reason why a text is not a number: its beginning, and a hint if it has a decimal
/// comma.
fn no_number(text: &str) -> String {
    let with_point = text.replacen(',', ".", 1);
    match number_with_unit(&with_point) {
        Some(_) if with_point != text => format!("{}; write a point for the comma", excerpt(text)),
        _ => excerpt(text),
    }
}

/// Returns the number at the beginning of a text and the unit after it, which may be empty. Returns
/// `None` for any other text, such as `21,5`, `12:30`, `0x15` or two numbers.
fn number_with_unit(text: &str) -> Option<(f64, &str)> {
    let text = text.trim();
    let is_of_number = |symbol: char| symbol.is_ascii_digit() || "+-.eE".contains(symbol);
    let end = text.find(|symbol| !is_of_number(symbol)).unwrap_or(text.len());
    let (number, unit) = (text[..end].parse().ok()?, text[end..].trim());
    is_like_a_unit(unit).then_some((number, unit))
}

/// Whether a text may be a unit: it is empty, or begins with a letter or a sign such as `°`. Its
/// only digit may be an exponent at the end, as in `µg/m3`.
fn is_like_a_unit(text: &str) -> bool {
    let begins =
        text.chars().next().is_none_or(|first| first.is_alphabetic() || "°%‰".contains(first));
    let base = text.strip_suffix(['2', '3']).unwrap_or(text);
    begins && !base.contains(|symbol: char| symbol.is_ascii_digit())
}

/// Returns 1 or 0 for a text that means yes or no, and the number for a number; `None` for any
/// other text.
fn yes_or_no(said: &str, quantity: &str) -> Option<f64> {
    let word = said.trim().to_ascii_lowercase();
    match word.as_str() {
        // For a door, most devices report whether it is open; the quantity `contact` is whether it
        // is closed.
        "closed" if quantity == "contact" => Some(1.0),
        "open" if quantity == "contact" => Some(0.0),
        yes if YES.contains(&yes) => Some(1.0),
        no if NO.contains(&no) => Some(0.0),
        number => number.parse().ok().filter(|number: &f64| number.is_finite()),
    }
}

/// Returns the value at a JSON pointer (RFC 6901) in a JSON text; `None` if there is no value.
pub(crate) fn at(text: &str, pointer: &str, quantity: &str) -> Option<FoundValue> {
    let json: Value = serde_json::from_str(text).ok()?;
    let word = json.pointer(pointer).map(plain)?;
    let (around, _) = pointer.rsplit_once('/')?;
    let around = json.pointer(around).and_then(Value::as_object);
    Some(FoundValue { word, unit: stated_unit(&json, around, quantity) })
}

/// Returns the value in a JSON object under one of the names of a quantity. The value may also be
/// one level down, as in Tasmota's `{"SI7021": {"Temperature": 21.5}}`.
pub(crate) fn named(text: &str, quantity: &str) -> Option<FoundValue> {
    let json: Value = serde_json::from_str(text).ok()?;
    let object = json.as_object()?;
    let aliases = ALIASES.iter().filter(|(name, _)| *name == quantity);
    let names: Vec<_> = std::iter::once(quantity)
        .chain(aliases.flat_map(|(_, names)| names.iter().copied()))
        .collect();
    let in_object = |object: &JsonObject| {
        let named = |name: &&str| object.iter().find(|(key, _)| name.eq_ignore_ascii_case(key));
        let (_, value) = names.iter().find_map(named)?;
        Some(FoundValue { word: plain(value), unit: stated_unit(&json, Some(object), quantity) })
    };
    in_object(object).or_else(|| {
        // The temperature of a chip differs from that of the room. A part that also measures
        // humidity is preferred.
        let is_own = |name: &String| CHIPS.iter().any(|chip| name.starts_with(chip));
        let parts = object.iter().filter(|(name, _)| !is_own(name));
        let mut parts: Vec<&JsonObject> = parts.filter_map(|(_, part)| part.as_object()).collect();
        parts.sort_by_key(|part| !part.keys().any(|key| key.eq_ignore_ascii_case("humidity")));
        parts.into_iter().find_map(in_object)
    })
}

/// Returns the unit of a quantity in a JSON text; `None` if there is none. A key with the
/// quantity's name (`TempUnit`, `temperature_unit`) may also be at the top of the text. A plain
/// `unit` applies only to the value beside it, and only if there is no other number to which it may
/// belong.
fn stated_unit(json: &Value, around: Option<&JsonObject>, quantity: &str) -> Option<String> {
    let unit = |object: &JsonObject, names: &[&str]| {
        let plain = |key: &str| key.replace(['_', '-', ' '], "").to_ascii_lowercase();
        let found = object.iter().find(|(key, _)| names.contains(&plain(key).as_str()));
        found.and_then(|(_, unit)| unit.as_str()).map(str::to_owned)
    };
    let own = format!("{quantity}unit");
    let mut names = vec![own.as_str()];
    names.extend((quantity == "temperature").then_some("tempunit"));
    let objects = [around, json.as_object()];
    objects.into_iter().flatten().find_map(|object| unit(object, &names)).or_else(|| {
        let is_number = |value: &&Value| value.is_number();
        let around = around.filter(|object| object.values().filter(is_number).count() <= 1)?;
        unit(around, &["unit", "unitofmeasurement"])
    })
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Whether a text of the availability topic means that the device is offline.
pub(crate) fn is_offline(text: &str) -> bool {
    let json: Option<Value> = serde_json::from_str(text).ok();
    let state = json.as_ref().and_then(|json| json.pointer("/state")).map(plain);
    let word = state.unwrap_or_else(|| text.trim().to_owned());
    word.eq_ignore_ascii_case("offline")
}

/// Returns the beginning of a text, for a message to people.
pub(crate) fn excerpt(text: &str) -> String {
    let line = text.lines().next().unwrap_or_default();
    let mut told: String = line.chars().take(QUOTED_CHARS).collect();
    if told.len() < text.len() {
        told.push('…');
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantity_is_found_under_the_names_that_devices_use() {
        let zigbee = r#"{"battery":100,"humidity":44.72,"linkquality":121,"temperature":27.34}"#;
        let tasmota =
            r#"{"Time":"2026-11-22T14:00:00","SI7021":{"Temperature":21.5,"Humidity":40}}"#;
        for (text, quantity, expected) in [
            (zigbee, "temperature", Some("27.34")),
            (zigbee, "humidity", Some("44.72")),
            (zigbee, "co2", None),
            (tasmota, "temperature", Some("21.5")),
            (r#"{"occupancy":true}"#, "motion", Some("true")),
            (r#"{"illuminance":12}"#, "light", Some("12")),
            (r#"{"illuminance":21000,"illuminance_lux":126}"#, "light", Some("126")),
            (
                r#"{"Time":"x","ESP32":{"Temperature":53.3},"SI7021":{"Temperature":21.5,"Humidity":40}}"#,
                "temperature",
                Some("21.5"),
            ),
            (
                r#"{"DS18B20":{"Temperature":60},"SHT3X":{"Temperature":21.5,"Humidity":40}}"#,
                "temperature",
                Some("21.5"),
            ),
            (r#"{"ESP32":{"Temperature":53.3}}"#, "temperature", None),
            ("21.5", "temperature", None),
            ("not json", "temperature", None),
        ] {
            let found = named(text, quantity).map(|found| found.word);
            assert_eq!(found.as_deref(), expected, "{text}");
        }
    }

    #[test]
    fn a_word_is_converted_to_yes_or_no_for_its_quantity() {
        for (word, quantity, expected) in [
            ("on", "motion", Some(1.0)),
            (" Clear ", "motion", Some(0.0)),
            ("open", "reflection", Some(1.0)),
            ("OPEN", "contact", Some(0.0)),
            ("closed", "contact", Some(1.0)),
            ("true", "contact", Some(1.0)),
            ("0", "contact", Some(0.0)),
            ("perhaps", "contact", None),
        ] {
            let value = extract(word, quantity, &TextFormat::default());
            assert_eq!(value.and_then(Result::ok), expected, "{word} of {quantity}");
        }
    }

    fn extract(text: &str, quantity: &str, format: &TextFormat) -> Option<Result<f64, String>> {
        format.extract(text, SensorQuantity::named(quantity).expect("a quantity"))
    }

    #[test]
    fn an_unknown_value_differs_from_a_missing_one() {
        for (text, quantity, expected) in [
            (r#"{"temperature":21.5}"#, "temperature", Some(Ok(21.5))),
            ("21.5", "temperature", Some(Ok(21.5))),
            (r#"{"battery":90}"#, "temperature", None),
            (r#"{"temperature":null}"#, "temperature", Some(Err("null"))),
            (r#"{"temperature":"warm"}"#, "temperature", Some(Err("warm"))),
            (r#"{"temperature":false}"#, "temperature", Some(Err("false"))),
            (r#"{"humidity":"on"}"#, "humidity", Some(Err("on"))),
            (r#"{"motion":"on"}"#, "motion", Some(Ok(1.0))),
            ("off", "temperature", Some(Err("off"))),
            ("closed", "co2", Some(Err("closed"))),
            ("no", "distance", Some(Err("no"))),
            ("nan", "temperature", Some(Err("nan"))),
            ("inf", "temperature", Some(Err("inf"))),
            ("unavailable", "motion", Some(Err("unavailable"))),
            ("warm", "motion", Some(Err("warm"))),
            ("-127", "temperature", Some(Err("-127, which is impossible in °C"))),
            ("999", "temperature", Some(Err("999, which is impossible in °C"))),
            ("327.67", "temperature", Some(Err("327.67, which is impossible in °C"))),
            ("1e305", "temperature", Some(Err("1e305, which is impossible in °C"))),
            ("655.35", "humidity", Some(Err("655.35, which is impossible in %"))),
            ("-1", "light", Some(Err("-1, which is impossible in lx"))),
            ("-1", "motion", Some(Err("-1, which is impossible"))),
        ] {
            let expected = expected.map(|said| said.map_err(str::to_owned));
            assert_eq!(extract(text, quantity, &TextFormat::default()), expected, "{text}");
        }
        let at = |pointer: &str| TextFormat {
            pointer: Some(pointer.to_owned()),
            ..TextFormat::default()
        };
        assert_eq!(extract(r#"{"a":{"b":7}}"#, "co2", &at("/a/b")), Some(Ok(7.0)));
        assert_eq!(extract(r#"{"battery":7}"#, "co2", &at("/a/b")), None);
        assert_eq!(extract(r#"{"a":null}"#, "co2", &at("/a")), Some(Err("null".to_owned())));
    }

    #[test]
    fn units_in_texts_are_converted() {
        let is_pascal = "1013, which is in `hPa` and not in °C";
        for (text, pointer, unit, quantity, expected) in [
            (
                r#"{"SI7021":{"Temperature":68},"TempUnit":"F"}"#,
                None,
                None,
                "temperature",
                Ok(20.0),
            ),
            (
                r#"{"SI7021":{"Temperature":68},"TempUnit":"F"}"#,
                Some("/SI7021/Temperature"),
                None,
                "temperature",
                Ok(20.0),
            ),
            (
                r#"{"SI7021":{"Temperature":20},"TempUnit":"C"}"#,
                None,
                None,
                "temperature",
                Ok(20.0),
            ),
            (r#"{"SI7021":{"Humidity":40},"TempUnit":"F"}"#, None, None, "humidity", Ok(40.0)),
            (r#"{"temperature":68,"temperature_unit":"°F"}"#, None, None, "temperature", Ok(20.0)),
            (r#"{"value":68,"unit":"F"}"#, Some("/value"), None, "temperature", Ok(20.0)),
            (r#"{"value":1013,"unit":"hPa"}"#, Some("/value"), None, "temperature", Err(is_pascal)),
            (r#"{"temperature":20,"p":1013,"unit":"hPa"}"#, None, None, "temperature", Ok(20.0)),
            ("68 °F", None, None, "temperature", Ok(20.0)),
            ("293.15 K", None, None, "temperature", Ok(20.0)),
            ("40%", None, None, "humidity", Ok(40.0)),
            ("26 cm", None, None, "distance", Ok(0.26)),
            (
                "1013 hPa",
                None,
                None,
                "temperature",
                Err("1013 hPa, which is in `hPa` and not in °C"),
            ),
            ("68", None, Some("F"), "temperature", Ok(20.0)),
            ("20 °C", None, Some("F"), "temperature", Ok(20.0)),
            ("999 °F", None, None, "temperature", Err("537.222222, which is impossible in °C")),
        ] {
            let own = |text: Option<&str>| text.map(str::to_owned);
            let format = TextFormat { pointer: own(pointer), unit: own(unit), factor: None };
            let expected = expected.map_err(str::to_owned);
            assert_eq!(extract(text, quantity, &format), Some(expected), "{text}");
        }
        // A factor means that the author of the config has already accounted for the unit.
        let format = TextFormat { factor: Some(0.001), ..TextFormat::default() };
        assert_eq!(extract("48312 m°C", "temperature", &format), Some(Ok(48.312)));
        assert!(extract("4831200", "temperature", &format).is_some_and(|value| value.is_err()));
    }

    #[test]
    fn a_text_after_a_number_must_be_a_unit() {
        for (text, expected) in [
            ("21,5", "21,5; write a point for the comma"),
            ("21,5 °C", "21,5 °C; write a point for the comma"),
            ("1,234,567", "1,234,567"),
            ("12:30", "12:30"),
            ("0x15", "0x15"),
            ("21.5 22.5", "21.5 22.5"),
            ("21.5;40", "21.5;40"),
            ("2026-11-26T20:00", "2026-11-26T20:00"),
        ] {
            // A factor makes no difference, because such a text has no number to convert.
            for factor in [None, Some(0.1)] {
                let format = TextFormat { factor, ..TextFormat::default() };
                let found = extract(text, "temperature", &format);
                assert_eq!(found, Some(Err(expected.to_owned())), "{text} {factor:?}");
            }
        }
        let dust = SensorQuantity::named("co2").expect("a quantity");
        let format = TextFormat { factor: Some(1.0), ..TextFormat::default() };
        assert_eq!(format.extract("12 µg/m3", dust), Some(Ok(12.0)));
    }

    #[test]
    fn availability_is_parsed_in_both_forms() {
        for (text, offline) in [
            ("offline", true),
            (r#"{"state":"offline"}"#, true),
            ("online", false),
            (r#"{"state":"online"}"#, false),
            ("", false),
        ] {
            assert_eq!(is_offline(text), offline, "{text}");
        }
    }
}
