//! Topics of Shelly devices. Devices of the first generation report everything under
//! `shellies/NAME/…`. Later generations report their state under `ID/status/…` and `ID/events/rpc`,
//! and receive commands as calls under `ID/rpc`.
//!
//! Shelly devices send no descriptions; their features follow from the topics of their reports.
//! `shelly_calls` has the calls of later generations.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use crate::description::{
    Availability, AvailabilityMode, AvailabilityTopic, DescribedDevice, DeviceFeature,
    OutgoingMessage, SwitchCommand, UnusedFeature, ValueSource,
};
use crate::setting::{DeviceSetting, LevelSetting, NumberMessage};
use crate::shelly_calls::ShellyCalls;

/// Prefix of the factory-set names of devices.
const BEGINNING: &str = "shelly";

/// Suffix of the topic for events. The texts of this topic are about different parts of a device.
pub(crate) const EVENTS: &str = "/events/rpc";

/// Maximum number of devices that are kept; further devices are ignored.
const DEVICES_MAX: usize = 4_096;

/// Suffix of the name of a part that measures its power.
const METER: &str = " meter";

/// Maximum number of parts of one device that are kept; further parts are ignored.
const PARTS_MAX: usize = 64;

/// Parts of devices in the reports so far, by the name of the device: for the first generation and
/// for later ones.
#[derive(Debug, Default)]
pub(crate) struct ShellyDiscovery {
    first: BTreeMap<String, BTreeSet<String>>,
    second: BTreeMap<String, BTreeSet<String>>,
}

/// Returns the topic filters that the gateway subscribes to for Shelly devices.
pub(crate) fn filters() -> [String; 5] {
    [
        "shellies/+/online".to_owned(),
        "shellies/+/+/+".to_owned(),
        "+/online".to_owned(),
        "+/status/+".to_owned(),
        format!("+{EVENTS}"),
    ]
}

/// Whether a topic is a topic of Shelly devices.
pub(crate) fn is_own(topic: &str) -> bool {
    topic.starts_with("shellies/") || topic.starts_with(BEGINNING)
}

impl ShellyDiscovery {
    /// Handles a message. Returns `true` if it shows a new device or a new part.
    pub(crate) fn receive_report(&mut self, topic: &str, text: &str) -> bool {
        let levels: Vec<_> = topic.split('/').collect();
        match levels[..] {
            ["shellies", name, "online"] => note(&mut self.first, name, None),
            // `…/relay/0/command` is a command; `…/relay/0/power` has one level more and does not
            // match.
            ["shellies", name, kind, number] if number != "command" => {
                note(&mut self.first, name, Some(format!("{kind}/{number}")))
            }
            [name, "online"] if name.starts_with(BEGINNING) => note(&mut self.second, name, None),
            [name, "status", part] if name.starts_with(BEGINNING) => {
                let has_meter = serde_json::from_str::<Value>(text)
                    .is_ok_and(|json| json["apower"].is_number());
                let is_new = note(&mut self.second, name, Some(part.to_owned()));
                let meter = has_meter.then(|| format!("{part}{METER}"));
                let has_new = meter.is_some_and(|part| note(&mut self.second, name, Some(part)));
                is_new | has_new
            }
            [name, "events", "rpc"] if name.starts_with(BEGINNING) => {
                let json: Value = serde_json::from_str(text).unwrap_or_default();
                let parts = json["params"].as_object().into_iter().flatten();
                let parts = parts.filter(|(part, _)| part.contains(':'));
                let mut is_new = note(&mut self.second, name, None);
                for (part, _) in parts {
                    is_new |= note(&mut self.second, name, Some(part.clone()));
                }
                is_new
            }
            _ => false,
        }
    }

    /// Returns all devices that have sent a report.
    pub(crate) fn devices(&self) -> Vec<DescribedDevice> {
        let first = self.first.iter().map(|(name, parts)| of_first(name, parts));
        first.chain(self.second.iter().map(|(name, parts)| of_second(name, parts))).collect()
    }
}

