//! Known and unknown facts, with real daemons: only an agent's own claim counts for the facts it
//! answers for, a number is measured before it is judged, and the facts of a dead daemon become
//! unknown.

use std::fs;

use crate::support::{Office, lab};

/// Returns the entry of a lamp that runs two programs; its state is in the file `FOLDER/NAME`.
fn lamp(name: &str, daemon: &str) -> String {
    let program = |word: &str| format!(r#"["/bin/sh", "-c", "echo {word} > FOLDER/{name}"]"#);
    format!(
        r#"
[[agent]]
name = "{name}"
plugin = "switch"
driver = "command"
daemon = "{daemon}"

[agent.config]
location = "office1"
kind = "lamp"
on = {on}
off = {off}
state = ["cat", "FOLDER/{name}"]
every = "100ms"
"#,
        on = program("on"),
        off = program("off"),
    )
}

/// Returns the lab, with the reasoning agents on a machine of their own.
fn reasoning_apart(mode: &str) -> String {
    let reasoning = ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];
    reasoning.iter().fold(lab(mode), |text, plugin| {
        let line = format!("plugin = \"{plugin}\"\n");
        text.replace(&line, &format!("{line}daemon = \"reasoning\"\n"))
    })
}

#[test]
fn the_light_of_a_room_is_unknown_when_a_lamps_daemon_dies() {
    for mode in ["decentralized", "centralized"] {
        let office = Office::new();
        let folder = office.folder().display().to_string();
        let lamps = lamp("lamp-a", "reasoning") + &lamp("lamp-b", "wall-pi");
        let text = reasoning_apart(mode) + &lamps.replace("FOLDER", &folder);
        let file = office.write("lab.toml", &text);
        office.write("lamp-a", "on\n");
        office.write("lamp-b", "on\n");
        let folder = office.folder().to_owned();
        let mut office = office.with_file(file);
        office.up(&["reasoning", "wall-pi"], &[]);
        office.await_devices(2);
        office.await_fact("(lit office1)", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        let is = |name: &str| {
            let text = fs::read_to_string(folder.join(name)).expect("it was written");
            text.trim().to_owned()
        };
        assert_eq!((is("lamp-a"), is("lamp-b")), ("off".to_owned(), "off".to_owned()), "{mode}");

        // The wall's lamp is on, and its daemon dies.
        office.write("lamp-b", "on\n");
        office.await_fact("(lamp-on lamp-b)", true);
        office.kill("wall-pi");
        office.await_fact("(unknown (lit office1))", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(1), "{mode}: the lamp burns: {said}");
        assert!(said.contains("it is unknown whether"), "{mode}: {said}");
        assert_eq!(is("lamp-b"), "on", "{mode}");
        // A person checks the room and reports it.
        let (code, said) = office.ask(&["set", "--retract", "(unknown (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        // The daemon returns and reports the real state.
        office.up(&["wall-pi"], &[]);
        office.await_fact("(lit office1)", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert_eq!(is("lamp-b"), "off", "{mode}");
    }
}

/// No axiom derives the light of a room if its only lamp has left. The lamp's last claim is unknown
/// then, and so is whether the room is dark.
#[test]
fn the_light_of_a_room_is_unknown_when_its_only_lamp_leaves() {
    for mode in ["decentralized", "centralized"] {
        let office = Office::new();
        let folder = office.folder().display().to_string();
        let elsewhere = lamp("lamp-a", "reasoning").replace("office1", "conf-room");
        let lamps = elsewhere + &lamp("lamp-b", "wall-pi");
        let text = reasoning_apart(mode) + &lamps.replace("FOLDER", &folder);
        let file = office.write("lab.toml", &text);
        office.write("lamp-a", "on\n");
        office.write("lamp-b", "on\n");
        let mut office = office.with_file(file);
        office.up(&["reasoning", "wall-pi"], &[]);
        office.await_devices(2);
        office.await_fact("(lit office1)", true);
        office.kill("wall-pi");
        office.await_fact("(unknown (lit office1))", true);
        for goal in ["(not (lit office1))", "(and (not (lit conf-room)) (not (lit office1)))"] {
            let (code, said) = office.ask(&["goal", goal]);
            assert_eq!(code, Some(1), "{mode}: the lamp burns: {said}");
            assert!(said.contains("it is unknown whether"), "{mode}: {said}");
        }
    }
}

/// The file names a lamp on a daemon that starts after the reasoning agents. Until then it is
/// unknown whether the lamp is on.
#[test]
fn the_light_of_a_room_is_unknown_until_its_lamp_joins() {
    for mode in ["decentralized", "centralized"] {
        let office = Office::new();
        let folder = office.folder().display().to_string();
        let elsewhere = lamp("lamp-a", "reasoning").replace("office1", "conf-room");
        let lamps = elsewhere + &lamp("lamp-b", "wall-pi");
        let text = reasoning_apart(mode) + &lamps.replace("FOLDER", &folder);
        let file = office.write("lab.toml", &text);
        office.write("lamp-a", "on\n");
        office.write("lamp-b", "on\n");
        let folder = office.folder().to_owned();
        let mut office = office.with_file(file);
        office.up(&["reasoning"], &[]);
        office.await_fact("(lit conf-room)", true);
        office.await_fact("(unknown (lit office1))", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(1), "{mode}: the lamp burns: {said}");
        assert!(said.contains("it is unknown whether"), "{mode}: {said}");
        // A fact for which no agent of the file answers is false, as before.
        let (code, said) = office.ask(&["goal", "(not (known-temperature office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        office.up(&["wall-pi"], &[]);
        office.await_fact("(lit office1)", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        let state = fs::read_to_string(folder.join("lamp-b")).expect("it was written");
        assert_eq!(state.trim(), "off", "{mode}");
    }
}

#[test]
fn a_lamp_is_switched_off_among_many_agents() {
    for mode in ["decentralized", "centralized"] {
        let office = Office::new();
        let folder = office.folder().display().to_string();
        let thermometer = |number: usize| {
            format!(
                "\n[[agent]]\nname = \"t-{number}\"\nplugin = \"temperature-sensor\"\n\
                 config = {{ location = \"office1\" }}\n"
            )
        };
        let thermometers: String = (1..=8).map(thermometer).collect();
        let lamp = lamp("lamp-a", "daemon").replace("daemon = \"daemon\"\n", "");
        let lamp = lamp.replace("FOLDER", &folder);
        let file = office.write("lab.toml", &(lab(mode) + &lamp + &thermometers));
        office.write("lamp-a", "on\n");
        let folder = office.folder().to_owned();
        let mut office = office.with_file(file);
        office.up(&["daemon"], &[]);
        office.await_devices(9);
        office.await_fact("(lit office1)", true);
        let (code, said) = office.ask(&["goal", "(not (lit office1))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        let state = fs::read_to_string(folder.join("lamp-a")).expect("it was written");
        assert_eq!(state.trim(), "off", "{mode}");
    }
}

#[test]
fn a_number_is_measured_before_it_is_judged() {
    for mode in ["decentralized", "centralized"] {
        let office = Office::new();
        let thermometer = "\n[[agent]]\nname = \"t-1\"\nplugin = \"temperature-sensor\"\n\
             driver = \"command\"\nconfig = { location = \"office1\", command = [\"cat\", \
             \"FOLDER/degrees\"], valid-for = \"2s\" }\n";
        let thermometer = thermometer.replace("FOLDER", &office.folder().display().to_string());
        let file = office.write("lab.toml", &(lab(mode) + &thermometer));
        office.write("degrees", "19.5\n");
        let mut office = office.with_file(file);
        office.up(&["daemon"], &[]);
        office.await_devices(1);
        let (code, said) = office.ask(&["goal", "(>= (temperature office1) 19)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert!(said.contains("a plan of 1 step") && said.contains("19.5 °C"), "{mode}: {said}");
        // Neither the condition nor its negation holds on unknown values.
        office.await_fact("(= (temperature office1) 19.5)", false);
        let (code, said) = office.ask(&["goal", "(not (>= (temperature office1) 21))"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert!(said.contains("a plan of 1 step"), "{mode}: {said}");
        office.await_fact("(= (temperature office1) 19.5)", false);
        let (code, said) = office.ask(&["goal", "(>= (temperature office1) 21)"]);
        assert_eq!(code, Some(1), "{mode}: {said}");
        let why = "`(temperature office1)` is 19.5, and no action here changes it";
        assert!(said.replace('\n', " ").contains(why), "{mode}: {said}");
    }
}

#[test]
fn a_claim_of_a_person_does_not_move_a_robot() {
    let mut office = Office::new();
    let robot = "\n[[agent]]\nname = \"robot-1\"\nplugin = \"turtlebot\"\n\
                 config = { start = \"corridor\", speed = 0.3 }\n";
    let file = office.write("lab.toml", &(lab("decentralized") + robot));
    office = office.with_file(file);
    office.up(&["daemon"], &[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["set", "(at robot-1 office2)"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("it says `(at robot-1 corridor)`"), "{said}");
    let (code, said) = office.ask(&["goal", "(at robot-1 office2)"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(!said.contains("holds already"), "{said}");
    let (code, said) = office.ask(&["goal", "(and (at robot-1 office1) (at robot-1 office2))"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("exclude each other"), "{said}");
    let (code, said) = office.ask(&["set", "(= (distance corridor office1) -5)"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("cannot be -5 m long; write more than 0"), "{said}");
}
