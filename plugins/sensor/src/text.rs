//! Texts of programs and devices: the value in them.

/// So much of a text is told where it is no measurement.
const TOLD_CHARS: usize = 60;

/// Words for yes and no.
const YES: [&str; 5] = ["true", "yes", "on", "open", "detected"];
const NO: [&str; 5] = ["false", "no", "off", "closed", "clear"];

/// What devices call a quantity, beside its name: Zigbee2MQTT, Tasmota and others.
const ALIASES: &[(&str, &[&str])] = &[
    ("light", &["illuminance", "illuminance_lux"]),
    ("motion", &["occupancy", "presence"]),
    ("humidity", &["relative_humidity"]),
    ("co2", &["carbon_dioxide"]),
];

/// What stands at a place of a JSON text (RFC 6901), as text.
pub(crate) fn at(text: &str, pointer: &str) -> Option<String> {
    let json: serde_json::Value = serde_json::from_str(text).ok()?;
    json.pointer(pointer).map(plain)
}

/// What a JSON object calls by a quantity's name, or another of its names; also one level down, as
/// Tasmota writes it: `{"SI7021": {"Temperature": 21.5}}`.
pub(crate) fn named(text: &str, quantity: &str) -> Option<String> {
    let json: serde_json::Value = serde_json::from_str(text).ok()?;
    let object = json.as_object()?;
    let aliases = ALIASES.iter().filter(|(name, _)| *name == quantity);
    let names: Vec<_> = std::iter::once(quantity)
        .chain(aliases.flat_map(|(_, names)| names.iter().copied()))
        .collect();
    let is_named = |key: &str| names.iter().any(|name| name.eq_ignore_ascii_case(key));
    let in_object = |object: &serde_json::Map<String, serde_json::Value>| {
        object.iter().find(|(key, _)| is_named(key)).map(|(_, value)| plain(value))
    };
    in_object(object)
        .or_else(|| object.values().filter_map(serde_json::Value::as_object).find_map(in_object))
}

fn plain(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// A number, or a word for yes or no.
pub(crate) fn value(said: &str, quantity: &str) -> Option<f64> {
    let word = said.trim().to_ascii_lowercase();
    match word.as_str() {
        // Of a door most devices say whether it is open; a contact is asked whether it is closed.
        "closed" if quantity == "contact" => Some(1.0),
        "open" if quantity == "contact" => Some(0.0),
        yes if YES.contains(&yes) => Some(1.0),
        no if NO.contains(&no) => Some(0.0),
        number => number.parse().ok().filter(|number: &f64| number.is_finite()),
    }
}

/// Whether a word of availability says that a device is away.
pub(crate) fn is_offline(text: &str) -> bool {
    let word = at(text, "/state").unwrap_or_else(|| text.trim().to_owned());
    word.eq_ignore_ascii_case("offline")
}

/// How a text begins, for people.
pub(crate) fn told(text: &str) -> String {
    let line = text.lines().next().unwrap_or_default();
    let mut told: String = line.chars().take(TOLD_CHARS).collect();
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