fn note(
    devices: &mut BTreeMap<String, BTreeSet<String>>,
    name: &str,
    part: Option<String>,
) -> bool {
    if !devices.contains_key(name) && devices.len() >= DEVICES_MAX {
        return false;
    }
    let is_new = !devices.contains_key(name);
    let parts = devices.entry(name.to_owned()).or_default();
    let is_more = part.is_some_and(|part| parts.len() < PARTS_MAX && parts.insert(part));
    is_new || is_more
}

fn described(
    name: &str,
    online: String,
    mut features: Vec<DeviceFeature>,
    unused: Vec<UnusedFeature>,
) -> DescribedDevice {
    let voice = AvailabilityTopic {
        source: ValueSource::whole(online),
        online: "true".to_owned(),
        offline: "false".to_owned(),
        is_online_at_first: true,
    };
    // A device with a battery sleeps, and is offline meanwhile. Therefore only features that are
    // switched have availability.
    let is_set = |feature: &&mut DeviceFeature| feature.command_topic().is_some();
    for feature in features.iter_mut().filter(is_set) {
        let voices = vec![voice.clone()];
        feature.availability = Availability { topics: voices, mode: AvailabilityMode::Latest };
    }
    let (name, id) = (name.to_owned(), name.to_owned());
    DescribedDevice { name, id, other_ids: Vec::new(), area: None, features, unused }
}

fn of_first(name: &str, parts: &BTreeSet<String>) -> DescribedDevice {
    let mut features = Vec::new();
    let base = format!("shellies/{name}");
    for part in parts {
        let (kind, number) = part.split_once('/').unwrap_or((part, ""));
        let states = vec![ValueSource::whole(format!("{base}/{part}"))];
        let word = |word: &str| vec![word.to_owned()];
        let numbered = |class: &str, unit: &str| DeviceFeature {
            states: states.clone(),
            unit: unit.to_owned(),
            ..DeviceFeature::named(class, part)
        };
        match (kind, number) {
            ("relay" | "light" | "color" | "white", _) if number.parse::<u8>().is_ok() => {
                let class = if kind == "relay" { "switch" } else { "light" };
                let told =
                    |text: &str| OutgoingMessage::new(format!("{base}/{part}/command"), text);
                if matches!(kind, "light" | "white") {
                    features.push(first_brightness(&base, part));
                }
                features.push(DeviceFeature {
                    thing: Some(part.clone()),
                    yes: word("on"),
                    no: word("off"),
                    // The relay has switched itself off without reporting the state `off`.
                    neither: word("overpower"),
                    command: Some(SwitchCommand { on: told("on"), off: told("off") }),
                    value_request: Some(OutgoingMessage::new(format!("{base}/command"), "update")),
                    ..numbered(class, "")
                });
            }
            ("roller", _) if number.parse::<u8>().is_ok() => {
                features.extend(first_roller(&base, part));
            }
            ("sensor", "temperature") => features.push(numbered("temperature", "°C")),
            ("sensor", "humidity") => features.push(numbered("humidity", "%")),
            ("sensor", "lux") => features.push(numbered("illuminance", "lx")),
            ("sensor", "motion") => {
                let (yes, no) = (
                    vec!["1".to_owned(), "true".to_owned()],
                    vec!["0".to_owned(), "false".to_owned()],
                );
                features.push(DeviceFeature { yes, no, ..numbered("motion", "") });
            }
            ("sensor", "state") => features.push(DeviceFeature {
                yes: word("open"),
                no: vec!["close".to_owned(), "closed".to_owned()],
                ..numbered("opening", "")
            }),
            _ => (),
        }
    }
    described(name, format!("{base}/online"), features, Vec::new())
}

/// Returns the brightness of a lamp of the first generation.
fn first_brightness(base: &str, part: &str) -> DeviceFeature {
    let body = json!({ "turn": "on", "brightness": null });
    let message = NumberMessage::json(format!("{base}/{part}/set"), body, "/brightness");
    let setting = LevelSetting { min: 1.0, switches_on: true, ..LevelSetting::percent(message) };
    DeviceFeature {
        states: vec![ValueSource::at(format!("{base}/{part}/status"), &["brightness"])],
        value_request: Some(OutgoingMessage::new(format!("{base}/command"), "update")),
        setting: Some(DeviceSetting::Level(setting)),
        thing: Some(part.to_owned()),
        ..DeviceFeature::named("brightness", part)
    }
}

