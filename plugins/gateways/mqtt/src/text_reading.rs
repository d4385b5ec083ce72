//! Extracts values from the texts of devices: the whole text, a part of JSON, or the output of a
//! template.

use serde_json::Value;

use crate::color::{OTHER, name_of_color};
use crate::description::{ReadingMethod, ValueSource};

/// Result of reading the value of a feature in a text that the device sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ReadOutcome {
    /// The text has this value, which is not interpreted yet.
    Text(String),
    /// The device reports that the value is unknown.
    Unknown,
    /// The text has no value; the feature keeps its earlier value.
    Nothing,
    /// The text could not be read, for this reason; the feature keeps its earlier value.
    Unread(String),
}

/// Texts by which devices report that a value is unknown.
const UNKNOWN: &[&str] = &["none", "null", "unknown", "unavailable", "nan"];

impl ReadOutcome {
    fn of(text: &str) -> ReadOutcome {
        match text.trim() {
            "" => ReadOutcome::Nothing,
            word if UNKNOWN.iter().any(|unknown| word.eq_ignore_ascii_case(unknown)) => {
                ReadOutcome::Unknown
            }
            word => ReadOutcome::Text(word.to_owned()),
        }
    }
}

impl ValueSource {
    /// Returns the value in a text without interpreting it; `None` if the text has no value.
    pub(crate) fn word(&self, text: &str) -> Option<String> {
        match &self.reading {
            ReadingMethod::Whole => Some(text.trim().to_owned()),
            ReadingMethod::At(keys) => match at(text, keys) {
                ReadOutcome::Text(word) => Some(word),
                _ => None,
            },
            ReadingMethod::Color(keys) => color(text, keys).map(str::to_owned),
            ReadingMethod::Template(template) => template.of_word(text).ok(),
        }
    }

    /// Reads the value in a text; recognises texts for an unknown value.
    pub(crate) fn read(&self, text: &str) -> ReadOutcome {
        match &self.reading {
            ReadingMethod::Whole => ReadOutcome::of(text),
            ReadingMethod::At(keys) => at(text, keys),
            ReadingMethod::Color(keys) => color(text, keys)
                .map_or(ReadOutcome::Nothing, |name| ReadOutcome::Text(name.to_owned())),
            ReadingMethod::Template(template) => match template.of_word(text) {
                Ok(said) => ReadOutcome::of(&said),
                Err(unrendered) => ReadOutcome::Unread(unrendered.0),
            },
        }
    }
}

/// Returns the name of the color at a path of keys in JSON; `None` if there is no color.
fn color(text: &str, keys: &[String]) -> Option<&'static str> {
    let json = serde_json::from_str::<Value>(text).ok()?;
    // A lamp that shines white reports the color that is nearest to its white.
    if matches!(json["color_mode"].as_str(), Some("color_temp" | "white")) {
        return Some(OTHER);
    }
    name_of_color(keys.iter().try_fold(&json, |json, key| json.get(key))?)
}

fn at(text: &str, keys: &[String]) -> ReadOutcome {
    let Ok(json) = serde_json::from_str::<Value>(text) else {
        // Some devices send a single word where other devices send JSON.
        let is_word = keys.len() == 1 && !text.trim_start().starts_with(['{', '[']);
        return if is_word { ReadOutcome::of(text) } else { ReadOutcome::Nothing };
    };
    let value = match (&json, keys) {
        (Value::Object(_), keys) => keys.iter().try_fold(&json, |json, key| json.get(key)),
        (_, [_]) => Some(&json),
        _ => None,
    };
    match value {
        None => ReadOutcome::Nothing,
        Some(Value::Null) => ReadOutcome::Unknown,
        Some(Value::String(text)) if text.trim().is_empty() => ReadOutcome::Unknown,
        Some(Value::String(text)) => ReadOutcome::of(text),
        Some(Value::Object(_) | Value::Array(_)) => ReadOutcome::Unknown,
        Some(other) => ReadOutcome::Text(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::Template;

    fn by(template: &str) -> ReadingMethod {
        let template = Template::new(template, &["value", "value_json"]);
        ReadingMethod::Template(template.expect("it is right"))
    }

    #[test]
    fn values_are_extracted_and_an_unknown_value_differs_from_a_missing_one() {
        let keys = |keys: &[&str]| ValueSource::at("", keys).reading;
        let text = |text: &str| ReadOutcome::Text(text.to_owned());
        for (reading, said, expected) in [
            (keys(&["temperature"]), r#"{"temperature":27.34}"#, text("27.34")),
            (keys(&["SI7021", "Temperature"]), r#"{"SI7021":{"Temperature":21.5}}"#, text("21.5")),
            (keys(&["occupancy"]), r#"{"occupancy":true}"#, text("true")),
            (keys(&["state"]), "offline", text("offline")),
            (keys(&["state"]), r#"{"state":"offline"}"#, text("offline")),
            (keys(&["state"]), "21", text("21")),
            (keys(&["temperature"]), r#"{"temperature":null}"#, ReadOutcome::Unknown),
            (keys(&["temperature"]), r#"{"temperature":""}"#, ReadOutcome::Unknown),
            (keys(&["temperature"]), r#"{"temperature":{}}"#, ReadOutcome::Unknown),
            (keys(&["temperature"]), r#"{"battery":7}"#, ReadOutcome::Nothing),
            (keys(&["temperature"]), r#"{"temperature":27"#, ReadOutcome::Nothing),
            (keys(&["a", "b"]), "12", ReadOutcome::Nothing),
            (keys(&["a", "b"]), r#"{"a":7}"#, ReadOutcome::Nothing),
            (ReadingMethod::Whole, " ON ", text("ON")),
            (ReadingMethod::Whole, "", ReadOutcome::Nothing),
            (ReadingMethod::Whole, "unavailable", ReadOutcome::Unknown),
            (by("{{ value_json.x }}"), r#"{"x":null}"#, ReadOutcome::Unknown),
            (by("{{ value_json.x }}"), r#"{"y":1}"#, ReadOutcome::Nothing),
            (by("{{ value_json.x }}"), r#"{"x":true}"#, text("True")),
        ] {
            assert_eq!(
                ValueSource { topic: String::new(), reading }.read(said),
                expected,
                "{said}"
            );
        }
        let source =
            ValueSource { topic: String::new(), reading: by("{{ value_json.x | float }}") };
        for nothing in ["{}", r#"{"x":null}"#, r#"{"x":"warm"}"#, "warm"] {
            assert!(matches!(source.read(nothing), ReadOutcome::Unread(_)), "{nothing}");
        }
    }
}
