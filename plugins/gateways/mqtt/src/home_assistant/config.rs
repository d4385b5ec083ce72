//! Reads one discovery message: expands short keys, replaces `~`, and interprets values in the same
//! way as Home Assistant.

use std::collections::HashMap;
use std::sync::OnceLock;
use std::time::Duration;

use serde_json::{Map, Value};

use crate::description::{
    Availability, AvailabilityMode, AvailabilityTopic, OutgoingMessage, ReadingMethod, ValueSource,
};
use crate::setting::{NumberMessage, NumberText, TemplateVariable};
use crate::template::Template;

/// Table of the short forms of keys: first the keys of an entity, then the keys of an entity's
/// device.
const SHORT: &str = include_str!("../abbreviations.tsv");

/// Keys that apply to all components of a message if they are beside the list of components.
const SHARED: &[&str] = &[
    "availability",
    "availability_mode",
    "availability_template",
    "availability_topic",
    "command_topic",
    "device",
    "payload_available",
    "payload_not_available",
    "state_topic",
    "~",
];

/// The config of one entity, with the long forms of its keys.
pub(crate) struct EntityConfig(pub(crate) Map<String, Value>);

type KeyForms = HashMap<&'static str, &'static str>;

/// Returns the long forms of short keys, in two tables: for keys of an entity, and for keys of a
/// device.
fn long_forms() -> &'static (KeyForms, KeyForms) {
    static FORMS: OnceLock<(KeyForms, KeyForms)> = OnceLock::new();
    FORMS.get_or_init(|| {
        let (entity, device) = SHORT.split_once("# device").unwrap_or((SHORT, ""));
        let of =
            |part: &'static str| part.lines().filter_map(|line| line.split_once('\t')).collect();
        (of(entity), of(device))
    })
}

fn long(map: Map<String, Value>, forms: &KeyForms) -> Map<String, Value> {
    let key = |name: String| forms.get(name.as_str()).map_or(name, |long| (*long).to_owned());
    map.into_iter().map(|(name, value)| (key(name), value)).collect()
}

impl EntityConfig {
    /// Reads the config of an entity from the text of a message.
    ///
    /// # Errors
    ///
    /// Returns an error if the text is not a JSON object.
    pub(crate) fn read(text: &str) -> Result<EntityConfig, String> {
        match serde_json::from_str(text) {
            Ok(Value::Object(map)) => Ok(EntityConfig::of(map)),
            Ok(_) => Err("it is no JSON object".to_owned()),
            Err(error) => Err(error.to_string()),
        }
    }

    fn of(map: Map<String, Value>) -> EntityConfig {
        let (of_entity, of_device) = long_forms();
        let mut map = long(map, of_entity);
        if let Some(Value::Object(device)) = map.remove("device") {
            map.insert("device".to_owned(), Value::Object(long(device, of_device)));
        }
        let lengthened = |value| match value {
            Value::Object(one) => Value::Object(long(one, of_entity)),
            other => other,
        };
        match map.remove("availability") {
            Some(Value::Array(several)) => {
                let several = several.into_iter().map(lengthened).collect();
                map.insert("availability".to_owned(), Value::Array(several));
            }
            Some(one) => {
                map.insert("availability".to_owned(), lengthened(one));
            }
            None => (),
        }
        EntityConfig(map)
    }

    /// Returns the components of a message about a whole device: the name of each component, and
    /// its config merged with the shared keys.
    pub(crate) fn components(&self) -> Vec<(String, EntityConfig)> {
        let Some(Value::Object(components)) = self.0.get("components") else { return Vec::new() };
        let shared = |key: &&str| Some(((*key).to_owned(), self.0.get(*key)?.clone()));
        let shared: Map<_, _> = SHARED.iter().filter_map(shared).collect();
        let of = |(name, component): (&String, &Value)| {
            // An entry that is not an object has no keys, and therefore no platform.
            let own = EntityConfig::of(component.as_object().cloned().unwrap_or_default()).0;
            // A component with only its platform is to be removed.
            if own.keys().all(|key| key == "platform") && !own.is_empty() {
                return None;
            }
            let mut all = shared.clone();
            // A component with its own availability does not inherit the shared one.
            if own.keys().any(|key| matches!(key.as_str(), "availability" | "availability_topic")) {
                all.retain(|key, _| !key.starts_with("availability"));
            }
            all.extend(own);
            Some((name.clone(), EntityConfig(all)))
        };
        components.iter().filter_map(of).collect()
    }

