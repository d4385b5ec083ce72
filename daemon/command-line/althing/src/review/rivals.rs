//! Finds two agents that use one thing which has room for one: a line of a board, a topic of a
//! broker, a screen, a robot.

use std::collections::BTreeMap;

use actuator::OnOffNames;
use pddl::{Diagnostic, Severity, Span};
use serde_json::Value;

use super::Reviewer;
use crate::config::AgentEntry;

/// A kind of thing that one agent uses at a time, and the keys of `config` that name the thing.
struct SharedThing {
    /// The plugins with entries that name such a thing; empty for any plugin.
    plugins: &'static [&'static str],
    /// The drivers with entries that name such a thing; empty for any driver.
    drivers: &'static [&'static str],
    /// The keys that together name the thing; tables are separated by points. An entry without the
    /// first key names no such thing.
    keys: &'static [&'static str],
    /// Returns the value of a key in the form in which two names of one thing are equal.
    form: fn(&Value, &str) -> String,
    /// Whether the thing is one of the machine, so that another daemon has another one of the same
    /// name.
    is_of_machine: bool,
    severity: Severity,
    /// The name of the kind, as a part of a sentence.
    kind: &'static str,
    help: &'static str,
}

const SENSORS: &[&str] = &["temperature-sensor", "sensor"];
const ROBOTS: &[&str] = &["turtlebot", "cleaning-robot", "video-robot"];

/// The kinds of things that one agent uses at a time.
const THINGS: &[SharedThing] = &[
    SharedThing {
        plugins: &[],
        drivers: &["gpio"],
        keys: &["line", "chips"],
        form: of_line,
        is_of_machine: true,
        severity: Severity::Error,
        kind: "the GPIO line",
        help: "the kernel gives a line to one program at a time: write the line that this one is \
               wired to",
    },
    SharedThing {
        plugins: SENSORS,
        drivers: &["linux"],
        keys: &["device", "channel", "quantity", "sysfs"],
        form: as_written,
        is_of_machine: true,
        severity: Severity::Warning,
        kind: "the sensor",
        help: "`althing sensors` lists the names of all sensors of the machine",
    },
    SharedThing {
        plugins: SENSORS,
        drivers: &["phidget"],
        keys: &["serial", "hub-port", "port", "quantity"],
        form: as_written,
        is_of_machine: false,
        severity: Severity::Warning,
        kind: "the Phidget",
        help: "write the port that this one is plugged into",
    },
    SharedThing {
        plugins: SENSORS,
        drivers: &["mqtt"],
        keys: &["topic", "broker", "json", "quantity"],
        form: at_port::<1883>,
        is_of_machine: false,
        severity: Severity::Warning,
        kind: "the topic",
        help: "write the topic of this sensor's own device",
    },
    SharedThing {
        plugins: SENSORS,
        drivers: &["command"],
        keys: &["command", "json", "quantity"],
        form: as_written,
        is_of_machine: true,
        severity: Severity::Warning,
        kind: "the program",
        help: "both tell the same number: give each the program that measures its own place",
    },
    SharedThing {
        plugins: &["switch"],
        drivers: &["command"],
        keys: &["on"],
        form: as_written,
        is_of_machine: true,
        severity: Severity::Warning,
        kind: "the program",
        help: "both switch the same thing: remove one of the two entries, or correct the program",
    },
    SharedThing {
        plugins: &["mqtt"],
        drivers: &[],
        keys: &["broker", "devices"],
        form: at_port::<1883>,
        is_of_machine: false,
        severity: Severity::Warning,
        kind: "the broker",
        help: "each device would appear twice: remove one of the two entries, or name the devices \
               of each by `devices`",
    },
    SharedThing {
        plugins: ROBOTS,
        drivers: &["ros2"],
        keys: &["ros2.endpoint", "ros2.namespace", "ros2.domain-id"],
        form: of_robot,
        is_of_machine: false,
        severity: Severity::Error,
        kind: "the robot at",
        help: "write the `endpoint` or the `namespace` of this robot",
    },
    SharedThing {
        plugins: ROBOTS,
        drivers: &[],
        keys: &["dock"],
        form: as_written,
        is_of_machine: false,
        severity: Severity::Hint,
        kind: "the dock",
        help: "one robot charges there at a time; give each a dock of its own if both need it",
    },
    SharedThing {
        plugins: &["screen"],
        drivers: &["cast"],
        keys: &["address"],
        form: at_port::<8009>,
        is_of_machine: false,
        severity: Severity::Warning,
        kind: "the Chromecast",
        help: "each would end what the other shows: remove one of the two entries",
    },
    SharedThing {
        plugins: &["screen"],
        drivers: &["browser", "mpv"],
        keys: &["display"],
        form: as_written,
        is_of_machine: true,
        severity: Severity::Warning,
        kind: "the display",
        help: "each would cover what the other shows: write the `display` of each",
    },
    SharedThing {
        plugins: &["ptz-camera"],
        drivers: &["onvif"],
        keys: &["address"],
        form: at_port::<80>,
        is_of_machine: false,
        severity: Severity::Warning,
        kind: "the camera",
        help: "each would turn it away from the other: remove one of the two entries",
    },
    SharedThing {
        plugins: &["ptz-camera"],
        drivers: &["v4l2"],
        keys: &["device"],
        form: as_written,
        is_of_machine: true,
        severity: Severity::Error,
        kind: "the camera",
        help: "the kernel gives a camera to one program at a time",
    },
];

