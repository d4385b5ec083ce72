//! The agents of an ecosystem: checks their names and plugins, and the references in their entries.

use std::collections::BTreeSet;

use acl::{AgentId, DaemonId};
use pddl::Diagnostic;
use serde_json::Value;

use super::Interpreter;
use super::files::PddlFiles;
use crate::config::KnownPlugin;
use crate::config::ecosystem::AgentEntry;
use crate::config::raw::RawAgentEntry;
use crate::config::reader;

/// Paths of keys in an agent's `config` that hold names of places on the map, for every plugin. In
/// a path, `*` stands for every key of a table or every element of a list.
const PLACES: &[&str] = &[
    "location",
    "start",
    "dock",
    "presets.*.shows",
    "poses.*",
    "poses.*.near",
    "patrol.places.*",
    "rooms.*",
    "between.*",
    "landings.*",
    "parcels.*",
];
/// Keys in an agent's `config` that hold the name of another agent, for every plugin.
const OTHER_AGENTS: &[&str] = &["mounted-on", "robot"];

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the agents with correct entries. Reports the mistakes in the other entries.
    pub(super) fn agents(
        &mut self,
        raw: Vec<RawAgentEntry>,
        files: Option<&PddlFiles>,
    ) -> Vec<AgentEntry> {
        let names: Vec<Option<String>> = raw.iter().map(|agent| agent.name.clone()).collect();
        let poses: BTreeSet<String> = raw.iter().flat_map(poses).cloned().collect();
        let mut agents = Vec::new();
        for (index, raw) in raw.into_iter().enumerate() {
            let path = format!("agent.{index}");
            self.duplicate_name(&names, index);
            self.references(&path, &raw, &names, &poses, files);
            agents.extend(self.agent(&path, raw, files));
        }
        agents
    }

    fn agent(
        &mut self,
        path: &str,
        raw: RawAgentEntry,
        files: Option<&PddlFiles>,
    ) -> Option<AgentEntry> {
        // The key `actions` is read by `rights`.
        let RawAgentEntry { name, plugin, package, daemon, driver, config, actions: _ } = raw;
        let name = self.agent_name(path, name, files);
        if let Some(package) = package {
            let package = self.package(path, package);
            let daemons = self.hosts(path, None, &daemon)?;
            self.one_host(path, &daemons);
            let package = package?;
            let (plugin, config) = (plugin.unwrap_or_else(|| package.clone()), config.into());
            let package = Some(package);
            let path = path.to_owned();
            return Some(AgentEntry {
                path,
                name: name?,
                plugin,
                package,
                daemons,
                driver,
                config,
            });
        }
        let plugin = self.plugin(path, plugin, name.as_ref());
        let has_driver = match (plugin, &driver) {
            (Some(known), Some(driver)) => self.driver(path, known.name, known.drivers, driver),
            _ => true,
        };
        let daemons = self.hosts(path, plugin, &daemon)?;
        let plugin = plugin.filter(|_| has_driver)?.name.to_owned();
        let (path, package, config) = (path.to_owned(), None, config.into());
        Some(AgentEntry { path, name: name?, plugin, package, daemons, driver, config })
    }

    /// Checks that a package has a valid name. Whether the package exists is known only on the
    /// machine that hosts the agent.
    fn package(&mut self, path: &str, package: String) -> Option<String> {
        match AgentId::new(&package) {
            Ok(_) => Some(package),
            Err(err) => {
                self.invalid_name(&format!("{path}.package"), &err);
                None
            }
        }
    }

    /// Reports an error if the entry of an agent from a package names several daemons: an agent
    /// from a package cannot be a standby.
    fn one_host(&mut self, path: &str, hosts: &[DaemonId]) {
        if hosts.len() > 1 {
            self.about_value(&format!("{path}.daemon"), |span| {
                let message = "several daemons cannot host an agent of a package";
                Diagnostic::error(span, message)
                    .with_help("give it to one, or write several entries")
            });
        }
    }

    /// Returns the daemons that host an agent. If one of the names is invalid, reports that and
    /// returns `None`.
    fn hosts(
        &mut self,
        path: &str,
        plugin: Option<KnownPlugin>,
        names: &[String],
    ) -> Option<Vec<DaemonId>> {
        let mut hosts = Vec::new();
        for (index, name) in names.iter().enumerate() {
            let path = format!("{path}.daemon.{index}");
            match DaemonId::new(name) {
                Ok(daemon) if hosts.contains(&daemon) => self.about_value(&path, |span| {
                    Diagnostic::warning(span, format!("daemon `{daemon}` is listed twice"))
                }),
                Ok(daemon) => hosts.push(daemon),
                Err(err) => {
                    self.invalid_name(&path, &err);
                    return None;
                }
            }
        }
        if let Some(plugin) = plugin.filter(|plugin| !plugin.stands_by && hosts.len() > 1) {
            let message = format!("several daemons cannot host a `{}`", plugin.name);
            let known = self.known_plugins.iter().filter(|plugin| plugin.stands_by);
            let known: Vec<_> = known.map(|plugin| format!("`{}`", plugin.name)).collect();
            let help = format!(
                "give it to one, or write several entries; only these can have standbys: {}",
                known.join(", ")
            );
            self.about_value(&format!("{path}.daemon"), |span| {
                Diagnostic::error(span, message).with_help(help)
            });
        }
        Some(hosts)
    }

    fn agent_name(
        &mut self,
        path: &str,
        name: Option<String>,
        files: Option<&PddlFiles>,
    ) -> Option<AgentId> {
        let Some(name) = name else {
            self.missing(path, "name", "thermometer-office2");
            return None;
        };
        let path = format!("{path}.name");
        if files.is_some_and(|files| files.has_object(&name)) {
            let message = format!("`{name}` is on the map already");
            let help = "an agent is an object of the composed domain, so its name must be new";
            self.about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
        }
        AgentId::new(&name).map_err(|err| self.invalid_name(&path, &err)).ok()
    }

    /// Reports the agent at `index` if an earlier agent has the same name.
    fn duplicate_name(&mut self, names: &[Option<String>], index: usize) {
        let Some(name) = &names[index] else { return };
        let Some(first) = names[..index].iter().position(|other| other.as_ref() == Some(name))
        else {
            return;
        };
        let first = self.place(&format!("agent.{first}.name")).map(|(_, place)| place.value);
        self.about_value(&format!("agent.{index}.name"), |span| {
            let found = Diagnostic::error(span, format!("two agents are called `{name}`"))
                .with_help("give this one a name of its own");
            match first {
                Some(first) => found.with_note(first, "the first"),
                None => found,
            }
        });
    }

    fn plugin(
        &mut self,
        path: &str,
        plugin: Option<String>,
        name: Option<&AgentId>,
    ) -> Option<KnownPlugin> {
        let Some(plugin) = plugin else {
            self.missing(path, "plugin", "temperature-sensor");
            return None;
        };
        let known = self.known_plugins;
        if let Some(found) = known.iter().find(|known| known.name == plugin) {
            return Some(*found);
        }
        let names = || known.iter().map(|known| known.name);
        let swapped = name.filter(|name| names().any(|known| known == name.as_str()));
        let near = pddl::nearest(&plugin, names()).or_else(|| by_another_word(&plugin));
        let help = match (swapped, near) {
            (Some(name), _) => format!(
                "`name` and `plugin` are swapped: write name = \"{plugin}\" and plugin = \"{name}\""
            ),
            (None, Some(nearest)) => format!("did you mean `{nearest}`?"),
            (None, None) => format!("known are {}", names().collect::<Vec<_>>().join(", ")),
        };
        let message = format!("unknown plugin `{plugin}`");
        self.about_value(&format!("{path}.plugin"), |span| {
            Diagnostic::error(span, message).with_help(help)
        });
        None
    }

    /// Whether `driver` is one of the plugin's drivers. Reports a mistake if it is not.
    fn driver(&mut self, path: &str, plugin: &str, drivers: &[&str], driver: &str) -> bool {
        if drivers.contains(&driver) {
            return true;
        }
        let message = format!("plugin `{plugin}` has no driver `{driver}`");
        let help = match pddl::nearest(driver, drivers.iter().copied()) {
            Some(nearest) => format!("did you mean `{nearest}`?"),
            None if drivers.is_empty() => "it needs none: leave the key out".to_owned(),
            None => format!("it has {}", drivers.join(", ")),
        };
        self.about_value(&format!("{path}.driver"), |span| {
            Diagnostic::error(span, message).with_help(help)
        });
        false
    }

    /// Checks the values in the `config` of an entry that name a place or another agent.
    fn references(
        &mut self,
        path: &str,
        raw: &RawAgentEntry,
        names: &[Option<String>],
        poses: &BTreeSet<String>,
        files: Option<&PddlFiles>,
    ) {
        let Value::Object(config) = &raw.config else { return };
        let text = |key: &&str| Some((format!("{path}.config.{key}"), config.get(*key)?.as_str()?));
        for (key, place) in PLACES.iter().flat_map(|pattern| texts_at(&raw.config, pattern)) {
            let unknown = files.filter(|_| !poses.contains(place));
            if let Some((message, help)) = unknown.and_then(|files| files.unknown_object(place)) {
                let path = format!("{path}.config.{key}");
                self.about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
            }
        }
        for (path, carrier) in OTHER_AGENTS.iter().filter_map(text) {
            let known = || names.iter().flatten().map(String::as_str);
            if raw.name.as_deref() == Some(carrier) {
                let message = format!("`{carrier}` is this agent itself");
                let help = "write the name of the robot that carries it";
                self.about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
                continue;
            }
            if known().any(|name| name == carrier) {
                continue;
            }
            let suggestion = pddl::nearest(carrier, known());
            let message = format!("there is no agent `{carrier}`");
            let is_place = files.is_some_and(|files| files.unknown_object(carrier).is_none());
            self.about_value(&path, |span| {
                let found = Diagnostic::error(span, message).with_suggestion(suggestion);
                match is_place && suggestion.is_none() {
                    true => found.with_help(format!(
                        "`{carrier}` is a place: what stays there has location = \"{carrier}\""
                    )),
                    false => found,
                }
            });
        }
    }
}

