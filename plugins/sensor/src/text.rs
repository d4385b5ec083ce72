//! Finds values in the texts of programs and devices.

/// The most characters that are quoted of a text that is no measurement.
const QUOTED_CHARS: usize = 60;

/// Texts that mean yes, and texts that mean no.
const YES: [&str; 5] = ["true", "yes", "on", "open", "detected"];
const NO: [&str; 5] = ["false", "no", "off", "closed", "clear"];

/// Other names of each quantity in the messages of devices: of Zigbee2MQTT, Tasmota and others.
const ALIASES: &[(&str, &[&str])] = &[
    // If both are present, `illuminance` is a raw value (Zigbee2MQTT 1.x).
    ("light", &["illuminance_lux", "illuminance"]),
    ("motion", &["occupancy", "presence"]),
    ("humidity", &["relative_humidity"]),
    ("co2", &["carbon_dioxide"]),
];

/// Beginnings of the names of chips that measure a Tasmota device itself, not the room.
const CHIPS: &[&str] = &["ESP32", "ENERGY", "AXP", "MPU", "BL09"];

/// Returns the value that the JSON pointer `pointer` (RFC 6901) addresses in a JSON text, as a text.
pub(crate) fn at(text: &str, pointer: &str) -> Option<String> {
    let json: serde_json::Value = serde_json::from_str(text).ok()?;
    json.pointer(pointer).map(plain)
}

/// Returns the value of a quantity in a text, or the reason why the quantity has no value; `None` if the
/// text is about other things, such as a battery.
pub(crate) fn extract_value(
    text: &str,
    quantity: &str,
    pointer: Option<&str>,
) -> Option<Result<f64, String>> {
    let is_json =
        serde_json::from_str::<serde_json::Value>(text).is_ok_and(|json| json.is_object());
    let word = match pointer {
        Some(pointer) => at(text, pointer)?,
        None if is_json => named(text, quantity)?,
        None => text.to_owned(),
    };
    let said = value(&word, quantity).filter(|value| is_possible(*value, quantity));
    Some(said.ok_or_else(|| excerpt(&word)))
}

/// Returns the value that a JSON object has under one of the names of a quantity. The value may also lie
/// one level down, as in Tasmota's `{"SI7021": {"Temperature": 21.5}}`.
pub(crate) fn named(text: &str, quantity: &str) -> Option<String> {
    let json: serde_json::Value = serde_json::from_str(text).ok()?;
    let object = json.as_object()?;
    let aliases = ALIASES.iter().filter(|(name, _)| *name == quantity);
    let names: Vec<_> = std::iter::once(quantity)
        .chain(aliases.flat_map(|(_, names)| names.iter().copied()))
        .collect();
    type Object = serde_json::Map<String, serde_json::Value>;
    let in_object = |object: &Object| {
        let named = |name: &&str| object.iter().find(|(key, _)| name.eq_ignore_ascii_case(key));
        names.iter().find_map(named).map(|(_, value)| plain(value))
    };
    in_object(object).or_else(|| {
        // The temperature of a chip is not that of the room. A part that measures humidity too is
        // preferred.
        let is_own = |name: &String| CHIPS.iter().any(|chip| name.starts_with(chip));
        let parts = object.iter().filter(|(name, _)| !is_own(name));
        let mut parts: Vec<&Object> = parts.filter_map(|(_, part)| part.as_object()).collect();
        parts.sort_by_key(|part| !part.keys().any(|key| key.eq_ignore_ascii_case("humidity")));
        parts.into_iter().find_map(in_object)
    })
}

/// Whether a value is possible for a quantity. Chips report special numbers for “no value”.
fn is_possible(value: f64, quantity: &str) -> bool {
    match quantity {
        "temperature" => value > -127.0,
        "humidity" => (0.0..=110.0).contains(&value),
        "co2" | "light" | "distance" => value >= 0.0,
        _ => true,
    }
}

fn plain(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Returns the number in a text, or 1 or 0 if the text means yes or no; `None` for any other text.
pub(crate) fn value(said: &str, quantity: &str) -> Option<f64> {
    let word = said.trim().to_ascii_lowercase();
    match word.as_str() {
        // For a door, most devices report whether it is open; the quantity `contact` is whether it is
        // closed.
        "closed" if quantity == "contact" => Some(1.0),
        "open" if quantity == "contact" => Some(0.0),
        yes if YES.contains(&yes) => Some(1.0),
        no if NO.contains(&no) => Some(0.0),
        number => number.parse().ok().filter(|number: &f64| number.is_finite()),
    }
}

/// Whether a text of the availability topic means offline.
pub(crate) fn is_offline(text: &str) -> bool {
    let word = at(text, "/state").unwrap_or_else(|| text.trim().to_owned());
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
    fn a_quantity_is_found_by_what_devices_call_it() {
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
            assert_eq!(named(text, quantity).as_deref(), expected, "{text}");
        }
    }

    #[test]
    fn a_word_says_yes_or_no_to_what_is_asked() {
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
            assert_eq!(value(word, quantity), expected, "{word} of {quantity}");
        }
    }

    #[test]
    fn what_is_not_known_is_told_from_what_is_not_said() {
        for (text, quantity, expected) in [
            (r#"{"temperature":21.5}"#, "temperature", Some(Ok(21.5))),
            ("21.5", "temperature", Some(Ok(21.5))),
            (r#"{"battery":90}"#, "temperature", None),
            (r#"{"temperature":null}"#, "temperature", Some(Err("null"))),
            (r#"{"temperature":"warm"}"#, "temperature", Some(Err("warm"))),
            (r#"{"temperature":-127}"#, "temperature", Some(Err("-127"))),
            (r#"{"humidity":655.35}"#, "humidity", Some(Err("655.35"))),
            ("nan", "temperature", Some(Err("nan"))),
            ("unavailable", "motion", Some(Err("unavailable"))),
        ] {
            let expected = expected.map(|said| said.map_err(str::to_owned));
            assert_eq!(extract_value(text, quantity, None), expected, "{text}");
        }
        assert_eq!(extract_value(r#"{"a":{"b":7}}"#, "co2", Some("/a/b")), Some(Ok(7.0)));
        assert_eq!(extract_value(r#"{"battery":7}"#, "co2", Some("/a/b")), None);
        assert_eq!(extract_value(r#"{"a":null}"#, "co2", Some("/a")), Some(Err("null".to_owned())));
    }

    #[test]
    fn availability_is_told_in_two_ways() {
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