    /// Replaces `~` at the beginning and the end of topics by the base topic.
    pub(crate) fn with_base(mut self) -> EntityConfig {
        let Some(base) = self.0.remove("~") else { return self };
        let Value::String(base) = base else { return self };
        let replace = |text: &mut String| {
            if let Some(rest) = text.strip_prefix('~') {
                *text = format!("{base}{rest}");
            }
            if let Some(rest) = text.strip_suffix('~') {
                *text = format!("{rest}{base}");
            }
        };
        for (key, value) in &mut self.0 {
            match value {
                Value::String(text) if key.ends_with("topic") => replace(text),
                Value::Array(several) if key == "availability" => {
                    for topic in several.iter_mut().filter_map(|one| one.get_mut("topic")) {
                        if let Value::String(text) = topic {
                            replace(text);
                        }
                    }
                }
                Value::Object(one) if key == "availability" => {
                    if let Some(Value::String(text)) = one.get_mut("topic") {
                        replace(text);
                    }
                }
                _ => (),
            }
        }
        self
    }

    /// Returns the text under a key; `None` if the text is missing or empty.
    pub(crate) fn text(&self, key: &str) -> Option<&str> {
        text(&self.0, key)
    }

    pub(crate) fn has(&self, key: &str) -> bool {
        self.0.get(key).is_some_and(|value| !value.is_null())
    }

    pub(crate) fn is(&self, key: &str) -> Option<bool> {
        match self.0.get(key)? {
            Value::Bool(is_so) => Some(*is_so),
            Value::String(word) => match word.to_ascii_lowercase().as_str() {
                "true" | "yes" | "on" | "1" => Some(true),
                "false" | "no" | "off" | "0" => Some(false),
                _ => None,
            },
            Value::Number(number) => number.as_f64().map(|number| number != 0.0),
            _ => None,
        }
    }

    /// Returns the number under a key, which may be written as a text; `None` if there is none.
    pub(crate) fn number(&self, key: &str) -> Option<f64> {
        match self.0.get(key)? {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => text.trim().parse().ok(),
            _ => None,
        }
    }

