//! Reads Zigbee2MQTT's description of its devices (`zigbee2mqtt/bridge/devices`), which contains
//! the features that each device exposes. `zigbee_exposes` converts these.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use crate::description::{
    Availability, AvailabilityMode, AvailabilityTopic, DescribedDevice, DeviceFeature,
    UnusedFeature, ValueSource,
};
use crate::zigbee_exposes::{ExposedFeature, features_of};

#[derive(Deserialize)]
struct ZigbeeDevice {
    ieee_address: String,
    friendly_name: String,
    #[serde(default, rename = "type")]
    kind: String,
    #[serde(default)]
    disabled: bool,
    definition: Option<ZigbeeDefinition>,
}

#[derive(Deserialize)]
struct ZigbeeDefinition {
    exposes: Vec<ExposedFeature>,
}

/// The devices in the descriptions of the bridge, by the address of the device.
#[derive(Debug, Default)]
pub(crate) struct ZigbeeDiscovery {
    devices: BTreeMap<String, DescribedDevice>,
    /// Reason why the last message was invalid; the devices are then those of an earlier message.
    pub(crate) problem: Option<String>,
}

impl ZigbeeDiscovery {
    /// Handles the bridge's description of all its devices.
    ///
    /// # Errors
    ///
    /// Returns an error if the text is invalid, or has an invalid entry without an address. Devices
    /// that such a text or entry may be about do not change; all other devices are updated.
    pub(crate) fn receive_devices(&mut self, base: &str, text: &str) -> Result<(), String> {
        // An empty text means that the retained text was removed; therefore the devices are
        // removed.
        let told: Result<Vec<Value>, _> = match text.trim().is_empty() {
            true => Ok(Vec::new()),
            false => serde_json::from_str(text),
        };
        let told = told.map_err(|error| {
            let problem = error.to_string();
            self.problem = Some(problem.clone());
            problem
        })?;
        self.problem = None;
        let (mut devices, mut unnamed) = (BTreeMap::new(), None);
        for device in told {
            let text = |key: &str| device.get(key).and_then(Value::as_str).map(str::to_owned);
            let (address, name) = (text("ieee_address"), text("friendly_name"));
            match serde_json::from_value::<ZigbeeDevice>(device) {
                Ok(device) if device.disabled => (),
                Ok(device) => {
                    let address = device.ieee_address.clone();
                    devices.extend(described(base, device).map(|device| (address, device)));
                }
                // An invalid entry does not affect the other devices, and its own device does not
                // change.
                Err(error) => {
                    let Some(address) = address else {
                        unnamed = Some(error.to_string());
                        continue;
                    };
                    let known = self.devices.remove(&address);
                    let mut device = known.unwrap_or_else(|| unread(&address, name));
                    let reason = format!("its last description cannot be read: {error}");
                    if !device.unused.iter().any(|unused| unused.reason == reason) {
                        device.unused.push(UnusedFeature::because(reason));
                    }
                    devices.insert(address, device);
                }
            }
        }
        if unnamed.is_some() {
            // The invalid entry may be about any known device that the text does not contain.
            let earlier = std::mem::take(&mut self.devices).into_iter();
            let kept = earlier.filter(|(address, _)| !devices.contains_key(address));
            devices.extend(kept.collect::<Vec<_>>());
        }
        self.devices = devices;
        self.problem.clone_from(&unnamed);
        unnamed.map_or(Ok(()), Err)
    }

    pub(crate) fn devices(&self) -> Vec<DescribedDevice> {
        let trouble = self.problem.as_ref().map(|problem| {
            UnusedFeature::because(format!("the last `bridge/devices` cannot be read: {problem}"))
        });
        let with_trouble = |device: &DescribedDevice| {
            let unused = device.unused.iter().cloned().chain(trouble.clone()).collect();
            DescribedDevice { unused, ..device.clone() }
        };
        self.devices.values().map(with_trouble).collect()
    }
}

/// Returns a device without features, for an entry with a valid address and perhaps a name, but
/// otherwise invalid.
fn unread(address: &str, name: Option<String>) -> DescribedDevice {
    DescribedDevice {
        name: name.unwrap_or_else(|| address.to_owned()),
        id: address.to_owned(),
        other_ids: Vec::new(),
        area: None,
        features: Vec::new(),
        unused: Vec::new(),
    }
}

