//! The setting of a scenario: the building, the agents on their machines, and the goals. The
//! setting is written to files of the same form as those of a user.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use ::building::{BuildingDevice, Layout};

/// The ontology of the paper's office, which every building of the scenarios uses.
const ONTOLOGY: &str = include_str!("../../../../../domains/smart-office/domain.pddl");

/// The factor by which all durations in the building are multiplied: driving 4 m takes 130 ms.
pub(crate) const TIME_SCALE: f64 = 0.01;

/// The name that the ecosystem file gives to the goal.
pub(crate) const GOAL: &str = "temperatures";

/// The name of the daemon that hosts the reasoning agents.
pub(crate) const REASONING: &str = "reasoning";

/// The building and the agents of a scenario.
pub(crate) struct Setting {
    /// The name of the ecosystem.
    name: &'static str,
    /// The building with the devices that are there from the start.
    pub(crate) at_first: Layout,
    /// The building with all devices, including those that are added later.
    layout: Layout,
    /// A function that returns further keys for the `config` of a device's agent, besides the
    /// device's place.
    more: Box<dyn Fn(&BuildingDevice) -> String>,
    replanning: bool,
    /// Whether agents keep from each other what their models declare `:private`.
    is_confidential: bool,
}

impl Setting {
    /// Creates a setting in which no device is added later, and each `config` contains only the
    /// device's place.
    pub(crate) fn new(name: &'static str, layout: &Layout) -> Setting {
        let more = Box::new(|_: &BuildingDevice| String::new());
        let (at_first, layout) = (layout.clone(), layout.clone());
        Setting { name, at_first, layout, more, replanning: true, is_confidential: false }
    }

    /// Sets the building as it is at the start; the other devices of the setting are plugged in
    /// later.
    pub(super) fn at_first(self, at_first: Layout) -> Setting {
        Setting { at_first, ..self }
    }

    /// Sets a function that returns further keys for the `config` of each device's agent, besides
    /// the device's place.
    pub(super) fn more(self, more: impl Fn(&BuildingDevice) -> String + 'static) -> Setting {
        Setting { more: Box::new(more), ..self }
    }

    /// Sets whether plans are repaired. `false` is used only in tests, which show that the scenario
    /// then fails.
    pub(super) fn replanning(self, replanning: bool) -> Setting {
        Setting { replanning, ..self }
    }

    /// Lets agents keep from each other what their models declare `:private`.
    pub(super) fn confidential(self) -> Setting {
        Setting { is_confidential: true, ..self }
    }

    /// Returns the names of the devices that are there from the start and have an agent.
    pub(crate) fn devices_at_first(&self) -> BTreeSet<String> {
        // A tag reader has no actions, so it is not among the agents that can be planned with.
        let has_agent = |device: &&BuildingDevice| {
            !matches!(
                device,
                BuildingDevice::MountedScreen { .. } | BuildingDevice::TagReader { .. }
            )
        };
        let devices = self.at_first.devices().iter().filter(has_agent);
        devices.map(|device| device.name().to_owned()).collect()
    }

    /// Returns the names of the parcels and tables in the building.
    pub(super) fn parcels(&self) -> BTreeSet<String> {
        let stored = self.layout.devices().iter().flat_map(|device| match device {
            BuildingDevice::Arm { stored, .. } => stored.keys().cloned().collect(),
            _ => Vec::new(),
        });
        let standing = self.layout.parcels().keys().chain(self.layout.tables().keys());
        standing.cloned().chain(stored).collect()
    }

    /// Whether the agent named `agent` is launched later than the others.
    pub(super) fn comes_later(&self, agent: &str) -> bool {
        self.layout.device(agent).is_some() && self.at_first.device(agent).is_none()
    }

    /// Writes the files of the ecosystem into `folder`. Returns the path of the ecosystem file.
    pub(super) fn write(&self, folder: &Path, socket: Option<&Path>) -> io::Result<PathBuf> {
        fs::write(folder.join("domain.pddl"), ONTOLOGY)?;
        fs::write(folder.join("map.pddl"), self.layout.map_pddl("smart-office"))?;
        let file = folder.join("althing.toml");
        fs::write(&file, self.ecosystem(folder, socket))?;
        Ok(file)
    }