/// Other words that users write for a plugin.
const PLUGIN_WORDS: &[(&str, &[&str])] = &[
    ("temperature-sensor", &["thermometer", "temperature", "temp", "temp-sensor"]),
    (
        "sensor",
        &[
            "hygrometer",
            "humidity",
            "humidity-sensor",
            "co2",
            "co2-sensor",
            "light-sensor",
            "motion-sensor",
            "motion",
            "contact",
            "contact-sensor",
            "door-sensor",
        ],
    ),
    (
        "switch",
        &[
            "lamp", "light", "relay", "socket", "plug", "heater", "heating", "fan", "lock",
            "cover", "blind", "shutter",
        ],
    ),
    ("turtlebot", &["robot", "mobile-robot"]),
    ("cleaning-robot", &["vacuum", "vacuum-cleaner", "cleaner", "roomba", "mop"]),
    ("ptz-camera", &["camera", "ip-camera", "webcam", "onvif"]),
    ("screen", &["tv", "television", "display", "monitor", "projector", "chromecast"]),
    ("mqtt", &["zigbee", "zigbee2mqtt", "broker", "tasmota", "home-assistant", "shelly"]),
    ("notifier", &["notification", "notifications", "mail", "email", "ntfy", "push", "webhook"]),
    ("command", &["script", "program", "exec", "shell"]),
];

