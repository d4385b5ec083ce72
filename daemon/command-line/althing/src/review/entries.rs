//! Checks the entries of agents: builds each agent without launching it.

use std::collections::BTreeSet;

use agent::BuildError;
use pddl::{Diagnostic, Severity, Span, Types};
use serde_json::{Map, Value};

use super::wording::{self, ConfigMistake, ExplainedMistake, worded};
use super::{ReviewScope, Reviewer};
use crate::config::{AgentEntry, Ecosystem};
use crate::hosting::{DryRun, HostError};

/// Maximum number of mistakes that are reported per entry. An entry with more should be written
/// anew.
const MISTAKES_MAX: usize = 8;

impl Reviewer<'_> {
    /// Reports all mistakes in the entries of agents.
    pub(super) fn entries(&mut self, scope: ReviewScope<'_>) {
        let ecosystem = self.ecosystem;
        let stage = DryRun::of(ecosystem);
        // Entries of packages are skipped: only the machine with the package can check them.
        for entry in ecosystem.agents.iter().filter(|entry| entry.is_built_in()) {
            let severity = match scope {
                ReviewScope::Daemon(daemon)
                    if !entry.daemons.is_empty() && !entry.daemons.contains(daemon) =>
                {
                    Severity::Warning
                }
                _ => Severity::Error,
            };
            self.entry(entry, &stage, severity);
        }
    }

    /// Builds the agent of an entry, and reports the mistake that prevents it. Then corrects or
    /// removes the mistake and builds the agent again, so that all mistakes are found.
    fn entry(&mut self, entry: &AgentEntry, stage: &DryRun, severity: Severity) {
        let mut tried = entry.clone();
        // Keys that were removed because of wrong values. They do not count as missing.
        let mut taken = BTreeSet::new();
        for _ in 0..MISTAKES_MAX {
            let Err(error) = stage.build(&tried) else { return };
            if let HostError::Build(BuildError::Safeguards { problem, .. }) = &error {
                return self.say_of_safeguards(entry, problem, severity);
            }
            let path = culprit(&tried, stage, &error);
            let value = at(&tried.config, &path);
            let dotted = path.join(".");
            let example = |key: &str| example(key, &dotted, self.ecosystem);
            let ExplainedMistake { kind, message, help } =
                worded(&said(&error), &dotted, value, example);
            if let ConfigMistake::MissingKey(missing) = &kind
                && let Some(written) = self.misspelt(&tried, stage, &path, missing)
            {
                self.say_misspelt(entry, &path, &written, missing, severity);
                rename(&mut tried, &path, &written, missing);
                continue;
            }
            let is_consequence = match &kind {
                // A missing key has been reported already if it was removed above, or if it stands
                // beside `config`.
                ConfigMistake::MissingKey(key) => taken.contains(key) || self.is_beside(entry, key),
                ConfigMistake::Other => !taken.is_empty(),
                ConfigMistake::UnknownKey(..) | ConfigMistake::Kind => false,
            };
            if !is_consequence {
                self.is_complete &= severity != Severity::Error;
                let message = format!("config of `{}`: {message}", entry.name);
                let mut found = Diagnostic::error(Span::default(), message);
                (found.severity, found.help) = (severity, help);
                self.say_of_entry(entry, &dotted, found, &kind);
            }
            if !goes_on(&mut tried, &path, &kind, &mut taken, self.ecosystem) {
                return;
            }
        }
    }

    /// Returns the key that was written instead of the missing key `missing`: a key that the plugin
    /// does not have, and that resembles the missing key or is a synonym of it.
    fn misspelt(
        &self,
        entry: &AgentEntry,
        stage: &DryRun,
        path: &[String],
        missing: &str,
    ) -> Option<String> {
        let table = at(&entry.config, path)?.as_object()?;
        let known = [missing.to_owned()];
        let alike = table.keys().filter(|key| wording::meant(key, &known).is_some());
        let is_unknown = |key: &&String| {
            let mut tried = entry.clone();
            rename(&mut tried, path, key, missing);
            let mut both = tried.clone();
            let mut config = Value::clone(&both.config);
            let table = at_mut(&mut config, path);
            let table = table.and_then(Value::as_object_mut);
            table.into_iter().for_each(|table| {
                table.insert((*key).clone(), Value::Null);
            });
            both.config = config.into();
            let says = |entry: &AgentEntry| stage.build(entry).map_err(|error| said(&error));
            let names = |said: &str| {
                ["unknown field", "has no key"].iter().any(|words| said.contains(words))
                    && said.contains(&format!("`{key}`"))
            };
            says(&both).is_err_and(|said| names(&said))
        };
        alike.filter(|key| *key != missing).find(is_unknown).cloned()
    }

    fn say_misspelt(
        &mut self,
        entry: &AgentEntry,
        path: &[String],
        written: &str,
        missing: &str,
        severity: Severity,
    ) {
        let whole: Vec<&str> = path.iter().map(String::as_str).chain([written]).collect();
        let whole = whole.join(".");
        let message = format!("config of `{}`: there is no key `{whole}`", entry.name);
        let mut found = Diagnostic::error(Span::default(), message);
        (found.severity, found.help) = (severity, Some(format!("did you mean `{missing}`?")));
        self.is_complete &= severity != Severity::Error;
        let kind = ConfigMistake::UnknownKey(written.to_owned(), None);
        self.say_of_entry(entry, &whole, found, &kind);
    }

    /// Whether the key `key` stands directly in the entry instead of in the entry's `config`.
    fn is_beside(&self, entry: &AgentEntry, key: &str) -> bool {
        let path = format!("{}.{key}", entry.path);
        self.ecosystem.places.find(&path).is_some_and(|(_, _, is_it)| is_it)
    }

    /// Reports that the safeguards of an agent name an action that it does not have.
    fn say_of_safeguards(&mut self, entry: &AgentEntry, problem: &str, severity: Severity) {
        self.is_complete &= severity != Severity::Error;
        let message = format!("safeguards of `{}`: {problem}", entry.name);
        let mut found = Diagnostic::error(Span::default(), message);
        found.severity = severity;
        self.report_key(&format!("safeguards.{}", entry.name), found);
    }

    /// Reports a mistake in the `config` of an entry: at the key if the key is unknown or missing,
    /// otherwise at the value. If a mistake at that place has been reported already, does nothing.
    fn say_of_entry(
        &mut self,
        entry: &AgentEntry,
        path: &str,
        found: Diagnostic,
        kind: &ConfigMistake,
    ) {
        let config = format!("{}.config", entry.path);
        let path = if path.is_empty() { config } else { format!("{config}.{path}") };
        if let Some((source, place, true)) = self.ecosystem.places.find(&path)
            && self.said.contains(&(source.name.clone(), place.value.start))
        {
            return;
        }
        match kind {
            ConfigMistake::UnknownKey(..) | ConfigMistake::MissingKey(_) => {
                self.report_key(&path, found)
            }
            ConfigMistake::Kind | ConfigMistake::Other => self.report_value(&path, found),
        }
    }
}

