//! Explains the errors of plugins about their `config` in the terms of the ecosystem file.
//!
//! Plugins read their `config` with serde, which reports mistakes in Rust's terms: “invalid type:
//! string "0.3", expected f64”. Such a message is reworded as “`speed` must be a number, and is the
//! text "0.3"”, and a correction is added.

use pddl::nearest;
use serde_json::Value;
use terminal::form_error;

use crate::config::number_text;

/// Maximum number of keys that a help text lists; the others are only counted.
const LISTED_MAX: usize = 6;

/// Number of characters at the beginning of a name that suffice to identify it.
const PREFIX_MIN: usize = 4;

/// Keys of entries, each with other words that users write instead of the key.
const SYNONYMS: &[(&str, &[&str])] = &[
    ("location", &["room", "place", "where", "position", "in", "at"]),
    ("start", &["location", "room", "place", "where", "position", "at", "home"]),
    ("mounted-on", &["carrier", "robot", "on", "base", "mounted", "carried-by", "location"]),
    ("speed", &["velocity", "meters-per-second"]),
    ("quantity", &["kind", "type", "measures", "unit"]),
    ("presets", &["directions", "positions", "views"]),
    ("broker", &["host", "server", "url", "address"]),
    ("command", &["program", "run", "exec"]),
    ("device", &["path", "file"]),
];

/// Keys in a `config` that hold durations.
const DURATIONS: &[&str] = &[
    "after",
    "debounce",
    "every",
    "motion-for",
    "offline-after",
    "patience",
    "settle",
    "time-out",
    "valid-for",
    "within",
];

/// Key with a short duration, because contacts bounce for milliseconds.
const SHORT: &str = "debounce";

/// A mistake in a `config`, with its message and a correction.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ExplainedMistake {
    pub(super) kind: ConfigMistake,
    pub(super) message: String,
    pub(super) help: Option<String>,
    /// Further corrections, for a plugin that refuses the first one.
    pub(super) other_helps: Vec<String>,
}

// === impl ExplainedMistake ===

impl ExplainedMistake {
    fn new(
        kind: ConfigMistake,
        message: String,
        helps: impl IntoIterator<Item = String>,
    ) -> ExplainedMistake {
        let mut helps = helps.into_iter();
        ExplainedMistake { kind, message, help: helps.next(), other_helps: helps.collect() }
    }
}

/// The kind of a mistake in a `config`.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ConfigMistake {
    /// The `config` has an unknown key; the second text is the key that was probably meant.
    UnknownKey(String, Option<String>),
    /// The `config` lacks this required key.
    MissingKey(String),
    /// A value has another type than the plugin requires.
    Kind,
    /// The plugin reports any other mistake.
    Other,
}

/// Explains the message `said` of a plugin about the key at `path` and its value `value`. The path
/// is that within the `config`, such as `presets.door`, and empty for the whole `config`. `example`
/// returns an example of the value of a key.
pub(super) fn worded(
    said: &str,
    path: &str,
    value: Option<&Value>,
    example: impl Fn(&str) -> Option<String>,
) -> ExplainedMistake {
    match form_error::FormError::of(said) {
        Some(form_error::FormError::UnknownKey { key, known }) => {
            return unknown_key(key, &owned(&known), path);
        }
        Some(form_error::FormError::MissingKey(key)) => return missing_key(key, path, example),
        Some(form_error::FormError::UnknownWord { word, known }) => {
            return unknown_word(word, &owned(&known), path);
        }
        Some(form_error::FormError::Kind { got, wanted }) => {
            return wrong_kind(got, wanted, path, value, example);
        }
        Some(form_error::FormError::NoForm) => return of_no_form(path, example),
        None => (),
    }
    if let Some((key, text)) = duration_error(said, path, value) {
        let message = format!("`{key}` must be a duration, and is \"{text}\"");
        let help = "write a number and ms, s, min or h in quotes, such as \"30s\" or \"10min\"";
        return ExplainedMistake::new(ConfigMistake::Other, message, [help.to_owned()]);
    }
    let key = said.split_once("has no key `").and_then(|(_, rest)| rest.split('`').next());
    if let Some(key) = key {
        let whole = if ends_with(path, key) { path.to_owned() } else { join(path, key) };
        let help = beside(key).unwrap_or_else(|| format!("take `{key}` out"));
        let kind = ConfigMistake::UnknownKey(key.to_owned(), None);
        return ExplainedMistake::new(kind, format!("there is no key `{whole}`"), [help]);
    }
    if let Some(found) = of_another_driver(said, path) {
        return found;
    }
    let message = said.to_owned();
    ExplainedMistake::new(ConfigMistake::Other, message, positive(said, path, value))
}

