//! Converts the features that a device of Zigbee2MQTT exposes into features that are measured, set,
//! triggered or pressed.
//!
//! A *specific* feature (`light`, `cover`, `fan`, `climate` …) contains the properties of one
//! thing. A *generic* one (`numeric`, `binary`, `enum`) stands alone.

use serde::Deserialize;
use serde_json::{Value, json};

use crate::color::{COLORS, NamedColor};
use crate::description::{
    DeviceFeature, OutgoingMessage, ReadingMethod, SwitchCommand, UnusedFeature, ValueSource,
};
use crate::setting::{DeviceSetting, LevelSetting, NumberMessage, NumberScale, PressText};

/// A feature that a device exposes.
#[derive(Deserialize)]
pub(crate) struct ExposedFeature {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    name: String,
    property: Option<String>,
    unit: Option<String>,
    /// Access to the feature, as bits: 1 if the device reports it, 2 if it can be set, 4 if its
    /// value can be requested.
    #[serde(default)]
    access: u8,
    value_on: Option<Value>,
    value_off: Option<Value>,
    /// Bounds of a number, which may be missing or of any type.
    #[serde(default)]
    value_min: Value,
    #[serde(default)]
    value_max: Value,
    #[serde(default)]
    value_step: Value,
    /// Values of an enumeration, which may be of any type.
    #[serde(default)]
    values: Value,
    #[serde(default)]
    features: Vec<ExposedFeature>,
}

const SAYS: u8 = 1;
const SET: u8 = 2;
const ASKED: u8 = 4;

/// Properties of things, each with the kind of the thing and the device class.
const LEVELS: &[(&str, &str, &str)] = &[
    ("light", "brightness", "brightness"),
    ("light", "color_temp", "color_temp"),
    ("cover", "position", "cover_position"),
    ("cover", "tilt", "cover_tilt"),
    ("fan", "speed", "fan_speed"),
    ("climate", "occupied_heating_setpoint", "heating_setpoint"),
    ("climate", "current_heating_setpoint", "heating_setpoint"),
    ("climate", "occupied_cooling_setpoint", "cooling_setpoint"),
];

/// Choices of things, each with the kind of the thing and the device class.
const CHOICES: &[(&str, &str, &str)] = &[
    ("fan", "mode", "fan_mode"),
    ("climate", "system_mode", "thermostat_mode"),
    ("climate", "preset", "thermostat_program"),
    ("climate", "fan_mode", "thermostat_fan"),
];

/// Converts a feature that a device on the topic `topic` exposes.
pub(crate) fn features_of(
    expose: &ExposedFeature,
    topic: &str,
    features: &mut Vec<DeviceFeature>,
    unused: &mut Vec<UnusedFeature>,
) {
    match expose.kind.as_str() {
        "numeric" | "binary" if expose.access & SAYS != 0 => {
            features.push(heard(expose, topic, measured(expose)));
        }
        "enum" if expose.name == "action" && expose.access & SAYS != 0 => {
            let presses = expose.options().map(PressText::named).collect();
            let setting = Some(DeviceSetting::Press(presses));
            let feature = DeviceFeature { setting, ..DeviceFeature::named("action", "action") };
            // A press is no state, and must not be requested.
            let feature = heard(expose, topic, feature);
            features.push(DeviceFeature { value_request: None, ..feature });
        }
        "switch" | "light" | "lock" | "fan" => {
            let before = features.len();
            let switch = part(expose, "state").filter(|part| part.access & SET != 0);
            match switch {
                Some(part) if is_setting(&expose.kind, part) => {
                    let (kind, property) = (&expose.kind, part.property());
                    unused.push(UnusedFeature::as_usual(format!(
                        "its {kind} `{property}` is a setting of the device"
                    )));
                    return;
                }
                Some(part) => features.extend(switched(&expose.kind, part, topic)),
                None if expose.kind != "fan" => return,
                None => (),
            }
            settings(expose, topic, features);
            name_thing(expose, &mut features[before..]);
        }
        "cover" => {
            let before = features.len();
            features.extend(part(expose, "state").and_then(|part| moved(part, topic)));
            settings(expose, topic, features);
            name_thing(expose, &mut features[before..]);
            if features.len() == before {
                unused.push(UnusedFeature::because("its cover cannot be moved".to_owned()));
            }
        }
        "climate" => climate(expose, topic, features, unused),
        _ => (),
    }
}