/// The use of a thing by an entry: the thing, and the place of the key that names it.
struct ThingUse<'e> {
    entry: &'e AgentEntry,
    thing: &'static SharedThing,
    /// The path of the key in the file that names the thing.
    path: String,
    /// The name of the thing, as it is written.
    written: String,
}

impl Reviewer<'_> {
    /// Reports each thing that a second agent uses.
    pub(super) fn rivals(&mut self) {
        let ecosystem = self.ecosystem;
        let mut first_uses: BTreeMap<String, ThingUse<'_>> = BTreeMap::new();
        let mut doubles = Vec::new();
        for entry in ecosystem.agents.iter().filter(|entry| entry.is_built_in()) {
            for (identity, used) in uses(entry) {
                match first_uses.get(&identity) {
                    Some(first) if first.entry.name != used.entry.name => {
                        doubles.push((first.entry, first.path.clone(), used));
                    }
                    Some(_) => (),
                    None => drop(first_uses.insert(identity, used)),
                }
            }
        }
        for (first, first_path, ThingUse { entry, thing, path, written }) in doubles {
            let message = format!(
                "`{}` uses {} `{written}`, and so does `{}`",
                entry.name, thing.kind, first.name
            );
            let mut found = Diagnostic::warning(Span::default(), message).with_help(thing.help);
            found.severity = thing.severity;
            self.report_double(&path, &first_path, found);
        }
        self.switches_of_one_state();
    }

    /// Reports switches of one kind in one room, if the ontology gives the state of the room to the
    /// switch: each would then contradict the other.
    fn switches_of_one_state(&mut self) {
        let ecosystem = self.ecosystem;
        let mut first_switches: BTreeMap<String, &AgentEntry> = BTreeMap::new();
        let mut doubles = Vec::new();
        for entry in ecosystem.agents.iter().filter(|entry| entry.plugin == "switch") {
            let names = match entry.config["kind"].as_str() {
                Some("lamp") => OnOffNames::LAMP,
                Some("relay") => OnOffNames::RELAY,
                Some("lock") => OnOffNames::DOOR_LOCK,
                _ => continue,
            };
            let Some(room) = entry.config["location"].as_str() else { continue };
            let state = names.predicates.term(entry.name.as_str(), room, &ecosystem.domain);
            match first_switches.get(&state) {
                Some(first) => doubles.push((*first, entry, state)),
                None => drop(first_switches.insert(state, entry)),
            }
        }
        for (first, entry, state) in doubles {
            let message = format!(
                "`{}` and `{}` both tell whether `{state}`, and one of them may be on while the \
                 other is off",
                first.name, entry.name
            );
            let help = "leave the predicate out of the ontology: the daemon then derives it from \
                        all switches of the room";
            let found = Diagnostic::warning(Span::default(), message).with_help(help);
            let path = |entry: &AgentEntry| format!("{}.config.location", entry.path);
            self.report_double(&path(entry), &path(first), found);
        }
    }

    /// Reports `found` at `path`, with a mark at `first`, where the same is written before.
    fn report_double(&mut self, path: &str, first: &str, found: Diagnostic) {
        let places = &self.ecosystem.places;
        let found = match (places.find(path), places.find(first)) {
            (Some((here, ..)), Some((there, place, true))) if here.name == there.name => {
                found.with_note(place.value, "the first")
            }
            _ => found,
        };
        self.report_value(path, found);
    }
}

