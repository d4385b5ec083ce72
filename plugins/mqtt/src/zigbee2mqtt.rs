//! What Zigbee2MQTT says of its devices (`zigbee2mqtt/bridge/devices`): what each exposes.

use serde::Deserialize;
use serde_json::Value;

use crate::described::{Availability, Command, Described, Feature, Reading, Source};

#[derive(Deserialize)]
struct Device {
    ieee_address: String,
    friendly_name: String,
    #[serde(default)]
    disabled: bool,
    definition: Option<Definition>,
}

#[derive(Deserialize)]
struct Definition {
    #[serde(default)]
    exposes: Vec<Expose>,
}

#[derive(Deserialize)]
struct Expose {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    name: String,
    property: Option<String>,
    unit: Option<String>,
    /// Bits: 1 it says so by itself, 2 it can be set, 4 it can be asked for.
    #[serde(default)]
    access: u8,
    value_on: Option<Value>,
    value_off: Option<Value>,
    #[serde(default)]
    features: Vec<Expose>,
}

const SAYS: u8 = 1;
const SET: u8 = 2;

/// The devices in what the bridge says.
///
/// # Errors
///
/// If it is none of its texts.
pub(crate) fn devices(base: &str, text: &str) -> Result<Vec<Described>, String> {
    let devices: Vec<Value> = serde_json::from_str(text).map_err(|error| error.to_string())?;
    // One that nobody understands keeps no other away.
    let read = |device| serde_json::from_value::<Device>(device).ok();
    let devices = devices.into_iter().filter_map(read).filter(|device| !device.disabled);
    Ok(devices.filter_map(|device| described(base, device)).collect())
}

fn described(base: &str, device: Device) -> Option<Described> {
    let Device { ieee_address, friendly_name, definition, .. } = device;
    let topic = format!("{base}/{friendly_name}");
    let exposes = definition?.exposes;
    let features: Vec<_> = exposes.iter().flat_map(|expose| features_of(expose, &topic)).collect();
    let at = |topic: String, key: &str| Availability {
        source: Source { topic, reading: Reading::At(vec![key.to_owned()]) },
        offline: "offline".to_owned(),
    };
    Some(Described {
        id: ieee_address,
        area: None,
        features,
        availability: vec![
            at(format!("{topic}/availability"), "state"),
            at(format!("{base}/bridge/state"), "state"),
        ],
        any_is_enough: false,
        name: friendly_name,
    })
}

fn features_of(expose: &Expose, topic: &str) -> Vec<Feature> {
    let plain = |value: &Option<Value>, otherwise: &str| match value {
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
        None => otherwise.to_owned(),
    };
    let state = |of: &Expose| {
        let property = of.property.clone()?;
        let reading = Reading::At(vec![property]);
        (of.access & SAYS != 0).then(|| Source { topic: topic.to_owned(), reading })
    };
    match expose.kind.as_str() {
        "numeric" | "binary" if expose.access & SAYS != 0 => vec![Feature {
            class: expose.name.clone(),
            label: expose.property.clone().unwrap_or_default(),
            state: state(expose),
            unit: expose.unit.clone().unwrap_or_default(),
            yes: plain(&expose.value_on, "true"),
            no: plain(&expose.value_off, "false"),
            command: None,
        }],
        "switch" | "light" | "lock" => {
            let is_state = |part: &&Expose| part.name == "state" && part.access & SET != 0;
            let part = expose.features.iter().find(is_state);
            let switch = part.and_then(|part| {
                let property = part.property.clone()?;
                let (yes, no) = (plain(&part.value_on, "ON"), plain(&part.value_off, "OFF"));
                let say = |value: &str| serde_json::json!({ &property: value }).to_string();
                let (on, off) = (say(&yes), say(&no));
                Some(Feature {
                    class: expose.kind.clone(),
                    label: property.clone(),
                    state: state(part),
                    unit: String::new(),
                    yes,
                    no,
                    command: Some(Command { topic: format!("{topic}/set"), on, off }),
                })
            });
            switch.into_iter().collect()
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As Zigbee2MQTT 1.40 writes it of an Aqara thermometer, an Innr plug and a lamp, shortened to
    /// what is read.
    const DEVICES: &str = r#"[
      {"ieee_address":"0x00124b0000000001","type":"Coordinator","friendly_name":"Coordinator","definition":null},
      {"ieee_address":"0x00158d0001a2b3c4","type":"EndDevice","friendly_name":"office1/thermo","supported":true,
       "disabled":false,"definition":{"model":"WSDCGQ11LM","vendor":"Aqara","description":"sensor","exposes":[
        {"type":"numeric","name":"temperature","label":"Temperature","property":"temperature","unit":"°C","access":1},
        {"type":"numeric","name":"humidity","property":"humidity","unit":"%","access":1},
        {"type":"numeric","name":"linkquality","property":"linkquality","unit":"lqi","access":1}]}},
      {"ieee_address":"0x00158d0001a2b3c5","type":"Router","friendly_name":"plug","definition":{"exposes":[
        {"type":"switch","features":[{"type":"binary","name":"state","property":"state","access":7,
         "value_on":"ON","value_off":"OFF","value_toggle":"TOGGLE"}]},
        {"type":"numeric","name":"power","property":"power","unit":"W","access":5}]}},
      {"ieee_address":"0x00158d0001a2b3c6","type":"EndDevice","friendly_name":"pir","definition":{"exposes":[
        {"type":"binary","name":"occupancy","property":"occupancy","access":1,"value_on":true,"value_off":false}]}},
      {"friendly_name":"nonsense"},
      {"ieee_address":"0x1","friendly_name":"off","disabled":true,"definition":{"exposes":[]}}
    ]"#;

    #[test]
    fn what_devices_expose_is_read() {
        let devices = devices("zigbee2mqtt", DEVICES).expect("its text");
        let names: Vec<_> = devices.iter().map(|device| device.name.as_str()).collect();
        assert_eq!(names, ["office1/thermo", "plug", "pir"]);
        let classes: Vec<_> =
            devices[0].features.iter().map(|feature| feature.class.as_str()).collect();
        assert_eq!(classes, ["temperature", "humidity", "linkquality"]);
        let plug = &devices[1].features[0];
        let command = plug.command.as_ref().expect("it can be set");
        assert_eq!(
            (command.topic.as_str(), command.on.as_str()),
            ("zigbee2mqtt/plug/set", r#"{"state":"ON"}"#)
        );
        assert_eq!(devices[2].features[0].yes, "true");
        for rubbish in ["", "{}", "[", "[1, null, \"x\"]"] {
            assert!(
                super::devices("z", rubbish).is_ok_and(|found| found.is_empty())
                    || rubbish != "[1, null, \"x\"]"
            );
        }
    }
}