fn described(base: &str, device: ZigbeeDevice) -> Option<DescribedDevice> {
    let ZigbeeDevice { ieee_address, friendly_name, kind, definition, .. } = device;
    if kind == "Coordinator" {
        return None;
    }
    let topic = format!("{base}/{friendly_name}");
    let (mut features, mut unused) = (Vec::new(), Vec::new());
    let exposes = definition.map(|definition| definition.exposes).unwrap_or_else(|| {
        let reason = "Zigbee2MQTT does not know what it is: it has no `definition`";
        unused.push(UnusedFeature::because(reason));
        Vec::new()
    });
    for expose in &exposes {
        features_of(expose, &topic, &mut features, &mut unused);
    }
    // Besides `illuminance_lux`, Zigbee2MQTT 1.x exposes a raw value as `illuminance`.
    let is_raw =
        |feature: &DeviceFeature| feature.class == "illuminance" && feature.unit.is_empty();
    let has_lux = features.iter().any(|feature| feature.class == "illuminance_lux");
    if features.iter().any(is_raw) && !has_lux {
        let reason = "its illuminance has no unit: Zigbee2MQTT 1.x reports raw values";
        unused.push(UnusedFeature::because(reason));
    }
    features.retain(|feature| !is_raw(feature));
    let voice = |topic: String| AvailabilityTopic {
        source: ValueSource::at(topic, &["state"]),
        online: "online".to_owned(),
        offline: "offline".to_owned(),
        // Availability is reported only if it is enabled in Zigbee2MQTT.
        is_online_at_first: true,
    };
    let voices =
        vec![voice(format!("{topic}/availability")), voice(format!("{base}/bridge/state"))];
    for feature in &mut features {
        let voices = voices.clone();
        feature.availability = Availability { topics: voices, mode: AvailabilityMode::All };
    }
    let problem = mqtt_link::topic_problem(&topic);
    if let Some(problem) = problem {
        features.clear();
        unused.push(UnusedFeature::because(problem));
    }
    let (name, id, also, area) = (friendly_name, ieee_address, Vec::new(), None);
    Some(DescribedDevice { name, id, other_ids: also, area, features, unused })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::OutgoingMessage;

    /// A description by Zigbee2MQTT 1.40 of an Aqara thermometer, an Innr plug and a motion
    /// detector, shortened to the keys that are used.
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
    fn exposed_features_become_features() {
        let mut bridge = ZigbeeDiscovery::default();
        let problem = bridge.receive_devices("zigbee2mqtt", DEVICES).expect_err("one is nonsense");
        assert!(problem.contains("ieee_address"), "{problem}");
        let devices = bridge.devices();
        let names: Vec<_> = devices.iter().map(|device| device.name.as_str()).collect();
        assert_eq!(names, ["office1/thermo", "plug", "pir"]);
        let classes: Vec<_> =
            devices[0].features.iter().map(|feature| feature.class.as_str()).collect();
        assert_eq!(classes, ["temperature", "humidity", "linkquality"]);
        let plug = &devices[1].features[0];
        let command = plug.command.as_ref().expect("it can be set");
        assert_eq!(
            (command.on.topic.as_str(), command.on.text.as_str()),
            ("zigbee2mqtt/plug/set", r#"{"state":"ON"}"#)
        );
        assert_eq!(devices[2].features[0].yes, ["true"]);
        assert_eq!(
            plug.value_request,
            Some(OutgoingMessage::new("zigbee2mqtt/plug/get", r#"{"state":""}"#)),
            "it can be asked"
        );
    }

    #[test]
    fn an_invalid_description_keeps_the_earlier_devices() {
        let mut bridge = ZigbeeDiscovery::default();
        bridge.receive_devices("z", DEVICES).expect_err("one is nonsense");
        for rubbish in ["{}", "[", "12", "{\"a\":1}"] {
            assert!(bridge.receive_devices("z", rubbish).is_err(), "{rubbish}");
            let devices = bridge.devices();
            assert_eq!(devices.len(), 3);
            let reason = &devices[0].unused[0].reason;
            assert!(reason.contains("`bridge/devices` cannot be read"), "{reason}");
        }
        // A device with an invalid description does not change, and the other devices are updated.
        let text = r#"[{"ieee_address":"0x00158d0001a2b3c4","friendly_name":7},
            {"ieee_address":"0x1","friendly_name":"new","definition":{"exposes":[]}}]"#;
        // An entry without an address may be about any device, so that no device is removed.
        let with_another = text.replace("7},", "7},null,");
        bridge.receive_devices("z", &with_another).expect_err("one is null");
        assert_eq!(bridge.devices().len(), 4);
        bridge.receive_devices("z", text).expect("its text");
        let devices = bridge.devices();
        let names: Vec<_> = devices.iter().map(|device| device.name.as_str()).collect();
        assert_eq!(names, ["office1/thermo", "new"]);
        assert!(devices[0].unused[0].reason.contains("cannot be read"));
        bridge.receive_devices("z", "").expect("taken back");
        assert!(bridge.devices().is_empty());
    }
}
