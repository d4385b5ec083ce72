//! Devices of a real MQTT broker that appear as discovered agents: as Zigbee2MQTT, ESPHome (Home
//! Assistant's discovery) and Tasmota describe them.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::broker::Broker;
use crate::support::{Office, lab};

const PATIENCE: Duration = Duration::from_secs(60);

/// Starts a daemon with a gateway to this broker.
pub(crate) fn office(mode: &str, broker: &Broker, config: &str) -> Office {
    let office = Office::new();
    let gateway = format!(
        "[[agent]]\nname = \"zigbee\"\nplugin = \"mqtt\"\n\n[agent.config]\nbroker = \"{}\"\n{config}\n",
        broker.name()
    );
    let file = office.write("lab.toml", &(lab(mode) + &gateway));
    let mut office = office.with_file(file);
    office.up(&["daemon"], &[]);
    office
}

fn thermometer(name: &str, id: &str, unit: &str) -> Value {
    json!({ "ieee_address": id, "type": "EndDevice", "friendly_name": name, "definition": { "exposes": [
        { "type": "numeric", "name": "temperature", "property": "temperature", "unit": unit, "access": 1 },
        { "type": "numeric", "name": "linkquality", "property": "linkquality", "unit": "lqi", "access": 1 },
    ] } })
}

fn pir(name: &str, id: &str) -> Value {
    json!({ "ieee_address": id, "type": "EndDevice", "friendly_name": name, "definition": { "exposes": [
        { "type": "binary", "name": "occupancy", "property": "occupancy", "access": 1,
          "value_on": true, "value_off": false },
    ] } })
}

fn door(name: &str, id: &str) -> Value {
    json!({ "ieee_address": id, "type": "EndDevice", "friendly_name": name, "definition": { "exposes": [
        { "type": "binary", "name": "contact", "property": "contact", "access": 1,
          "value_on": false, "value_off": true },
    ] } })
}

pub(crate) fn tell(broker: &Broker, devices: &[Value]) {
    broker.retain("zigbee2mqtt/bridge/devices", &json!(devices).to_string());
}

pub(crate) fn await_discovered(
    office: &Office,
    agent: &str,
    is_so: impl Fn(&Value) -> bool,
) -> Value {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let answer = office.ask_json(&["agents", "--discovered"]);
        let all = answer["daemons"][0]["discovered"].as_array().cloned().unwrap_or_default();
        let found = all.iter().find(|one| one["agent"] == agent);
        if let Some(found) = found.filter(|found| is_so(found)) {
            return found.clone();
        }
        assert!(Instant::now() < deadline, "{agent}: {all:?}");
    }
}

