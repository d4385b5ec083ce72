//! The discovery messages of Tasmota devices: `tasmota/discovery/MAC/config` and `…/sensors`.
//! `tasmota_things` describes what is set or pressed.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::description::{
    Availability, AvailabilityMode, AvailabilityTopic, DescribedDevice, DeviceFeature,
    OutgoingMessage, SwitchCommand, UnusedFeature, ValueSource,
};

/// Indices of the topic prefixes of a device: for commands, for answers, and for reports that the
/// device sends by itself.
pub(crate) const CMND: usize = 0;
pub(crate) const STAT: usize = 1;
pub(crate) const TELE: usize = 2;

/// Prefixes of the names of chips that measure the device itself instead of the room.
const CHIPS: &[&str] = &["ESP32", "ENERGY", "AXP", "MPU", "BL09", "Shelly"];

fn is_chip(name: &str) -> bool {
    CHIPS.iter().any(|chip| name.starts_with(chip))
}

/// Descriptions received so far, by the address of the device: its config and its sensors.
#[derive(Debug, Default)]
pub(crate) struct TasmotaDiscovery {
    devices: BTreeMap<String, (Value, Value)>,
    /// Reason why the last message on a topic was invalid, by the address of the device and the
    /// last level of the topic. The description of the device is then that of an earlier message.
    problems: BTreeMap<(String, String), String>,
}

impl TasmotaDiscovery {
    /// Handles a discovery message. An empty text withdraws the previous description of the topic.
    ///
    /// # Errors
    ///
    /// Returns the problem in words if the message is invalid.
    pub(crate) fn receive_discovery(&mut self, topic: &str, text: &str) -> Result<(), String> {
        let mut levels = topic.rsplit('/');
        let (Some(what), Some(address)) = (levels.next(), levels.next()) else { return Ok(()) };
        let known = self.devices.get(address);
        let said = match text.trim().is_empty() {
            true => Ok(Value::Null),
            false => read(what, text, known),
        };
        let place = (address.to_owned(), what.to_owned());
        let said = match said {
            Ok(said) => said,
            Err(problem) => {
                if known.is_some() {
                    self.problems.insert(place, format!("`{topic}`: {problem}"));
                }
                return Err(problem);
            }
        };
        self.problems.remove(&place);
        let device = self.devices.entry(address.to_owned()).or_default();
        match what {
            "config" => device.0 = said,
            "sensors" => device.1 = said,
            _ => (),
        }
        if device.0.is_null() && device.1.is_null() {
            self.devices.remove(address);
            self.problems.retain(|(of, _), _| of != address);
        }
        Ok(())
    }

    /// Returns all devices in the descriptions.
    pub(crate) fn devices(&self) -> Vec<DescribedDevice> {
        let described = |(address, (config, sensors)): (&String, &(Value, Value))| {
            let mut device = described(address, config, sensors)?;
            let of_device = self.problems.iter().filter(|((of, _), _)| of == address);
            for (_, problem) in of_device {
                let reason = format!("its last description cannot be read: {problem}");
                device.unused.push(UnusedFeature::because(reason));
            }
            Some(device)
        };
        self.devices.iter().filter_map(described).collect()
    }
}

/// Parses a discovery message. `known` has the previous config and sensors of the device.
///
/// # Errors
///
/// Returns the problem in words if the text is not JSON, or lacks a part of the previous
/// description, because such a message is not an update.
fn read(what: &str, text: &str, known: Option<&(Value, Value)>) -> Result<Value, String> {
    let said: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let lacks = |before: &Value, key: &str| {
        let is_alike = |value: &Value| match before[key] {
            Value::String(_) => value.is_string(),
            Value::Array(_) => value.is_array(),
            Value::Object(_) => value.is_object(),
            _ => true,
        };
        (!is_alike(&said[key])).then(|| format!("it has no `{key}` as before"))
    };
    let problem = match (what, known) {
        ("config", Some((before, _))) => {
            ["t", "ft", "tp", "rl"].iter().find_map(|key| lacks(before, key))
        }
        ("sensors", Some((_, before))) => lacks(before, "sn"),
        _ => None,
    };
    problem.map_or(Ok(said), Err)
}

