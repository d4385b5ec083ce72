//! Reads TOML against the schema: each value that matches becomes part of a [`Layer`], each other
//! value a diagnostic.
//!
//! Reading continues after every mistake, so that all mistakes are reported at once. Whether names
//! refer to something, and whether the values are consistent with each other, is checked in
//! `interpret`.

use std::sync::Arc;

use ::config::{Map, Value, ValueKind};
use pddl::{Diagnostic, Span, nearest};
use terminal::report::SourceText;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::duration;
use super::layer::{KeyValueSpan, Layer};
use super::number_text;
use super::schema::{self, SchemaKey, Shape};
use super::syntax::{self, TomlError};

/// Walks through the syntax tree of a TOML text, and collects values, places and mistakes.
pub(super) struct TomlReader {
    pub(super) layer: Layer,
    pub(super) diagnostics: Vec<Diagnostic>,
    /// Offset in the whole source text at which the text of the syntax tree begins.
    pub(super) base: usize,
}

/// Reads a whole ecosystem file. Returns its values, and diagnostics about its mistakes.
pub(super) fn read(source: &Arc<SourceText>) -> (Layer, Vec<Diagnostic>) {
    let mut reader = TomlReader::new(Arc::clone(source));
    let (tree, errors) = DeTable::parse_recoverable(&source.text);
    let failure = |err: &toml::de::Error| TomlError {
        message: err.message().to_owned(),
        range: err.span().unwrap_or(0..0),
    };
    let failures: Vec<_> = errors.iter().map(failure).collect();
    reader.diagnostics.extend(syntax::mistakes(&source.text, &failures));
    let keys = match &schema::FILE {
        Shape::Table(keys) => *keys,
        _ => &[],
    };
    reader.layer.is_whole = errors.is_empty();
    reader.layer.values = reader.table("", keys, tree.get_ref());
    reader.diagnostics.sort_by_key(|found| (found.span.start, found.span.end));
    (reader.layer, reader.diagnostics)
}

// === impl TomlReader ===

impl TomlReader {
    pub(super) fn new(source: Arc<SourceText>) -> TomlReader {
        TomlReader { layer: Layer::new(source), diagnostics: Vec::new(), base: 0 }
    }

    fn table(&mut self, path: &str, keys: &[SchemaKey], table: &DeTable<'_>) -> Map<String, Value> {
        let mut values = Map::new();
        for (written, value) in table {
            let name = written.get_ref().as_ref();
            let place = self.place(written.span(), value.span());
            let inner = join(path, name);
            self.layer.places.insert(inner.clone(), place);
            let Some(key) = keys.iter().find(|key| key.name == name) else {
                let found = unknown_key((path, table), keys, name, value.get_ref(), place.key);
                self.diagnostics.push(found);
                continue;
            };
            let path = inner;
            let value = self.value(&path, &key.shape, key.about, value);
            values.extend(value.map(|value| (name.to_owned(), value)));
        }
        values
    }

    /// Returns a value if it has the shape `shape`; otherwise adds a diagnostic and returns `None`.
    pub(super) fn value(
        &mut self,
        path: &str,
        shape: &Shape,
        about: &str,
        value: &Spanned<DeValue<'_>>,
    ) -> Option<Value> {
        let wrong = match (shape, value.get_ref()) {
            (Shape::Text, DeValue::String(_)) => return Some(to_config_value(value.get_ref())),
            (Shape::Path, DeValue::String(path)) if !path.trim().is_empty() => {
                return Some(to_config_value(value.get_ref()));
            }
            (Shape::Free, DeValue::Table(table)) => {
                self.record_places(path, table);
                return Some(to_config_value(value.get_ref()));
            }
            (Shape::Any, given) => {
                self.remember_within(path, value);
                return Some(to_config_value(given));
            }
            (Shape::Table(keys), DeValue::Table(table)) => {
                return Some(table_value(self.table(path, keys, table)));
            }
            (Shape::Each(shape), DeValue::Table(table)) => {
                return Some(self.each(path, shape, about, table));
            }
            (Shape::List(shape), DeValue::Array(list)) => {
                return Some(self.list(path, shape, about, list));
            }
            (Shape::Brief(_, keys), DeValue::Table(table)) => {
                return Some(table_value(self.table(path, keys, table)));
            }
            (Shape::Brief(key, _), DeValue::String(_)) => {
                let place = self.place(0..0, value.span());
                self.layer.places.insert(join(path, key), place);
                let one = [((*key).to_owned(), to_config_value(value.get_ref()))];
                return Some(table_value(one.into_iter().collect()));
            }
            // A single text counts as a list with one element.
            (Shape::Texts, DeValue::String(_)) => {
                let place = self.place(0..0, value.span());
                self.layer.places.insert(join(path, "0"), place);
                let one = vec![to_config_value(value.get_ref())];
                return Some(Value::new(None, ValueKind::Array(one)));
            }
            (Shape::Texts, DeValue::Array(list)) => {
                return Some(self.list(path, &Shape::Text, about, list));
            }
            (_, value) => match scalar(shape, value) {
                Ok(value) => return Some(value),
                Err(wrong) => wrong,
            },
        };
        let span = self.place(0..0, value.span()).value;
        let wrong = wrong.or_else(|| type_correction(path, shape, value.get_ref()));
        self.diagnostics.push(wrong_value(path, about, shape, wrong, span));
        None
    }