/// Corrects a mistake in an entry if the intention is clear, otherwise removes it, so that the
/// other mistakes are found. Returns `false` if neither is possible.
fn goes_on(
    entry: &mut AgentEntry,
    path: &[String],
    kind: &ConfigMistake,
    taken: &mut BTreeSet<String>,
    ecosystem: &Ecosystem,
) -> bool {
    let mut config = Value::clone(&entry.config);
    match kind {
        ConfigMistake::UnknownKey(key, meant) => {
            let Some(value) = take(&mut config, path) else { return false };
            if path.last() != Some(key) {
                return false;
            }
            if let (Some(meant), Some((_, tables))) = (meant, path.split_last()) {
                let tables = at_mut(&mut config, tables);
                if let Some(Value::Object(table)) = tables {
                    table.entry(meant.clone()).or_insert(value);
                }
            }
        }
        ConfigMistake::Kind => {
            if take(&mut config, path).is_none() {
                return false;
            }
            taken.extend(path.last().cloned());
        }
        ConfigMistake::MissingKey(key) => {
            let example = example(key, &path.join("."), ecosystem).and_then(|text| parsed(&text));
            let Some(example) = example else { return false };
            if config.is_null() {
                config = Value::Object(Map::new());
            }
            let table = at_mut(&mut config, path);
            let Some(Value::Object(table)) = table else { return false };
            taken.insert(key.clone());
            if table.insert(key.clone(), example).is_some() {
                return false;
            }
        }
        ConfigMistake::Other => return false,
    }
    entry.config = config.into();
    true
}

/// Renames a key in the table at `path` in an entry's `config`.
fn rename(entry: &mut AgentEntry, path: &[String], from: &str, to: &str) {
    let mut config = Value::clone(&entry.config);
    let table = at_mut(&mut config, path);
    if let Some(table) = table.and_then(Value::as_object_mut)
        && let Some(value) = table.remove(from)
    {
        table.insert(to.to_owned(), value);
    }
    entry.config = config.into();
}

/// Returns the error message of the plugin that rejected an entry.
fn said(error: &HostError) -> String {
    match error {
        HostError::Build(BuildError::Config { source, .. }) => source.to_string(),
        HostError::Build(BuildError::Other { problem, .. }) => problem.clone(),
        error => format!("failed to {error}"),
    }
}