/// The config message of a device, with the device's topics and texts.
pub(crate) struct TasmotaConfig<'c> {
    pub(crate) said: &'c Value,
    /// Topic of the device itself, which is a part of its full topics.
    own: &'c str,
    /// Address of the device's network card.
    address: &'c str,
}

impl<'c> TasmotaConfig<'c> {
    fn of(said: &'c Value, address: &'c str) -> Option<TasmotaConfig<'c>> {
        let address = said["mac"].as_str().unwrap_or(address);
        Some(TasmotaConfig { said, own: said["t"].as_str()?, address })
    }

    fn text(&self, key: &str) -> Option<&'c str> {
        self.said[key].as_str()
    }

    /// Returns the full topic of commands (`cmnd`, prefix 0), of answers (`stat`, 1) or of reports
    /// (`tele`, 2).
    pub(crate) fn topic(&self, prefix: usize, what: &str) -> String {
        let usual = ["cmnd", "stat", "tele"][prefix];
        let prefix = self.said["tp"][prefix].as_str().unwrap_or(usual);
        let full = self.text("ft").unwrap_or("%prefix%/%topic%/");
        let digits: String = self.address.chars().filter(char::is_ascii_hexdigit).collect();
        let id = digits.get(digits.len().saturating_sub(6)..).unwrap_or_default();
        let full = full.replace("%prefix%", prefix).replace("%topic%", self.own);
        let full = full.replace("%hostname%", self.text("hn").unwrap_or_default());
        full.replace("%id%", &id.to_ascii_uppercase()) + what
    }

    fn word(&self, index: usize, otherwise: &str) -> String {
        self.said["state"][index].as_str().unwrap_or(otherwise).to_owned()
    }

    /// Returns the kind of each relay of the device: 0 none, 1 a relay, 2 a lamp, 3 part of a
    /// shutter.
    pub(crate) fn relays(&self) -> Vec<u64> {
        let relays = self.said["rl"].as_array().into_iter().flatten();
        relays.map(|relay| relay.as_u64().unwrap_or(0)).collect()
    }

    fn relay(&self, index: usize, kind: u64, is_alone: bool) -> Option<DeviceFeature> {
        // Option 30 means that all relays of the device switch lamps.
        let is_lamp = self.said["so"]["30"].as_u64() == Some(1);
        let class = match kind {
            1 if !is_lamp => "switch",
            1 | 2 => "light",
            _ => return None,
        };
        let power = if is_alone { "POWER".to_owned() } else { format!("POWER{}", index + 1) };
        let states = |power: &str| {
            [
                ValueSource::whole(self.topic(STAT, power)),
                ValueSource::at(self.topic(STAT, "RESULT"), &[power]),
                ValueSource::at(self.topic(TELE, "STATE"), &[power]),
            ]
        };
        let mut said = states(&power).to_vec();
        // If option 26 is set, a single relay reports under its number as well.
        if is_alone {
            said.extend(states("POWER1"));
        }
        let (on, off) = (self.word(1, "ON"), self.word(0, "OFF"));
        let command = self.topic(CMND, &power);
        Some(DeviceFeature {
            states: said,
            yes: vec![on.clone()],
            no: vec![off.clone()],
            command: Some(SwitchCommand {
                on: OutgoingMessage::new(command.as_str(), on),
                off: OutgoingMessage::new(command, off),
            }),
            value_request: Some(OutgoingMessage::new(self.topic(CMND, "STATE"), "")),
            ..DeviceFeature::named(class, &power.to_lowercase())
        })
    }

    fn availability(&self) -> Availability {
        let voice = AvailabilityTopic {
            source: ValueSource::whole(self.topic(TELE, "LWT")),
            online: self.text("onln").unwrap_or("Online").to_owned(),
            offline: self.text("ofln").unwrap_or("Offline").to_owned(),
            is_online_at_first: true,
        };
        Availability { topics: vec![voice], mode: AvailabilityMode::Latest }
    }
}

