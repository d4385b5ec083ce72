//! Things of Tasmota devices that are set or pressed: shutters, dimmers, fans, buttons; and energy
//! meters.

use serde_json::Value;

use crate::color::{COLORS, NamedColor};
use crate::description::{
    DeviceFeature, OutgoingMessage, ReadingMethod, SwitchCommand, ValueSource,
};
use crate::setting::{DeviceSetting, LevelSetting, NumberMessage, NumberScale, PressText};
use crate::tasmota::{CMND, STAT, TELE, TasmotaConfig};

/// Kind of a relay that is part of a shutter.
const SHUTTER: u64 = 3;

/// Maximum number of shutters, and of buttons, of one device.
const THINGS_MAX: usize = 16;

/// Kinds of light in the key `lt_st`, with a color temperature: cold and warm white, and these with
/// colors.
const WITH_COLOR_TEMPERATURE: [u64; 2] = [2, 5];

/// The first kind of light in the key `lt_st` with colors.
const RGB: u64 = 3;

/// Number of speeds of a fan.
const FAN_SPEEDS: f64 = 3.0;

/// Ways to press a button.
const PRESSES: [&str; 6] = ["SINGLE", "DOUBLE", "TRIPLE", "QUAD", "PENTA", "HOLD"];

impl TasmotaConfig<'_> {
    /// Returns the shutters, the fan and the buttons of the device.
    pub(crate) fn things(&self) -> Vec<DeviceFeature> {
        let relays = self.relays();
        let shutters = (relays.iter().filter(|kind| **kind == SHUTTER).count() / 2).min(THINGS_MAX);
        let mut found: Vec<_> = (1..=shutters).flat_map(|number| self.shutter(number)).collect();
        if self.said["if"].as_u64() == Some(1) {
            found.extend(self.fan());
        }
        found.extend(self.buttons());
        found
    }

    /// Returns where a value with these keys is reported.
    fn reported(&self, keys: &[&str]) -> Vec<ValueSource> {
        let within: Vec<_> = std::iter::once("StatusSNS").chain(keys.iter().copied()).collect();
        vec![
            ValueSource::at(self.topic(STAT, "RESULT"), keys),
            ValueSource::at(self.topic(TELE, "SENSOR"), keys),
            ValueSource::at(self.topic(STAT, "STATUS10"), &within),
        ]
    }

    fn shutter(&self, number: usize) -> [DeviceFeature; 2] {
        let name = format!("Shutter{number}");
        let command = |verb: &str| {
            OutgoingMessage::new(self.topic(CMND, &format!("Shutter{verb}{number}")), "")
        };
        // The option 1 of a shutter inverts its positions.
        let options = self.said["sho"][number - 1].as_u64().unwrap_or(0);
        let (zero, full) = if options & 1 == 1 { (100.0, 0.0) } else { (0.0, 100.0) };
        let to = self.topic(CMND, &format!("ShutterPosition{number}"));
        let setting = LevelSetting {
            scale: NumberScale::Percent { zero, full },
            stop: Some(command("Stop")),
            ..LevelSetting::percent(NumberMessage::plain(to))
        };
        let ask = OutgoingMessage::new(self.topic(CMND, "STATUS"), "10");
        let (label, thing) = (name.to_lowercase(), Some(name.clone()));
        let switch = DeviceFeature {
            command: Some(SwitchCommand { on: command("Open"), off: command("Close") }),
            thing: thing.clone(),
            ..DeviceFeature::named("cover", &label)
        };
        let position = DeviceFeature {
            states: self.reported(&[&name, "Position"]),
            value_request: Some(ask),
            setting: Some(DeviceSetting::Level(setting)),
            thing,
            ..DeviceFeature::named("cover_position", &label)
        };
        [switch, position]
    }

    /// Returns the levels of the light of a device: its brightness and its color temperature.
    pub(crate) fn light_levels(&self, thing: &str) -> Vec<DeviceFeature> {
        let Some(kind) = self.said["lt_st"].as_u64().filter(|kind| *kind > 0) else {
            return Vec::new();
        };
        let states = |key: &str| {
            vec![
                ValueSource::at(self.topic(STAT, "RESULT"), &[key]),
                ValueSource::at(self.topic(TELE, "STATE"), &[key]),
            ]
        };
        let level = |class: &str, key: &str, setting: LevelSetting| DeviceFeature {
            states: states(key),
            value_request: Some(OutgoingMessage::new(self.topic(CMND, "STATE"), "")),
            setting: Some(DeviceSetting::Level(setting)),
            thing: Some(thing.to_owned()),
            ..DeviceFeature::named(class, &key.to_lowercase())
        };
        let percent = |key: &str| LevelSetting {
            switches_on: true,
            ..LevelSetting::percent(NumberMessage::plain(self.topic(CMND, key)))
        };
        let mut found = vec![level("brightness", "Dimmer", percent("Dimmer"))];
        if kind >= RGB {
            let to = self.topic(CMND, "HSBColor");
            let option = |color: NamedColor| {
                let text = format!("{},100,100", color.hue);
                (color.name.to_owned(), OutgoingMessage::new(to.as_str(), text))
            };
            let reading = || ReadingMethod::Color(vec!["HSBColor".to_owned()]);
            let topics = [self.topic(STAT, "RESULT"), self.topic(TELE, "STATE")];
            found.push(DeviceFeature {
                states: topics.map(|topic| ValueSource { topic, reading: reading() }).to_vec(),
                setting: Some(DeviceSetting::Choice(COLORS.map(option).to_vec())),
                thing: Some(thing.to_owned()),
                ..DeviceFeature::named("color", "color")
            });
        }
        if WITH_COLOR_TEMPERATURE.contains(&kind) {
            // Option 82 narrows the range.
            let narrow = self.said["so"]["82"].as_u64() == Some(1);
            let (min, max) = if narrow { (200.0, 380.0) } else { (153.0, 500.0) };
            let setting = LevelSetting { min, max, scale: NumberScale::Mired, ..percent("CT") };
            found.push(level("color_temp", "CT", setting));
        }
        found
    }

    fn fan(&self) -> [DeviceFeature; 2] {
        let to = self.topic(CMND, "FanSpeed");
        let states = vec![
            ValueSource::at(self.topic(STAT, "RESULT"), &["FanSpeed"]),
            ValueSource::at(self.topic(TELE, "STATE"), &["FanSpeed"]),
        ];
        let ask = Some(OutgoingMessage::new(self.topic(CMND, "STATE"), ""));
        let feature = |class: &str| DeviceFeature {
            states: states.clone(),
            value_request: ask.clone(),
            thing: Some("fan".to_owned()),
            ..DeviceFeature::named(class, "fan")
        };
        let setting = LevelSetting {
            min: 1.0,
            max: FAN_SPEEDS,
            scale: NumberScale::Percent { zero: 0.0, full: FAN_SPEEDS },
            switches_on: true,
            ..LevelSetting::percent(NumberMessage::plain(to.as_str()))
        };
        let switch = DeviceFeature {
            yes: ["1", "2", "3"].map(str::to_owned).to_vec(),
            no: vec!["0".to_owned()],
            command: Some(SwitchCommand {
                on: OutgoingMessage::new(to.as_str(), "1"),
                off: OutgoingMessage::new(to.as_str(), "0"),
            }),
            ..feature("fan")
        };
        [
            switch,
            DeviceFeature { setting: Some(DeviceSetting::Level(setting)), ..feature("fan_speed") },
        ]
    }

    /// Returns the buttons of the device. They report presses only with option 73.
    fn buttons(&self) -> Vec<DeviceFeature> {
        if self.said["so"]["73"].as_u64() != Some(1) {
            return Vec::new();
        }
        let buttons = self.said["btn"].as_array().into_iter().flatten().take(THINGS_MAX);
        let present = (1_usize..).zip(buttons).filter(|(_, kind)| kind.as_u64() != Some(0));
        let button = |(number, _): (usize, &Value)| {
            let name = format!("Button{number}");
            let press = |text: &str| PressText {
                name: format!("{name} {text}"),
                text: text.to_owned(),
                source: Some(0),
            };
            let source = ValueSource::at(self.topic(STAT, "RESULT"), &[&name, "Action"]);
            DeviceFeature {
                states: vec![source],
                setting: Some(DeviceSetting::Press(PRESSES.map(press).to_vec())),
                thing: Some("buttons".to_owned()),
                ..DeviceFeature::named("action", "buttons")
            }
        };
        present.map(button).collect()
    }

    /// Returns the power and the energy that the device measures. A device with several phases
    /// reports lists, which are left out.
    pub(crate) fn meters(&self, sensors: &Value, ask: &OutgoingMessage) -> Vec<DeviceFeature> {
        let meters = [("Power", "power", "W"), ("Total", "energy", "kWh")];
        let measured = meters.into_iter().filter(|(key, ..)| sensors["ENERGY"][*key].is_number());
        let meter = |(key, class, unit): (&str, &str, &str)| DeviceFeature {
            states: self.reported(&["ENERGY", key]),
            unit: unit.to_owned(),
            value_request: Some(ask.clone()),
            ..DeviceFeature::named(class, &format!("ENERGY-{key}"))
        };
        measured.map(meter).collect()
    }
}