    /// Returns the texts in the list under a key; `None` if there is no list.
    pub(crate) fn list(&self, key: &str) -> Option<Vec<String>> {
        let plain = |value: &Value| match value {
            Value::String(text) => Some(text.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        };
        Some(self.0.get(key)?.as_array()?.iter().filter_map(plain).collect())
    }

    pub(crate) fn duration(&self, key: &str) -> Option<Duration> {
        let seconds = match self.0.get(key)? {
            Value::Number(number) => number.as_f64()?,
            Value::String(text) => text.trim().parse().ok()?,
            _ => return None,
        };
        Duration::try_from_secs_f64(seconds).ok().filter(|duration| !duration.is_zero())
    }

    /// Returns the payload under a key in the form in which it is sent; `otherwise` if the key is
    /// missing. A JSON value that is not a string is sent as JSON.
    pub(crate) fn payload(&self, key: &str, otherwise: &str) -> String {
        match self.0.get(key) {
            Some(Value::String(text)) => text.clone(),
            Some(Value::Null) | None => otherwise.to_owned(),
            Some(other) => other.to_string(),
        }
    }

    /// Returns the payload under a key in the form that templates produce, with booleans as Python
    /// prints them; `otherwise` if the key is missing.
    pub(crate) fn payload_in_python(&self, key: &str, otherwise: &str) -> String {
        match self.0.get(key) {
            Some(Value::Bool(true)) => "True".to_owned(),
            Some(Value::Bool(false)) => "False".to_owned(),
            _ => self.payload(key, otherwise),
        }
    }

    /// Returns the received texts that mean the payload under a key: the payload as JSON, and as
    /// Python prints it.
    pub(crate) fn words(&self, key: &str, otherwise: &str) -> Vec<String> {
        let mut words = vec![self.payload(key, otherwise), self.payload_in_python(key, otherwise)];
        words.dedup();
        words
    }

    /// Returns the template under a key; `None` if the config has no such key.
    ///
    /// # Errors
    ///
    /// Returns an error if the template is invalid.
    pub(crate) fn template(&self, key: &str) -> Result<Option<Template>, String> {
        template(&self.0, key, &["value", "value_json"])
    }

    /// Returns the source of a value, from the topic under one key and the template for reading the
    /// value under another key. Without a template, the value is read by `otherwise`. Returns
    /// `None` if the config has no such topic.
    ///
    /// # Errors
    ///
    /// Returns an error if the topic or the template is invalid.
    pub(crate) fn source(
        &self,
        topic: &str,
        template: &str,
        otherwise: ReadingMethod,
    ) -> Result<Option<ValueSource>, String> {
        let Some(topic) = self.text(topic) else { return Ok(None) };
        if let Some(problem) = mqtt_link::filter_problem(topic) {
            return Err(problem);
        }
        let reading = self.template(template)?.map_or(otherwise, ReadingMethod::Template);
        Ok(Some(ValueSource { topic: topic.to_owned(), reading }))
    }

    /// Returns the message of a command: a payload, rendered by the command's template if there is
    /// one.
    ///
    /// # Errors
    ///
    /// Returns an error if the topic is missing or invalid, or the template cannot be rendered.
    pub(crate) fn telegram(
        &self,
        topic: &str,
        by: Option<&str>,
        payload: (&str, &str),
    ) -> Result<OutgoingMessage, String> {
        let to = self.text(topic).ok_or_else(|| format!("it has no `{topic}`"))?;
        if let Some(problem) = mqtt_link::topic_problem(to) {
            return Err(problem);
        }
        let (key, otherwise) = payload;
        let Some(by) = by.filter(|by| self.has(by)) else {
            return Ok(OutgoingMessage::new(to, self.payload(key, otherwise)));
        };
        let value = self.payload_in_python(key, otherwise);
        let text = self.rendered(by, &[("value", value.into())], &[])?;
        Ok(OutgoingMessage::new(to, text))
    }

    /// Returns the output of a command's template for the given variables. The template may also
    /// use the variables `missing`, which are undefined.
    ///
    /// # Errors
    ///
    /// Returns an error if the template is missing or invalid, cannot be rendered, or renders to an
    /// empty text.
    pub(crate) fn rendered(
        &self,
        key: &str,
        given: &[(&str, minijinja::Value)],
        missing: &[&str],
    ) -> Result<String, String> {
        let names: Vec<_> =
            given.iter().map(|(name, _)| *name).chain(missing.iter().copied()).collect();
        let Some(template) = template(&self.0, key, &names)? else {
            return Err(format!("it has no `{key}`"));
        };
        let text = template.render(given).map_err(|unrendered| unrendered.0)?;
        if text.is_empty() { Err(format!("its `{key}` gives no text")) } else { Ok(text) }
    }

    /// Returns the message that sets a number: by the template under the key `by`, or else as the
    /// number alone. The template has the variables `given`, and may use those in `missing`, which
    /// are undefined.
    ///
    /// # Errors
    ///
    /// Returns an error if the topic is missing or invalid, or the template is invalid.
    pub(crate) fn number_message(
        &self,
        topic: &str,
        by: &str,
        given: &[(&str, TemplateVariable)],
        missing: &[&str],
    ) -> Result<NumberMessage, String> {
        let to = self.telegram(topic, None, ("", ""))?.topic;
        let names: Vec<_> =
            given.iter().map(|(name, _)| *name).chain(missing.iter().copied()).collect();
        let mut message = NumberMessage::plain(to);
        if let Some(template) = template(&self.0, by, &names)? {
            let variables = given.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
            message.text = NumberText::Template { template, variables: variables.collect() };
        }
        Ok(message)
    }

    /// Returns the topics that report whether the entity is online.
    ///
    /// # Errors
    ///
    /// Returns an error if a topic or a template is invalid.
    pub(crate) fn availability(&self) -> Result<Availability, String> {
        let map = &self.0;
        let mut voices = Vec::new();
        let (topic, by_template) = ("topic", "value_template");
        match map.get("availability") {
            Some(Value::Array(several)) => {
                for one in several.iter().filter_map(Value::as_object) {
                    voices.extend(voice(one, topic, by_template)?);
                }
            }
            Some(Value::Object(one)) => voices.extend(voice(one, topic, by_template)?),
            _ => voices.extend(voice(map, "availability_topic", "availability_template")?),
        }
        let mode = match self.text("availability_mode") {
            Some("all") => AvailabilityMode::All,
            Some("any") => AvailabilityMode::Any,
            _ => AvailabilityMode::Latest,
        };
        Ok(Availability { topics: voices, mode })
    }
}

fn text<'m>(map: &'m Map<String, Value>, key: &str) -> Option<&'m str> {
    map.get(key).and_then(Value::as_str).filter(|text| !text.is_empty())
}

