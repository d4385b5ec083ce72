//! Home Assistant's MQTT discovery, which ESPHome, OpenMQTTGateway and many others use for their
//! descriptions. The topic is `homeassistant/COMPONENT/[NODE/]OBJECT/config`; one message may also
//! describe a whole device.
//!
//! - `config` reads one message; `component` converts an entity to features, with `lighting`,
//!   `climate` and `settings` for entities that are set.
//! - A message usually describes one *entity*. This module groups entities into devices: entities
//!   that share an identifier or a connection belong to one device. The name and the area of the
//!   device may be in the description of any of its entities.
//! - A message that is not valid JSON or not a valid description does not change the entities of
//!   its topic; the problem is reported.

mod climate;
mod component;
mod config;
mod lighting;
mod settings;

use std::collections::{BTreeMap, HashMap};

use serde_json::{Map, Value};

use crate::description::{DescribedDevice, DeviceFeature, UnusedFeature};
use config::EntityConfig;

/// Maximum number of topics with a stored description; descriptions on further topics are rejected.
const ENTITIES_MAX: usize = 1 << 16;

/// The descriptions received so far, by topic.
#[derive(Debug, Default)]
pub(crate) struct HomeAssistantDiscovery {
    texts: BTreeMap<String, TopicEntities>,
}

/// The entities that the messages under one topic describe.
#[derive(Debug, Default)]
struct TopicEntities {
    /// The entities by their names in the message; the name is empty in a message about one entity.
    entities: BTreeMap<String, DescribedEntity>,
    /// Reason why the last message was invalid; the entities are then those of an earlier message.
    /// `None` if the last message was valid.
    problem: Option<String>,
}

#[derive(Clone, Debug)]
struct DescribedEntity {
    /// Identifiers and connections of the entity's device; there is at least one.
    keys: Vec<String>,
    device_name: Option<String>,
    /// The name of the entity itself.
    own_name: String,
    area: Option<String>,
    features: Vec<DeviceFeature>,
    unused: Option<UnusedFeature>,
}

impl HomeAssistantDiscovery {
    /// Handles a discovery message. An empty text withdraws the previous description of the topic.
    ///
    /// # Errors
    ///
    /// Returns the problem in words if the message is invalid, or if too many topics are known.
    pub(crate) fn receive_description(
        &mut self,
        prefix: &str,
        topic: &str,
        text: &str,
    ) -> Result<(), String> {
        if text.trim().is_empty() {
            self.texts.remove(topic);
            return Ok(());
        }
        if !self.texts.contains_key(topic) && self.texts.len() >= ENTITIES_MAX {
            return Err(format!("more than {ENTITIES_MAX} entities are announced"));
        }
        let within = topic.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('/'));
        let component = within.and_then(|within| within.split('/').next()).unwrap_or_default();
        let known = self.texts.entry(topic.to_owned()).or_default();
        let config = match EntityConfig::read(text) {
            Ok(config) => config,
            Err(problem) => {
                known.problem = Some(problem.clone());
                return Err(problem);
            }
        };
        let has_entities = known.entities.values().any(|entity| !entity.features.is_empty());
        if component == "device" && has_entities && config.components().is_empty() {
            let problem = "it has no components".to_owned();
            known.problem = Some(problem.clone());
            return Err(problem);
        }
        let object = object_of(topic, prefix, component);
        known.take(match component {
            "device" => whole(&config, object),
            component => vec![(String::new(), entity(component, config.with_base(), object))],
        })
    }

    /// Returns all devices in the descriptions.
    pub(crate) fn devices(&self) -> Vec<DescribedDevice> {
        let mut groups = DeviceGroups::default();
        for (topic, text) in &self.texts {
            let trouble = text.problem.as_ref().map(|problem| {
                UnusedFeature::because(format!(
                    "its last description (`{topic}`) cannot be read: {problem}"
                ))
            });
            for (number, entity) in text.entities.values().enumerate() {
                groups.add(entity, trouble.clone().filter(|_| number == 0));
            }
            // If no message of a device is valid, only its topic is known.
            if let Some(trouble) = trouble.filter(|_| text.entities.is_empty()) {
                let object = topic.trim_end_matches("/config");
                let object = object.splitn(3, '/').last().unwrap_or(object);
                groups.add(&unread(object), Some(trouble));
            }
        }
        groups.devices()
    }
}

