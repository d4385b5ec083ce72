//! The search for the value in an entry's `config` that causes a mistake.
//!
//! 1. A message that begins with the path of a value, such as `ros2.places.hall: …`, is believed.
//! 2. So is a message that quotes the text of one value.
//! 3. Otherwise values are left out, one after the other: without the cause, there is no mistake, or
//!    another one. A mistake that only says that the value is missing proves nothing.

use agent::BuildError;
use serde_json::Value;

use super::config_value::{at, at_mut, keys_called, part, parts, take, texts_within};
use super::examples::{example, parsed};
use crate::config::{AgentEntry, Ecosystem};
use crate::hosting::{DryRun, HostError};

/// Returns the path of the value in an entry's `config` that causes a mistake. The path is empty if
/// the mistake is that a key is missing. `said` is the message of the plugin.
pub(super) fn culprit(
    entry: &AgentEntry,
    stage: &DryRun,
    (error, said): (&HostError, &str),
    ecosystem: &Ecosystem,
) -> Vec<String> {
    let search = CulpritSearch {
        entry,
        stage,
        ecosystem,
        is_shape: matches!(error, HostError::Build(BuildError::Config { .. })),
        told: error.to_string(),
    };
    search.cause(said)
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
    fn cause(&self, said: &str) -> Vec<String> {
        let config: &Value = &self.entry.config;
        if self.is_shape {
            return self.below(Vec::new());
        }
        let is_of_it = |path: &Vec<String>| self.without(path).err().as_ref() != Some(&self.told);
        let quoted = quoted_value(said, config).filter(|path| is_of_it(path));
        if let Some(path) = named_path(said, config).filter(is_of_it) {
            return match quoted {
                // A template is filled with values that stand elsewhere.
                Some(quoted) if is_template(at(config, &path)) => quoted,
                _ => self.below(path),
            };
        }
        if let Some(quoted) = quoted {
            return quoted;
        }
        let found = self.below(Vec::new());
        match found.is_empty() {
            true => self.only_named().unwrap_or_default(),
            false => found,
        }
    }

    /// Returns the path of the only key of the `config` that the message names; `None` if it names
    /// none or several.
    fn only_named(&self) -> Option<Vec<String>> {
        let config: &Value = &self.entry.config;
        let words = self.told.split('`').skip(1).step_by(2);
        let mut found: Vec<_> = words.flat_map(|word| keys_called(config, word)).collect();
        found.dedup();
        match found.as_slice() {
            [only] => Some(only.clone()),
            _ => None,
        }
    }

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
        self.without(path)
            .is_err_and(|now| now != self.told && (self.is_shape || !self.is_demanded(key, &now)))
    }

    /// Whether the message `now`, about the entry without the key `key`, only says that the key is
    /// missing.
    fn is_demanded(&self, key: &str, now: &str) -> bool {
        now.contains(&format!("missing field `{key}`"))
            || (key.parse::<usize>().is_err() && has_word(now, key) && !has_word(&self.told, key))
    }

    fn is_cured_by_example(&self, path: &[String]) -> bool {
        let Some((key, tables)) = path.split_last() else { return false };
        let value = example(key, &tables.join("."), self.entry, self.ecosystem);
        let value = value.and_then(|it| parsed(&it));
        let mut config = Value::clone(&self.entry.config);
        match (at_mut(&mut config, path), value) {
            (Some(place), Some(value)) => *place = value,
            _ => return false,
        }
        self.built(config).is_ok()
    }
}

/// Returns the path with which a message begins, as far as the `config` has it: `actions.pick.facts: …`,
/// ``topics, `gripper`: type: …``, ``the preset `desk`: …``. Returns `None` if it begins otherwise.
fn named_path(said: &str, config: &Value) -> Option<Vec<String>> {
    if let Some((path, rest)) = path_of_article(said, config) {
        return Some(with_rest(path, rest, config));
    }
    let said = said.strip_prefix("config.").unwrap_or(said);
    let said = said.strip_prefix('`').unwrap_or(said);
    let is_of_path = |symbol: char| symbol.is_alphanumeric() || "-_.".contains(symbol);
    let end = said.find(|symbol| !is_of_path(symbol)).unwrap_or(said.len());
    let (named, rest) = said.split_at(end);
    let (mut path, mut value) = (Vec::new(), config);
    for key in named.split('.') {
        let Some(inner) = part(value, key) else { break };
        path.push(key.to_owned());
        value = inner;
    }
    if path.is_empty() {
        return None;
    }
    let table = rest.strip_prefix(", `").and_then(|rest| rest.split_once('`'));
    if let (Some((name, rest)), Some(list)) = (table, value.as_array()) {
        let number = list.iter().position(|table| table["name"] == name)?;
        path.push(number.to_string());
        return Some(with_rest(path, rest, config));
    }
    Some(with_rest(path, rest, config))
}