impl ExposedFeature {
    fn property(&self) -> &str {
        self.property.as_deref().unwrap_or_default()
    }

    /// Returns the message that ends the movement of a cover; `None` if it cannot be stopped.
    fn stop(&self, topic: &str) -> Option<OutgoingMessage> {
        let state = part(self, "state").filter(|part| part.options().any(|word| word == "STOP"))?;
        let body = json!({ state.property(): "STOP" }).to_string();
        Some(OutgoingMessage::new(format!("{topic}/set"), body))
    }

    /// Returns the property that switches the thing on; `None` if it cannot be switched.
    fn switch(&self) -> Option<String> {
        part(self, "state").filter(|part| part.access & SET != 0)?.property.clone()
    }

    /// Whether the property is the color of a lamp. A lamp may expose it in two forms.
    fn is_color(&self) -> bool {
        matches!(self.name.as_str(), "color_xy" | "color_hs")
    }

    /// Returns the texts of an enumeration.
    fn options(&self) -> impl Iterator<Item = &str> {
        self.values.as_array().into_iter().flatten().filter_map(Value::as_str)
    }
}

fn part<'e>(expose: &'e ExposedFeature, name: &str) -> Option<&'e ExposedFeature> {
    expose.features.iter().find(|part| part.name == name)
}

/// Makes these features the properties of one thing. A device may have several things of one kind,
/// which differ in the properties of their features.
fn name_thing(expose: &ExposedFeature, features: &mut [DeviceFeature]) {
    let Some(first) = features.first() else { return };
    let thing = format!("{} {}", expose.kind, first.label);
    for feature in features {
        feature.thing = Some(thing.clone());
    }
}

/// Whether a switch is a setting of the device, such as `child_lock`. A fan has a property of its
/// own in some devices.
fn is_setting(kind: &str, part: &ExposedFeature) -> bool {
    let property = part.property();
    kind != "fan" && property != "state" && !property.starts_with("state_")
}

fn measured(expose: &ExposedFeature) -> DeviceFeature {
    let (mut yes, mut no) = (plain(&expose.value_on, "true"), plain(&expose.value_off, "false"));
    if is_closed(&expose.name, &yes) {
        std::mem::swap(&mut yes, &mut no);
    }
    DeviceFeature {
        unit: expose.unit.clone().unwrap_or_default(),
        yes: vec![yes],
        no: vec![no],
        ..DeviceFeature::named(&expose.name, expose.property())
    }
}

/// Adds the levels and the choices of a thing.
fn settings(expose: &ExposedFeature, topic: &str, features: &mut Vec<DeviceFeature>) {
    let is = |kind: &str, name: &str, part: &ExposedFeature| {
        kind == expose.kind && name == part.name && part.access & SET != 0
    };
    for part in &expose.features {
        let level = LEVELS.iter().find(|(kind, name, _)| is(kind, name, part));
        if let Some((kind, _, class)) = level {
            let mut body = json!({ part.property(): null });
            // The brightness of a lamp that is off is set when it is on.
            let switch = expose.switch().filter(|_| *kind == "light");
            if let Some(switch) = &switch {
                body[switch] = json!("ON");
            }
            let mut level = level_of(class, part, topic, (body, switch.is_some()));
            if let Some(DeviceSetting::Level(setting)) = &mut level.setting {
                setting.stop = expose.stop(topic).filter(|_| *class == "cover_position");
            }
            features.push(heard(part, topic, level));
        }
        if expose.kind == "light" && is("light", part.name.as_str(), part) && part.is_color() {
            features.push(colored(part, topic, expose.switch()));
        }
        let choice = CHOICES.iter().find(|(kind, name, _)| is(kind, name, part));
        if let Some((_, _, class)) = choice {
            features.push(heard(part, topic, choice_of(class, part, topic)));
        }
    }
}