/// Returns the path of the value in an entry's `config` that causes a mistake: if that value is
/// removed, there is no mistake or another one. The path is empty if the mistake is that a key is
/// missing.
fn culprit(entry: &AgentEntry, stage: &DryRun, error: &HostError) -> Vec<String> {
    let built = |config: Value| {
        let entry = AgentEntry { config: config.into(), ..entry.clone() };
        stage.build(&entry).map_err(|error| error.to_string())
    };
    let (is_shape, told) =
        (matches!(error, HostError::Build(BuildError::Config { .. })), error.to_string());
    let mut path: Vec<String> = Vec::new();
    while let Some(within) = at(&entry.config, &path) {
        let keys = parts(within);
        let outcome = |key: &String| {
            let path: Vec<String> = path.iter().chain([key]).cloned().collect();
            let mut config = Value::clone(&entry.config);
            take(&mut config, &path);
            built(config)
        };
        let is_right = |key: &&String| outcome(key).is_ok();
        // Removing a required key yields another error, but does not make that key the cause.
        // A key that is missing is missing in a table: another value cannot be the cause.
        let may_lack = |key: &&String| {
            let value = part(within, key.as_str());
            !told.contains("missing field") || value.is_some_and(|it| !parts(it).is_empty())
        };
        let is_other = |key: &&String| {
            outcome(key).is_err_and(|now| {
                now != told && (is_shape || !now.contains(&format!("missing field `{key}`")))
            })
        };
        let next = keys.iter().find(is_right);
        let next = next.or_else(|| keys.iter().filter(may_lack).find(is_other)).cloned();
        match next {
            Some(key) => path.push(key),
            None => break,
        }
    }
    path
}

/// Returns the keys of a table, or the numbers of the tables in a list; nothing for another value.
fn parts(value: &Value) -> Vec<String> {
    match value {
        Value::Object(table) => table.keys().cloned().collect(),
        Value::Array(list) if list.iter().all(Value::is_object) => {
            (0..list.len()).map(|number| number.to_string()).collect()
        }
        _ => Vec::new(),
    }
}

/// Returns the value at a key of a table, or at a number in a list.
fn part<'v>(value: &'v Value, key: &str) -> Option<&'v Value> {
    match value {
        Value::Array(list) => list.get(key.parse::<usize>().ok()?),
        other => other.get(key),
    }
}

fn at<'v>(value: &'v Value, path: &[String]) -> Option<&'v Value> {
    path.iter().try_fold(value, |value, key| part(value, key))
}

fn at_mut<'v>(value: &'v mut Value, path: &[String]) -> Option<&'v mut Value> {
    path.iter().try_fold(value, |value, key| match value {
        Value::Array(list) => list.get_mut(key.parse::<usize>().ok()?),
        other => other.get_mut(key.as_str()),
    })
}

/// Removes the value at `path` from `value`, and returns it.
fn take(value: &mut Value, path: &[String]) -> Option<Value> {
    let (last, tables) = path.split_last()?;
    match at_mut(value, tables)? {
        Value::Array(list) => {
            let number = last.parse::<usize>().ok().filter(|number| *number < list.len())?;
            Some(list.remove(number))
        }
        other => other.as_object_mut()?.remove(last.as_str()),
    }
}

/// Returns an example of the value of a key in the table at `path` of a `config`, as TOML. The example contains names of
/// this ecosystem where possible.
fn example(key: &str, path: &str, ecosystem: &Ecosystem) -> Option<String> {
    let quote = |name: &str| format!("\"{name}\"");
    let place = || place(ecosystem, "location").unwrap_or_else(|| "hall".to_owned());
    Some(match key {
        "location" => quote(&super::entries::place(ecosystem, "room").unwrap_or_else(place)),
        "start" | "dock" | "shows" | "near" => quote(&place()),
        "mounted-on" => {
            let robots = ecosystem.agents.iter().filter(|each| each.config.get("start").is_some());
            quote(robots.map(|each| each.name.as_str()).next().unwrap_or("robot-1"))
        }
        "presets" => format!("{{ door = {{ shows = \"{}\" }} }}", place()),
        "poses" => format!("{{ window = {{ near = \"{}\", meters = 2.0 }} }}", place()),
        "patrol" => format!("{{ places = [\"{}\"], every = \"10min\" }}", place()),
        "endpoint" => quote("tcp/192.168.1.20:7447"),
        "places" if path.ends_with("ros2") => {
            format!("{{ {} = {{ x = 0.0, y = 0.0, yaw = 0.0 }} }}", place())
        }
        "places" => format!("[\"{}\"]", place()),
        "media" => "{ welcome = \"Welcome\" }".to_owned(),
        "quantity" => quote("co2"),
        "kind" => quote("lamp"),
        "broker" => quote("localhost:1883"),
        "model" => quote("MODEL.pddl"),
        "command" | "run" => "[\"PROGRAM\", \"ARGUMENT\"]".to_owned(),
        "range" => "100.0".to_owned(),
        "every" => quote("10min"),
        "battery" => "{ range = 100.0 }".to_owned(),
        _ => return None,
    })
}

/// Parses a text that [`example`] has returned.
fn parsed(text: &str) -> Option<Value> {
    let table: toml::Table = format!("value = {text}").parse().ok()?;
    serde_json::to_value(table.get("value")?).ok()
}

/// Returns the name of the first object of the map that has the type `sort`.
fn place(ecosystem: &Ecosystem, sort: &str) -> Option<String> {
    let types = Types::of(&ecosystem.domain);
    let mut objects = ecosystem.problem.objects.iter().map(|declaration| &declaration.object);
    let is_one = |ty: &pddl::Name| types.is_subtype(ty.as_str(), sort);
    let found = objects.find(|object| object.ty.alternatives.iter().any(is_one));
    found.map(|object| object.name.as_str().to_owned())
}