    /// Records the places of all values in a table that is passed on unread, because some of them
    /// are checked later.
    fn record_places(&mut self, path: &str, table: &DeTable<'_>) {
        for (written, value) in table {
            let path = join(path, written.get_ref());
            self.remember_within(&path, value);
            let place = self.place(written.span(), value.span());
            self.layer.places.insert(path, place);
        }
    }

    fn remember_within(&mut self, path: &str, value: &Spanned<DeValue<'_>>) {
        match value.get_ref() {
            DeValue::Table(table) => self.record_places(path, table),
            DeValue::Array(list) => {
                for (index, element) in list.iter().enumerate() {
                    let path = join(path, &index.to_string());
                    self.remember_within(&path, element);
                    let place = self.place(element.span(), element.span());
                    self.layer.places.insert(path, place);
                }
            }
            _ => (),
        }
    }

    fn each(&mut self, path: &str, shape: &Shape, about: &str, table: &DeTable<'_>) -> Value {
        let mut values = Map::new();
        for (written, value) in table {
            let name = written.get_ref().as_ref();
            let path = join(path, name);
            let place = self.place(written.span(), value.span());
            self.layer.places.insert(path.clone(), place);
            let value = self.value(&path, shape, about, value);
            values.extend(value.map(|value| (name.to_owned(), value)));
        }
        table_value(values)
    }

    fn list(&mut self, path: &str, shape: &Shape, about: &str, list: &DeArray<'_>) -> Value {
        let mut values = Vec::new();
        for element in list {
            // Wrong elements are left out of the list, so they are not counted in the index either.
            let path = join(path, &values.len().to_string());
            let place = self.place(element.span(), element.span());
            self.layer.places.insert(path.clone(), place);
            values.extend(self.value(&path, shape, about, element));
        }
        Value::new(None, ValueKind::Array(values))
    }

    fn place(&self, key: std::ops::Range<usize>, value: std::ops::Range<usize>) -> KeyValueSpan {
        let span = |range: std::ops::Range<usize>| {
            Span::new(self.base + range.start, self.base + range.end)
        };
        KeyValueSpan { key: span(key), value: span(value) }
    }
}

/// Returns a value that is neither a table nor a list, if it has the shape `shape`. Otherwise
/// returns a help text as the error, or `None` if it is enough to report the wrong type.
fn scalar(shape: &Shape, value: &DeValue<'_>) -> Result<Value, Option<String>> {
    let ok = Ok(to_config_value(value));
    match (shape, value) {
        (Shape::Choice(words), DeValue::String(word)) => {
            if words.contains(&word.as_ref()) {
                return ok;
            }
            let nearest = nearest(word, words.iter().copied());
            Err(nearest.map(|word| format!("did you mean \"{word}\"?")))
        }
        (Shape::Duration, DeValue::String(text)) => match duration::parse(text) {
            Ok(_) => ok,
            Err(help) => Err(Some(help)),
        },
        (Shape::Flag, DeValue::Boolean(_)) => ok,
        (Shape::Duration, DeValue::Integer(_) | DeValue::Float(_)) => {
            Err(Some("a duration has a unit and stands in quotes, such as \"500ms\"".to_owned()))
        }
        (Shape::Count, DeValue::Integer(_)) => match to_config_value(value).kind {
            ValueKind::I64(1..) => ok,
            _ => Err(None),
        },
        (Shape::Number { min, max }, DeValue::Integer(_) | DeValue::Float(_)) => {
            match to_config_value(value).into_float() {
                Ok(number) if (*min..=*max).contains(&number) => ok,
                _ => Err(None),
            }
        }
        _ => Err(None),
    }
}

