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
        // Paths of values that are not the author's: examples, and those of keys that were renamed.
        let mut invented: Vec<Vec<String>> = Vec::new();
        for _ in 0..MISTAKES_MAX {
            let Err(error) = stage.build(&tried) else { return };
            if let HostError::Build(BuildError::Safeguards { problem, .. }) = &error {
                return self.say_of_safeguards(entry, problem, severity);
            }
            let path = culprit(&tried, stage, &error, self.ecosystem);
            if invented.iter().any(|own| path.starts_with(own)) {
                return;
            }
            let value = at(&tried.config, &path);
            let dotted = path.join(".");
            let example = |key: &str| example(key, &dotted, self.ecosystem);
            let ExplainedMistake { kind, message, help } =
                worded(&said(&error), &shown(&path), value, example);
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
            invented.extend(written_instead(&path, &kind));
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

/// Returns the path of the value that [`goes_on`] has written for a mistake at `path`.
fn written_instead(path: &[String], kind: &ConfigMistake) -> Option<Vec<String>> {
    let (tables, key) = match kind {
        ConfigMistake::MissingKey(key) => (path, key),
        ConfigMistake::UnknownKey(_, Some(meant)) => (path.split_last()?.1, meant),
        _ => return None,
    };
    Some(tables.iter().chain([key]).cloned().collect())
}

/// Returns a path as the author reads it: behind the number of a table in a list, which the place of
/// the report shows.
fn shown(path: &[String]) -> String {
    let is_number = |key: &String| key.parse::<usize>().is_ok();
    let begins = path.iter().rposition(is_number).map_or(0, |number| number + 1);
    let names: Vec<&str> = match path[begins..] {
        [] => path.iter().filter(|key| !is_number(key)).map(String::as_str).collect(),
        _ => path[begins..].iter().map(String::as_str).collect(),
    };
    names.join(".")
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
/// removed, or replaced by the example of its key, there is no mistake or another one. The path is
/// empty if the mistake is that a key is missing.
fn culprit(
    entry: &AgentEntry,
    stage: &DryRun,
    error: &HostError,
    ecosystem: &Ecosystem,
) -> Vec<String> {
    let search = CulpritSearch {
        entry,
        stage,
        ecosystem,
        is_shape: matches!(error, HostError::Build(BuildError::Config { .. })),
        told: error.to_string(),
    };
    search.below(Vec::new())
}

/// The search for the value that causes a mistake.
struct CulpritSearch<'s> {
    entry: &'s AgentEntry,
    stage: &'s DryRun,
    ecosystem: &'s Ecosystem,
    /// Whether the mistake is one of types and keys.
    is_shape: bool,
    /// The message about the mistake.
    told: String,
}

// === impl CulpritSearch ===

impl CulpritSearch<'_> {
    /// Returns the path of the cause at `path` or below it.
    fn below(&self, path: Vec<String>) -> Vec<String> {
        let Some(within) = at(&self.entry.config, &path) else { return path };
        let mut keys = parts(within);
        // A key that the message names is the cause more probably than another one.
        keys.sort_by_key(|key| !self.names(key));
        let inner = |key: &String| -> Vec<String> { path.iter().chain([key]).cloned().collect() };
        let is_right = |key: &&String| self.without(&inner(key)).is_ok();
        let is_other = |key: &&String| self.may_be_cause(within, key) && self.differs(&inner(key));
        let next = keys.iter().find(is_right).or_else(|| keys.iter().find(is_other));
        if let Some(key) = next {
            return self.below(inner(key));
        }
        // A required key cannot be removed, but what stands in it can be the cause.
        let nested = keys.iter().map(|key| (inner(key), self.below(inner(key))));
        if let Some((_, found)) = nested.into_iter().find(|(from, found)| found.len() > from.len())
        {
            return found;
        }
        let is_cured = |key: &&String| self.is_cured_by_example(&inner(key));
        match keys.iter().find(is_cured) {
            Some(key) => inner(key),
            None => path,
        }
    }

    fn names(&self, key: &str) -> bool {
        self.told.contains(&format!("`{key}`"))
    }

    /// Whether the removal of the value at `key` is worth a trial. A key that is missing is missing
    /// in a table: another value cannot be the cause.
    fn may_be_cause(&self, within: &Value, key: &str) -> bool {
        let is_container = part(within, key).is_some_and(|value| !parts(value).is_empty());
        let is_missing = self.told.contains("missing field");
        let needs_another = ["is missing", " needs `"].iter().any(|it| self.told.contains(it));
        is_container || !is_missing && (self.is_shape || !needs_another || self.names(key))
    }

    /// Returns what the plugin says about the entry without the value at `path`.
    fn without(&self, path: &[String]) -> Result<(), String> {
        let mut config = Value::clone(&self.entry.config);
        take(&mut config, path);
        self.built(config)
    }

    fn built(&self, config: Value) -> Result<(), String> {
        let entry = AgentEntry { config: config.into(), ..self.entry.clone() };
        self.stage.build(&entry).map(|_| ()).map_err(|error| error.to_string())
    }

    /// Whether another mistake is reported without the value at `path`. Removing a required key
    /// yields another error, but does not make that key the cause.
    fn differs(&self, path: &[String]) -> bool {
        let key = path.last().map_or("", String::as_str);
        self.without(path).is_err_and(|now| {
            now != self.told && (self.is_shape || !now.contains(&format!("missing field `{key}`")))
        })
    }

    fn is_cured_by_example(&self, path: &[String]) -> bool {
        let Some((key, tables)) = path.split_last() else { return false };
        let value = example(key, &tables.join("."), self.ecosystem).and_then(|it| parsed(&it));
        let mut config = Value::clone(&self.entry.config);
        match (at_mut(&mut config, path), value) {
            (Some(place), Some(value)) => *place = value,
            _ => return false,
        }
        self.built(config).is_ok()
    }
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
        "line" => quote("GPIO17"),
        "to" => "[{ kind = \"ntfy\", url = \"https://ntfy.example/TOPIC\" }]".to_owned(),
        "max-size" => quote("1GiB"),
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
