//! What homes have, at a real MQTT broker: shutters, lamps, thermostats, fans, scenes and buttons.
//! Goals are about numbers and options; the messages that the devices receive are the evidence.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::gateway::{Told, await_discovered, entity, office, tell};
use crate::support::Office;
use crate::support::broker::{Broker, Subscriber};

const PATIENCE: Duration = Duration::from_secs(60);

/// How long a test waits to see that something does not happen.
const NOTHING_FOR: Duration = Duration::from_secs(2);

/// A shutter motor, as Zigbee2MQTT describes Moes' MS-108ZR.
fn shutter(name: &str, id: &str) -> Value {
    json!({ "ieee_address": id, "type": "Router", "friendly_name": name, "definition": { "exposes": [
        { "type": "cover", "features": [
            { "type": "enum", "name": "state", "property": "state", "access": 3,
              "values": ["OPEN", "CLOSE", "STOP"] },
            { "type": "numeric", "name": "position", "property": "position", "access": 7,
              "unit": "%", "value_min": 0, "value_max": 100 } ] },
        { "type": "enum", "name": "moving", "property": "moving", "access": 1,
          "values": ["UP", "STOP", "DOWN"] },
        { "type": "binary", "name": "motor_reversal", "property": "motor_reversal", "access": 7,
          "value_on": "ON", "value_off": "OFF" } ] } })
}

/// A room thermostat, as Zigbee2MQTT describes Moes' BHT-002.
fn thermostat(name: &str, id: &str) -> Value {
    json!({ "ieee_address": id, "type": "Router", "friendly_name": name, "definition": { "exposes": [
        { "type": "climate", "features": [
            { "type": "numeric", "name": "current_heating_setpoint", "access": 3, "unit": "°C",
              "property": "current_heating_setpoint", "value_min": 5, "value_max": 45,
              "value_step": 1 },
            { "type": "numeric", "name": "local_temperature", "property": "local_temperature",
              "access": 1, "unit": "°C" },
            { "type": "enum", "name": "system_mode", "property": "system_mode", "access": 3,
              "values": ["off", "heat"] },
            { "type": "enum", "name": "preset", "property": "preset", "access": 3,
              "values": ["hold", "program"] } ] } ] } })
}

/// Starts a shutter that reports a position on its way before it reports the one that it was told.
fn move_shutter(broker: &Arc<Broker>, name: &str, told: &Told) -> Subscriber {
    let (speaker, told, topic) = (Arc::clone(broker), told.clone(), format!("zigbee2mqtt/{name}"));
    broker.device(&format!("{topic}/set"), move |command| {
        told.push(command.to_owned());
        let command: Value = serde_json::from_str(command).expect("JSON");
        let position = match (&command["position"], command["state"].as_str()) {
            (Value::Number(position), _) => position.as_f64().expect("a number"),
            (_, Some("OPEN")) => 100.0,
            (_, Some("CLOSE")) => 0.0,
            _ => return,
        };
        for position in [f64::midpoint(position, 50.0).round(), position] {
            let state = if position > 0.0 { "OPEN" } else { "CLOSE" };
            speaker.say(&topic, &json!({ "position": position, "state": state }).to_string());
        }
    })
}

#[track_caller]
fn reach(office: &Office, goal: &str) -> String {
    let (code, said) = office.ask(&["goal", goal]);
    assert_eq!(code, Some(0), "{goal}: {said}");
    said
}

