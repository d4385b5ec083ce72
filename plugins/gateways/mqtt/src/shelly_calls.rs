//! The calls and reports of Shelly devices of the second and later generations.

use serde_json::{Value, json};

use crate::description::{DeviceFeature, OutgoingMessage, SwitchCommand, ValueSource};
use crate::setting::{DeviceSetting, LevelSetting, NumberMessage};

/// The topics of one device.
pub(crate) struct ShellyCalls<'n> {
    name: &'n str,
    /// Beginning of the topic to which the device sends its answers to calls.
    answers: String,
}

impl ShellyCalls<'_> {
    pub(crate) fn of(name: &str) -> ShellyCalls<'_> {
        ShellyCalls { name, answers: format!("althing/{name}") }
    }

    fn body(&self, method: &str, params: &Value) -> Value {
        json!({ "id": 1, "src": self.answers, "method": method, "params": params })
    }

    fn call(&self, method: &str, params: &Value) -> OutgoingMessage {
        OutgoingMessage::new(format!("{}/rpc", self.name), self.body(method, params).to_string())
    }

    /// Returns a call with the number at `place` in its parameters.
    fn number_call(&self, method: &str, params: &Value, place: &str) -> NumberMessage {
        let body = self.body(method, params);
        NumberMessage::json(format!("{}/rpc", self.name), body, &format!("/params/{place}"))
    }

    fn ask(&self) -> OutgoingMessage {
        self.call("Shelly.GetStatus", &json!({}))
    }

    fn states(&self, part: &str, keys: &[&str]) -> Vec<ValueSource> {
        let ShellyCalls { name, answers } = self;
        let within = |first: &'static str| -> Vec<&str> {
            [first, part].into_iter().chain(keys.iter().copied()).collect()
        };
        vec![
            ValueSource::at(format!("{name}/status/{part}"), keys),
            ValueSource::at(format!("{name}/events/rpc"), &within("params")),
            ValueSource::at(format!("{answers}/rpc"), &within("result")),
        ]
    }

    pub(crate) fn measured(&self, class: &str, part: &str, key: &str, unit: &str) -> DeviceFeature {
        DeviceFeature {
            states: self.states(part, &[key]),
            unit: unit.to_owned(),
            ..DeviceFeature::named(class, part)
        }
    }

    pub(crate) fn switch(&self, part: &str, kind: &str, number: u32) -> DeviceFeature {
        let method = if kind == "switch" { "Switch.Set" } else { "Light.Set" };
        let set = |is_on: bool| self.call(method, &json!({ "id": number, "on": is_on }));
        DeviceFeature {
            thing: Some(part.to_owned()),
            yes: vec!["true".to_owned()],
            no: vec!["false".to_owned()],
            command: Some(SwitchCommand { on: set(true), off: set(false) }),
            value_request: Some(self.ask()),
            ..self.measured(kind, part, "output", "")
        }
    }

    pub(crate) fn brightness(&self, part: &str, number: u32) -> DeviceFeature {
        let params = json!({ "id": number, "on": true, "brightness": null });
        let message = self.number_call("Light.Set", &params, "brightness");
        let setting =
            LevelSetting { min: 1.0, switches_on: true, ..LevelSetting::percent(message) };
        DeviceFeature {
            setting: Some(DeviceSetting::Level(setting)),
            thing: Some(part.to_owned()),
            value_request: Some(self.ask()),
            ..self.measured("brightness", part, "brightness", "")
        }
    }

    /// Returns a cover, with the position that it reports after its calibration.
    pub(crate) fn cover(&self, part: &str, number: u32) -> [DeviceFeature; 2] {
        let told = |method: &str| self.call(method, &json!({ "id": number }));
        let params = json!({ "id": number, "pos": null });
        let setting = LevelSetting {
            stop: Some(told("Cover.Stop")),
            ..LevelSetting::percent(self.number_call("Cover.GoToPosition", &params, "pos"))
        };
        let switch = DeviceFeature {
            command: Some(SwitchCommand { on: told("Cover.Open"), off: told("Cover.Close") }),
            thing: Some(part.to_owned()),
            ..DeviceFeature::named("cover", part)
        };
        let position = DeviceFeature {
            setting: Some(DeviceSetting::Level(setting)),
            thing: Some(part.to_owned()),
            value_request: Some(self.ask()),
            ..self.measured("cover_position", part, "current_pos", "")
        };
        [switch, position]
    }

    /// Returns the power and the energy that a part measures.
    pub(crate) fn meters(&self, part: &str) -> [DeviceFeature; 2] {
        let energy = DeviceFeature {
            states: self.states(part, &["aenergy", "total"]),
            unit: "Wh".to_owned(),
            ..DeviceFeature::named("energy", part)
        };
        [self.measured("power", part, "apower", "W"), energy]
    }
}