/// Returns a level of a thing. The message that sets it is `body`, which may switch the thing on.
fn level_of(
    class: &str,
    part: &ExposedFeature,
    topic: &str,
    (body, switches_on): (Value, bool),
) -> DeviceFeature {
    let number = |value: &Value, otherwise: f64| value.as_f64().unwrap_or(otherwise);
    let property = part.property();
    let set = format!("{topic}/set");
    let (low, high, scale) = match class {
        "brightness" => {
            let full = number(&part.value_max, 254.0);
            (1.0, full, NumberScale::Percent { zero: 0.0, full })
        }
        "color_temp" => {
            (number(&part.value_min, 153.0), number(&part.value_max, 500.0), NumberScale::Mired)
        }
        "cover_position" | "cover_tilt" => {
            let (zero, full) = (number(&part.value_min, 0.0), number(&part.value_max, 100.0));
            (zero, full, NumberScale::Percent { zero, full })
        }
        "fan_speed" => {
            let full = number(&part.value_max, 254.0);
            let low = number(&part.value_min, 1.0).max(1.0);
            (low, full, NumberScale::Percent { zero: 0.0, full })
        }
        _ => (number(&part.value_min, 5.0), number(&part.value_max, 30.0), NumberScale::Unit),
    };
    // Percentages and mireds are whole numbers.
    let is_whole = !matches!(scale, NumberScale::Unit);
    let step = part.value_step.as_f64().or_else(|| is_whole.then_some(1.0));
    let pointer = format!("/{}", property.replace('~', "~0").replace('/', "~1"));
    let setting = LevelSetting {
        min: low,
        max: high,
        step,
        scale,
        message: NumberMessage::json(set, body, &pointer),
        stop: None,
        switches_on,
    };
    DeviceFeature {
        unit: part.unit.clone().unwrap_or_default(),
        setting: Some(DeviceSetting::Level(setting)),
        ..DeviceFeature::named(class, property)
    }
}

/// Returns the color of a lamp, which is set by its hexadecimal digits. `switch` is the property
/// that switches the lamp on.
fn colored(part: &ExposedFeature, topic: &str, switch: Option<String>) -> DeviceFeature {
    let property = part.property();
    let option = |color: NamedColor| {
        let mut body = json!({ property: { "hex": color.hex() } });
        if let Some(switch) = &switch {
            body[switch] = json!("ON");
        }
        let message = OutgoingMessage::new(format!("{topic}/set"), body.to_string());
        (color.name.to_owned(), message)
    };
    let reading = ReadingMethod::Color(vec![property.to_owned()]);
    DeviceFeature {
        states: vec![ValueSource { topic: topic.to_owned(), reading }],
        setting: Some(DeviceSetting::Choice(COLORS.map(option).to_vec())),
        ..DeviceFeature::named("color", property)
    }
}

fn choice_of(class: &str, part: &ExposedFeature, topic: &str) -> DeviceFeature {
    let property = part.property();
    let option = |text: &str| {
        let body = json!({ property: text }).to_string();
        (text.to_owned(), OutgoingMessage::new(format!("{topic}/set"), body))
    };
    let options = part.options().map(option).collect();
    let setting = Some(DeviceSetting::Choice(options));
    DeviceFeature { setting, ..DeviceFeature::named(class, property) }
}

