//! Home Assistant's MQTT discovery, by which ESPHome, OpenMQTTGateway and many others say what they are:
//! `homeassistant/COMPONENT/[NODE/]OBJECT/config`, and whole devices in one text.
//!
//! Each text is of one *entity*; entities of one device are put together here.

use std::collections::BTreeMap;

use serde_json::{Map, Value};

use crate::described::{Availability, Command, Described, Feature, Reading, Source};

/// Short forms of keys, as discovery allows them.
const SHORT: &[(&str, &str)] = &[
    ("avty", "availability"),
    ("avty_mode", "availability_mode"),
    ("avty_t", "availability_topic"),
    ("avty_tpl", "availability_template"),
    ("cmd_t", "command_topic"),
    ("cmps", "components"),
    ("dev", "device"),
    ("dev_cla", "device_class"),
    ("ent_cat", "entity_category"),
    ("ids", "identifiers"),
    ("obj_id", "object_id"),
    ("p", "platform"),
    ("pl_avail", "payload_available"),
    ("pl_lock", "payload_lock"),
    ("pl_not_avail", "payload_not_available"),
    ("pl_off", "payload_off"),
    ("pl_on", "payload_on"),
    ("pl_unlk", "payload_unlock"),
    ("sa", "suggested_area"),
    ("stat_locked", "state_locked"),
    ("stat_off", "state_off"),
    ("stat_on", "state_on"),
    ("stat_t", "state_topic"),
    ("stat_unlocked", "state_unlocked"),
    ("t", "topic"),
    ("uniq_id", "unique_id"),
    ("unit_of_meas", "unit_of_measurement"),
    ("val_tpl", "value_template"),
];

/// What was said so far, by the topic under which it was said.
#[derive(Debug, Default)]
pub(crate) struct Discovery {
    entities: BTreeMap<String, Vec<Entity>>,
}

#[derive(Clone, Debug)]
struct Entity {
    device: String,
    device_name: String,
    area: Option<String>,
    feature: Feature,
    availability: Vec<Availability>,
    any_is_enough: bool,
}

impl Discovery {
    /// Takes what was said under a topic; an empty text takes back what was said before.
    ///
    /// # Errors
    ///
    /// What is wrong with it, for a person.
    pub(crate) fn hear(&mut self, prefix: &str, topic: &str, text: &str) -> Result<(), String> {
        self.entities.remove(topic);
        if text.trim().is_empty() {
            return Ok(());
        }
        let within = topic.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('/'));
        let component = within.and_then(|within| within.split('/').next()).unwrap_or_default();
        let config: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let Value::Object(config) = long(config) else {
            return Err("it is no JSON object".to_owned());
        };
        let entities = match component {
            "device" => whole(&config),
            component => entity(component, &config).into_iter().collect(),
        };
        self.entities.insert(topic.to_owned(), entities);
        Ok(())
    }

    /// The devices of which something is known.
    pub(crate) fn devices(&self) -> Vec<Described> {
        let mut devices: BTreeMap<&str, Described> = BTreeMap::new();
        for entity in self.entities.values().flatten() {
            let device = devices.entry(&entity.device).or_insert_with(|| Described {
                name: entity.device_name.clone(),
                id: entity.device.clone(),
                area: entity.area.clone(),
                features: Vec::new(),
                availability: Vec::new(),
                any_is_enough: entity.any_is_enough,
            });
            device.features.push(entity.feature.clone());
            for one in &entity.availability {
                if !device.availability.contains(one) {
                    device.availability.push(one.clone());
                }
            }
        }
        devices.into_values().collect()
    }
}

/// Writes short keys out, and `~` where it stands for the base topic.
fn long(value: Value) -> Value {
    let base = value.get("~").and_then(Value::as_str).map(str::to_owned);
    written_out(value, base.as_deref())
}

fn written_out(value: Value, base: Option<&str>) -> Value {
    match value {
        Value::Object(object) => {
            let key = |key: String| match SHORT.iter().find(|(short, _)| *short == key) {
                Some((_, long)) => (*long).to_owned(),
                None => key,
            };
            let pairs = object.into_iter().map(|(name, value)| {
                let name = key(name);
                let is_topic = name.ends_with("topic");
                (name, written_out(value, base.filter(|_| is_topic).or(base)))
            });
            Value::Object(pairs.collect())
        }
        Value::Array(values) => {
            Value::Array(values.into_iter().map(|value| written_out(value, base)).collect())
        }
        Value::String(text) => match base {
            Some(base) if text.starts_with("~/") => Value::String(format!("{base}{}", &text[1..])),
            Some(base) if text.ends_with("/~") => {
                Value::String(format!("{}{base}", &text[..text.len() - 1]))
            }
            _ => Value::String(text),
        },
        other => other,
    }
}

