//! Reads values from the texts of devices: the whole text, a value in JSON, or the output of a template.

use serde_json::Value;

use crate::described::{Reading, Source};

/// The result of reading a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Found {
    /// A value.
    Text(String),
    /// The device states that the value is not known.
    Unknown,
    /// The text has no value; the earlier one stays.
    Nothing,
    /// The text could not be read, with the reason; the earlier value stays.
    Unread(String),
}

/// Texts by which devices report that a value is not known.
const UNKNOWN: &[&str] = &["none", "null", "unknown", "unavailable", "nan"];

impl Found {
    fn of(text: &str) -> Found {
        match text.trim() {
            "" => Found::Nothing,
            word if UNKNOWN.iter().any(|unknown| word.eq_ignore_ascii_case(unknown)) => {
                Found::Unknown
            }
            word => Found::Text(word.to_owned()),
        }
    }
}

impl Source {
    /// Returns the value in a text, whatever it means; `None` if there is none.
    pub(crate) fn word(&self, text: &str) -> Option<String> {
        match &self.reading {
            Reading::Whole => Some(text.trim().to_owned()),
            Reading::At(keys) => match at(text, keys) {
                Found::Text(word) => Some(word),
                _ => None,
            },
            Reading::Template(template) => template.of_word(text).ok(),
        }
    }

    /// Reads a text.
    pub(crate) fn read(&self, text: &str) -> Found {
        match &self.reading {
            Reading::Whole => Found::of(text),
            Reading::At(keys) => at(text, keys),
            Reading::Template(template) => match template.of_word(text) {
                Ok(said) => Found::of(&said),
                Err(unrendered) => Found::Unread(unrendered.0),
            },
        }
    }
}

fn at(text: &str, keys: &[String]) -> Found {
    let Ok(json) = serde_json::from_str::<Value>(text) else {
        // Some devices send as one word what others send in JSON.
        let is_word = keys.len() == 1 && !text.trim_start().starts_with(['{', '[']);
        return if is_word { Found::of(text) } else { Found::Nothing };
    };
    let value = match (&json, keys) {
        (Value::Object(_), keys) => keys.iter().try_fold(&json, |json, key| json.get(key)),
        (_, [_]) => Some(&json),
        _ => None,
    };
    match value {
        None => Found::Nothing,
        Some(Value::Null) => Found::Unknown,
        Some(Value::String(text)) if text.trim().is_empty() => Found::Unknown,
        Some(Value::String(text)) => Found::of(text),
        Some(Value::Object(_) | Value::Array(_)) => Found::Unknown,
        Some(other) => Found::Text(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::Template;

    fn by(template: &str) -> Reading {
        let template = Template::new(template, &["value", "value_json"]);
        Reading::Template(template.expect("it is right"))
    }

    #[test]
    fn values_are_found_and_what_is_not_known_is_told_from_what_is_not_said() {
        let keys = |keys: &[&str]| Source::at("", keys).reading;
        let text = |text: &str| Found::Text(text.to_owned());
        for (reading, said, expected) in [
            (keys(&["temperature"]), r#"{"temperature":27.34}"#, text("27.34")),
            (keys(&["SI7021", "Temperature"]), r#"{"SI7021":{"Temperature":21.5}}"#, text("21.5")),
            (keys(&["occupancy"]), r#"{"occupancy":true}"#, text("true")),
            (keys(&["state"]), "offline", text("offline")),
            (keys(&["state"]), r#"{"state":"offline"}"#, text("offline")),
            (keys(&["state"]), "21", text("21")),
            (keys(&["temperature"]), r#"{"temperature":null}"#, Found::Unknown),
            (keys(&["temperature"]), r#"{"temperature":""}"#, Found::Unknown),
            (keys(&["temperature"]), r#"{"temperature":{}}"#, Found::Unknown),
            (keys(&["temperature"]), r#"{"battery":7}"#, Found::Nothing),
            (keys(&["temperature"]), r#"{"temperature":27"#, Found::Nothing),
            (keys(&["a", "b"]), "12", Found::Nothing),
            (keys(&["a", "b"]), r#"{"a":7}"#, Found::Nothing),
            (Reading::Whole, " ON ", text("ON")),
            (Reading::Whole, "", Found::Nothing),
            (Reading::Whole, "unavailable", Found::Unknown),
            (by("{{ value_json.x }}"), r#"{"x":null}"#, Found::Unknown),
            (by("{{ value_json.x }}"), r#"{"y":1}"#, Found::Nothing),
            (by("{{ value_json.x }}"), r#"{"x":true}"#, text("True")),
        ] {
            assert_eq!(Source { topic: String::new(), reading }.read(said), expected, "{said}");
        }
        let source = Source { topic: String::new(), reading: by("{{ value_json.x | float }}") };
        for nothing in ["{}", r#"{"x":null}"#, r#"{"x":"warm"}"#, "warm"] {
            assert!(matches!(source.read(nothing), Found::Unread(_)), "{nothing}");
        }
    }
}