/// Returns the switch of a cover: it is opened and closed.
fn moved(part: &ExposedFeature, topic: &str) -> Option<DeviceFeature> {
    let property = part.property.as_deref().filter(|_| part.access & SET != 0)?;
    let say = |word: &str| {
        OutgoingMessage::new(format!("{topic}/set"), json!({ property: word }).to_string())
    };
    let feature = DeviceFeature {
        yes: vec!["OPEN".to_owned()],
        no: vec!["CLOSE".to_owned()],
        neither: vec!["STOP".to_owned()],
        command: Some(SwitchCommand { on: say("OPEN"), off: say("CLOSE") }),
        ..DeviceFeature::named("cover", property)
    };
    Some(heard(part, topic, feature))
}

fn climate(
    expose: &ExposedFeature,
    topic: &str,
    features: &mut Vec<DeviceFeature>,
    unused: &mut Vec<UnusedFeature>,
) {
    let before = features.len();
    settings(expose, topic, features);
    name_thing(expose, &mut features[before..]);
    for feature in &mut features[before..] {
        feature.label = "thermostat".to_owned();
    }
    if let Some(part) = part(expose, "local_temperature") {
        let unit = part.unit.clone().unwrap_or_default();
        // A separate thermometer beside the valve is more accurate.
        let feature =
            DeviceFeature { unit, rank: 1, ..DeviceFeature::named("temperature", part.property()) };
        features.push(heard(part, topic, feature));
    }
    if features.len() == before {
        let reason = "its climate: it neither measures nor sets a temperature";
        unused.push(UnusedFeature::because(reason.to_owned()));
    }
}

fn plain(value: &Option<Value>, otherwise: &str) -> String {
    match value {
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
        None => otherwise.to_owned(),
    }
}

/// Returns `feature` with the topic of its reports and the request for its value added.
fn heard(expose: &ExposedFeature, topic: &str, feature: DeviceFeature) -> DeviceFeature {
    let Some(property) = expose.property.as_deref() else { return feature };
    let states = match expose.access & SAYS {
        0 => Vec::new(),
        _ => vec![ValueSource::at(topic, &[property])],
    };
    let ask = (expose.access & ASKED != 0)
        .then(|| OutgoingMessage::new(format!("{topic}/get"), json!({ property: "" }).to_string()));
    DeviceFeature { states, value_request: ask, ..feature }
}

/// Whether a device's text for yes means closed, for a door, a window or a contact. In the built-in
/// device classes, yes means open for these devices.
fn is_closed(name: &str, word: &str) -> bool {
    let word = word.to_ascii_lowercase();
    match name {
        "contact" => matches!(word.as_str(), "close" | "closed" | "shut" | "true"),
        "door" | "garage_door" | "opening" | "window" => {
            matches!(word.as_str(), "close" | "closed" | "shut")
        }
        _ => false,
    }
}

fn switched(class: &str, part: &ExposedFeature, topic: &str) -> Option<DeviceFeature> {
    let property = part.property.clone()?;
    // The commands for a lock differ from the texts of its reports.
    let (on, off) = match class {
        "lock" => ("LOCK", "UNLOCK"),
        _ => ("ON", "OFF"),
    };
    let on = part.value_on.clone().unwrap_or_else(|| on.into());
    let off = part.value_off.clone().unwrap_or_else(|| off.into());
    let say = |value: &Value| {
        OutgoingMessage::new(format!("{topic}/set"), json!({ &property: value }).to_string())
    };
    let words = |value: &Value| plain(&Some(value.clone()), "");
    let (yes, no) = match class {
        "lock" => (vec![words(&on), "LOCKED".to_owned()], vec![words(&off), "UNLOCKED".to_owned()]),
        _ => (vec![words(&on)], vec![words(&off)]),
    };
    let command = Some(SwitchCommand { on: say(&on), off: say(&off) });
    let feature = DeviceFeature { yes, no, command, ..DeviceFeature::named(class, &property) };
    Some(heard(part, topic, feature))
}