#[test]
fn a_goal_about_a_position_moves_a_shutter() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    for mode in ["decentralized", "centralized"] {
        let told = Told::default();
        let _shutter = move_shutter(&broker, "office1 blind", &told);
        tell(&broker, &[shutter("office1 blind", "0x70")]);
        broker.retain("zigbee2mqtt/office1 blind", r#"{"position":20,"state":"OPEN"}"#);
        let office = office(mode, &broker, "");
        office.await_devices(1);
        office.await_fact("(= (cover-position office1-blind) 20)", true);
        // Of all positions that reach the goal, the nearest one is set.
        for (goal, expected) in [
            ("(>= (cover-position office1-blind) 50)", r#"{"position":50}"#),
            ("(<= (cover-position office1-blind) 32)", r#"{"position":30}"#),
            ("(= (cover-position office1-blind) 35)", r#"{"position":35}"#),
            ("(not (covers-open office1))", r#"{"state":"CLOSE"}"#),
            ("(forall (?c - cover) (> (cover-position ?c) 70))", r#"{"position":75}"#),
            ("(not (cover-open office1-blind))", r#"{"state":"CLOSE"}"#),
            ("(covers-open office1)", r#"{"state":"OPEN"}"#),
        ] {
            let said = reach(&office, goal);
            assert_eq!(told.take(), [expected], "{mode}: {goal}: {said}");
        }
        office.await_fact("(= (cover-position office1-blind) 100)", true);
        let said = reach(&office, "(>= (cover-position office1-blind) 50)");
        assert!(said.contains("it holds already"), "{mode}: {said}");
        let (code, said) = office.ask(&["goal", "(> (cover-position office1-blind) 100)"]);
        assert_eq!(code, Some(1), "{mode}: {said}");
        assert!(told.take().is_empty(), "{mode}");
        let (_, said) =
            office.ask(&["act", "(set-cover-position office1-blind office1 percent-45)"]);
        assert!(said.contains("45 % at office1"), "{mode}: {said}");
        tell(&broker, &[]);
        broker.retain("zigbee2mqtt/office1 blind", "");
    }
}

#[test]
fn a_kept_position_is_restored_after_a_person_has_moved_the_shutter() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Told::default();
    let _shutter = move_shutter(&broker, "office1 blind", &told);
    tell(&broker, &[shutter("office1 blind", "0x70")]);
    broker.retain("zigbee2mqtt/office1 blind", r#"{"position":20,"state":"OPEN"}"#);
    let office = office("decentralized", &broker, "");
    office.await_devices(1);
    let goal =
        "(and (>= (cover-position office1-blind) 40) (<= (cover-position office1-blind) 60))";
    let mut keeping = office.command(&["goal", goal, "--maintain"]);
    let mut keeping = keeping.spawn().expect("it is built");
    told.await_text(r#"{"position":40}"#);
    office.await_fact("(= (cover-position office1-blind) 40)", true);
    told.take();
    // A motor that stops a little beside the commanded position has done its work.
    broker.say("zigbee2mqtt/office1 blind", r#"{"position":39,"state":"OPEN"}"#);
    broker.say("zigbee2mqtt/office1 blind", r#"{"position":90,"state":"OPEN"}"#);
    told.await_text(r#"{"position":60}"#);
    assert_eq!(told.take(), [r#"{"position":60}"#]);
    office.terminate(&keeping);
    keeping.wait().expect("our own child");
}

#[test]
fn a_room_is_heated_until_its_thermostat_measures_the_temperature() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    for mode in ["decentralized", "centralized"] {
        let told = Told::default();
        let (speaker, heard) = (Arc::clone(&broker), told.clone());
        let _thermostat = broker.device("zigbee2mqtt/office1 thermo/set", move |command| {
            heard.push(command.to_owned());
            speaker.say("zigbee2mqtt/office1 thermo", command);
        });
        tell(&broker, &[thermostat("office1 thermo", "0xa4")]);
        broker.retain(
            "zigbee2mqtt/office1 thermo",
            r#"{"local_temperature":19.5,"current_heating_setpoint":17,"system_mode":"off","preset":"hold"}"#,
        );
        let office = office(mode, &broker, "");
        office.await_devices(2);
        office.await_fact("(= (temperature office1) 19.5)", true);
        office.await_fact("(thermostat-mode office1-thermo-thermostat mode-off)", true);
        let mut heating = office.command(&["goal", "(>= (temperature office1) 21)"]);
        let mut heating =
            heating.stdout(std::process::Stdio::piped()).spawn().expect("it is built");
        told.await_text(r#"{"current_heating_setpoint":21}"#);
        assert_eq!(
            told.take(),
            [r#"{"system_mode":"heat"}"#, r#"{"current_heating_setpoint":21}"#],
            "{mode}"
        );
        // The goal is about the building, not about the set point.
        broker.say("zigbee2mqtt/office1 thermo", r#"{"local_temperature":20.9}"#);
        office.await_fact("(= (temperature office1) 20.9)", true);
        std::thread::sleep(NOTHING_FOR);
        assert!(heating.try_wait().expect("our own child").is_none(), "{mode}: it is too cold yet");
        broker.say("zigbee2mqtt/office1 thermo", r#"{"local_temperature":21.1}"#);
        let done = heating.wait_with_output().expect("our own child");
        assert_eq!(done.status.code(), Some(0), "{mode}: {done:?}");
        // The set point alone is a goal, too, and so is the program.
        let thermo = "office1-thermo-thermostat";
        reach(&office, &format!("(<= (target-temperature {thermo}) 18)"));
        reach(&office, &format!("(thermostat-program {thermo} program-program)"));
        assert_eq!(
            told.take(),
            [r#"{"current_heating_setpoint":18}"#, r#"{"preset":"program"}"#],
            "{mode}"
        );
        // This thermostat has no mode in which it cools.
        let (code, said) = office.ask(&["goal", "(<= (temperature office1) 18)"]);
        assert_eq!(code, Some(1), "{mode}: {said}");
        tell(&broker, &[]);
        broker.retain("zigbee2mqtt/office1 thermo", "");
    }
}

/// Starts a light of the JSON schema, which keeps its brightness while it is off.
fn light(broker: &Arc<Broker>, told: &Told) -> Subscriber {
    let (speaker, told) = (Arc::clone(broker), told.clone());
    let mut state = json!({ "state": "OFF", "brightness": 204, "color_temp": 370 });
    broker.retain("lab/lamp", &state.to_string());
    broker.device("lab/lamp/set", move |command| {
        told.push(command.to_owned());
        let command: Value = serde_json::from_str(command).expect("JSON");
        for (key, value) in command.as_object().expect("an object") {
            state[key] = value.clone();
        }
        speaker.retain("lab/lamp", &state.to_string());
    })
}

#[test]
fn a_lamp_is_dimmed_and_its_warmth_is_set() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Told::default();
    let lamp = json!({ "schema": "json", "cmd_t": "lab/lamp/set", "stat_t": "lab/lamp",
        "sup_clrm": ["color_temp", "xy"], "min_mirs": 153, "max_mirs": 500 });
    broker.retain("homeassistant/light/lamp/config", &entity("lamp1", lamp));
    for mode in ["decentralized", "centralized"] {
        let _light = light(&broker, &told);
        let office = office(mode, &broker, "");
        office.await_devices(1);
        // A lamp that is off gives no light, whatever it remembers.
        office.await_fact("(= (brightness lamp1) 0)", true);
        office.await_fact("(= (last-brightness lamp1) 80)", true);
        for (goal, expected) in [
            ("(= (brightness lamp1) 50)", &[r#"{"brightness":128,"state":"ON"}"#][..]),
            (
                "(and (lit office1) (<= (brightness lamp1) 20))",
                &[r#"{"brightness":51,"state":"ON"}"#],
            ),
            ("(<= (color-temperature lamp1) 2500)", &[r#"{"color_temp":400,"state":"ON"}"#]),
            ("(not (lit office1))", &[r#"{"state":"OFF"}"#]),
            ("(lamp-color lamp1 color-blue)", &[r#"{"color":{"x":0.15,"y":0.06},"state":"ON"}"#]),
            ("(and (lamp-color lamp1 color-blue) (not (lit office1)))", &[r#"{"state":"OFF"}"#]),
            ("(lit office1)", &[r#"{"state":"ON"}"#]),
            ("(>= (brightness lamp1) 80)", &[r#"{"brightness":204,"state":"ON"}"#]),
            ("(= (brightness lamp1) 0)", &[r#"{"state":"OFF"}"#]),
        ] {
            let said = reach(&office, goal);
            assert_eq!(told.take(), expected, "{mode}: {goal}: {said}");
        }
    }
}

#[test]
fn fans_numbers_choices_and_scenes_are_set() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Told::default();
    let mut devices = Vec::new();
    for (topic, report) in [
        ("lab/fan/set", "lab/fan"),
        ("lab/fan/speed/set", "lab/fan/speed"),
        ("lab/volume/set", "lab/volume"),
        ("lab/source/set", "lab/source"),
        ("lab/scene/set", ""),
    ] {
        let (speaker, heard) = (Arc::clone(&broker), told.clone());
        devices.push(broker.device(topic, move |command| {
            heard.push(format!("{topic} {command}"));
            if !report.is_empty() {
                speaker.retain(report, command);
            }
        }));
    }
    let fan = json!({ "cmd_t": "lab/fan/set", "stat_t": "lab/fan", "pct_cmd_t": "lab/fan/speed/set",
        "pct_stat_t": "lab/fan/speed", "spd_rng_min": 1, "spd_rng_max": 3 });
    broker.retain("homeassistant/fan/fan/config", &entity("fan1", fan));
    broker.retain("lab/fan", "OFF");
    let volume = json!({ "cmd_t": "lab/volume/set", "stat_t": "lab/volume", "min": 0, "max": 10 });
    broker.retain("homeassistant/number/volume/config", &entity("volume1", volume));
    broker.retain("lab/volume", "2");
    let source = json!({ "cmd_t": "lab/source/set", "stat_t": "lab/source",
        "options": ["Radio", "Line in"] });
    broker.retain("homeassistant/select/source/config", &entity("source1", source));
    broker.retain("lab/source", "Radio");
    let scene = json!({ "cmd_t": "lab/scene/set", "pl_on": "movie" });
    broker.retain("homeassistant/scene/movie/config", &entity("movie1", scene));
    let office = office("decentralized", &broker, "");
    office.await_devices(4);
    office.await_fact("(selected source1 option-radio)", true);
    for (goal, expected) in [
        ("(>= (fan-speed fan1) 50)", &["lab/fan/speed/set 2", "lab/fan/set ON"][..]),
        ("(>= (dial-value volume1) 5)", &["lab/volume/set 5"]),
        ("(<= (dial-value volume1) 3)", &["lab/volume/set 3"]),
        ("(selected source1 option-line-in)", &["lab/source/set Line in"]),
        ("(scene-active movie1)", &["lab/scene/set movie"]),
        ("(not (ventilated office1))", &["lab/fan/set OFF"]),
    ] {
        let said = reach(&office, goal);
        // The order of messages on several topics is not known here.
        let (mut told, mut expected) = (told.take(), expected.to_vec());
        told.sort();
        expected.sort_unstable();
        assert_eq!(told, expected, "{goal}: {said}");
    }
    office.await_fact("(selected source1 option-radio)", false);
}

/// A shutter that moves until it is told to stop.
#[test]
fn a_stop_ends_the_movement_of_a_shutter() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Told::default();
    let (speaker, heard) = (Arc::clone(&broker), told.clone());
    let _shutter = broker.device("zigbee2mqtt/office1 blind/set", move |command| {
        heard.push(command.to_owned());
        let is_stop = command.contains("STOP");
        let position = if is_stop { 34 } else { 30 };
        let report = json!({ "position": position, "state": "OPEN" });
        speaker.say("zigbee2mqtt/office1 blind", &report.to_string());
    });
    tell(&broker, &[shutter("office1 blind", "0x70")]);
    broker.retain("zigbee2mqtt/office1 blind", r#"{"position":20,"state":"OPEN"}"#);
    let office = office("decentralized", &broker, "");
    office.await_devices(1);
    let step = "(raise-cover-position office1-blind office1 percent-80)";
    let mut moving = office.command(&["act", step]).spawn().expect("it is built");
    office.await_fact("(= (cover-position office1-blind) 30)", true);
    let (code, table) = office.ask(&["stop"]);
    assert_eq!(code, Some(0), "{table}");
    assert!(table.contains(&format!("stopped: {step}")), "{table}");
    assert_eq!(told.take(), [r#"{"position":80}"#, r#"{"state":"STOP"}"#], "{table}");
    office.await_fact("(= (cover-position office1-blind) 34)", true);
    moving.wait().expect("our own child");
    let (code, said) = office.ask(&["act", step]);
    assert_eq!(code, Some(1), "{said}");
    assert!(told.take().is_empty(), "{said}");
}

/// The dimmer of docs/devices.md, driven by a program.
#[test]
fn a_program_sets_a_level() {
    let Some(broker) = Broker::start() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("dim");
    let text =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../docs/devices.md"));
    let text = text.expect("the document is there");
    let entry = text.split("```toml\n").find(|block| block.contains("name = \"lamp-2\""));
    let entry = entry.and_then(|block| block.split("```").next()).expect("its example");
    let run = format!("[\"/bin/sh\", \"-c\", \"echo $0 > {}\", \"{{l}}\"]", file.display());
    let entry = entry.replace("[\"/usr/local/bin/dim\", \"{l}\"]", &run);
    let office = office("decentralized", &broker, &format!("\n{entry}"));
    office.await_devices(1);
    let said = reach(&office, "(= (brightness lamp-2) 50)");
    assert_eq!(std::fs::read_to_string(&file).expect("a file"), "percent-50\n", "{said}");
    office.await_fact("(= (brightness lamp-2) 50)", true);
    let said = reach(&office, "(< (brightness lamp-2) 50)");
    assert_eq!(std::fs::read_to_string(&file).expect("a file"), "percent-0\n", "{said}");
}

/// A wall button that Zigbee2MQTT describes, and a lamp: a kept goal reacts to the press.
#[test]
fn a_kept_goal_reacts_to_the_press_of_a_button() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Told::default();
    let _light = light(&broker, &told);
    let lamp = json!({ "schema": "json", "cmd_t": "lab/lamp/set", "stat_t": "lab/lamp" });
    broker.retain("homeassistant/light/lamp/config", &entity("lamp1", lamp));
    let button = json!({ "ieee_address": "0x15", "friendly_name": "office1 button", "definition": {
        "exposes": [{ "type": "enum", "name": "action", "property": "action", "access": 1,
            "values": ["single", "double", "hold"] }] } });
    tell(&broker, &[button]);
    // A press that the broker has kept happened at an unknown time.
    broker.retain("zigbee2mqtt/office1 button", r#"{"action":"single"}"#);
    let office = office("decentralized", &broker, "");
    office.await_devices(1);
    await_discovered(&office, "office1-button", |one| one["joined"] == true);
    let goal = "(imply (pressed office1-button press-single) (lit office1))";
    let mut keeping = office.command(&["goal", goal, "--maintain"]).spawn().expect("it is built");
    await_kept(&office);
    std::thread::sleep(NOTHING_FOR);
    assert_eq!(told.take(), [""; 0]);
    broker.say("zigbee2mqtt/office1 button", r#"{"action":"double"}"#);
    office.await_fact("(pressed office1-button press-double)", true);
    broker.say("zigbee2mqtt/office1 button", r#"{"action":"single"}"#);
    broker.say("zigbee2mqtt/office1 button", r#"{"action":""}"#);
    told.await_text(r#"{"state":"ON"}"#);
    // The press is over after some seconds.
    office.await_fact("(pressed office1-button press-single)", false);
    assert_eq!(told.take(), [r#"{"state":"ON"}"#]);
    office.terminate(&keeping);
    keeping.wait().expect("our own child");
}

/// Waits until the ecosystem has a goal that holds and is kept.
fn await_kept(office: &Office) {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let goals = office.ask_json(&["goals"]).to_string();
        if goals.contains("holding") {
            return;
        }
        assert!(Instant::now() < deadline, "{goals}");
    }
}

#[test]
fn hostile_descriptions_and_values_disturb_nothing() {
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let told = Told::default();
    let _shutter = move_shutter(&broker, "office1 blind", &told);
    tell(&broker, &[shutter("office1 blind", "0x70")]);
    let office = office("decentralized", &broker, "");
    office.await_devices(1);
    for bad in [
        r#"{"position":"NaN"}"#,
        r#"{"position":1e308}"#,
        r#"{"position":-5}"#,
        r#"{"position":250}"#,
        r#"{"position":null}"#,
        r#"{"position":[50]}"#,
    ] {
        broker.say("zigbee2mqtt/office1 blind", r#"{"position":20,"state":"OPEN"}"#);
        office.await_fact("(= (cover-position office1-blind) 20)", true);
        broker.say("zigbee2mqtt/office1 blind", bad);
        office.await_fact("(= (cover-position office1-blind) 20)", false);
    }
    // An unknown position is no obstacle to a command.
    reach(&office, "(= (cover-position office1-blind) 50)");
    assert_eq!(told.take(), [r#"{"position":50}"#]);
    for (name, bounds) in [
        ("huge", json!({ "min": -1e308, "max": 1e308 })),
        ("reversed", json!({ "min": 100, "max": 0 })),
        ("words", json!({ "min": "NaN", "max": "inf" })),
    ] {
        let mut number = json!({ "cmd_t": "lab/x/set", "stat_t": "lab/x" });
        for (key, value) in bounds.as_object().expect("an object") {
            number[key] = value.clone();
        }
        broker.retain(&format!("homeassistant/number/{name}/config"), &entity(name, number));
        let told = await_discovered(&office, name, |one| one["joined"] == false);
        assert!(told["problem"].to_string().contains("its bounds are"), "{told}");
    }
    let million =
        json!({ "cmd_t": "lab/y/set", "stat_t": "lab/y", "min": 0, "max": 1e6, "step": 1 });
    broker.retain("homeassistant/number/million/config", &entity("million", million));
    let endless = json!({ "cmd_t": "lab/z/set", "stat_t": "lab/z", "min": 0, "max": 5, "step": 0 });
    broker.retain("homeassistant/number/endless/config", &entity("endless", endless));
    await_discovered(&office, "million", |one| one["joined"] == true);
    await_discovered(&office, "endless", |one| one["joined"] == true);
    reach(&office, "(= (cover-position office1-blind) 75)");
}

/// A goal about all shutters of a building: each gets a position of its own.
#[test]
fn a_goal_about_forty_shutters_moves_each_once() {
    const SHUTTERS: usize = 40;
    let Some(broker) = Broker::start() else { return };
    let broker = Arc::new(broker);
    let names: Vec<_> = (0..SHUTTERS).map(|number| format!("office1 blind {number}")).collect();
    let devices: Vec<_> = (names.iter().enumerate())
        .map(|(number, name)| shutter(name, &format!("0x{number:04}")))
        .collect();
    for mode in ["decentralized", "centralized"] {
        let told = Told::default();
        let (speaker, heard) = (Arc::clone(&broker), told.clone());
        // One process stands for all motors: each command is reported as it was given.
        let _motors = broker.devices("zigbee2mqtt/+/set", move |topic, command| {
            heard.push(command.to_owned());
            speaker.say(topic.trim_end_matches("/set"), command);
        });
        tell(&broker, &devices);
        for name in &names {
            broker.retain(&format!("zigbee2mqtt/{name}"), r#"{"position":80,"state":"OPEN"}"#);
        }
        let office = office(mode, &broker, "");
        office.await_devices(SHUTTERS);
        office.await_fact("(= (cover-position office1-blind-39) 80)", true);
        let goal = "(forall (?c - cover) (<= (cover-position ?c) 50))";
        let said = reach(&office, goal);
        let told = told.take();
        assert_eq!(told.len(), SHUTTERS, "{mode}: {said}");
        // Each actuator proves that its own plan changes least. One plan for all may change more.
        let is_right = |told: &String| {
            let position = serde_json::from_str::<Value>(told).expect("JSON")["position"].as_f64();
            match mode {
                "decentralized" => position == Some(50.0),
                _ => position.is_some_and(|position| position <= 50.0),
            }
        };
        assert!(told.iter().all(is_right), "{mode}: {told:?}");
        tell(&broker, &[]);
    }
}