/// Returns a help text with the correct form, for a value of a wrong type.
fn type_correction(path: &str, shape: &Shape, value: &DeValue<'_>) -> Option<String> {
    let spoken = display_path(path);
    let key = spoken.rsplit('.').next().unwrap_or(&spoken);
    match (shape, value) {
        (Shape::List(Shape::Table(_)), DeValue::Table(_)) => Some(format!("write [[{key}]]")),
        (Shape::List(Shape::Text | Shape::Choice(_)), DeValue::String(text)) => {
            Some(format!("write {key} = [\"{text}\"]"))
        }
        (Shape::Text | Shape::Path | Shape::Texts, DeValue::Integer(_) | DeValue::Float(_)) => {
            Some(number_text::quoted(key, &toml_text(value)))
        }
        (Shape::Flag, DeValue::String(text)) if ["true", "false"].contains(&text.as_ref()) => {
            Some(format!("write {key} = {text}, without quotes"))
        }
        // `keep = true` means that a goal is to be kept.
        (Shape::Choice(words), DeValue::Boolean(true)) if words.contains(&"maintain") => {
            Some(format!("write {key} = \"maintain\""))
        }
        (Shape::Number { .. } | Shape::Count, DeValue::String(text)) => {
            number_text::correction(key, text, false)
        }
        _ => None,
    }
}

/// Converts any TOML value to a value of the `config` crate.
pub(super) fn to_config_value(value: &DeValue<'_>) -> Value {
    let kind = match value {
        DeValue::String(text) => ValueKind::String(text.to_string()),
        DeValue::Integer(number) => integer(number),
        DeValue::Float(number) => {
            // TOML allows underscores in numbers, Rust does not when parsing.
            ValueKind::Float(number.as_str().replace('_', "").parse().unwrap_or(f64::NAN))
        }
        DeValue::Boolean(truth) => ValueKind::Boolean(*truth),
        DeValue::Datetime(time) => ValueKind::String(time.to_string()),
        DeValue::Array(list) => ValueKind::Array(
            list.iter().map(|element| to_config_value(element.get_ref())).collect(),
        ),
        DeValue::Table(table) => {
            let values = table
                .iter()
                .map(|(key, value)| (key.get_ref().to_string(), to_config_value(value.get_ref())));
            ValueKind::Table(values.collect())
        }
    };
    Value::new(None, kind)
}

/// Converts a whole number of TOML; a number that does not fit into `i64` becomes the nearest
/// floating-point number.
fn integer(number: &toml::de::DeInteger<'_>) -> ValueKind {
    let digits = number.as_str().replace('_', "");
    match i64::from_str_radix(&digits, number.radix()) {
        Ok(number) => ValueKind::I64(number),
        Err(_) => ValueKind::Float(digits.parse().unwrap_or(f64::INFINITY)),
    }
}

fn table_value(values: Map<String, Value>) -> Value {
    Value::new(None, ValueKind::Table(values))
}

/// Joins a path and a key: `ecosystem` and `mode` make `ecosystem.mode`.
pub(super) fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Returns a path as users would write it, without indices: `agent.name` for `agent.3.name`.
pub(super) fn display_path(path: &str) -> String {
    let words = path.split('.').filter(|word| word.parse::<usize>().is_err());
    words.collect::<Vec<_>>().join(".")
}

