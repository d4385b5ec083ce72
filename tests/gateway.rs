//! Devices of a real MQTT broker that appear as agents by themselves: as Zigbee2MQTT, ESPHome (Home
//! Assistant's discovery) and Tasmota describe them.

mod support;

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use support::broker::Broker;
use support::{Office, lab};

const PATIENCE: Duration = Duration::from_secs(60);

/// A daemon with a gateway to this broker.
fn office(mode: &str, broker: &Broker, config: &str) -> Office {
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

fn tell(broker: &Broker, devices: &[Value]) {
    broker.retain("zigbee2mqtt/bridge/devices", &json!(devices).to_string());
}

fn await_discovered(office: &Office, agent: &str, is_so: impl Fn(&Value) -> bool) -> Value {
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
fn devices_appear_are_planned_with_go_and_come_back() {
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
        // What it says is known at once, without anybody asking.
        office.await_fact("(= (temperature office1) 21.5)", true);
        let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        broker.say("zigbee2mqtt/office2 pir", r#"{"occupancy":true}"#);
        office.await_fact("(motion office2)", true);
        // Of a door it is said whether its contact is closed.
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
fn lamps_relays_and_locks_are_switched_and_believed_by_what_they_say() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Arc::new(Mutex::new(Vec::new()));
    // A lamp as ESPHome has it, a relay as Tasmota, a lock that jams.
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
    // A corridor is no room, so the door's lock can be asked for nothing.
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
    // Somebody switches it by hand.
    broker.retain("stat/tasmota_D1/POWER", "OFF");
    office.await_fact("(powered office2)", false);
    let (code, said) = office.ask(&["act", "(lock-door front-door office1)"]);
    assert_eq!(code, Some(1), "it stands elsewhere: {said}");
}

#[test]
fn what_cannot_be_used_says_why_and_harms_nobody() {
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
    // Zigbee2MQTT tells Home Assistant the same: that is no other device.
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
    assert_eq!(nowhere["problem"], "nobody says in which room it stands");
    assert!(nowhere["toml"].to_string().contains("rooms = "), "{nowhere}");
    let good = await_discovered(&office, "office1-good", |one| one["joined"] == true);
    assert_eq!(good["problem"], Value::Null, "it is one device, told of twice");
    let odd = await_discovered(&office, "office1-odd", |one| one["joined"] == false);
    assert_eq!(odd["problem"], "its temperature is in `furlongs`, which is no °C");
    let broken = await_discovered(&office, "broken", |one| one["joined"] == false);
    let problem = broken["problem"].to_string();
    assert!(problem.contains("the template `{{ value_json. }}`"), "{problem}");
    // It changes its mind about its units, and is understood anew.
    broker.retain("zigbee2mqtt/office1/good", r#"{"temperature":68}"#);
    office.await_fact("(= (temperature office1) 68)", true);
    tell(&broker, &[thermometer("office1/good", "0x3", "°F")]);
    office.await_fact("(= (temperature office1) 20)", true);
    let (code, said) = office.ask(&["agents", "--discovered"]);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn where_the_file_says_so_devices_are_listed_and_those_that_are_named_join() {
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
fn where_the_file_says_so_a_person_is_asked_once() {
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
    // It is asked again, with what was wrong.
    office.answer("`office9-one` is none of them", "office1-two, office2-three");
    office.await_devices(2);
    let denied = await_discovered(&office, "office1-one", |one| one["problem"] != Value::Null);
    assert_eq!(denied["joined"], false);
    assert_eq!(denied["problem"], "a person has said no; the file may name it");

    // Who has said so is not asked again after a restart.
    office.kill("daemon");
    office.up(&["daemon"], &[]);
    office.await_devices(2);
    let denied = await_discovered(&office, "office1-one", |one| one["joined"] == false);
    assert_eq!(denied["problem"], "a person has said no; the file may name it");
}

#[test]
fn hundreds_of_devices_are_here_within_seconds_in_a_few_epochs() {
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
