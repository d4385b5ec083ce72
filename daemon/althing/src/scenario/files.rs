//! The ecosystem of a seed, as files: one TOML, the shared ontology, the map.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use ::building::{Device, Layout, SeededScenario};

/// The office's ontology serves every building of the scenario.
const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");

/// How much faster than real time the building lives: a walk of 4 m takes 130 ms.
pub(crate) const TIME_SCALE: f64 = 0.01;

/// The name of the goal in the file.
pub(crate) const GOAL: &str = "temperatures";

/// The daemon that hosts the reasoning engine.
pub(crate) const REASONING: &str = "reasoning";

/// Writes the files of a scenario into `folder`; yields the ecosystem file.
pub(super) fn write(
    scenario: &SeededScenario,
    folder: &Path,
    socket: Option<&Path>,
    replanning: bool,
) -> io::Result<PathBuf> {
    fs::write(folder.join("domain.pddl"), ONTOLOGY)?;
    fs::write(folder.join("map.pddl"), scenario.layout.map_pddl("smart-office"))?;
    let file = folder.join("althing.toml");
    fs::write(&file, ecosystem(scenario, socket, replanning))?;
    Ok(file)
}

fn ecosystem(scenario: &SeededScenario, socket: Option<&Path>, replanning: bool) -> String {
    let layout = &scenario.layout;
    let daemons: Vec<_> = layout.rooms().map(|room| format!("\"{}\"", daemon_of(room))).collect();
    let mut text = format!(
        "[ecosystem]\nname = \"scenario-1\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\
         daemons = [{}]\n",
        daemons.join(", ")
    );
    for plugin in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
        let config =
            if plugin == "plan-requester" && !replanning { "{ replanning = false }" } else { "{}" };
        agent(&mut text, plugin, plugin, REASONING, config);
    }
    for device in layout.devices() {
        device_entry(&mut text, device, layout);
    }
    let _ = write!(
        text,
        "[goals]\n{GOAL} = \"(forall (?r - room) (known-temperature ?r))\"\n\n\
         [building]\ntime-scale = {TIME_SCALE}\n"
    );
    if let Some(socket) = socket {
        let _ = writeln!(text, "socket = {:?}", socket.display().to_string());
    }
    let temperatures: Vec<_> = layout
        .locations()
        .iter()
        .map(|location| format!("{} = {:?}", location.name, location.celsius))
        .collect();
    let _ = writeln!(text, "temperatures = {{ {} }}", temperatures.join(", "));
    text
}

fn device_entry(text: &mut String, device: &Device, layout: &Layout) {
    let daemon = daemon_of_device(device, layout);
    let name = device.name();
    match device {
        Device::FixedSensor { location, .. } => {
            let config = format!("{{ location = \"{location}\" }}");
            agent(text, name, "temperature-sensor", &daemon, &config);
        }
        Device::Robot { start, meters_per_second, .. } => {
            let config = format!("{{ start = \"{start}\", speed = {meters_per_second:?} }}");
            agent(text, name, "turtlebot", &daemon, &config);
        }
        Device::MountedSensor { carrier, .. } => {
            let config = format!("{{ mounted-on = \"{carrier}\" }}");
            agent(text, name, "ir-temperature-sensor", &daemon, &config);
        }
        _ => (),
    }
}

fn agent(text: &mut String, name: &str, plugin: &str, daemon: &str, config: &str) {
    let _ = write!(
        text,
        "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\ndaemon = \"{daemon}\"\n\
         config = {config}\n\n"
    );
}

fn daemon_of(room: &str) -> String {
    format!("{room}-pi")
}

/// The machine that hosts a device: a room's board, or the laptop on a robot.
pub(super) fn daemon_of_device(device: &Device, layout: &Layout) -> String {
    match device {
        Device::FixedSensor { location, .. } => daemon_of(location),
        Device::MountedSensor { carrier, .. } => match layout.device(carrier) {
            Some(carrier) => daemon_of_device(carrier, layout),
            None => REASONING.to_owned(),
        },
        _ => format!("{}-laptop", device.name()),
    }
}
