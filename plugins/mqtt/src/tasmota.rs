//! Tasmota's own discovery: `tasmota/discovery/MAC/config` and `…/sensors`.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::described::{Availability, Command, Described, Feature, Reading, Source};

/// What was said so far, by the device's address.
#[derive(Debug, Default)]
pub(crate) struct Discovery {
    devices: BTreeMap<String, (Value, Value)>,
}

impl Discovery {
    /// Takes what was said under a topic; an empty text takes back what was said before.
    ///
    /// # Errors
    ///
    /// What is wrong with it, for a person.
    pub(crate) fn hear(&mut self, topic: &str, text: &str) -> Result<(), String> {
        let mut levels = topic.rsplit('/');
        let (Some(what), Some(address)) = (levels.next(), levels.next()) else { return Ok(()) };
        let said = match text.trim().is_empty() {
            true => Value::Null,
            false => serde_json::from_str(text).map_err(|error| error.to_string())?,
        };
        let device = self.devices.entry(address.to_owned()).or_default();
        match what {
            "config" => device.0 = said,
            "sensors" => device.1 = said,
            _ => (),
        }
        if device.0.is_null() && device.1.is_null() {
            self.devices.remove(address);
        }
        Ok(())
    }

    /// The devices of which something is known.
    pub(crate) fn devices(&self) -> Vec<Described> {
        let described = |(address, (config, sensors)): (&String, &(Value, Value))| {
            described(address, config, sensors)
        };
        self.devices.iter().filter_map(described).collect()
    }
}

fn described(address: &str, config: &Value, sensors: &Value) -> Option<Described> {
    let text = |key: &str| config.get(key).and_then(Value::as_str);
    let (own, full) = (text("t")?, text("ft").unwrap_or("%prefix%/%topic%/"));
    let prefix = |index: usize, otherwise: &'static str| {
        config["tp"].get(index).and_then(Value::as_str).unwrap_or(otherwise)
    };
    let topic =
        |prefix: &str, what: &str| full.replace("%prefix%", prefix).replace("%topic%", own) + what;
    let (cmnd, stat, tele) = (prefix(0, "cmnd"), prefix(1, "stat"), prefix(2, "tele"));
    let state = |index: usize, otherwise: &str| {
        let said = config["state"].get(index).and_then(Value::as_str);
        said.unwrap_or(otherwise).to_owned()
    };
    let relays: Vec<u64> = config["rl"]
        .as_array()
        .map(|relays| relays.iter().map(|relay| relay.as_u64().unwrap_or(0)).collect())
        .unwrap_or_default();
    let count = relays.iter().filter(|kind| **kind != 0).count();
    let relay = |(index, kind): (usize, &u64)| {
        let class = match kind {
            1 => "switch",
            2 => "light",
            _ => return None,
        };
        let power = if count > 1 { format!("POWER{}", index + 1) } else { "POWER".to_owned() };
        let (on, off) = (state(1, "ON"), state(0, "OFF"));
        Some(Feature {
            class: class.to_owned(),
            label: power.to_lowercase(),
            state: Some(Source { topic: topic(stat, &power), reading: Reading::Whole }),
            unit: String::new(),
            yes: on.clone(),
            no: off.clone(),
            command: Some(Command { topic: topic(cmnd, &power), on, off }),
        })
    };
    let mut features: Vec<_> = relays.iter().enumerate().filter_map(relay).collect();
    features.extend(measured(&sensors["sn"], &topic(tele, "SENSOR")));
    let availability = Availability {
        source: Source { topic: topic(tele, "LWT"), reading: Reading::Whole },
        offline: text("ofln").unwrap_or("Offline").to_owned(),
    };
    Some(Described {
        name: text("dn").unwrap_or(own).to_owned(),
        id: address.to_owned(),
        area: None,
        features,
        availability: vec![availability],
        any_is_enough: false,
    })
}

/// What its sensors measure: `{"SI7021": {"Temperature": 21.5}, "TempUnit": "C"}`.
fn measured(sensors: &Value, topic: &str) -> Vec<Feature> {
    let unit_of_temperature = sensors["TempUnit"].as_str().unwrap_or("C");
    let chips = sensors.as_object().into_iter().flatten();
    let mut features = Vec::new();
    for (chip, values) in chips {
        for key in values.as_object().into_iter().flatten().map(|(key, _)| key) {
            let class = key.to_ascii_lowercase();
            let unit = match class.as_str() {
                "temperature" => format!("°{unit_of_temperature}"),
                "carbondioxide" => "ppm".to_owned(),
                _ => String::new(),
            };
            let class = if class == "carbondioxide" { "carbon_dioxide".to_owned() } else { class };
            let reading = Reading::At(vec![chip.clone(), key.clone()]);
            features.push(Feature {
                class,
                label: format!("{chip}-{key}"),
                state: Some(Source { topic: topic.to_owned(), reading }),
                unit,
                yes: "ON".to_owned(),
                no: "OFF".to_owned(),
                command: None,
            });
        }
    }
    features
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As Tasmota 13 writes it, shortened to what is read.
    const CONFIG: &str = r#"{"ip":"192.168.1.20","dn":"Desk","fn":["Lamp",null],"hn":"tasmota-d1e2f3",
        "mac":"A4CF12D1E2F3","md":"Sonoff TH","ofln":"Offline","onln":"Online","state":["OFF","ON","TOGGLE","HOLD"],
        "sw":"13.1.0","t":"tasmota_D1E2F3","ft":"%prefix%/%topic%/","tp":["cmnd","stat","tele"],
        "rl":[1,0,0,0],"ver":1}"#;
    const SENSORS: &str = r#"{"sn":{"Time":"2026-11-22T10:00:00","SI7021":{"Temperature":21.5,"Humidity":40.1},"TempUnit":"C"},"ver":1}"#;

    #[test]
    fn relays_and_sensors_are_read() {
        let mut discovery = Discovery::default();
        discovery.hear("tasmota/discovery/A4CF12D1E2F3/config", CONFIG).expect("understood");
        discovery.hear("tasmota/discovery/A4CF12D1E2F3/sensors", SENSORS).expect("understood");
        let devices = discovery.devices();
        let device = &devices[0];
        assert_eq!(device.name, "Desk");
        let command = device.features[0].command.as_ref().expect("a relay");
        assert_eq!(
            (command.topic.as_str(), command.on.as_str()),
            ("cmnd/tasmota_D1E2F3/POWER", "ON")
        );
        let classes: Vec<_> =
            device.features.iter().map(|feature| feature.class.as_str()).collect();
        assert_eq!(classes, ["switch", "humidity", "temperature"]);
        assert_eq!(device.availability[0].source.topic, "tele/tasmota_D1E2F3/LWT");
        assert!(discovery.hear("tasmota/discovery/X/config", "{").is_err());
        discovery.hear("tasmota/discovery/A4CF12D1E2F3/config", "").expect("taken back");
        assert!(discovery.devices().is_empty());
    }
}