impl TopicEntities {
    /// Replaces the entities by those of a new message. An entity with features keeps them if its
    /// new description is malformed.
    ///
    /// # Errors
    ///
    /// Returns the problem in words if one of the descriptions is malformed.
    fn take(&mut self, described: Vec<(String, EntityMessage)>) -> Result<(), String> {
        let mut earlier = std::mem::take(&mut self.entities);
        self.problem = None;
        for (name, EntityMessage { entity, malformed }) in described {
            let kept = earlier.remove(&name).filter(|kept| !kept.features.is_empty());
            match (malformed, kept) {
                (Some(problem), Some(kept)) => {
                    self.entities.insert(name, kept);
                    self.problem.get_or_insert(problem);
                }
                _ => drop(self.entities.insert(name, entity)),
            }
        }
        self.problem.clone().map_or(Ok(()), Err)
    }
}

/// A description of an entity, and the reason why the description is malformed; `None` if it is
/// well-formed.
struct EntityMessage {
    entity: DescribedEntity,
    malformed: Option<String>,
}

/// Returns the part of a topic that identifies the entity: `NODE/OBJECT` or `OBJECT`.
fn object_of<'t>(topic: &'t str, prefix: &str, component: &str) -> &'t str {
    let rest = topic.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('/'));
    let rest = rest.and_then(|rest| rest.strip_prefix(component)?.strip_prefix('/'));
    rest.and_then(|rest| rest.strip_suffix("/config")).unwrap_or(topic)
}

fn unread(object: &str) -> DescribedEntity {
    DescribedEntity {
        keys: vec![object.to_owned()],
        device_name: None,
        own_name: object.to_owned(),
        area: None,
        features: Vec::new(),
        unused: None,
    }
}

/// Entities, grouped into devices.
#[derive(Default)]
struct DeviceGroups {
    devices: Vec<Option<DeviceGroup>>,
    /// Index in `devices` of the device with an identifier, by identifier.
    by_key: HashMap<String, usize>,
}

#[derive(Default)]
struct DeviceGroup {
    keys: Vec<String>,
    name: Option<String>,
    own_name: String,
    area: Option<String>,
    features: Vec<DeviceFeature>,
    unused: Vec<UnusedFeature>,
}