    fn ecosystem(&self, folder: &Path, socket: Option<&Path>) -> String {
        let layout = &self.layout;
        let daemons: Vec<_> =
            layout.rooms().map(|room| format!("\"{}\"", daemon_of(room))).collect();
        let mut text = format!(
            "[ecosystem]\nname = \"{}\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\
             daemons = [{}]\n",
            self.name,
            daemons.join(", ")
        );
        if self.is_confidential {
            text.push_str("privacy = \"agents\"\n");
        }
        for plugin in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
            let stays = plugin == "plan-requester" && !self.replanning;
            let config = if stays { "replanning = false" } else { "" };
            agent(&mut text, plugin, plugin, REASONING, config);
        }
        for device in layout.devices() {
            if let Some((plugin, config)) = plugin_of(device, layout) {
                let config = format!("{config}{}", (self.more)(device))
                    .replace("{folder}", &folder.display().to_string());
                agent(&mut text, device.name(), plugin, &daemon_of_device(device, layout), &config);
            }
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
}

/// Returns the plugin of a device's agent, and the keys that set the device's place in the agent's
/// `config`; `None` if the device has no agent.
fn plugin_of(device: &BuildingDevice, layout: &Layout) -> Option<(&'static str, String)> {
    let at = |location: &String| format!("location = \"{location}\"");
    match device {
        BuildingDevice::FixedSensor { location, .. } => Some(("temperature-sensor", at(location))),
        BuildingDevice::Camera { location, .. } => Some(("ptz-camera", at(location))),
        BuildingDevice::Screen { location, .. } => Some(("screen", at(location))),
        BuildingDevice::MountedSensor { carrier, .. } => {
            Some(("ir-temperature-sensor", format!("mounted-on = \"{carrier}\"")))
        }
        BuildingDevice::Robot { name, start, meters_per_second } => {
            let has_screen = layout.devices().iter().any(
                |device| matches!(device, BuildingDevice::MountedScreen { carrier, .. } if carrier == name),
            );
            let is_arm = |device: &BuildingDevice| matches!(device, BuildingDevice::Arm { .. });
            let (plugin, tray) = match has_screen {
                true => ("video-robot", ""),
                false if layout.devices().iter().any(is_arm) => ("courier", ", tray = true"),
                false if !layout.parcels().is_empty() => ("courier", ""),
                false if !layout.tables().is_empty() => ("mover", ""),
                false => ("turtlebot", ""),
            };
            Some((plugin, format!("start = \"{start}\", speed = {meters_per_second:?}{tray}")))
        }
        BuildingDevice::Door { a, b, .. } => Some(("door", format!("between = {:?}", [a, b]))),
        BuildingDevice::Lift { landings, .. } => Some(("lift", format!("landings = {landings:?}"))),
        BuildingDevice::Arm { location, shelves, stored, .. } => {
            let stored: Vec<_> =
                stored.iter().map(|(parcel, shelf)| format!("{parcel} = {shelf:?}")).collect();
            let stored = stored.join(", ");
            let place = at(location);
            Some(("arm", format!("{place}, shelves = {shelves:?}, stored = {{ {stored} }}")))
        }
        BuildingDevice::TagReader { .. } => {
            let things = |things: &BTreeMap<String, String>| {
                let things = things.iter().map(|(name, at)| format!("{name} = {at:?}"));
                things.collect::<Vec<_>>().join(", ")
            };
            let (parcels, tables) = (things(layout.parcels()), things(layout.tables()));
            let config = format!("parcels = {{ {parcels} }}, tables = {{ {tables} }}");
            Some(("tag-reader", config))
        }
        _ => None,
    }
}

fn agent(text: &mut String, name: &str, plugin: &str, daemon: &str, config: &str) {
    let _ = write!(
        text,
        "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\ndaemon = \"{daemon}\"\n\
         config = {{ {config} }}\n\n"
    );
}

fn daemon_of(room: &str) -> String {
    format!("{room}-pi")
}

/// Returns the name of the daemon on the machine that hosts a device: the board of a place, or the
/// laptop of a robot.
fn daemon_of_device(device: &BuildingDevice, layout: &Layout) -> String {
    match device {
        BuildingDevice::FixedSensor { location, .. }
        | BuildingDevice::Camera { location, .. }
        | BuildingDevice::Screen { location, .. } => daemon_of(location),
        BuildingDevice::MountedSensor { carrier, .. } => match layout.device(carrier) {
            Some(carrier) => daemon_of_device(carrier, layout),
            None => REASONING.to_owned(),
        },
        BuildingDevice::TagReader { .. } => REASONING.to_owned(),
        BuildingDevice::Door { name, .. }
        | BuildingDevice::Lift { name, .. }
        | BuildingDevice::Arm { name, .. } => daemon_of(name),
        _ => format!("{}-laptop", device.name()),
    }
}
