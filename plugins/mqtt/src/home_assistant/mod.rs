//! Home Assistant's MQTT discovery, by which ESPHome, OpenMQTTGateway and many others say what they are:
//! `homeassistant/COMPONENT/[NODE/]OBJECT/config`, and whole devices in one text.
//!
//! - `config` reads one text, `component` says what an entity is here.
//! - Each text is of one *entity*; entities of one device are put together here: those that share an
//!   identifier or a connection. Any of them may name the device and its area.
//! - A text that cannot be read leaves the entity as it was, and is told of.

mod component;
mod config;

use std::collections::{BTreeMap, HashMap};

use serde_json::{Map, Value};

use crate::described::{Described, Feature, Unused};
use config::Config;

/// Entities that are remembered.
const ENTITIES_MAX: usize = 1 << 16;

/// What was said so far, by the topic under which it was said.
#[derive(Debug, Default)]
pub(crate) struct Discovery {
    texts: BTreeMap<String, Text>,
}

/// What the last text under a topic says.
#[derive(Debug, Default)]
struct Text {
    entities: Vec<Entity>,
    /// Why the last text was not read; then the entities are those of the one before.
    problem: Option<String>,
}

#[derive(Clone, Debug)]
struct Entity {
    /// Identifiers and connections of its device: at least one.
    keys: Vec<String>,
    device_name: Option<String>,
    /// What the entity itself is called.
    own_name: String,
    area: Option<String>,
    features: Vec<Feature>,
    unused: Option<Unused>,
}

impl Discovery {
    /// Takes what was said under a topic; an empty text takes back what was said before.
    ///
    /// # Errors
    ///
    /// What is wrong with it, for a person.
    pub(crate) fn hear(&mut self, prefix: &str, topic: &str, text: &str) -> Result<(), String> {
        if text.trim().is_empty() {
            self.texts.remove(topic);
            return Ok(());
        }
        if !self.texts.contains_key(topic) && self.texts.len() >= ENTITIES_MAX {
            return Err(format!("more than {ENTITIES_MAX} entities are told of"));
        }
        let within = topic.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('/'));
        let component = within.and_then(|within| within.split('/').next()).unwrap_or_default();
        let known = self.texts.entry(topic.to_owned()).or_default();
        let config = match Config::read(text) {
            Ok(config) => config,
            Err(problem) => {
                known.problem = Some(problem.clone());
                return Err(problem);
            }
        };
        let object = object_of(topic, prefix, component);
        known.problem = None;
        known.entities = match component {
            "device" => whole(&config, object),
            component => vec![entity(component, config.with_base(), object)],
        };
        Ok(())
    }

    /// The devices of which something is known.
    pub(crate) fn devices(&self) -> Vec<Described> {
        let mut groups = Groups::default();
        for (topic, text) in &self.texts {
            let trouble = text.problem.as_ref().map(|problem| {
                Unused::because(format!(
                    "its last description (`{topic}`) cannot be read: {problem}"
                ))
            });
            for (number, entity) in text.entities.iter().enumerate() {
                groups.add(entity, trouble.clone().filter(|_| number == 0));
            }
            // Of a device that was never understood, its topic is all that is known.
            if let Some(trouble) = trouble.filter(|_| text.entities.is_empty()) {
                let object = topic.trim_end_matches("/config");
                let object = object.splitn(3, '/').last().unwrap_or(object);
                groups.add(&unread(object), Some(trouble));
            }
        }
        groups.devices()
    }
}

/// What a topic says of the entity: `NODE/OBJECT` or `OBJECT`.
fn object_of<'t>(topic: &'t str, prefix: &str, component: &str) -> &'t str {
    let rest = topic.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('/'));
    let rest = rest.and_then(|rest| rest.strip_prefix(component)?.strip_prefix('/'));
    rest.and_then(|rest| rest.strip_suffix("/config")).unwrap_or(topic)
}

fn unread(object: &str) -> Entity {
    Entity {
        keys: vec![object.to_owned()],
        device_name: None,
        own_name: object.to_owned(),
        area: None,
        features: Vec::new(),
        unused: None,
    }
}

/// Entities, put together to devices.
#[derive(Default)]
struct Groups {
    devices: Vec<Option<Group>>,
    /// Which device has an identifier.
    by_key: HashMap<String, usize>,
}

#[derive(Default)]
struct Group {
    keys: Vec<String>,
    name: Option<String>,
    own_name: String,
    area: Option<String>,
    features: Vec<Feature>,
    unused: Vec<Unused>,
}