impl DeviceGroups {
    fn add(&mut self, entity: &DescribedEntity, trouble: Option<UnusedFeature>) {
        let mut known: Vec<usize> =
            entity.keys.iter().filter_map(|key| self.by_key.get(key).copied()).collect();
        known.sort_unstable();
        known.dedup();
        let at = known.first().copied().unwrap_or_else(|| {
            self.devices.push(Some(DeviceGroup {
                own_name: entity.own_name.clone(),
                ..DeviceGroup::default()
            }));
            self.devices.len() - 1
        });
        // An entity that shares identifiers with several devices merges them into one device.
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

    fn devices(self) -> Vec<DescribedDevice> {
        let described = |group: DeviceGroup| {
            let mut keys = group.keys.into_iter();
            let id = keys.next().unwrap_or_default();
            DescribedDevice {
                name: group.name.unwrap_or(group.own_name),
                id,
                other_ids: keys.collect(),
                area: group.area,
                features: group.features,
                unused: group.unused,
            }
        };
        self.devices.into_iter().flatten().map(described).collect()
    }
}

/// Returns the entities in a message about a whole device, each with the name of its component.
fn whole(config: &EntityConfig, object: &str) -> Vec<(String, EntityMessage)> {
    let components = config.components();
    let is_said = config.0.get("components").and_then(Value::as_object);
    if is_said.is_none_or(Map::is_empty) {
        let nothing = UnusedFeature::because("its description has no components".to_owned());
        let entity = DescribedEntity { unused: Some(nothing), ..about(config, object) };
        return vec![(String::new(), EntityMessage { entity, malformed: None })];
    }
    let of = |(name, component): (String, EntityConfig)| match component.text("platform") {
        Some(platform) => {
            let platform = platform.to_owned();
            let entity = entity(&platform, component.with_base(), &name);
            (name, entity)
        }
        None => {
            let reason = format!("its component `{name}` has no `platform`");
            let unused = Some(UnusedFeature::because(reason.clone()));
            let entity = DescribedEntity { unused, ..about(&component, object) };
            (name, EntityMessage { entity, malformed: Some(reason) })
        }
    };
    components.into_iter().map(of).collect()
}

fn entity(component: &str, config: EntityConfig, object: &str) -> EntityMessage {
    let label = config.text("object_id").or_else(|| config.text("unique_id"));
    let label = label.or_else(|| config.text("name")).unwrap_or(object).to_owned();
    let (features, unused) = match component::features(component, &config, &label) {
        Ok(features) => (features, None),
        Err(unused) => (Vec::new(), Some(unused)),
    };
    // A description with features is well-formed.
    let malformed =
        if features.is_empty() { component::malformed(component, &config) } else { None };
    let entity = DescribedEntity { features, unused, ..about(&config, object) };
    EntityMessage { entity, malformed }
}

/// Returns an entity without features, with the data of its device from the config.
fn about(config: &EntityConfig, object: &str) -> DescribedEntity {
    let device = config.0.get("device").and_then(Value::as_object);
    // An `object_id` is not unique: entities of other nodes may have the same one.
    let own = config.text("unique_id").unwrap_or(object);
    let mut keys = device.map(identifiers).unwrap_or_default();
    if keys.is_empty() {
        keys.push(own.to_owned());
    }
    let of_device = |key: &str| {
        let text = device?.get(key)?.as_str()?.trim();
        (!text.is_empty()).then(|| text.to_owned())
    };
    DescribedEntity {
        own_name: config.text("name").map_or_else(|| keys[0].clone(), str::to_owned),
        device_name: of_device("name"),
        area: of_device("suggested_area"),
        keys,
        features: Vec::new(),
        unused: None,
    }
}

/// Returns the identifiers of a device, followed by its connections. Numbers are converted to
/// texts.
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

/// Returns the canonical spelling of the address of a network card; returns any other text
/// unchanged.
fn mac(address: &str) -> String {
    let digits: String =
        address.chars().filter(char::is_ascii_hexdigit).collect::<String>().to_ascii_lowercase();
    if digits.len() != 12 {
        return address.to_owned();
    }
    let pairs: Vec<_> = (0..6).map(|pair| &digits[2 * pair..2 * pair + 2]).collect();
    pairs.join(":")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_invalid_topic_or_template_keeps_the_earlier_features() {
        let mut discovery = HomeAssistantDiscovery::default();
        let topic = "homeassistant/sensor/t/config";
        let mut receive = |text: &str| {
            let received = discovery.receive_description("homeassistant", topic, text);
            (received, discovery.devices()[0].features.len())
        };
        let good = r#"{"uniq_id":"t","dev_cla":"temperature","stat_t":"t/state"}"#;
        assert_eq!(receive(good), (Ok(()), 1));
        for (bad, expected) in [
            (r##"{"uniq_id":"t","dev_cla":"temperature","stat_t":"t/#/state"}"##, "is no topic"),
            (
                r#"{"uniq_id":"t","dev_cla":"temperature","stat_t":"t","val_tpl":"{{ value. }}"}"#,
                "syntax error",
            ),
        ] {
            let (received, features) = receive(bad);
            let problem = received.expect_err(bad);
            assert!(problem.contains(expected), "{problem}");
            assert_eq!(features, 1, "{bad}");
        }
        // A template that uses an unknown function is valid, and makes the entity unusable.
        let other =
            r#"{"uniq_id":"t","dev_cla":"temperature","stat_t":"t","val_tpl":"{{ now() }}"}"#;
        assert_eq!(receive(other), (Ok(()), 0));
        assert_eq!(receive(good), (Ok(()), 1));
    }
}