fn template(
    map: &Map<String, Value>,
    key: &str,
    variables: &[&str],
) -> Result<Option<Template>, String> {
    text(map, key).map(|text| Template::new(text, variables)).transpose()
}

fn voice(
    map: &Map<String, Value>,
    topic: &str,
    by: &str,
) -> Result<Option<AvailabilityTopic>, String> {
    let Some(topic) = text(map, topic) else { return Ok(None) };
    if let Some(problem) = mqtt_link::filter_problem(topic) {
        return Err(format!("its availability: {problem}"));
    }
    let reading = template(map, by, &["value", "value_json"])?;
    let reading = reading.map_or(ReadingMethod::Whole, ReadingMethod::Template);
    let word = |key: &str, otherwise: &str| match map.get(key) {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Bool(true)) => "True".to_owned(),
        Some(Value::Bool(false)) => "False".to_owned(),
        Some(Value::Null) | None => otherwise.to_owned(),
        Some(other) => other.to_string(),
    };
    Ok(Some(AvailabilityTopic {
        source: ValueSource { topic: topic.to_owned(), reading },
        online: word("payload_available", "online"),
        offline: word("payload_not_available", "offline"),
        is_online_at_first: false,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_base_topic_replaces_a_tilde_at_both_ends() {
        for (base, topic, expected) in [
            ("lab/n", "~", "lab/n"),
            ("lab/", "~n", "lab/n"),
            ("lab", "~/state", "lab/state"),
            ("lab", "tele/~", "tele/lab"),
            ("lab", "tele~", "telelab"),
            ("lab", "a/~/b", "a/~/b"),
            ("lab", "plain", "plain"),
        ] {
            let text = format!(
                r#"{{"~":"{base}","stat_t":"{topic}","avty":[{{"t":"{topic}"}}],"json_attr_t":"{topic}",
                    "pl_on":"~"}}"#
            );
            let config = EntityConfig::read(&text).expect("an object").with_base();
            assert_eq!(config.text("state_topic"), Some(expected));
            assert_eq!(config.text("json_attributes_topic"), Some(expected));
            assert_eq!(config.text("payload_on"), Some("~"), "it is no topic");
            let availability = config.availability().expect("it is right");
            assert_eq!(availability.topics[0].source.topic, expected);
        }
    }

    #[test]
    fn short_keys_are_expanded() {
        let text = r#"{"cmd_on_tpl":"a","ret":true,"dev":{"ids":["x"],"sa":"Kitchen","sn":"7"},"bri_cmd_t":"b"}"#;
        let config = EntityConfig::read(text).expect("an object");
        assert_eq!(config.text("command_on_template"), Some("a"));
        assert_eq!(config.text("brightness_command_topic"), Some("b"));
        let device = config.0["device"].as_object().expect("a device");
        assert_eq!(device["suggested_area"], "Kitchen");
        assert_eq!(device["serial_number"], "7");
    }
}