impl Groups {
    fn add(&mut self, entity: &Entity, trouble: Option<Unused>) {
        let mut known: Vec<usize> =
            entity.keys.iter().filter_map(|key| self.by_key.get(key).copied()).collect();
        known.sort_unstable();
        known.dedup();
        let at = known.first().copied().unwrap_or_else(|| {
            self.devices
                .push(Some(Group { own_name: entity.own_name.clone(), ..Group::default() }));
            self.devices.len() - 1
        });
        // One that shares identifiers with several makes them one.
        for other in known.into_iter().skip(1) {
            let Some(other) = self.devices[other].take() else { continue };
            if let Some(group) = &mut self.devices[at] {
                group.keys.extend(other.keys);
                group.name = group.name.take().or(other.name);
                group.area = group.area.take().or(other.area);
                group.features.extend(other.features);
                group.unused.extend(other.unused);
            }
        }
        let Some(group) = &mut self.devices[at] else { return };
        for key in &entity.keys {
            if !group.keys.contains(key) {
                group.keys.push(key.clone());
            }
        }
        group.name = group.name.take().or_else(|| entity.device_name.clone());
        group.area = group.area.take().or_else(|| entity.area.clone());
        group.features.extend(entity.features.iter().cloned());
        group.unused.extend(entity.unused.iter().cloned().chain(trouble));
        for key in &group.keys {
            self.by_key.insert(key.clone(), at);
        }
    }

    fn devices(self) -> Vec<Described> {
        let described = |group: Group| {
            let mut keys = group.keys.into_iter();
            let id = keys.next().unwrap_or_default();
            Described {
                name: group.name.unwrap_or(group.own_name),
                id,
                also: keys.collect(),
                area: group.area,
                features: group.features,
                unused: group.unused,
            }
        };
        self.devices.into_iter().flatten().map(described).collect()
    }
}

/// A whole device in one text.
fn whole(config: &Config, object: &str) -> Vec<Entity> {
    let components = config.components();
    let is_said = config.0.get("components").and_then(Value::as_object);
    if is_said.is_none_or(Map::is_empty) {
        let nothing = Unused::because("its description has no components".to_owned());
        return vec![Entity { unused: Some(nothing), ..about(config, object) }];
    }
    let of = |(name, component): (String, Config)| match component.text("platform") {
        Some(platform) => {
            let platform = platform.to_owned();
            entity(&platform, component.with_base(), &name)
        }
        None => {
            let reason = format!("its component `{name}` does not say its `platform`");
            let unused = Some(Unused::because(reason));
            Entity { unused, ..about(&component, object) }
        }
    };
    components.into_iter().map(of).collect()
}

fn entity(component: &str, config: Config, object: &str) -> Entity {
    let label = config.text("object_id").or_else(|| config.text("unique_id"));
    let label = label.or_else(|| config.text("name")).unwrap_or(object).to_owned();
    let (features, unused) = match component::features(component, &config, &label) {
        Ok(features) => (features, None),
        Err(unused) => (Vec::new(), Some(unused)),
    };
    Entity { features, unused, ..about(&config, object) }
}

/// What a text says of its device.
fn about(config: &Config, object: &str) -> Entity {
    let device = config.0.get("device").and_then(Value::as_object);
    // An `object_id` may be that of other nodes, too.
    let own = config.text("unique_id").unwrap_or(object);
    let mut keys = device.map(identifiers).unwrap_or_default();
    if keys.is_empty() {
        keys.push(own.to_owned());
    }
    let of_device = |key: &str| {
        let text = device?.get(key)?.as_str()?.trim();
        (!text.is_empty()).then(|| text.to_owned())
    };
    Entity {
        own_name: config.text("name").map_or_else(|| keys[0].clone(), str::to_owned),
        device_name: of_device("name"),
        area: of_device("suggested_area"),
        keys,
        features: Vec::new(),
        unused: None,
    }
}

/// The identifiers of a device, then its connections. Numbers are as good as texts.
fn identifiers(device: &Map<String, Value>) -> Vec<String> {
    let plain = |value: &Value| match value {
        Value::String(text) => Some(text.trim().to_owned()).filter(|text| !text.is_empty()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    };
    let mut keys: Vec<String> = match device.get("identifiers") {
        Some(Value::Array(several)) => several.iter().filter_map(plain).collect(),
        Some(one) => plain(one).into_iter().collect(),
        None => Vec::new(),
    };
    let connections = device.get("connections").and_then(Value::as_array);
    for connection in connections.into_iter().flatten().filter_map(Value::as_array) {
        if let [kind, address] = &connection[..]
            && let (Some(kind), Some(address)) = (plain(kind), plain(address))
        {
            keys.push(if kind == "mac" { mac(&address) } else { address });
        }
    }
    keys
}

/// An address of a network card, which is written in several ways.
fn mac(address: &str) -> String {
    let digits: String =
        address.chars().filter(char::is_ascii_hexdigit).collect::<String>().to_ascii_lowercase();
    if digits.len() != 12 {
        return address.to_owned();
    }
    let pairs: Vec<_> = (0..6).map(|pair| &digits[2 * pair..2 * pair + 2]).collect();
    pairs.join(":")
}
