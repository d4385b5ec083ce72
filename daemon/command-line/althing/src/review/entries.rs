//! Checks the entries of agents: builds each agent without launching it.

use std::collections::BTreeSet;

use agent::BuildError;
use pddl::{Diagnostic, Severity, Span};
use serde_json::{Map, Value};

use super::config_value::{at, at_mut, take};
use super::culprit::culprit;
use super::examples::{example, parsed};
use super::wording::{self, ConfigMistake, ExplainedMistake, worded};
use super::{ReviewScope, Reviewer};
use crate::config::{AgentEntry, Ecosystem};
use crate::hosting::{DryRun, HostError};
use crate::plugins;

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
        if self.say_of_missing_driver(entry, stage, severity) {
            return;
        }
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
            let said = with_present_table(said(&error), &tried.config);
            if said.starts_with("model:") && self.say_of_model(entry, severity) {
                return;
            }
            let path = culprit(&tried, stage, (&error, &said), self.ecosystem);
            if invented.iter().any(|own| path.starts_with(own)) {
                return;
            }
            let value = at(&tried.config, &path);
            let dotted = path.join(".");
            let example = |key: &str| example(key, &dotted, entry, self.ecosystem);
            let explained = worded(&said, &shown(&path), value, example);
            let help = self.accepted_help(&tried, stage, &path, &explained);
            let ExplainedMistake { kind, message, .. } = explained;
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
            if !is_consequence && !self.follows_from_wrong_name(entry, &message) {
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

    /// Reports that an entry names no driver although its `config` is that of a driver that is not the
    /// default one. Returns `false` if it is not so.
    fn say_of_missing_driver(
        &mut self,
        entry: &AgentEntry,
        stage: &DryRun,
        severity: Severity,
    ) -> bool {
        let drivers = plugins::find(&entry.plugin).map_or(&[][..], |plugin| plugin.drivers);
        let (None, [default, others @ ..]) = (&entry.driver, drivers) else { return false };
        let Err(error) = stage.build(entry) else { return false };
        let said = said(&error);
        let path = culprit(entry, stage, (&error, &said), self.ecosystem);
        // One key that is too much has a correction of its own.
        let mut without = entry.clone();
        let mut config = Value::clone(&entry.config);
        if take(&mut config, &path).is_some() {
            without.config = config.into();
            if stage.build(&without).is_ok() {
                return false;
            }
        }
        let fits = |driver: &&&str| {
            let driver = Some((**driver).to_owned());
            stage.build(&AgentEntry { driver, ..entry.clone() }).is_ok()
        };
        let Some(driver) = others.iter().find(fits) else { return false };
        let message = format!("config of `{}`: it is not for driver `{default}`", entry.name);
        let help = format!("write driver = \"{driver}\" beside `plugin`");
        let mut found = Diagnostic::error(Span::default(), message).with_help(help);
        found.severity = severity;
        self.is_complete &= severity != Severity::Error;
        self.report_value(&format!("{}.plugin", entry.path), found);
        true
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
        let table = format!("safeguards.{}", entry.name);
        let action = problem.split('`').nth(1).unwrap_or_default();
        // Names of actions are of any case in the file.
        let mut written = self.ecosystem.places.keys_under(&table);
        let written = written.find(|key| key.eq_ignore_ascii_case(action));
        let path = written.map_or_else(|| table.clone(), |key| format!("{table}.{key}"));
        self.report_key(&path, found);
    }

    /// Whether a message about an entry names a text of its `config` that is reported already, as the
    /// name of a place that is not there.
    fn follows_from_wrong_name(&self, entry: &AgentEntry, message: &str) -> bool {
        let config = format!("{}.config", entry.path);
        let places = self.ecosystem.places.within(&config);
        let mut wrong = places.filter_map(|(source, place)| {
            let is_said = self.said.contains(&(source.name.clone(), place.value.start));
            let text = source.text.get(place.value.range()).filter(|_| is_said)?;
            Some(text.trim_matches(['"', '\'']))
        });
        wrong.any(|text| !text.is_empty() && message.contains(&format!("`{text}`")))
    }

    /// Returns the first help text for a mistake with which the plugin would not refuse the same value
    /// again; `None` if there is none.
    fn accepted_help(
        &self,
        entry: &AgentEntry,
        stage: &DryRun,
        path: &[String],
        explained: &ExplainedMistake,
    ) -> Option<String> {
        let mut path = path.to_vec();
        if let ConfigMistake::MissingKey(key) = &explained.kind {
            path.push(key.clone());
        }
        let is_refused = |help: &String| {
            let written = written_values(help, &path);
            written.into_iter().any(|(at, value)| {
                let mut config = Value::clone(&entry.config);
                if !put(&mut config, &at, value) {
                    return false;
                }
                let cured = AgentEntry { config: config.into(), ..entry.clone() };
                let Err(error) = stage.build(&cured) else { return false };
                let again = culprit(&cured, stage, (&error, &said(&error)), self.ecosystem);
                again.starts_with(&at)
            })
        };
        let mut helps = explained.help.iter().chain(&explained.other_helps);
        helps.find(|help| !is_refused(help)).cloned()
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
            let example = example(key, &path.join("."), entry, ecosystem);
            let example = example.and_then(|text| parsed(&text));
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

/// Returns the message of a plugin with a correction that fits if the table to write is there already:
/// `write objects.tray = { x = … }` would be a second one.
fn with_present_table(said: String, config: &Value) -> String {
    let parts = || {
        let (before, rest) = said.split_once("write ")?;
        let (table, rest) = rest.split_once(" = { ")?;
        let (setting, after) = rest.split_once(" }")?;
        let path: Vec<String> = table.split('.').map(str::to_owned).collect();
        at(config, &path)?.as_object()?;
        Some(format!("{before}write {setting} in {table}{after}"))
    };
    parts().unwrap_or(said)
}

/// Returns the values that a help text tells to write for the key at `path` or a table around it, each
/// with its path: `write after = "2s"` or `"2min"`. Returns nothing if it tells none.
fn written_values(help: &str, path: &[String]) -> Vec<(Vec<String>, Value)> {
    for length in (1..=path.len()).rev() {
        let written = format!("{} = ", path[length - 1]);
        let Some((_, text)) = help.split_once(&written) else { continue };
        let text = text.split(", without").next().unwrap_or(text);
        let values: Vec<Value> = match parsed(text) {
            Some(value) => vec![value],
            None => text.split(" or ").filter_map(|text| parsed(last_of(text, &written))).collect(),
        };
        return values.into_iter().map(|value| (path[..length].to_vec(), value)).collect();
    }
    Vec::new()
}

fn last_of<'t>(text: &'t str, written: &str) -> &'t str {
    text.rsplit_once(written).map_or(text, |(_, value)| value)
}

/// Writes a value at `path` in a `config`. Returns `false` if no table is around the path.
fn put(config: &mut Value, path: &[String], value: Value) -> bool {
    if let Some(place) = at_mut(config, path) {
        *place = value;
        return true;
    }
    let Some((key, tables)) = path.split_last() else { return false };
    let table = at_mut(config, tables).and_then(Value::as_object_mut);
    table.is_some_and(|table| table.insert(key.clone(), value).is_none())
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