fn unknown_key(
    (path, around): (&str, &DeTable<'_>),
    keys: &[SchemaKey],
    name: &str,
    value: &DeValue<'_>,
    span: Span,
) -> Diagnostic {
    let table = display_path(path);
    let within = match table.as_str() {
        "" => String::new(),
        table => format!(" in `{table}`"),
    };
    let written = |key: &SchemaKey| match (&key.shape, table.as_str()) {
        (Shape::List(Shape::Table(_)), "") => format!("[[{}]]", key.name),
        (_, "") => format!("[{}]", key.name),
        _ => key.name.to_owned(),
    };
    let near = nearest(name, keys.iter().map(|key| key.name)).or_else(|| synonym(name, keys));
    let near = near.and_then(|near| keys.iter().find(|key| key.name == near));
    let elsewhere = || {
        let tables = match &schema::FILE {
            Shape::Table(tables) => *tables,
            _ => &[],
        };
        let has_key = |key: &&SchemaKey| match &key.shape {
            Shape::Table(keys) => keys.iter().any(|key| key.name == name),
            _ => false,
        };
        let is_table = |key: &&SchemaKey| key.name == name && !table.is_empty();
        if let Some(table) = tables.iter().find(is_table) {
            let written = match &table.shape {
                Shape::List(Shape::Table(_)) => format!("[[{name}]]"),
                _ => format!("[{name}]"),
            };
            return Some(format!("write a table of its own, {written}, and each entry below it"));
        }
        tables.iter().find(has_key).map(|table| format!("`{name}` stands under [{}]", table.name))
    };
    let help = match near {
        Some(near) => format!("did you mean `{}`?", written(near)),
        None => elsewhere().unwrap_or_else(|| match table.as_str() {
            "agent" if is_of_config(name, value) => in_config(name, value),
            "agent" if matches!(value, DeValue::Table(_)) => format!(
                "an agent is an entry of its own: write [[agent]], and below it name = \"{name}\""
            ),
            "" if name == "config" => {
                "write [agent.config], below the [[agent]] that it is for".to_owned()
            }
            "agent" if around.contains_key("config") => {
                format!("if its plugin is to read it, move `{name}` into the entry's `config`")
            }
            "agent" => {
                let value = toml_text(value);
                format!("if its plugin is to read it, write config = {{ {name} = {value} }}")
            }
            _ => {
                let names: Vec<_> = keys.iter().map(written).collect();
                format!("known are {}", names.join(", "))
            }
        }),
    };
    Diagnostic::error(span, format!("unknown key `{name}`{within}")).with_help(help)
}

/// Tables of the `config` of agents, each with the table in which it stands there.
const CONFIG_TABLES: &[(&str, &str)] = &[
    ("battery", ""),
    ("lanes", ""),
    ("login", ""),
    ("media", ""),
    ("objects", ""),
    ("on-motion", ""),
    ("parcels", ""),
    ("patrol", ""),
    ("places", "ros2."),
    ("poses", ""),
    ("presets", ""),
    ("ros2", ""),
    ("settings", ""),
];

/// Whether a key of an entry is a table of its `config`: one that agents have, or a list of tables.
fn is_of_config(name: &str, value: &DeValue<'_>) -> bool {
    match value {
        DeValue::Table(table) => {
            !table.contains_key("plugin") && CONFIG_TABLES.iter().any(|(table, _)| *table == name)
        }
        DeValue::Array(list) => is_list_of_tables(list),
        _ => false,
    }
}

fn is_list_of_tables(list: &DeArray<'_>) -> bool {
    !list.is_empty() && list.iter().all(|element| matches!(element.get_ref(), DeValue::Table(_)))
}

/// Returns a help text for a table of a `config` that stands beside the `config`.
fn in_config(name: &str, value: &DeValue<'_>) -> String {
    let around = CONFIG_TABLES.iter().find(|(table, _)| *table == name);
    let path = format!("agent.config.{}{name}", around.map_or("", |(_, around)| around));
    match value {
        DeValue::Array(_) => format!("its plugin reads it: write [[{path}]]"),
        _ => format!("its plugin reads it: write [{path}]"),
    }
}

/// Other words that users write for a key.
const SYNONYMS: &[(&str, &[&str])] = &[
    ("goal", &["condition", "pddl", "formula", "text", "what", "want"]),
    ("plugin", &["type", "kind", "class", "module"]),
    ("name", &["id", "called", "title"]),
    ("daemon", &["host", "machine", "node", "computer"]),
    ("config", &["settings", "options", "parameters"]),
    ("priority", &["importance", "weight", "prio"]),
];

/// Returns the key of a table for which `name` is another word.
fn synonym(name: &str, keys: &[SchemaKey]) -> Option<&'static str> {
    let (meant, _) = SYNONYMS.iter().find(|(_, words)| words.contains(&name))?;
    keys.iter().any(|key| key.name == *meant).then_some(*meant)
}

/// Returns a short value as TOML text, as the user may have written it; `…` for any longer value.
fn toml_text(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) if text.len() <= 40 => format!("\"{text}\""),
        DeValue::Integer(number) => number.to_string(),
        DeValue::Float(number) => number.to_string(),
        DeValue::Boolean(truth) => truth.to_string(),
        _ => "…".to_owned(),
    }
}

fn wrong_value(
    path: &str,
    about: &str,
    shape: &Shape,
    help: Option<String>,
    span: Span,
) -> Diagnostic {
    let path = display_path(path);
    let key = path.rsplit('.').next().unwrap_or(&path);
    let message = format!("`{path}` must be {}", shape.expected());
    let mut found = Diagnostic::error(span, message)
        .with_rule(format!("{key} = {}  # {about}", shape.notation()));
    found.help = help;
    found
}