fn described(address: &str, config: &Value, sensors: &Value) -> Option<DescribedDevice> {
    let said = config;
    let Some(config) = TasmotaConfig::of(config, address) else {
        // If only the sensors of a device are known so far, its config will follow soon.
        let name = said["dn"].as_str().filter(|name| !name.is_empty()).unwrap_or(address);
        let no_topic = UnusedFeature::because("its description does not say its topic (`t`)");
        return (!said.is_null()).then(|| DescribedDevice {
            name: name.to_owned(),
            id: address.to_owned(),
            other_ids: Vec::new(),
            area: None,
            features: Vec::new(),
            unused: vec![no_topic],
        });
    };
    let relays = config.relays();
    let is_alone = relays.iter().filter(|kind| **kind != 0).count() <= 1;
    let of = |(index, kind): (usize, &u64)| config.relay(index, *kind, is_alone);
    let mut features: Vec<_> = relays.iter().enumerate().filter_map(of).collect();
    // The levels of a device are those of its only light.
    if features.iter().filter(|feature| feature.class == "light").count() == 1
        && let Some(light) = features.iter_mut().find(|feature| feature.class == "light")
    {
        let thing = light.label.clone();
        light.thing = Some(thing.clone());
        features.extend(config.light_levels(&thing));
    }
    features.extend(config.things());
    let sources = [(TELE, "SENSOR"), (STAT, "STATUS10"), (STAT, "STATUS8")];
    let sources = sources.map(|(prefix, what)| config.topic(prefix, what));
    let ask = OutgoingMessage::new(config.topic(CMND, "STATUS"), "10");
    features.extend(measured(&sensors["sn"], &sources, &ask));
    features.extend(config.meters(&sensors["sn"], &ask));
    for feature in &mut features {
        feature.availability = config.availability();
    }
    let chips = sensors["sn"].as_object().into_iter().flatten();
    let chips = chips.filter(|(chip, values)| values.is_object() && is_chip(chip));
    let mut unused: Vec<_> = chips
        .map(|(chip, _)| {
            UnusedFeature::as_usual(format!("its `{chip}` measures the device itself"))
        })
        .collect();
    if let Some(problem) = mqtt_link::topic_problem(&config.topic(CMND, "STATE")) {
        features.clear();
        unused.push(UnusedFeature::because(problem));
    }
    Some(DescribedDevice {
        name: config.text("dn").filter(|name| !name.is_empty()).unwrap_or(config.own).to_owned(),
        id: address.to_owned(),
        other_ids: vec![config.own.to_owned()],
        area: None,
        features,
        unused,
    })
}

