//! Runs the test corpus: messages of devices of many makes, and the expected outcome of each. The
//! files in `tests/corpus` were written for Althing, based on the documentation of each firmware.

use serde::Deserialize;

use crate::description::{DescribedDevice, OutgoingMessage};
use crate::device_agents::AssignedNames;
use crate::device_class::DeviceClasses;
use crate::feature_tracker::{ObservedValue, TextContent};
use crate::part::{ClassifiedFeature, DividedDevice};
use crate::setting::DeviceSetting;
use crate::{home_assistant, shelly, tasmota, zigbee2mqtt};

const FILES: &[(&str, &str)] = &[
    ("esphome", include_str!("../tests/corpus/esphome.toml")),
    ("home_assistant", include_str!("../tests/corpus/home_assistant.toml")),
    ("shelly", include_str!("../tests/corpus/shelly.toml")),
    ("tasmota", include_str!("../tests/corpus/tasmota.toml")),
    ("things", include_str!("../tests/corpus/things.toml")),
    ("zigbee2mqtt", include_str!("../tests/corpus/zigbee2mqtt.toml")),
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    case: Vec<Case>,
}

/// One case of the corpus: the messages of a device, and their expected outcome.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Case {
    about: String,
    /// Messages of the device, each as a topic and a text.
    said: Vec<[String; 2]>,
    /// Expected lines of `outcome`, in any order.
    becomes: Vec<String>,
}

/// Returns the outcome of the messages: the agents with their areas, the values of the agents, the
/// messages that switch and query each agent, and the parts of devices that cannot be used.
fn outcome(said: &[[String; 2]]) -> Vec<String> {
    let classes = DeviceClasses::with(&serde_json::Value::Null).expect("built in");
    let devices = devices(said);
    let mut lines = Vec::new();
    for (device, name) in devices.iter().zip(AssignedNames::default().names(&devices, |_| false)) {
        let DividedDevice { parts, problem } = DividedDevice::of(device, &classes);
        for (suffix, features) in &parts {
            let agent = format!("{name}{suffix}");
            let area = device.area.as_ref().map(|area| format!(" in {area}")).unwrap_or_default();
            lines.push(format!("{agent}{area}"));
            for known in features.iter().filter(|known| !known.is_observed_only) {
                lines.extend(of_feature(&agent, known, said));
            }
        }
        lines.extend(problem.map(|problem| format!("{name}: {problem}")));
    }
    lines
}

fn devices(said: &[[String; 2]]) -> Vec<DescribedDevice> {
    let mut bridge = zigbee2mqtt::ZigbeeDiscovery::default();
    let mut home_assistant = home_assistant::HomeAssistantDiscovery::default();
    let mut tasmota = tasmota::TasmotaDiscovery::default();
    let mut shelly = shelly::ShellyDiscovery::default();
    for [topic, text] in said {
        let _ = match topic {
            topic if topic == "zigbee2mqtt/bridge/devices" => {
                bridge.receive_devices("zigbee2mqtt", text)
            }
            topic if topic.starts_with("homeassistant/") => {
                home_assistant.receive_description("homeassistant", topic, text)
            }
            topic if topic.starts_with("tasmota/discovery/") => {
                tasmota.receive_discovery(topic, text)
            }
            topic => {
                shelly.receive_report(topic, text);
                Ok(())
            }
        };
    }
    let mut devices = home_assistant.devices();
    devices.extend(bridge.devices());
    devices.extend(tasmota.devices());
    devices.extend(shelly.devices());
    devices
}