/// Explains that a key is for another driver than that of the entry: ``KEY` is for `driver = "X"`…`.
fn of_another_driver(said: &str, path: &str) -> Option<ExplainedMistake> {
    let (key, rest) = said.strip_prefix('`')?.split_once("` is for `driver = \"")?;
    let (driver, _) = rest.split_once('"')?;
    let help = format!("leave `{key}` out, or write driver = \"{driver}\"");
    let kind = match ends_with(path, key) {
        true => ConfigMistake::UnknownKey(key.to_owned(), None),
        false => ConfigMistake::Other,
    };
    Some(ExplainedMistake::new(kind, said.to_owned(), [help]))
}

/// Returns how to write a number that must be above zero and is negative.
fn positive(said: &str, path: &str, value: Option<&Value>) -> Option<String> {
    let number = value?.as_f64().filter(|number| *number < 0.0)?;
    let key = path.rsplit('.').next()?;
    said.contains("above zero").then(|| format!("write {key} = {}", -number))
}

fn owned(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

fn unknown_key(key: &str, known: &[String], path: &str) -> ExplainedMistake {
    let meant = meant(key, known);
    // The path ends either with the key itself, or with the table that contains it.
    let whole = if ends_with(path, key) { path.to_owned() } else { join(path, key) };
    let help = match (&meant, known.len()) {
        (Some(meant), _) => format!("did you mean `{meant}`?"),
        (None, 0) => "it takes no keys: leave it out".to_owned(),
        (None, _) => beside(key).unwrap_or_else(|| listed(known)),
    };
    let kind = ConfigMistake::UnknownKey(key.to_owned(), meant);
    ExplainedMistake::new(kind, format!("there is no key `{whole}`"), [help])
}

/// Returns a help text for a key that was written in the `config`, but belongs to the entry itself.
fn beside(key: &str) -> Option<String> {
    let of_entry = ["name", "plugin", "package", "daemon", "driver", "actions"];
    of_entry.contains(&key).then(|| {
        format!("`{key}` stands beside `config`, and not in it: write it in a line of its own")
    })
}

fn missing_key(
    key: &str,
    path: &str,
    example: impl Fn(&str) -> Option<String>,
) -> ExplainedMistake {
    let within = match path {
        "" => String::new(),
        path => format!(" in `{path}`"),
    };
    let shown = example(key).map(|example| format!("write {key} = {example}"));
    let helps = shown.into_iter().chain([format!("write {key} = …")]);
    let kind = ConfigMistake::MissingKey(key.to_owned());
    ExplainedMistake::new(kind, format!("`{key}` is missing{within}"), helps)
}

fn unknown_word(word: &str, known: &[String], path: &str) -> ExplainedMistake {
    let meant = meant(word, known);
    let known: Vec<String> = known.iter().map(|word| format!("\"{word}\"")).collect();
    let message = format!("`{path}` cannot be \"{word}\"");
    let help = match meant {
        Some(meant) => format!("did you mean \"{meant}\"?"),
        None => format!("write {}", either(&known)),
    };
    ExplainedMistake::new(ConfigMistake::Kind, message, [help])
}

fn wrong_kind(
    got: &str,
    wanted: &str,
    path: &str,
    value: Option<&Value>,
    example: impl Fn(&str) -> Option<String>,
) -> ExplainedMistake {
    let (wanted_words, got_words) = match (list_length(wanted), value) {
        (Some(wanted), Some(Value::Array(list))) if got.parse::<usize>().is_ok() => {
            (format!("a list of {wanted}").into(), format!("one of {}", list.len()))
        }
        // TOML has no other value that is nothing in JSON.
        _ if ["null", "unit value"].contains(&got) => {
            (form_error::kind(wanted), "nan or inf".to_owned())
        }
        _ => (form_error::kind(wanted), form_error::got(got)),
    };
    let is_itself = value.is_none_or(|value| is_of(got, value));
    let subject = match (path, is_itself) {
        ("", _) => "`config`".to_owned(),
        (path, true) => format!("`{path}`"),
        (path, false) => format!("what stands in `{path}`"),
    };
    let key = path.rsplit('.').next().unwrap_or(path);
    let text = value.filter(|_| is_itself);
    let mut helps = text.map(|value| cures(key, wanted, value)).unwrap_or_default();
    let own = example(key).filter(|_| is_itself);
    helps.extend(own.map(|example| format!("write {key} = {example}")));
    let within = path.split('.').next().filter(|table| *table != path);
    let around = within.and_then(|table| Some((table, example(table)?)));
    helps.extend(around.map(|(table, example)| format!("such as {table} = {example}")));
    let message = format!("{subject} must be {wanted_words}, and is {got_words}");
    ExplainedMistake::new(ConfigMistake::Kind, message, helps)
}

/// Returns the number of elements of the list that serde wants: `an array of length 3`.
fn list_length(wanted: &str) -> Option<usize> {
    let of_tuple = || wanted.strip_prefix("a tuple of size ");
    wanted.strip_prefix("an array of length ").or_else(of_tuple)?.parse().ok()
}

fn of_no_form(path: &str, example: impl Fn(&str) -> Option<String>) -> ExplainedMistake {
    let key = path.split('.').next().unwrap_or(path);
    let message = format!("`{path}` has none of the forms that it may have");
    let help = example(key).map(|example| format!("such as {key} = {example}"));
    ExplainedMistake::new(ConfigMistake::Kind, message, help)
}

/// Returns `path`, the path of the key, and the text of its value, if the error message `said` of
/// the plugin means that the value could not be parsed as a duration.
fn duration_error(said: &str, path: &str, value: Option<&Value>) -> Option<(String, String)> {
    let told = [
        "expected number at ",
        "invalid character at ",
        "time unit needed",
        "unknown time unit",
        "number is too large",
        "value was empty",
    ];
    told.iter().any(|words| said.contains(words)).then_some(())?;
    let text = value?.as_str()?;
    Some((path.to_owned(), text.to_owned()))
}

/// Returns the word of `known` that was probably meant by `word`.
pub(super) fn meant(word: &str, known: &[String]) -> Option<String> {
    let is_known = |key: &&str| known.iter().any(|known| known == key);
    if let Some(near) = nearest(word, known.iter().map(String::as_str)) {
        return Some(near.to_owned());
    }
    // Differences in case, hyphens and underscores are ignored: `valid_for` and `validFor` mean
    // `valid-for`.
    let plain = |word: &str| word.replace(['-', '_'], "").to_lowercase();
    if let Some(same) = known.iter().find(|known| plain(known) == plain(word)) {
        return Some(same.clone());
    }
    let lower = word.to_lowercase();
    let begins = known.iter().filter(|known| {
        let (long, short) =
            if known.len() > lower.len() { (*known, &lower) } else { (&lower, *known) };
        short.len() >= PREFIX_MIN && long.starts_with(short.as_str())
    });
    if let [only] = begins.collect::<Vec<_>>()[..] {
        return Some(only.clone());
    }
    let synonyms = SYNONYMS.iter().filter(|(_, words)| words.contains(&lower.as_str()));
    synonyms.map(|(key, _)| *key).find(is_known).map(str::to_owned)
}

fn listed(known: &[String]) -> String {
    let shown: Vec<_> = known.iter().take(LISTED_MAX).map(|key| format!("`{key}`")).collect();
    match known.len().saturating_sub(LISTED_MAX) {
        0 => format!("known are {}", shown.join(", ")),
        more => format!("known are {}, and {more} more", shown.join(", ")),
    }
}

fn either(words: &[String]) -> String {
    match words {
        [] => "another word".to_owned(),
        [only] => only.clone(),
        [first @ .., last] => format!("{} or {last}", first.join(", ")),
    }
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

fn ends_with(path: &str, key: &str) -> bool {
    path.rsplit('.').next() == Some(key)
}

/// Whether serde's description `got` refers to `value` itself, and not to something within it.
fn is_of(got: &str, value: &Value) -> bool {
    match value {
        Value::String(_) => got.starts_with("string "),
        Value::Number(_) => got.starts_with("integer ") || got.starts_with("floating point "),
        Value::Bool(_) => got.starts_with("boolean "),
        Value::Array(_) => got == "sequence" || got.starts_with(|c: char| c.is_ascii_digit()),
        Value::Object(_) => got == "map",
        Value::Null => true,
    }
}

/// Returns help texts with the correct form, for a value of a wrong type, the most probable one first.
fn cures(key: &str, wanted: &str, value: &Value) -> Vec<String> {
    let is_whole = wanted.len() <= 5 && wanted.starts_with(['u', 'i']);
    let help = match (wanted, value) {
        ("f32" | "f64", Value::String(text)) => number_text::correction(key, text, false),
        (_, Value::String(text)) if is_whole => number_text::correction(key, text, true),
        ("a boolean", Value::String(text)) => {
            let truth = match text.to_lowercase().as_str() {
                "yes" | "on" | "true" | "ja" | "1" => Some(true),
                "no" | "off" | "false" | "nein" | "0" => Some(false),
                _ => None,
            };
            Some(match truth {
                Some(truth) => format!("write {key} = {truth}, without quotes"),
                None => format!("write {key} = true or {key} = false, without quotes"),
            })
        }
        ("a boolean", Value::Number(number)) => Some(match number.as_i64() {
            Some(0) => format!("write {key} = false"),
            Some(1) => format!("write {key} = true"),
            _ => format!("write {key} = true or {key} = false"),
        }),
        ("a string", Value::Number(number)) if DURATIONS.contains(&key) => {
            return durations(key, &number.to_string());
        }
        ("a string" | "path string", Value::Number(number)) => {
            return number_text::quoted_forms(key, &number.to_string());
        }
        ("a string" | "path string", Value::Bool(_)) => Some(format!("write {key} = \"{value}\"")),
        ("a string" | "path string", Value::Array(list)) => Some(match &list[..] {
            [Value::String(only)] => format!("write {key} = \"{only}\", without [ ]"),
            _ => "write one text, without [ ]".to_owned(),
        }),
        ("a sequence", Value::String(text)) => {
            let words: Vec<_> = match key {
                // These keys hold commands, which are run without a shell.
                "command" | "run" | "on" | "off" | "state" => text.split_whitespace().collect(),
                _ => vec![text.as_str()],
            };
            let words: Vec<_> = words.into_iter().map(|word| format!("\"{word}\"")).collect();
            Some(format!("write {key} = [{}]", words.join(", ")))
        }
        _ => None,
    };
    help.into_iter().collect()
}

/// Returns help texts for a duration that is a number without a unit.
fn durations(key: &str, number: &str) -> Vec<String> {
    let write = |value: &str| format!("write a unit too, in quotes: {key} = {value}");
    let one = |unit: &&str| write(&format!("\"{number}{unit}\""));
    let both = write(&format!("\"{number}s\" or \"{number}min\""));
    match key {
        SHORT => ["ms", "s"].iter().map(one).collect(),
        _ => [both].into_iter().chain(["s", "min", "h", "ms"].iter().map(one)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn example(key: &str) -> Option<String> {
        (key == "start").then(|| "\"hall\"".to_owned())
    }

    #[track_caller]
    fn check(said: &str, path: &str, value: Value, message: &str, help: &str) {
        let worded = worded(said, path, Some(&value), example);
        assert_eq!(worded.message, message);
        assert_eq!(worded.help.as_deref().unwrap_or_default(), help);
    }

    #[test]
    fn kinds_of_values_are_those_of_the_file() {
        let text = |text: &str| format!("invalid type: string \"{text}\", expected f64");
        check(
            &text("0.3"),
            "speed",
            json!("0.3"),
            "`speed` must be a number, and is the text \"0.3\"",
            "write speed = 0.3, without quotes",
        );
        check(
            &text("21 C"),
            "limit",
            json!("21 C"),
            "`limit` must be a number, and is the text \"21 C\"",
            "write limit as a number alone, without `C`, in the unit of the key",
        );
        check(
            &text("1,5m"),
            "speed",
            json!("1,5m"),
            "`speed` must be a number, and is the text \"1,5m\"",
            "write the number of meters: speed = 1.5",
        );
        check(
            "invalid type: string \"yes\", expected a boolean",
            "humidity",
            json!("yes"),
            "`humidity` must be true or false, and is the text \"yes\"",
            "write humidity = true, without quotes",
        );
        check(
            "invalid type: integer `101`, expected a string",
            "location",
            json!(101),
            "`location` must be a text in quotes, and is 101",
            "write location = \"101\"",
        );
        check(
            "invalid type: string \"cat /tmp/t\", expected a sequence",
            "command",
            json!("cat /tmp/t"),
            "`command` must be a list in [ ], and is the text \"cat /tmp/t\"",
            "write command = [\"cat\", \"/tmp/t\"]",
        );
        check(
            "invalid value: integer `-3`, expected u8",
            "port",
            json!(-3),
            "`port` must be a whole number from 0 to 255, and is -3",
            "",
        );
        check(
            "invalid type: integer `3`, expected a string",
            "command",
            json!(["echo", 3]),
            "what stands in `command` must be a text in quotes, and is 3",
            "",
        );
    }

    #[test]
    fn lists_have_lengths_and_numbers_are_finite() {
        check(
            "invalid length 2, expected an array of length 3",
            "presets.desk.position",
            json!([1.0, 2.0]),
            "`presets.desk.position` must be a list of 3, and is one of 2",
            "",
        );
        check(
            "invalid type: null, expected f64",
            "x",
            json!(null),
            "`x` must be a number, and is nan or inf",
            "",
        );
    }

    #[test]
    fn keys_are_those_of_the_file() {
        let many = "unknown field `lokation`, expected one of `location`, `a`, `b`, `c`, `d`, `e`, \
                    `f`, `g`";
        let help = "did you mean `location`?";
        check(many, "lokation", json!("x"), "there is no key `lokation`", help);
        check(
            &many.replace("lokation", "zzz"),
            "zzz",
            json!("x"),
            "there is no key `zzz`",
            "known are `location`, `a`, `b`, `c`, `d`, `e`, and 2 more",
        );
        let room = many.replace("lokation", "room");
        check(&room, "room", json!("x"), "there is no key `room`", help);
        let driver = many.replace("lokation", "driver");
        let help = "`driver` stands beside `config`, and not in it: write it in a line of its own";
        check(&driver, "driver", json!("x"), "there is no key `driver`", help);
        let missing = "missing field `start`";
        check(missing, "", json!({}), "`start` is missing", "write start = \"hall\"");
        let missing = "missing field `shows`";
        let message = "`shows` is missing in `presets.door`";
        check(missing, "presets.door", json!({}), message, "write shows = …");
    }

    #[test]
    fn words_and_durations() {
        check(
            "unknown variant `lmp`, expected one of `lamp`, `relay`, `lock`",
            "kind",
            json!("lmp"),
            "`kind` cannot be \"lmp\"",
            "did you mean \"lamp\"?",
        );
        check(
            "`soon`: expected number at 0",
            "login.patience",
            json!("soon"),
            "`login.patience` must be a duration, and is \"soon\"",
            "write a number and ms, s, min or h in quotes, such as \"30s\" or \"10min\"",
        );
        let number = "invalid type: integer `2`, expected a string";
        let unit = "write a unit too, in quotes: ";
        let message = "`after` must be a text in quotes, and is 2";
        check(number, "after", json!(2), message, &format!("{unit}after = \"2s\" or \"2min\""));
        let message = "`debounce` must be a text in quotes, and is 2";
        check(number, "debounce", json!(2), message, &format!("{unit}debounce = \"2ms\""));
        let own = "speed = -0.3 must be above zero";
        check(own, "speed", json!(-0.3), own, "write speed = 0.3");
    }
}