/// A whole device in one text: what its components share stands beside them.
fn whole(config: &Map<String, Value>) -> Vec<Entity> {
    let components = config.get("components").and_then(Value::as_object);
    let components = components.into_iter().flatten();
    let of = |(_, component): (&String, &Value)| {
        let mut merged = config.clone();
        merged.remove("components");
        merged.extend(component.as_object()?.clone());
        let platform = text(&merged, "platform")?.to_owned();
        entity(&platform, &merged)
    };
    components.filter_map(of).collect()
}

fn text<'m>(map: &'m Map<String, Value>, key: &str) -> Option<&'m str> {
    map.get(key).and_then(Value::as_str).filter(|text| !text.is_empty())
}

fn plain(map: &Map<String, Value>, key: &str, otherwise: &str) -> String {
    match map.get(key) {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Null) | None => otherwise.to_owned(),
        Some(other) => other.to_string(),
    }
}

fn entity(component: &str, config: &Map<String, Value>) -> Option<Entity> {
    // What is about the device itself is nothing of the building's.
    if config.contains_key("entity_category") {
        return None;
    }
    let label = text(config, "object_id").or_else(|| text(config, "unique_id"));
    let label = label.or_else(|| text(config, "name")).unwrap_or(component).to_owned();
    let feature = feature(component, config, &label)?;
    let device = config.get("device").and_then(Value::as_object);
    let identifier = device.and_then(|device| match device.get("identifiers") {
        Some(Value::Array(several)) => several.first().and_then(Value::as_str),
        Some(Value::String(one)) => Some(one),
        _ => None,
    });
    let called = device.and_then(|device| text(device, "name")).or_else(|| text(config, "name"));
    let id = identifier.unwrap_or(&label).to_owned();
    Some(Entity {
        device_name: called.unwrap_or(&id).to_owned(),
        area: device.and_then(|device| text(device, "suggested_area")).map(str::to_owned),
        device: id,
        feature,
        availability: availability(config),
        any_is_enough: text(config, "availability_mode") == Some("any"),
    })
}

fn feature(component: &str, config: &Map<String, Value>, label: &str) -> Option<Feature> {
    let has_json = text(config, "schema") == Some("json");
    let reading =
        match text(config, "value_template").or_else(|| text(config, "state_value_template")) {
            Some(template) => Reading::Template(template.to_owned()),
            None if has_json => Reading::At(vec!["state".to_owned()]),
            None => Reading::Whole,
        };
    let state = text(config, "state_topic");
    let state = state.map(|topic| Source { topic: topic.to_owned(), reading });
    let unit = plain(config, "unit_of_measurement", "");
    let class = text(config, "device_class");
    let (class, yes, no) = match component {
        "sensor" => (class.or_else(|| class_of_unit(&unit))?, String::new(), String::new()),
        "binary_sensor" => {
            (class?, plain(config, "payload_on", "ON"), plain(config, "payload_off", "OFF"))
        }
        "switch" | "light" => (component, "ON".to_owned(), "OFF".to_owned()),
        "lock" => (
            component,
            plain(config, "state_locked", "LOCKED"),
            plain(config, "state_unlocked", "UNLOCKED"),
        ),
        _ => return None,
    };
    let (on_key, off_key, on, off) = match component {
        "lock" => ("payload_lock", "payload_unlock", "LOCK", "UNLOCK"),
        _ => ("payload_on", "payload_off", "ON", "OFF"),
    };
    let (on, off) = match has_json {
        true => (r#"{"state":"ON"}"#.to_owned(), r#"{"state":"OFF"}"#.to_owned()),
        false => (plain(config, on_key, on), plain(config, off_key, off)),
    };
    let is_switched = matches!(component, "switch" | "light" | "lock");
    // What a switch says is what it is told, unless it says otherwise.
    let said = |key, told: &str, otherwise: String| match (component, has_json) {
        ("switch" | "light", false) => plain(config, key, told),
        _ => otherwise,
    };
    let (yes, no) = (said("state_on", &on, yes), said("state_off", &off, no));
    let command = text(config, "command_topic").filter(|_| is_switched);
    let command = command.map(|topic| Command { topic: topic.to_owned(), on, off });
    if (is_switched && command.is_none()) || (!is_switched && state.is_none()) {
        return None;
    }
    let (class, label) = (class.to_owned(), label.to_owned());
    Some(Feature { class, label, state, unit, yes, no, command })
}

/// What is measured in a unit, where nobody says.
fn class_of_unit(unit: &str) -> Option<&'static str> {
    match unit {
        "°C" | "°F" => Some("temperature"),
        "lx" => Some("illuminance"),
        _ => None,
    }
}