/// Returns the plugin for which `word` is another word.
fn by_another_word(word: &str) -> Option<&'static str> {
    let word = word.to_lowercase().replace('_', "-");
    let found = PLUGIN_WORDS.iter().find(|(_, words)| words.contains(&word.as_str()));
    found.map(|(plugin, _)| *plugin)
}

/// Returns the names of the poses in an agent's entry, which are places besides those of the map.
fn poses(agent: &RawAgentEntry) -> impl Iterator<Item = &String> {
    let poses = agent.config.get("poses").and_then(Value::as_object);
    poses.into_iter().flat_map(|poses| poses.keys())
}

/// Returns the texts in `value` at the paths that match `pattern`, each with its path.
fn texts_at<'v>(value: &'v Value, pattern: &str) -> Vec<(String, &'v str)> {
    let mut found = vec![(String::new(), value)];
    for step in pattern.split('.') {
        let within = found.into_iter().flat_map(|(path, value)| {
            let below: Vec<(String, &Value)> = match (value, step) {
                (Value::Object(table), "*") => {
                    table.iter().map(|(key, value)| (key.clone(), value)).collect()
                }
                (Value::Array(list), "*") => {
                    list.iter().enumerate().map(|(at, value)| (at.to_string(), value)).collect()
                }
                (value, key) => {
                    value.get(key).into_iter().map(|value| (key.to_owned(), value)).collect()
                }
            };
            below.into_iter().map(move |(key, value)| (reader::join(&path, &key), value))
        });
        found = within.collect();
    }
    found.into_iter().filter_map(|(path, value)| Some((path, value.as_str()?))).collect()
}