#[test]
fn devices_join_leave_and_return() {
    let Some(mut broker) = Broker::start() else { return };
    for mode in ["decentralized", "centralized"] {
        let office = office(mode, &broker, "");
        let thermo = thermometer("office1/thermo", "0x1", "°C");
        let devices = [thermo, pir("office2 pir", "0x2"), door("conf-room door", "0x3")];
        let all = || {
            tell(&broker, &devices);
            broker.retain("zigbee2mqtt/office1/thermo", r#"{"temperature":21.5,"linkquality":87}"#);
        };
        all();
        office.await_devices(3);
        // A published value is known at once, without a query.
        office.await_fact("(= (temperature office1) 21.5)", true);
        let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        broker.say("zigbee2mqtt/office2 pir", r#"{"occupancy":true}"#);
        office.await_fact("(motion office2)", true);
        // For a door the contact state is announced.
        broker.retain("zigbee2mqtt/conf-room door", r#"{"contact":true}"#);
        office.await_fact("(closed conf-room)", true);
        broker.retain("zigbee2mqtt/conf-room door", r#"{"contact":false}"#);
        office.await_fact("(closed conf-room)", false);
        broker.say("zigbee2mqtt/office2 pir", r#"{"occupancy":false}"#);
        office.await_fact("(motion office2)", false);

        broker.retain("zigbee2mqtt/office1/thermo/availability", r#"{"state":"offline"}"#);
        office.await_fact("(= (temperature office1) 21.5)", false);
        let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
        assert_eq!(code, Some(1), "{mode}: it is away: {said}");
        broker.retain("zigbee2mqtt/office1/thermo/availability", r#"{"state":"online"}"#);
        office.await_fact("(= (temperature office1) 21.5)", true);

        broker.kill();
        office.await_fact("(= (temperature office1) 21.5)", false);
        broker.restart();
        tell(&broker, &devices);
        broker.retain("zigbee2mqtt/office1/thermo", r#"{"temperature":19.25}"#);
        office.await_fact("(= (temperature office1) 19.25)", true);
        let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");

        tell(&broker, &devices[1..]);
        office.await_devices(2);
        broker.retain("zigbee2mqtt/office1/thermo", "");
    }
}

#[test]
fn an_unreachable_broker_is_reported() {
    let Some(mut broker) = Broker::start() else { return };
    broker.kill();
    let office = office("decentralized", &broker, "");
    let told = await_discovered(&office, "zigbee", |one| one["problem"].is_string());
    let problem = told["problem"].as_str().expect("it is a text");
    assert!(
        problem.starts_with(&format!("the broker {} is not reached: ", broker.name())),
        "{told}"
    );
    broker.restart();
    tell(&broker, &[thermometer("office1/thermo", "0x1", "°C")]);
    office.await_devices(1);
    let all = office.ask_json(&["agents", "--discovered"]).to_string();
    assert!(!all.contains("is not reached"), "{all}");
}

#[test]
fn lamps_relays_and_locks_are_switched_and_report_their_states() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Arc::new(Mutex::new(Vec::new()));
    // A lamp as ESPHome describes it, a relay as Tasmota does, and a lock that jams.
    let (speaker, heard) = (Arc::clone(&broker), Arc::clone(&told));
    let _lamp = broker.device("kitchen/light/lamp/command", move |command| {
        heard.lock().expect("nobody panics").push(format!("lamp {command}"));
        speaker.retain("kitchen/light/lamp/state", command);
    });
    let (speaker, heard) = (Arc::clone(&broker), Arc::clone(&told));
    let _relay = broker.device("cmnd/tasmota_D1/POWER", move |command| {
        heard.lock().expect("nobody panics").push(format!("relay {command}"));
        speaker.retain("stat/tasmota_D1/POWER", command);
    });
    let heard = Arc::clone(&told);
    let _lock = broker.device("door/set", move |command| {
        heard.lock().expect("nobody panics").push(format!("lock {command}"));
    });
    broker.retain(
        "homeassistant/light/kitchen/lamp/config",
        r#"{"~":"kitchen/light/lamp","schema":"json","stat_t":"~/state","cmd_t":"~/command","uniq_id":"l1",
            "dev":{"ids":"a4cf","name":"desk lamp","sa":"Office 1"}}"#,
    );
    broker.retain("kitchen/light/lamp/state", r#"{"state":"OFF"}"#);
    broker.retain(
        "tasmota/discovery/D1/config",
        r#"{"dn":"Heater","t":"tasmota_D1","ft":"%prefix%/%topic%/","tp":["cmnd","stat","tele"],
            "state":["OFF","ON"],"rl":[1,0],"ofln":"Offline"}"#,
    );
    broker.retain("stat/tasmota_D1/POWER", "OFF");
    broker.retain(
        "homeassistant/lock/door/config",
        r#"{"name":"front door","stat_t":"door/state","cmd_t":"door/set","uniq_id":"d1"}"#,
    );
    broker.retain("door/state", "UNLOCKED");
    let rooms = "rooms = { \"Heater\" = \"office2\", \"front door\" = \"corridor\" }";
    // A corridor is no room, so the door's lock offers no action.
    let office = office("decentralized", &broker, rooms);
    office.await_devices(3);
    let (code, said) = office.ask(&["goal", "(and (lit office1) (powered office2))"]);
    assert_eq!(code, Some(0), "{said}");
    office.await_fact("(lit office1)", true);
    let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
    assert_eq!(code, Some(0), "{said}");
    let told = told.lock().expect("nobody panics").clone();
    for expected in ["lamp {\"state\":\"ON\"}", "lamp {\"state\":\"OFF\"}", "relay ON"] {
        assert!(told.iter().any(|told| told == expected), "{expected}: {told:?}");
    }
    // A person switches the relay by hand.
    broker.retain("stat/tasmota_D1/POWER", "OFF");
    office.await_fact("(powered office2)", false);
    let (code, said) = office.ask(&["act", "(lock-door front-door office1)"]);
    assert_eq!(code, Some(1), "it stands elsewhere: {said}");
}

/// A lamp of Zigbee2MQTT that reports no state until it is commanded.
fn silent_lamp(name: &str, id: &str) -> Value {
    json!({ "friendly_name": name, "ieee_address": id, "definition": { "exposes": [
        { "type": "light", "features": [{ "type": "binary", "name": "state", "property": "state",
            "access": 3, "value_on": "ON", "value_off": "OFF" }] }] } })
}

#[test]
fn the_state_of_a_silent_lamp_is_unknown() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    for mode in ["decentralized", "centralized"] {
        let told = Arc::new(Mutex::new(Vec::new()));
        let mut lamps = Vec::new();
        for name in ["office1 a", "office1 b"] {
            let (speaker, heard) = (Arc::clone(&broker), Arc::clone(&told));
            lamps.push(broker.device(&format!("zigbee2mqtt/{name}/set"), move |command| {
                heard.lock().expect("nobody panics").push(format!("{name} {command}"));
                speaker.say(&format!("zigbee2mqtt/{name}"), command);
            }));
        }
        tell(&broker, &[silent_lamp("office1 a", "0xa"), silent_lamp("office1 b", "0xb")]);
        let office = office(mode, &broker, "");
        office.await_devices(2);
        office.await_fact("(unknown (lit office1))", true);
        office.await_fact("(unknown (lamp-on office1-a))", true);
        // The state is unknown, so both lamps are commanded.
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert!(!said.contains("it holds already"), "{mode}: {said}");
        let heard = std::mem::take(&mut *told.lock().expect("nobody panics"));
        for name in ["office1 a", "office1 b"] {
            let off = format!(r#"{name} {{"state":"OFF"}}"#);
            assert!(heard.contains(&off), "{mode}: {off}: {heard:?}");
        }
        // If one of two lamps is lit, the room is lit; the room is dark when that lamp is off.
        broker.say("zigbee2mqtt/office1 b", r#"{"state":"ON"}"#);
        office.await_fact("(lit office1)", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        let heard = std::mem::take(&mut *told.lock().expect("nobody panics"));
        assert_eq!(heard, [r#"office1 b {"state":"OFF"}"#], "{mode}: {said}");
        office.await_fact("(lit office1)", false);
        // The state of an offline lamp is unknown, and the report says that it cannot be commanded.
        broker.retain("zigbee2mqtt/office1 b/availability", r#"{"state":"offline"}"#);
        office.await_fact("(unknown (lit office1))", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(1), "{mode}: {said}");
        assert!(said.contains("it is unknown whether"), "{mode}: {said}");
        broker.retain("zigbee2mqtt/office1 b/availability", "");
        tell(&broker, &[]);
    }
}

#[test]
fn unusable_devices_are_listed_with_the_reason() {
    let Some(broker) = Broker::start() else { return };
    for rubbish in ["{", "[1, null]", "\"x\""] {
        broker.retain("zigbee2mqtt/bridge/devices", rubbish);
        broker.retain("homeassistant/sensor/bad/config", rubbish);
        broker.retain("tasmota/discovery/X/config", rubbish);
    }
    broker.retain(
        "homeassistant/sensor/t/config",
        r#"{"dev_cla":"temperature","unit_of_meas":"°C","stat_t":"t/state","val_tpl":"{{ value_json. }}",
            "uniq_id":"t","dev":{"ids":"t","name":"broken","sa":"office2"}}"#,
    );
    broker.retain("t/state", r#"{"temperature": 20}"#);
    // Zigbee2MQTT announces the same device to Home Assistant: it must not appear twice.
    broker.retain(
        "homeassistant/sensor/0x3/temperature/config",
        r#"{"dev_cla":"temperature","unit_of_meas":"°C","stat_t":"zigbee2mqtt/office1/good",
            "val_tpl":"{{ value_json.temperature }}","uniq_id":"0x3_temperature_zigbee2mqtt",
            "dev":{"ids":["zigbee2mqtt_0x3"],"name":"office1/good"}}"#,
    );
    let office = office("decentralized", &broker, "");
    tell(
        &broker,
        &[
            thermometer("cellar", "0x1", "°C"),
            thermometer("office1/odd", "0x2", "furlongs"),
            thermometer("office1/good", "0x3", "°C"),
        ],
    );
    let nowhere = await_discovered(&office, "cellar", |one| one["joined"] == false);
    assert_eq!(nowhere["problem"], "its room is not known");
    assert!(nowhere["toml"].to_string().contains("rooms = "), "{nowhere}");
    let good = await_discovered(&office, "office1-good", |one| one["joined"] == true);
    assert_eq!(good["problem"], Value::Null, "it is one device, told of twice");
    let odd = await_discovered(&office, "office1-odd", |one| one["joined"] == false);
    assert_eq!(odd["problem"], "its temperature is in `furlongs`, which is no °C");
    let broken = await_discovered(&office, "broken", |one| one["joined"] == false);
    let problem = broken["problem"].to_string();
    assert!(problem.contains("the template `{{ value_json. }}`"), "{problem}");
    // The device changes its unit, and its values are converted by the new one.
    broker.retain("zigbee2mqtt/office1/good", r#"{"temperature":68}"#);
    office.await_fact("(= (temperature office1) 68)", true);
    tell(&broker, &[thermometer("office1/good", "0x3", "°F")]);
    office.await_fact("(= (temperature office1) 20)", true);
    let (code, said) = office.ask(&["agents", "--discovered"]);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn with_admission_by_list_only_named_devices_join() {
    let Some(broker) = Broker::start() else { return };
    let config = "devices = [\"0x2\"]\nignore = [\"secret*\"]\n\n[plugins]\nadmit = \"listed\"\n";
    let office = office("decentralized", &broker, config);
    let devices = [("office1/one", "0x1"), ("office1/two", "0x2"), ("secret one", "0x3")];
    let devices: Vec<_> = devices.iter().map(|(name, id)| thermometer(name, id, "°C")).collect();
    tell(&broker, &devices);
    await_discovered(&office, "office1-one", |one| one["joined"] == false);
    await_discovered(&office, "office1-two", |one| one["joined"] == true);
    office.await_devices(1);
    let (_, said) = office.ask(&["agents", "--discovered"]);
    assert!(!said.contains("secret"), "{said}");
}

#[test]
fn with_admission_by_consent_a_person_is_asked_once() {
    let Some(broker) = Broker::start() else { return };
    let ask =
        "\n[[agent]]\nname = \"keyboard\"\nplugin = \"keyboard\"\n\n[plugins]\nadmit = \"ask\"\n";
    let mut office = office("decentralized", &broker, ask);
    let devices = [("office1/one", "0x1"), ("office1/two", "0x2"), ("office2/three", "0x3")];
    let devices: Vec<_> = devices.iter().map(|(name, id)| thermometer(name, id, "°C")).collect();
    tell(&broker, &devices);
    for device in ["office1-one", "office1-two", "office2-three"] {
        let asked = await_discovered(&office, device, |one| one["joined"] == false);
        assert_eq!(asked["problem"], "a person is being asked: althing keyboard");
    }
    office.answer("`office1-one` (zigbee, office1)", "office9-one");
    // The question is asked again, with the mistake.
    office.answer("`office9-one` is none of them", "office1-two, office2-three");
    office.await_devices(2);
    let denied = await_discovered(&office, "office1-one", |one| one["problem"] != Value::Null);
    assert_eq!(denied["joined"], false);
    assert_eq!(denied["problem"], "a person has refused it; name it in the file");

    // The answer is stored: the question is not asked again after a restart.
    office.kill("daemon");
    office.up(&["daemon"], &[]);
    office.await_devices(2);
    let denied = await_discovered(&office, "office1-one", |one| one["joined"] == false);
    assert_eq!(denied["problem"], "a person has refused it; name it in the file");
}

#[test]
fn hundreds_of_devices_join_within_seconds_in_a_few_epochs() {
    let Some(broker) = Broker::start() else { return };
    let office = office("decentralized", &broker, "");
    let before = office.ask_json(&["domain"])["epoch"].as_u64().expect("a number");
    let devices: Vec<_> = (0..200)
        .map(|number| thermometer(&format!("office1/t{number}"), &format!("0x{number}"), "°C"))
        .collect();
    tell(&broker, &devices);
    office.await_devices(200);
    let after = office.ask_json(&["domain"])["epoch"].as_u64().expect("a number");
    assert!(after - before <= 40, "{} epochs for one burst", after - before);
}

/// Messages published to topics, in order of arrival.
#[derive(Clone, Default)]
pub(crate) struct Told(Arc<Mutex<Vec<String>>>);

impl Told {
    pub(crate) fn all(&self) -> Vec<String> {
        self.0.lock().expect("nobody panics").clone()
    }

    pub(crate) fn push(&self, text: String) {
        self.0.lock().expect("nobody panics").push(text);
    }

    /// Returns what was published so far, and forgets it.
    pub(crate) fn take(&self) -> Vec<String> {
        std::mem::take(&mut *self.0.lock().expect("nobody panics"))
    }

    pub(crate) fn listens(
        &self,
        broker: &Broker,
        topic: &str,
    ) -> crate::support::broker::Subscriber {
        let (told, to) = (self.clone(), topic.to_owned());
        broker.device(topic, move |text| {
            told.0.lock().expect("nobody panics").push(format!("{to} {text}"));
        })
    }

    pub(crate) fn await_text(&self, text: &str) {
        let deadline = Instant::now() + PATIENCE;
        while !self.all().iter().any(|told| told == text) {
            assert!(Instant::now() < deadline, "{text}: {:?}", self.all());
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Returns an entity of Home Assistant's discovery in office1, of a device of this name.
pub(crate) fn entity(name: &str, more: Value) -> String {
    let device = json!({ "ids": [name], "name": name, "sa": "Office 1" });
    let mut entity = json!({ "uniq_id": name, "dev": device });
    if let (Value::Object(entity), Value::Object(more)) = (&mut entity, more) {
        entity.extend(more);
    }
    entity.to_string()
}

#[test]
fn values_follow_templates_and_expire() {
    let Some(broker) = Broker::start() else { return };
    let office = office("decentralized", &broker, "");
    let fact = |text: &str, is_so: bool| office.await_fact(text, is_so);
    let temperature = |more: Value| {
        let mut config =
            json!({ "dev_cla": "temperature", "unit_of_meas": "°C", "stat_t": "lab/n" });
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        broker.retain("homeassistant/sensor/n/t/config", &entity("n1", config));
    };
    // A message without the key, with null, or with a word: the first keeps the known value.
    temperature(json!({ "val_tpl": "{{ value_json.temp | float | round(1) }}" }));
    office.await_devices(1);
    broker.say("lab/n", r#"{"temp":21.5}"#);
    fact("(= (temperature office1) 21.5)", true);
    for keeps in [r#"{"battery":90}"#, r#"{"temp":"warm"}"#, r#"{"temp":null}"#, "", "garbage"] {
        broker.say("lab/n", keeps);
    }
    broker.say("lab/n", r#"{"temp":21.75}"#);
    fact("(= (temperature office1) 21.8)", true);
    fact("(= (temperature office1) 0)", false);
    // A template without filters passes the raw value; null then means that the device does not
    // know.
    temperature(json!({ "val_tpl": "{{ value_json.temp }}" }));
    broker.say("lab/n", r#"{"temp":22.5}"#);
    fact("(= (temperature office1) 22.5)", true);
    for unknown in
        [r#"{"temp":null}"#, r#"{"temp":"unavailable"}"#, r#"{"temp":"ERR"}"#, r#"{"temp":-127}"#]
    {
        broker.say("lab/n", unknown);
        fact("(= (temperature office1) 22.5)", false);
        broker.say("lab/n", r#"{"temp":22.5}"#);
        fact("(= (temperature office1) 22.5)", true);
    }
    // A value that is not repeated expires.
    temperature(json!({ "exp_aft": 10 }));
    broker.say("lab/n", "23.5");
    fact("(= (temperature office1) 23.5)", true);
    fact("(= (temperature office1) 23.5)", false);
    broker.say("lab/n", "24.5");
    fact("(= (temperature office1) 24.5)", true);
    broker.retain("homeassistant/sensor/n/t/config", "");
    office.await_devices(0);

    let motion = json!({ "dev_cla": "motion", "stat_t": "lab/m", "off_dly": 10 });
    broker.retain("homeassistant/binary_sensor/n/m/config", &entity("pir1", motion));
    office.await_devices(1);
    broker.say("lab/m", "ON");
    fact("(motion office1)", true);
    fact("(motion office1)", false);
    let motion = json!({ "device_class": "motion", "stat_t": "zwave/5", "payload_on": true,
        "payload_off": false, "value_template": "{{ value_json.value }}" });
    broker.retain("homeassistant/binary_sensor/n/m/config", &entity("pir1", motion));
    broker.retain("zwave/5", r#"{"value":true}"#);
    fact("(motion office1)", true);
    broker.retain("zwave/5", r#"{"value":false}"#);
    fact("(motion office1)", false);
}

#[test]
fn entities_have_their_own_availability_and_survive_bad_descriptions() {
    let Some(mut broker) = Broker::start() else { return };
    let office = office("decentralized", &broker, "");
    let sensor = |class: &str, unit: &str, more: Value| {
        let mut config = json!({ "uniq_id": class, "dev_cla": class, "unit_of_meas": unit,
            "dev": { "ids": ["n"], "name": "n1", "sa": "Office 1" } });
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        config.to_string()
    };
    let describe = |broker: &Broker| {
        let dry = json!({ "~": "lab/", "stat_t": "~t", "avty_t": "lab/n/s" });
        let wet = json!({ "~": "lab/h", "stat_t": "~", "avty": [{ "t": "lab/n/hs" }] });
        broker.retain("homeassistant/sensor/n/a/config", &sensor("temperature", "°C", dry));
        broker.retain("homeassistant/sensor/n/z/config", &sensor("humidity", "%", wet));
        for (topic, text) in
            [("lab/n/s", "online"), ("lab/n/hs", "offline"), ("lab/t", "21.5"), ("lab/h", "40")]
        {
            broker.retain(topic, text);
        }
    };
    describe(&broker);
    office.await_fact("(= (temperature office1) 21.5)", true);
    office.await_fact("(= (humidity office1) 40)", false);
    let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
    assert_eq!(code, Some(0), "{said}");
    broker.retain("lab/n/hs", "online");
    office.await_fact("(= (humidity office1) 40)", true);
    broker.retain("lab/n/s", "offline");
    office.await_fact("(= (temperature office1) 21.5)", false);
    office.await_fact("(= (humidity office1) 40)", true);
    broker.retain("lab/n/s", "online");
    office.await_fact("(= (temperature office1) 21.5)", true);

    broker.retain("homeassistant/sensor/n/a/config", "{\"uniq_id\":");
    let told = await_discovered(&office, "n1", |one| one["problem"] != Value::Null);
    assert_eq!(told["joined"], true);
    let problem = told["problem"].to_string();
    assert!(problem.contains("homeassistant/sensor/n/a/config"), "{problem}");
    broker.retain("lab/t", "22.5");
    office.await_fact("(= (temperature office1) 22.5)", true);
    // JSON of another shape takes nothing away, either.
    broker.retain("homeassistant/sensor/n/a/config", r#"{"uniq_id":"temperature"}"#);
    await_discovered(&office, "n1", |one| {
        one["joined"] == true && one["problem"].to_string().contains("it has no `state_topic`")
    });
    broker.retain("lab/t", "23.5");
    office.await_fact("(= (temperature office1) 23.5)", true);
    broker.retain("lab/t", "22.5");
    office.await_fact("(= (temperature office1) 22.5)", true);

    // One invalid topic does not block the others, also after the broker was away.
    let bad = json!({ "dev_cla": "temperature", "stat_t": "lab/#/bad" });
    broker.retain("homeassistant/sensor/bad/t/config", &entity("bad1", bad.clone()));
    let told = await_discovered(&office, "bad1", |one| one["joined"] == false);
    let problem = told["problem"].to_string();
    assert!(problem.contains("`lab/#/bad` is no topic"), "{problem}");
    broker.kill();
    office.await_fact("(= (temperature office1) 22.5)", false);
    broker.restart();
    broker.retain("homeassistant/sensor/bad/t/config", &entity("bad1", bad));
    describe(&broker);
    office.await_fact("(= (temperature office1) 21.5)", true);
}

#[test]
fn commands_use_the_payloads_of_the_description() {
    let Some(broker) = Broker::start() else { return };
    let told = Told::default();
    let topics = ["lab/plug/set", "lab/lamp/set", "lab/door/set"];
    let _listening = topics.map(|topic| told.listens(&broker, topic));
    let plug = json!({ "cmd_t": "lab/plug/set", "cmd_tpl": "{\"power\":\"{{ value|lower }}\"}" });
    broker.retain("homeassistant/switch/plug/config", &entity("plug1", plug));
    let lamp = json!({ "schema": "template", "cmd_t": "lab/lamp/set", "cmd_on_tpl": "on,255",
        "cmd_off_tpl": "off", "stat_t": "lab/lamp", "stat_tpl": "{{ value.split(',')[0] }}" });
    broker.retain("homeassistant/light/lamp/config", &entity("lamp1", lamp));
    broker.retain("lab/lamp", "off,0");
    let door = json!({ "cmd_t": "lab/door/set", "stat_t": "lab/door", "code_format": "^\\d{4}$" });
    broker.retain("homeassistant/lock/door/config", &entity("door1", door));
    let office = office("decentralized", &broker, "");
    office.await_devices(2);
    let door = await_discovered(&office, "door1", |one| one["joined"] == false);
    let problem = door["problem"].to_string();
    assert!(problem.contains("it needs a code"), "{problem}");
    let (code, said) = office.ask(&["goal", "(powered office1)"]);
    assert_eq!(code, Some(0), "{said}");
    told.await_text(r#"lab/plug/set {"power":"on"}"#);
    // The lamp never reports that it is on, so the goal is not reached.
    let (_, said) = office.ask(&["act", "(turn-on-lamp lamp1 office1)"]);
    told.await_text("lab/lamp/set on,255");
    assert!(said.contains("receive a report on `lab/lamp` that it is done"), "{said}");
    let all = told.all();
    assert!(all.iter().all(|told| !told.ends_with(" ON") && !told.contains("door")), "{all:?}");
}

/// A plug that never reports its state: the last command counts, until the broker was away.
#[test]
fn the_state_of_a_silent_plug_is_unknown_after_a_broker_restart() {
    let Some(mut broker) = Broker::start() else { return };
    let told = Told::default();
    let plug = entity("plug1", json!({ "cmd_t": "lab/plug/set" }));
    let describe = |broker: &Broker| broker.retain("homeassistant/switch/plug/config", &plug);
    describe(&broker);
    let listening = told.listens(&broker, "lab/plug/set");
    let office = office("decentralized", &broker, "");
    office.await_devices(1);
    office.await_fact("(unknown (powered office1))", true);
    let (code, said) = office.ask(&["goal", "(powered office1)"]);
    assert_eq!(code, Some(0), "{said}");
    told.await_text("lab/plug/set ON");
    office.await_fact("(powered office1)", true);
    drop(listening);
    broker.kill();
    office.await_fact("(powered office1)", false);
    broker.restart();
    describe(&broker);
    told.0.lock().expect("nobody panics").clear();
    let _listening = told.listens(&broker, "lab/plug/set");
    // A person may have switched it by hand meanwhile, so the goal must not hold already.
    office.await_fact("(unknown (powered office1))", true);
    let (code, said) = office.ask(&["goal", "(powered office1)"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(!said.contains("it holds already"), "{said}");
    told.await_text("lab/plug/set ON");
}

/// Two windows of one device: the room is closed when both are.
#[test]
fn several_contacts_of_one_device_are_combined() {
    let Some(broker) = Broker::start() else { return };
    for name in ["left", "right"] {
        let device = json!({ "ids": ["both"], "name": "windows", "sa": "Office 1" });
        let contact = json!({ "uniq_id": name, "name": name, "dev_cla": "window", "dev": device,
            "stat_t": format!("lab/{name}") });
        let topic = format!("homeassistant/binary_sensor/both/{name}/config");
        broker.retain(&topic, &contact.to_string());
        broker.retain(&format!("lab/{name}"), "OFF");
    }
    let office = office("decentralized", &broker, "");
    office.await_devices(1);
    office.await_fact("(closed office1)", true);
    broker.retain("lab/right", "ON");
    office.await_fact("(closed office1)", false);
    // The other window repeats that it is closed, which changes nothing.
    broker.retain("lab/left", "OFF");
    let (code, said) = office.ask(&["goal", "(known-contact office1)"]);
    assert_eq!(code, Some(0), "{said}");
    office.await_fact("(closed office1)", false);
    broker.retain("lab/right", "OFF");
    office.await_fact("(closed office1)", true);
}

#[test]
fn states_and_descriptions_are_queried() {
    let Some(mut broker) = Broker::start() else { return };
    let told = Told::default();
    let listen = |broker: &Broker| {
        [
            told.listens(broker, "homeassistant/status"),
            told.listens(broker, "zigbee2mqtt/office1 plug/get"),
            told.listens(broker, "cmnd/box/STATE"),
            told.listens(broker, "cmnd/box/STATUS"),
        ]
    };
    let _listening = listen(&broker);
    let plug = json!({ "ieee_address": "0x2", "friendly_name": "office1 plug", "definition": {
        "exposes": [{ "type": "switch", "features": [{ "type": "binary", "name": "state",
            "property": "state", "access": 7, "value_on": "ON", "value_off": "OFF" }] }] } });
    let describe = |broker: &Broker| {
        tell(broker, std::slice::from_ref(&plug));
        broker.retain(
            "tasmota/discovery/B1/config",
            r#"{"dn":"office2 box","t":"box","ft":"%prefix%/%topic%/","tp":["cmnd","stat","tele"],
                "state":["OFF","ON"],"rl":[1],"ofln":"Offline","onln":"Online"}"#,
        );
        broker.retain(
            "tasmota/discovery/B1/sensors",
            r#"{"sn":{"ESP32":{"Temperature":53.3},"SI7021":{"Temperature":1,"Humidity":1},"TempUnit":"C"}}"#,
        );
    };
    describe(&broker);
    let office = office("decentralized", &broker, "");
    told.await_text("homeassistant/status online");
    told.await_text(r#"zigbee2mqtt/office1 plug/get {"state":""}"#);
    told.await_text("cmnd/box/STATE ");
    told.await_text("cmnd/box/STATUS 10");
    broker.say("zigbee2mqtt/office1 plug", r#"{"state":"ON"}"#);
    office.await_fact("(powered office1)", true);
    broker.say("stat/box/RESULT", r#"{"POWER":"ON"}"#);
    office.await_fact("(powered office2)", true);
    let status = r#"{"StatusSNS":{"ESP32":{"Temperature":53.3},"SI7021":{"Temperature":21.5,"Humidity":40}}}"#;
    broker.say("stat/box/STATUS10", status);
    office.await_fact("(= (temperature office2) 21.5)", true);

    // The state that a switch reported before the broker was away is unknown: it is queried again.
    broker.kill();
    office.await_fact("(powered office1)", false);
    told.0.lock().expect("nobody panics").clear();
    broker.restart();
    let _listening = listen(&broker);
    describe(&broker);
    told.await_text(r#"zigbee2mqtt/office1 plug/get {"state":""}"#);
    office.await_fact("(powered office1)", false);
    broker.say("zigbee2mqtt/office1 plug", r#"{"state":"ON"}"#);
    office.await_fact("(powered office1)", true);
}

#[test]
fn devices_are_identified_and_located() {
    let Some(broker) = Broker::start() else { return };
    let office = office("decentralized", &broker, "");
    let lux = json!([
        { "type": "numeric", "name": "illuminance", "property": "illuminance", "access": 1 },
        { "type": "numeric", "name": "illuminance_lux", "property": "illuminance_lux", "unit": "lx",
          "access": 1 },
    ]);
    let valve = json!([{ "type": "climate", "features": [{ "type": "numeric", "unit": "°C",
        "name": "local_temperature", "property": "local_temperature", "access": 5 }] }]);
    let zigbee = |name: &str, id: &str, exposes: &Value| json!({ "ieee_address": id, "friendly_name": name, "definition": { "exposes": exposes } });
    tell(
        &broker,
        &[
            thermometer("Office 10 sensor", "0xa1", "°C"),
            zigbee("office1/pir", "0xa2", &lux),
            zigbee("office2 valve", "0xa3", &valve),
        ],
    );
    broker.retain("zigbee2mqtt/office1/pir", r#"{"illuminance":21000,"illuminance_lux":126}"#);
    broker.retain("zigbee2mqtt/office2 valve", r#"{"local_temperature":19.5}"#);
    office.await_fact("(= (light office1) 126)", true);
    office.await_fact("(= (temperature office2) 19.5)", true);
    let nowhere = await_discovered(&office, "office-10-sensor", |one| one["joined"] == false);
    assert_eq!(nowhere["problem"], "its room is not known");
    tell(&broker, &[]);

    // Two devices of one name, one identified by its connections only, one in an area that is no
    // room.
    let sensor = |device: Value, class: &str, topic: &str| {
        json!({ "uniq_id": topic, "dev_cla": class, "stat_t": topic, "dev": device }).to_string()
    };
    let two = |id: &str, area: &str| json!({ "ids": [id], "name": "Thermometer", "sa": area });
    let publish = |object: &str, text: String| {
        broker.retain(&format!("homeassistant/sensor/{object}/config"), &text);
    };
    publish("a1", sensor(two("ble-aa01", "Office 1"), "temperature", "x/1"));
    // The first keeps its name when another with the same name appears.
    await_discovered(&office, "thermometer", |one| one["joined"] == true);
    publish("a2", sensor(two("ble-aa02", "Office 2"), "temperature", "x/2"));
    let mac = json!([["mac", "02:00:00:00:00:11"]]);
    publish("b1", sensor(json!({ "cns": mac }), "temperature", "x/3"));
    let named = json!({ "cns": mac, "name": "Hall", "sa": "Conf room" });
    publish("b2", sensor(named, "humidity", "x/4"));
    publish(
        "c1",
        sensor(json!({ "ids": 7, "name": "office1 far", "sa": "Garden" }), "temperature", "x/5"),
    );
    for (topic, text) in [("x/1", "20"), ("x/2", "21"), ("x/3", "22"), ("x/4", "50")] {
        broker.retain(topic, text);
    }
    for fact in [
        "(= (temperature office1) 20)",
        "(= (temperature office2) 21)",
        "(= (temperature conf-room) 22)",
        "(= (humidity conf-room) 50)",
    ] {
        office.await_fact(fact, true);
    }
    let far = await_discovered(&office, "office1-far", |one| one["joined"] == false);
    assert_eq!(far["problem"], "its area is `Garden`, which is no room here");
    for name in ["thermometer", "thermometer-leaa02", "hall"] {
        await_discovered(&office, name, |one| one["joined"] == true);
    }
}