fn availability(config: &Map<String, Value>) -> Vec<Availability> {
    let one = |map: &Map<String, Value>, topic: &str, template: &str| {
        let reading = match text(map, template) {
            Some(template) => Reading::Template(template.to_owned()),
            None => Reading::Whole,
        };
        let topic = text(map, topic)?.to_owned();
        let offline = plain(map, "payload_not_available", "offline");
        Some(Availability { source: Source { topic, reading }, offline })
    };
    match config.get("availability") {
        Some(Value::Array(several)) => several
            .iter()
            .filter_map(|each| one(each.as_object()?, "topic", "value_template"))
            .collect(),
        Some(Value::Object(single)) => one(single, "topic", "value_template").into_iter().collect(),
        _ => one(config, "availability_topic", "availability_template").into_iter().collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(texts: &[(&str, &str)]) -> Vec<Described> {
        let mut discovery = Discovery::default();
        for (topic, text) in texts {
            discovery.hear("homeassistant", topic, text).expect("it is understood");
        }
        discovery.devices()
    }

    /// As ESPHome 2024 writes it, and as the documentation of discovery has it with short keys.
    const TEMPERATURE: &str = r#"{"dev_cla":"temperature","unit_of_meas":"°C","stat_cla":"measurement",
        "name":"Temperature","stat_t":"kitchen-node/sensor/temperature/state","avty_t":"kitchen-node/status",
        "uniq_id":"ESPsensortemperature","dev":{"ids":"a4cf12f0e1d2","name":"kitchen-node","sw":"esphome",
        "mdl":"esp32dev","mf":"espressif","sa":"Kitchen"}}"#;
    const LAMP: &str = r#"{"~":"kitchen-node/light/lamp","schema":"json","name":"Lamp","stat_t":"~/state",
        "cmd_t":"~/command","avty_t":"kitchen-node/status","uniq_id":"ESPlightlamp",
        "dev":{"ids":"a4cf12f0e1d2","name":"kitchen-node","sa":"Kitchen"}}"#;
    const BUNDLE: &str = r#"{"dev":{"ids":"ea334450945afc","name":"Garden","sa":"garden"},
        "o":{"name":"bla2mqtt"},"cmps":{"t1":{"p":"sensor","device_class":"temperature","unit_of_measurement":"°F",
        "value_template":"{{ value_json.temperature }}","unique_id":"temp01ae_t"},
        "h":{"p":"sensor","device_class":"humidity","unit_of_measurement":"%",
        "value_template":"{{ value_json.humidity }}","unique_id":"h1"}},"stat_t":"sensorBedroom/state","qos":2}"#;

    #[test]
    fn entities_of_one_device_are_one_device() {
        let devices = heard(&[
            ("homeassistant/sensor/kitchen-node/temperature/config", TEMPERATURE),
            ("homeassistant/light/kitchen-node/lamp/config", LAMP),
        ]);
        assert_eq!(devices.len(), 1);
        let device = &devices[0];
        assert_eq!(
            (device.name.as_str(), device.area.as_deref()),
            ("kitchen-node", Some("Kitchen"))
        );
        assert_eq!(device.availability.len(), 1, "said twice, and one");
        let lamp =
            device.features.iter().find(|feature| feature.class == "light").expect("it is there");
        let command = lamp.command.as_ref().expect("it is switched");
        assert_eq!(command.topic, "kitchen-node/light/lamp/command");
        assert_eq!(command.on, r#"{"state":"ON"}"#);
        assert_eq!(lamp.yes, "ON");
    }

    #[test]
    fn a_whole_device_and_what_is_taken_back() {
        let topic = "homeassistant/device/0AFFD2/config";
        let devices = heard(&[(topic, BUNDLE)]);
        let units: Vec<_> =
            devices[0].features.iter().map(|feature| feature.unit.as_str()).collect();
        assert_eq!(units, ["%", "°F"]);
        assert_eq!(
            devices[0].features[0].state.as_ref().expect("shared").topic,
            "sensorBedroom/state"
        );
        assert!(heard(&[(topic, BUNDLE), (topic, "")]).is_empty());
    }

    #[test]
    fn rubbish_is_told_and_harms_nobody() {
        let mut discovery = Discovery::default();
        let topic = "homeassistant/sensor/x/config";
        for rubbish in ["{", "[]", "12", "\"x\""] {
            assert!(discovery.hear("homeassistant", topic, rubbish).is_err(), "{rubbish}");
        }
        for nothing in ["{}", r#"{"device_class":"temperature"}"#, r#"{"dev":7,"stat_t":3}"#] {
            assert!(discovery.hear("homeassistant", topic, nothing).is_ok(), "{nothing}");
        }
        assert!(discovery.devices().is_empty());
    }
}