/// Returns the path `path`, and what the rest of the message names below it: `: type: …`.
fn with_rest(mut path: Vec<String>, rest: &str, config: &Value) -> Vec<String> {
    let within = at(config, &path);
    let rest = rest.strip_prefix(": ").filter(|rest| !rest.is_empty());
    if let (Some(within), Some(rest)) = (within, rest)
        && let Some(more) = named_path(rest, within)
    {
        path.extend(more);
    }
    path
}

/// Returns the path of what a message calls ``the preset `desk` `` or ``the type `png` ``, and the rest
/// of the message: an element of a table of such things, or a key with this value.
fn path_of_article<'m>(said: &'m str, config: &Value) -> Option<(Vec<String>, &'m str)> {
    let (word, rest) = said.strip_prefix("the ")?.split_once(" `")?;
    let (name, rest) = rest.split_once('`')?;
    if part(config, word).and_then(Value::as_str) == Some(name) {
        return Some((vec![word.to_owned()], rest));
    }
    let table = if word == "medium" { "media".to_owned() } else { format!("{word}s") };
    part(part(config, &table)?, name)?;
    Some((vec![table, name.to_owned()], rest))
}

/// Returns the path of the only text in a `config` that a message quotes; `None` if it quotes none or
/// several.
fn quoted_value(said: &str, config: &Value) -> Option<Vec<String>> {
    let is_quoted = |text: &str| {
        !text.is_empty()
            && [format!("`{text}`"), format!("\"{text}\"")].iter().any(|it| said.contains(it))
    };
    let mut found = texts_within(config).into_iter().filter(|(_, text)| is_quoted(text));
    let (path, _) = found.next()?;
    found.next().is_none().then_some(path)
}

/// Whether a value has a text with a placeholder in braces.
fn is_template(value: Option<&Value>) -> bool {
    value.is_some_and(|value| texts_within(value).iter().any(|(_, text)| text.contains('{')))
}

/// Whether a text has the word `word`, which may have hyphens.
fn has_word(text: &str, word: &str) -> bool {
    let is_part = |symbol: char| symbol.is_alphanumeric() || "-_".contains(symbol);
    !word.is_empty()
        && text.match_indices(word).any(|(at, _)| {
            !text[..at].ends_with(is_part) && !text[at + word.len()..].starts_with(is_part)
        })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_message_that_begins_with_a_path_names_its_value() {
        let config = json!({
            "presets": { "desk": { "shows": "hall", "position": [1, 2, 3] } },
            "topics": [{ "name": "a", "type": "x" }, { "name": "b", "type": "y" }],
            "ros2": { "places": { "hall": {} }, "tolerance": 1 },
            "media": { "clip": { "address": "http://x", "type": "png" } },
        });
        for (said, expected) in [
            ("the preset `desk`: write `preset` or `position`", "presets.desk"),
            ("the preset `door` is out of reach", ""),
            ("topics, `b`: type: `y` is another kind of name", "topics.1.type"),
            ("config.ros2.places lacks the pose of `hall`", "ros2.places"),
            ("config.ros2.places.hall: x is missing", "ros2.places.hall"),
            ("config.ros2.tolerance = 1 must be above zero", "ros2.tolerance"),
            ("media.clip: the type `png` is not one of video/…", "media.clip.type"),
            ("`topics` are at most 64", "topics"),
            ("a camera needs `topics`", ""),
        ] {
            let path = named_path(said, &config).unwrap_or_default();
            assert_eq!(path.join("."), expected, "{said}");
        }
    }

    #[test]
    fn a_quoted_text_names_its_value() {
        let config =
            json!({ "address": "10.0.0.9:0", "user": "a", "objects": { "t": ["b", "a"] } });
        let named = |said: &str| quoted_value(said, &config).unwrap_or_default().join(".");
        assert_eq!(named("`10.0.0.9:0`: its port is no number"), "address");
        assert_eq!(named("`x` is the text \"b\""), "objects.t.0");
        assert_eq!(named("`a` is twice there"), "");
    }

    #[test]
    fn a_word_is_no_part_of_another() {
        assert!(has_word("driver needs the `line`: write", "line"));
        assert!(!has_word("the outline-of it", "line"));
        assert!(!has_word("an in-line", "line"));
    }
}