fn of_feature(agent: &str, known: &ClassifiedFeature, said: &[[String; 2]]) -> Vec<String> {
    let mut lines = Vec::new();
    let mut last = None;
    for [topic, text] in said {
        for (number, source) in known.feature.states.iter().enumerate() {
            if source.topic == *topic
                && let Some(word) = known.read(number, text)
            {
                last = Some(word);
            }
        }
    }
    let name = &known.name;
    lines.extend(last.map(|word| match word {
        TextContent::Is(ObservedValue::Number(number)) => format!("{agent} {name} {number}"),
        TextContent::Is(ObservedValue::Yes(is_so)) => {
            format!("{agent} {name} {}", if is_so { "yes" } else { "no" })
        }
        TextContent::Is(ObservedValue::Option(index)) => {
            format!("{agent} {name} {}", known.options()[index].name)
        }
        TextContent::NotKnown(_) => format!("{agent} {name} not known"),
    }));
    let feature = &known.feature;
    lines.extend(of_setting(agent, known));
    if let Some(command) = &feature.command {
        for (what, told) in [("on", &command.on), ("off", &command.off)] {
            let kept = if told.is_retained { " (kept)" } else { "" };
            lines.push(format!("{agent} {what}: {} {}{kept}", told.topic, told.text));
        }
    }
    lines.extend(
        feature.value_request.iter().map(|ask| format!("{agent} asks: {} {}", ask.topic, ask.text)),
    );
    if let Some(expires) = feature.expires {
        lines.push(format!("{agent} {name} expires after {expires:?}"));
    }
    if let Some(delay) = feature.off_delay {
        lines.push(format!("{agent} {name} is off after {delay:?}"));
    }
    lines
}

/// Returns the values that a feature can be set to: the lowest, the middle and the highest level,
/// or all options, with their messages.
fn of_setting(agent: &str, known: &ClassifiedFeature) -> Vec<String> {
    let name = &known.name;
    let line = |value: &str, message: &OutgoingMessage| {
        let kept = if message.is_retained { " (kept)" } else { "" };
        format!("{agent} {name} {value}: {} {}{kept}", message.topic, message.text)
    };
    let mut lines = Vec::new();
    if let Some(levels) = known.levels() {
        let all = &levels.levels;
        lines.push(format!("{agent} {name} has {} levels", all.len()));
        let shown = [0, all.len() / 2, all.len() - 1].map(|index| &all[index]);
        lines.extend(shown.map(|level| line(&level.name, &level.message)));
        lines.extend(levels.stop.iter().map(|stop| line("stop", stop)));
    }
    for option in known.options() {
        match &option.message {
            Some(message) => lines.push(line(&option.name, message)),
            None => lines.push(format!("{agent} {name} {} is pressed", option.name)),
        }
    }
    if let Some(DeviceSetting::Trigger(message)) = &known.feature.setting {
        lines.push(line("triggers", message));
    }
    lines
}

#[test]
fn every_case_of_the_corpus_has_its_expected_outcome() {
    let mut wrong = Vec::new();
    for (file, text) in FILES {
        let File { case } = toml::from_str(text).unwrap_or_else(|error| panic!("{file}: {error}"));
        for Case { about, said, becomes } in case {
            let (mut outcome, mut expected) = (outcome(&said), becomes);
            outcome.sort();
            outcome.dedup();
            expected.sort();
            if outcome != expected {
                let all = |lines: &[String]| {
                    lines.iter().map(|line| format!("    {line:?},\n")).collect::<String>()
                };
                wrong.push(format!(
                    "{file}: {about}\n  is\n{}  not\n{}",
                    all(&outcome),
                    all(&expected)
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Checks that the corpus has every component in Home Assistant's documentation.
#[test]
fn every_component_of_home_assistant_is_in_the_corpus() {
    let (_, text) = FILES[1];
    for component in [
        "alarm_control_panel",
        "binary_sensor",
        "button",
        "camera",
        "climate",
        "cover",
        "device_automation",
        "device_tracker",
        "event",
        "fan",
        "humidifier",
        "image",
        "lawn_mower",
        "light",
        "lock",
        "notify",
        "number",
        "scene",
        "select",
        "sensor",
        "siren",
        "switch",
        "tag",
        "text",
        "update",
        "vacuum",
        "valve",
        "water_heater",
    ] {
        assert!(text.contains(&format!("homeassistant/{component}/")), "{component}");
    }
}