/// Returns the features of a device's sensors, from a text such as `{"SI7021": {"Temperature":
/// 21.5}, "TempUnit": "C"}`.
fn measured(sensors: &Value, topics: &[String; 3], ask: &OutgoingMessage) -> Vec<DeviceFeature> {
    let unit_of_temperature = sensors["TempUnit"].as_str().unwrap_or("C");
    let chips = sensors.as_object().into_iter().flatten();
    let mut features = Vec::new();
    for (chip, values) in chips {
        let Some(values) = values.as_object() else { continue };
        let has_humidity = values.contains_key("Humidity");
        // The temperature of a chip differs from that of the room.
        if is_chip(chip) {
            continue;
        }
        for key in values.keys() {
            let class = key.to_ascii_lowercase();
            let (class, unit) = match class.as_str() {
                "temperature" => ("temperature", format!("°{unit_of_temperature}")),
                "carbondioxide" => ("carbon_dioxide", "ppm".to_owned()),
                "illuminance" => ("illuminance", "lx".to_owned()),
                other => (other, String::new()),
            };
            let [said, status, older] = topics;
            features.push(DeviceFeature {
                states: vec![
                    ValueSource::at(said.as_str(), &[chip, key]),
                    ValueSource::at(status.as_str(), &["StatusSNS", chip, key]),
                    ValueSource::at(older.as_str(), &["StatusSNS", chip, key]),
                ],
                unit,
                yes: vec!["ON".to_owned()],
                no: vec!["OFF".to_owned()],
                value_request: Some(ask.clone()),
                // A chip that also measures humidity is made for rooms.
                rank: u8::from(!has_humidity),
                ..DeviceFeature::named(class, &format!("{chip}-{key}"))
            });
        }
    }
    features
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A config message of Tasmota 13, shortened to the keys that are used.
    const CONFIG: &str = r#"{"ip":"192.168.1.20","dn":"Desk","fn":["Lamp",null],"hn":"tasmota-d1e2f3",
        "mac":"A4CF12D1E2F3","md":"Sonoff TH","ofln":"Offline","onln":"Online","state":["OFF","ON","TOGGLE","HOLD"],
        "sw":"13.1.0","t":"tasmota_D1E2F3","ft":"%prefix%/%topic%/","tp":["cmnd","stat","tele"],
        "rl":[1,0,0,0],"ver":1}"#;
    const SENSORS: &str = r#"{"sn":{"Time":"2026-11-22T10:00:00","SI7021":{"Temperature":21.5,"Humidity":40.1},"TempUnit":"C"},"ver":1}"#;

    #[test]
    fn relays_and_sensors_become_features() {
        let mut discovery = TasmotaDiscovery::default();
        discovery
            .receive_discovery("tasmota/discovery/A4CF12D1E2F3/config", CONFIG)
            .expect("understood");
        discovery
            .receive_discovery("tasmota/discovery/A4CF12D1E2F3/sensors", SENSORS)
            .expect("understood");
        let devices = discovery.devices();
        let device = &devices[0];
        assert_eq!(device.name, "Desk");
        let command = device.features[0].command.as_ref().expect("a relay");
        assert_eq!(
            (command.on.topic.as_str(), command.on.text.as_str()),
            ("cmnd/tasmota_D1E2F3/POWER", "ON")
        );
        let classes: Vec<_> =
            device.features.iter().map(|feature| feature.class.as_str()).collect();
        assert_eq!(classes, ["switch", "humidity", "temperature"]);
        let availability = &device.features[0].availability.topics[0];
        assert_eq!(availability.source.topic, "tele/tasmota_D1E2F3/LWT");
        let asked = OutgoingMessage::new("cmnd/tasmota_D1E2F3/STATE", "");
        assert_eq!(device.features[0].value_request, Some(asked));
        assert_eq!(device.features[2].states.len(), 3);
        assert!(discovery.receive_discovery("tasmota/discovery/X/config", "{").is_err());
        assert!(discovery.receive_discovery("tasmota/discovery/A4CF12D1E2F3/config", "{").is_err());
        let reason = &discovery.devices()[0].unused[0].reason;
        assert!(reason.contains("its last description cannot be read"), "{reason}");
        // JSON of another form does not change the description either.
        for (what, text) in [
            ("config", r#"{"ver":1}"#),
            ("config", "{}"),
            ("config", "5"),
            ("config", r#"{"t":7,"rl":[1]}"#),
            (
                "config",
                r#"{"t":"tasmota_D1E2F3","ft":"%prefix%/%topic%/","tp":["cmnd","stat","tele"]}"#,
            ),
            ("sensors", "[]"),
            ("sensors", r#"{"ver":1}"#),
        ] {
            let topic = format!("tasmota/discovery/A4CF12D1E2F3/{what}");
            assert!(discovery.receive_discovery(&topic, text).is_err(), "{text}");
            let device = &discovery.devices()[0];
            assert_eq!(device.features.len(), 3, "{text}");
            assert!(!device.unused.is_empty(), "{text}");
        }
        for (what, text) in [("config", CONFIG), ("sensors", SENSORS)] {
            let topic = format!("tasmota/discovery/A4CF12D1E2F3/{what}");
            discovery.receive_discovery(&topic, text).expect("it can be read again");
        }
        assert!(discovery.devices()[0].unused.is_empty());
        discovery
            .receive_discovery("tasmota/discovery/A4CF12D1E2F3/config", "")
            .expect("taken back");
        assert!(discovery.devices().is_empty());
    }
}