/// Returns the things that an entry uses, each with a text that identifies it in the whole
/// ecosystem.
fn uses(entry: &AgentEntry) -> Vec<(String, ThingUse<'_>)> {
    let driver = entry.driver.as_deref().unwrap_or_default();
    let is_of = |listed: &[&str], name: &str| listed.is_empty() || listed.contains(&name);
    let things = THINGS
        .iter()
        .filter(|thing| is_of(thing.plugins, &entry.plugin) && is_of(thing.drivers, driver));
    let mut uses = Vec::new();
    for thing in things {
        let Some((main, _)) = thing.keys.split_first() else { continue };
        let Some(written) = value_at(&entry.config, main) else { continue };
        let values = thing.keys.iter().map(|key| (thing.form)(&entry.config, key));
        let name = values.collect::<Vec<_>>().join(" ");
        // Two sensor plugins may measure different quantities of one device.
        let quantity_plugin = if thing.plugins == SENSORS { entry.plugin.as_str() } else { "" };
        let machines: Vec<&str> = match (thing.is_of_machine, entry.daemons.as_slice()) {
            (false, _) => vec!["*"],
            (true, []) => vec![""],
            (true, daemons) => daemons.iter().map(|daemon| daemon.as_str()).collect(),
        };
        for machine in machines {
            let identity = format!("{} {quantity_plugin} {machine} {name}", thing.kind);
            let path = format!("{}.config.{main}", entry.path);
            let written = plain(written);
            uses.push((identity, ThingUse { entry, thing, path, written }));
        }
    }
    uses
}

/// Returns the value at a path of keys that points separate.
fn value_at<'v>(config: &'v Value, path: &str) -> Option<&'v Value> {
    path.split('.').try_fold(config, |value, key| value.get(key))
}

/// Returns a value as it is written, whatever it means.
fn as_written(config: &Value, key: &str) -> String {
    value_at(config, key).map_or_else(|| "-".to_owned(), Value::to_string)
}

/// Returns a value of the address of a robot. Slashes at the ends of a namespace do not count, nor does
/// a key that is left out differ from its default.
fn of_robot(config: &Value, key: &str) -> String {
    // A wrong address is reported already.
    let Some(address) = mobile_base::ros_address(config) else { return as_written(config, key) };
    match key {
        "ros2.endpoint" => address.endpoint,
        "ros2.namespace" => address.namespace,
        _ => address.domain_id.to_string(),
    }
}

/// Returns a value of the name of a line. The folder of its chip is `/dev` if it is left out.
fn of_line(config: &Value, key: &str) -> String {
    match (key, value_at(config, key)) {
        ("chips", None) => "\"/dev\"".to_owned(),
        _ => as_written(config, key),
    }
}

/// Returns a value of the name of a thing in the network. An address without a port has the port `PORT`;
/// the protocol, and a slash at the end, do not count.
fn at_port<const PORT: u16>(config: &Value, key: &str) -> String {
    let written = match (key, value_at(config, key).and_then(Value::as_str)) {
        ("address" | "broker", Some(written)) => written.trim_end_matches('/').to_lowercase(),
        _ => return as_written(config, key),
    };
    let address = written.split_once("://").map_or(written.as_str(), |(_, rest)| rest);
    let has_port = address.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok());
    if has_port || address.contains('/') {
        return address.to_owned();
    }
    format!("{address}:{PORT}")
}

/// Returns a value as a person writes it: a text without quotes, a list as its words.
fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(words) => words.iter().map(plain).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}