/// Returns a roller of the first generation: a motor that opens and closes, with a position.
fn first_roller(base: &str, part: &str) -> [DeviceFeature; 2] {
    let told = |text: &str| OutgoingMessage::new(format!("{base}/{part}/command"), text);
    let message = NumberMessage::plain(format!("{base}/{part}/command/pos"));
    let setting = LevelSetting { stop: Some(told("stop")), ..LevelSetting::percent(message) };
    let feature = |class: &str| DeviceFeature {
        thing: Some(part.to_owned()),
        ..DeviceFeature::named(class, part)
    };
    let switch = DeviceFeature {
        command: Some(SwitchCommand { on: told("open"), off: told("close") }),
        ..feature("cover")
    };
    let position = DeviceFeature {
        states: vec![ValueSource::whole(format!("{base}/{part}/pos"))],
        value_request: Some(OutgoingMessage::new(format!("{base}/command"), "update")),
        setting: Some(DeviceSetting::Level(setting)),
        ..feature("cover_position")
    };
    [switch, position]
}

fn of_second(name: &str, parts: &BTreeSet<String>) -> DescribedDevice {
    let (mut features, mut unused) = (Vec::new(), Vec::new());
    let calls = ShellyCalls::of(name);
    for part in parts {
        if let Some(part) = part.strip_suffix(METER) {
            features.extend(calls.meters(part));
            continue;
        }
        let (kind, number) = part.split_once(':').unwrap_or((part, ""));
        let number: Option<u32> = number.parse().ok();
        match (kind, number) {
            ("switch", Some(number)) => features.push(calls.switch(part, kind, number)),
            ("light", Some(number)) => {
                features.push(calls.switch(part, kind, number));
                features.push(calls.brightness(part, number));
            }
            ("cover", Some(number)) => features.extend(calls.cover(part, number)),
            ("temperature", Some(_)) => {
                features.push(calls.measured("temperature", part, "tC", "°C"));
            }
            ("humidity", Some(_)) => features.push(calls.measured("humidity", part, "rh", "%")),
            ("illuminance", Some(_)) => {
                features.push(calls.measured("illuminance", part, "lux", "lx"));
            }
            ("rgb" | "rgbw" | "cct" | "thermostat", Some(_)) => {
                unused
                    .push(UnusedFeature::because(format!("its {kind}: there is no class for it")));
            }
            _ => (),
        }
    }
    described(name, format!("{name}/online"), features, unused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_device_follow_from_its_topics() {
        let mut discovery = ShellyDiscovery::default();
        for (topic, text, is_new) in [
            ("shellies/shelly1-A1/online", "true", true),
            ("shellies/shelly1-A1/relay/0", "off", true),
            ("shellies/shelly1-A1/relay/0", "on", false),
            ("shellies/shelly1-A1/input/0", "0", true),
            ("shellyplus1-b2/online", "true", true),
            (
                "shellyplus1-b2/events/rpc",
                r#"{"method":"NotifyStatus","params":{"ts":1,"switch:0":{"id":0,"output":true}}}"#,
                true,
            ),
            ("shellyhtg3-c3/status/temperature:0", r#"{"id":0,"tC":21.5,"tF":70.7}"#, true),
            ("other/status/x", "1", false),
            ("shellyplus1-b2/events/rpc", "{", false),
        ] {
            assert_eq!(discovery.receive_report(topic, text), is_new, "{topic}");
        }
        let devices = discovery.devices();
        let names: Vec<_> = devices.iter().map(|device| device.name.as_str()).collect();
        assert_eq!(names, ["shelly1-A1", "shellyhtg3-c3", "shellyplus1-b2"]);
        let relay = devices[0].features[0].command.as_ref().expect("it is switched");
        assert_eq!(relay.on, OutgoingMessage::new("shellies/shelly1-A1/relay/0/command", "on"));
        let relay = devices[2].features[0].command.as_ref().expect("it is switched");
        assert_eq!(relay.on.topic, "shellyplus1-b2/rpc");
        assert!(relay.on.text.contains(r#""params":{"id":0,"on":true}"#), "{}", relay.on.text);
        assert_eq!(devices[1].features[0].class, "temperature");
    }
}
